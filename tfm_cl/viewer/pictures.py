"""What a page shows as sRGB codes: a result's layers, maps, and two results beside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError, InputError
from tfm_cl.files.image_io.false_colour import SEEN, coloured, quantiles, range_around_zero
from tfm_cl.files.image_io.image import Picture
from tfm_cl.files.image_io.overlap import overlap
from tfm_cl.metrics import REC709, compare
from tfm_cl.render.shown import Shown, shown_layer
from tfm_cl.scene.layers import GROUPS, LAYERS, members
from tfm_cl.scene.lights.base import names_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tfm_cl.viewer.messages import Show
    from tfm_cl.viewer.renderer import LightMap, Result

Codes = NDArray[np.uint8]

WHITE = 255
"""The largest code."""
LARGEST_GAIN = 255.0
"""Of an error picture: the smallest difference of codes is then as large as can be."""

FIGURES = ("ssim", "psnr", "rmse")


def shown(result: Result, show: Show, like: Shown | None = None) -> Shown:
    """Show a layer of a result.

    Parameters
    ----------
    result
        What was rendered.
    show
        Which layer, and how; of a group, as ``lights``, the layer of its light.
    like
        The same of another result: exposure and range are taken from it.

    Returns
    -------
    Shown
        Its pixels, and the range that their colours stand for.

    Raises
    ------
    InputError
        The result has no such layer.
    """
    return shown_layer(result, _name(result, show), exposure=show.exposure, view=show.view, like=like)


def _name(result: Result, show: Show) -> str:
    """Name of a layer, or of a group's layer of a light."""
    if show.layer not in GROUPS or show.layer in LAYERS:
        return show.layer
    names = members(show.layer, {show.layer: names_of(result.scene.lights)})
    if not 0 <= show.light < len(names):
        raise InputError(f"layer '{show.layer}' of light {show.light}: the scene has {len(names)}, from 0")
    return names[show.light]


def seen_depth(aovs: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return how far away is what pixels show, [H, W], world units from the camera; 0 where they show none.

    Of media it is the opacity-weighted mean distance; where they let more than half of what is behind them
    through, it is the solid's, if there is one.

    Parameters
    ----------
    aovs
        Layers of a picture: ``depth``, ``transmittance`` and, with solids, ``solid_distance``.
    """
    depth, solid = aovs["depth"], aovs.get("solid_distance")
    if solid is None:
        return depth
    shows_solid = (solid > 0) & ((depth <= 0) | (aovs["transmittance"].mean(axis=-1) > 0.5))  # noqa: PLR2004 - half
    return np.where(shows_solid, solid, depth)


def error_picture(a: Codes, b: Codes) -> tuple[Codes, float]:
    """Show where a picture differs from another, in luma.

    Parameters
    ----------
    a, b
        [H, W, 3], sRGB; b is taken for right.

    Returns
    -------
    pixels
        [H, W, 3], sRGB: blue where a is too dark, orange where it is too bright, black where they are equal.
    gain
        By which the difference, 1 for white against black, is multiplied: the brightest colours are those of
        all but the largest 0.5 % of the differences. 1 where there are none.

    Raises
    ------
    ImageError
        Their sizes differ.
    """
    if a.shape != b.shape:
        (height, width), (other_height, other_width) = a.shape[:2], b.shape[:2]
        raise ImageError(
            f"{width}×{height} and {other_width}×{other_height} pixels cannot be compared; render both at "
            "the same size"
        )
    difference = (a.astype(np.float32) - b.astype(np.float32)) @ (REC709 / WHITE).astype(np.float32)
    highest = quantiles(np.abs(difference[difference != 0]), SEEN)
    gain = min(float(f"{1 / highest[0]:.2g}"), LARGEST_GAIN) if highest else 1.0
    return coloured(difference, (-1 / gain, 1 / gain), "signed"), gain


class Beside(NamedTuple):
    """Two pictures shown alike, and their difference."""

    a: Shown
    b: Shown
    error: Codes
    """[H, W, 3], sRGB: blue where A is too dark, orange where it is too bright."""
    gain: float
    """By which the difference is multiplied."""


def beside(a: Result, b: Result, show: Show) -> Beside:
    """Show a picture beside another: exposure and range of colours of both are those of A.

    Raises
    ------
    InputError
        One of them has no such layer.
    ImageError
        Sizes differ.
    """
    of_a = shown(a, show)
    of_b = shown(b, show, like=of_a)
    return Beside(of_a, of_b, *error_picture(of_a.pixels, of_b.pixels))


def figures(a: Result, b: Result) -> dict[str, float | None]:
    """Measure a picture against another that is taken for right.

    Parameters
    ----------
    a, b
        Of one size, or crops of one frame, of which the pixels that both have are compared.

    Returns
    -------
    dict
        ``ssim``, ``psnr`` (decibels) and ``rmse`` (of the reference's mean) over the pixels where B shows
        anything, or over all where it shows nothing; None for what is infinite, as the PSNR of equal ones.

    Raises
    ------
    InputError
        scikit-image is not installed.
    ImageError
        Pictures of different sizes, or that are not finite.
    """
    picture, other = (Picture(of.image, of.crop, (0, 0, *of.scene.camera.res)) for of in (a, b))
    common = overlap(picture, other, "the picture", "what it is compared with")
    found = compare(common.test, common.reference)
    measured = (found.lit or found).to_dict()
    return {name: measured[name] for name in FIGURES}


def shown_map(map: LightMap, coefficient: int) -> Shown:  # noqa: A002 - as scenes call it
    """Show a coefficient of a light's map, as the light sees the scene: v upwards.

    Numbers of one sign have the colours of ``viridis``; of both signs, blue is below 0 and orange above it.

    Raises
    ------
    InputError
        The map has no such coefficient.
    """
    numbers = map.coefficients
    if not 0 <= coefficient < numbers.shape[-1]:
        raise InputError(f"coefficient {coefficient}: the map has {numbers.shape[-1]}, counted from 0")
    seen = numbers[::-1, :, coefficient]
    if (seen < 0).any() and (seen > 0).any():
        ends = range_around_zero(seen)
        return Shown(coloured(seen, ends, "signed"), 0.0, ends, "signed")
    low, high = quantiles(seen, 1 - SEEN, SEEN)
    return Shown(coloured(seen, (low, high), "viridis"), 0.0, (low, high), "viridis")
