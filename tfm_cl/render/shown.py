"""What people see of a picture and its layers: sRGB codes of 8 bits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import InputError, unknown_key
from tfm_cl.files.image_io import WriteOptions
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.false_colour import Name, coloured, range_from_zero, range_of
from tfm_cl.files.image_io.png import codes_shown
from tfm_cl.scene.layers import Holds, layer_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tfm_cl.files.image_io import Exposure

PICTURE = "beauty"
"""What the picture itself is called among its layers."""
MEANING = "the picture, with its background"
Codes = NDArray[np.uint8]


class Rendered(Protocol):
    """A picture and its layers, as `tfm_cl.render.result.RenderResult`."""

    @property
    def image(self) -> NDArray[np.float32]:
        """[H, W, 4]."""

    @property
    def aovs(self) -> Mapping[str, NDArray[np.float32]]:
        """[H, W] or [H, W, 3] by name."""

    @property
    def crop(self) -> tuple[int, int, int, int]:
        """Where it lies in the full frame."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A layer as it is shown."""

    pixels: Codes
    """[H, W, 3], sRGB."""
    exposure: float
    """Stops, of what is light."""
    range: tuple[float, float] | None = None
    """Numbers that the first and the last colour stand for; None where it has colours of its own."""
    colours: Name | None = None
    """Of `tfm_cl.files.image_io.false_colour.COLOURS`; None likewise."""


def shown_layer(
    result: Rendered,
    name: str,
    *,
    exposure: Exposure = 0.0,
    view: str = "standard",
    like: Shown | None = None,
) -> Shown:
    """Show the picture or one of its layers.

    Light is exposed and goes through the view, exactly as in a PNG; all other layers are as bright whatever
    these are. Numbers have the colours of ``viridis``, errors those of ``magma``; where there is nothing, or
    no error, they are black.

    Parameters
    ----------
    result
        What was rendered.
    name
        A layer's, or `PICTURE`.
    exposure
        Stops, or ``"auto"``: those that suit the picture, whichever layer is shown.
    view
        Of `tfm_cl.files.image_io.views.VIEWS`.
    like
        The same layer of another result: exposure and range are taken from it, so that the two compare.

    Raises
    ------
    InputError
        The result has no such layer.
    ImageError
        No such view, or an exposure that is none.
    """
    if name != PICTURE and name not in result.aovs:
        line = unknown_key(name, [PICTURE, *result.aovs]).replace("key", "layer", 1)
        raise InputError(f"{line}: this picture has no other layers")
    options = WriteOptions(exposure=exposure if like is None else like.exposure, view=view)
    if options.exposure == "auto":
        options = replace(options, exposure=automatic_exposure(result.image, view))
    stops = float(options.exposure)
    if name == PICTURE:
        return Shown(codes_shown(result.image, options, result.crop[:2]).astype(np.uint8), stops)
    layer, holds = result.aovs[name], layer_of(name).holds
    if holds == "light":
        return Shown(codes_shown(layer, options, result.crop[:2]).astype(np.uint8), stops)
    if holds in _PLAIN:
        return Shown(_PLAIN[holds](layer), stops)
    colours, choose = _SCALED[holds]
    ends = choose(layer) if like is None or like.range is None else like.range
    pixels = coloured(layer, ends, colours)
    pixels[layer == 0] = 0
    return Shown(pixels, stops, ends, colours)


def _share(layer: NDArray[np.float32]) -> Codes:
    return codes_shown(layer, WriteOptions(dither=False)).astype(np.uint8)


def _direction(layer: NDArray[np.float32]) -> Codes:
    codes = np.round(127.5 + 127.5 * np.clip(layer, -1, 1)).astype(np.uint8)
    codes[~layer.any(axis=-1)] = 0
    return codes


_PLAIN: dict[Holds, Callable[[NDArray[np.float32]], Codes]] = {"share": _share, "direction": _direction}
"""What has colours of its own."""
_SCALED: dict[Holds, tuple[Name, Callable[[NDArray[np.float32]], tuple[float, float]]]] = {
    "number": ("viridis", range_of),
    "error": ("magma", range_from_zero),
}
"""Colours, and how their range is chosen."""
