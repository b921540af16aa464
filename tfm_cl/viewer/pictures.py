"""What a page shows: a result's layers, errors and maps as sRGB codes, and these as files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError, InputError
from tfm_cl.files.image_io.false_colour import SEEN, coloured, quantiles, range_around_zero
from tfm_cl.files.image_io.inline import encoded
from tfm_cl.metrics import REC709
from tfm_cl.render.shown import Rendered, Shown, shown_layer
from tfm_cl.scene.layers import GROUPS, LAYERS, members
from tfm_cl.scene.lights.base import names_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tfm_cl.scene.scene import Scene
    from tfm_cl.viewer.messages import Show

Codes = NDArray[np.uint8]

WHITE = 255
"""The largest code."""
LARGEST_GAIN = 255.0
"""Of an error picture: the smallest difference of codes is then as large as can be."""

__all__ = ["encoded", "error_picture", "layer_picture", "map_picture", "seen_depth", "shown", "shown_map"]


class Result(Rendered, Protocol):
    """What was rendered: `tfm_cl.render.result.RenderResult`."""

    @property
    def scene(self) -> Scene:
        """Whose lights have layers."""


class Map(Protocol):
    """A light's map: `tfm_cl.maps.transmittance_map.TransmittanceMap`."""

    @property
    def coefficients(self) -> NDArray[np.float32]:
        """[y, x, n]."""


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


def layer_picture(result: Result, show: Show) -> Codes:
    """Return the pixels of `shown`, [H, W, 3]."""
    return shown(result, show).pixels


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


def map_picture(map: Map, coefficient: int) -> Codes:  # noqa: A002 - as scenes call it
    """Return the pixels of `shown_map`, [res, res, 3]."""
    return shown_map(map, coefficient).pixels


def shown_map(map: Map, coefficient: int) -> Shown:  # noqa: A002 - as scenes call it
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
