"""Comparing pictures wherever they are: results, files and arrays, crops and layers."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tfm_cl import metrics
from tfm_cl.errors import ImageError, TfmWarning, unknown_key
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import Picture
from tfm_cl.files.image_io.overlap import Overlap, overlap

if TYPE_CHECKING:
    from tfm_cl.metrics import Comparison
    from tfm_cl.render.result import RenderResult

ALPHA = 3
"""Number of that channel."""


def compare(
    test: ArrayLike | RenderResult | str | Path,
    reference: ArrayLike | RenderResult | str | Path,
    *,
    layer: str | None = None,
) -> Comparison:
    """Measure a picture against another.

    Of crops, which results and EXR files place in the full frame, the pixels that both have are compared.

    Parameters
    ----------
    test, reference
        What `Renderer.render` returns, the name of a file (``.exr .png .npy``), or a scene-linear,
        premultiplied array [H, W, 3 or 4] of floating-point type. Only the reference's alpha is used, so only
        one of the two may have one; without it, lit means luminance > 0.
    layer
        Compare this layer, as ``"ambient"`` or ``"light.key"``, of results and EXR files, in place of the
        picture; lit is what the picture's alpha says. A layer of one channel counts as grey.

    Raises
    ------
    ImageError
        A file that cannot be read, or has no such layer; arrays that are no such images, are empty, or hold
        NaN or infinity; sizes or full frames that differ; crops without a common pixel.

    Warns
    -----
    TfmWarning
        Not all pixels of both are compared, or one does not say where they lie.
    """
    common = in_common(test, reference, layer)
    if common.note:
        warnings.warn(common.note, TfmWarning, stacklevel=2)
    return metrics.compare(common.test, common.reference)


def in_common(
    test: ArrayLike | RenderResult | str | Path,
    reference: ArrayLike | RenderResult | str | Path,
    layer: str | None = None,
) -> Overlap:
    """Return the pixels that `compare` compares; errors as there."""
    pictures = _picture(test, layer, "test image"), _picture(reference, layer, "reference image")
    return overlap(*pictures, _name(test, "test image"), _name(reference, "reference image"))


def _name(given: object, what: str) -> str:
    return str(given) if isinstance(given, str | Path) else f"the {what}"


def _picture(given: ArrayLike | RenderResult | str | Path, layer: str | None, what: str) -> Picture:
    if isinstance(given, str | Path):
        return image_io.load_picture(given, layer)
    if not hasattr(given, "aovs"):
        if layer is not None:
            raise ImageError(f"the {what}: an array has no layer '{layer}'; give a result or an EXR file")
        return Picture(np.asarray(given))
    result: RenderResult = given  # type: ignore[assignment]  # it has layers
    pixels = result.image
    if layer is not None:
        if layer not in result.aovs:
            raise ImageError(f"the {what}: " + unknown_key(layer, list(result.aovs)).replace("key", "layer"))
        pixels = image_io.with_alpha(result.aovs[layer], pixels[..., ALPHA])
    return Picture(pixels, result.crop, (0, 0, *result.scene.camera.res))
