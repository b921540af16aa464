"""Images on surfaces, averaged over what a pixel sees of them.

A pixel's footprint on a surface is an ellipse, as wide as the ray's cone and longer the more it grazes. Along
its longer axis up to `TAPS` samples are taken, each from the two levels of the pyramid whose texels are as
wide as its shorter axis (Heckbert, "Survey of Texture Mapping", 1986; McCormack et al., "Feline", 1999).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tfm_cl.files.mipmap import Mipmap, Wrap

Floats = NDArray[np.float64]

TAPS = 8
"""Most samples along a footprint; longer ones are blurred across instead."""

FURTHEST = 2.0**52
"""Texels: beyond, float64 has no fractions, and at last no place among integers."""

FLATTEST = 1e-3
"""Cosine of the angle of incidence below which footprints get no longer."""


def footprints(normals: Floats, directions: Floats, widths: Floats) -> Floats:
    """Return the axes of pixels' footprints on surfaces, [N, 2, 3], world: across the ray, and along it.

    Parameters
    ----------
    normals, directions
        [N, 3], unit; of the surfaces, and of the rays.
    widths
        [N]: of the rays' cones where they meet them, world units.
    """
    across = np.cross(normals, directions)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    # Where the ray is at a right angle to the surface, any axis serves.
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    anywhere = np.cross(normals, least)
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    across = np.where(length > FLATTEST, across / np.maximum(length, FLATTEST), anywhere)
    cosine = np.maximum(np.abs(np.einsum("ij,ij->i", normals, directions)), FLATTEST)
    axes: Floats = np.stack([across, np.cross(normals, across) / cosine[:, None]], axis=1)
    return axes * widths[:, None, None]


def sampled(image: Mipmap, uv: Floats, axes: Floats) -> Floats:
    """Return the mean of an image over footprints, RGB [N, 3], linear.

    Parameters
    ----------
    uv
        [N, 2], their centres; v points upwards.
    axes
        [N, 2, 2], their axes, as differences of u and v.
    """
    height, width = image.levels[0].shape[1:]
    lengths = np.linalg.norm(axes * (width, height), axis=2)  # texels
    longer = lengths.argmax(axis=1)
    rows = np.arange(len(uv))
    long, short = lengths[rows, longer], lengths[rows, 1 - longer]
    taps = np.clip(np.ceil(long / np.maximum(short, 1)), 1, TAPS)
    level = np.log2(np.maximum(np.maximum(short, long / taps), 1))
    level = np.minimum(level, len(image.levels) - 1)
    along, mean = axes[rows, longer], np.zeros((3, len(uv)), np.float32)
    for tap in range(int(taps.max(initial=0))):
        part = np.flatnonzero(taps > tap)
        offset = (tap + 0.5) / taps[part] - 0.5
        found = _between_levels(image, uv[part] + offset[:, None] * along[part], level[part])
        mean[:, part] += found / taps[part].astype(np.float32)
    return mean.T.astype(np.float64)


def _between_levels(image: Mipmap, uv: Floats, level: Floats) -> NDArray[np.float32]:
    """Interpolate between the levels of the pyramid, [RGB, N]."""
    finer = np.floor(level).astype(np.intp)
    weight = (level - finer).astype(np.float32)
    found = np.zeros((3, len(uv)), np.float32)
    for number in np.unique(finer):
        part = np.flatnonzero(finer == number)
        found[:, part] = _bilinear(image.levels[number], image.wrap, uv[part])
        part = part[weight[part] > 0]
        if len(part):
            coarser = _bilinear(image.levels[number + 1], image.wrap, uv[part])
            found[:, part] += weight[part] * (coarser - found[:, part])
    return found


def _bilinear(texels: NDArray[np.float16], wraps: tuple[Wrap, Wrap], uv: Floats) -> NDArray[np.float32]:
    height, width = texels.shape[1:]
    x, y = np.clip([uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5], -FURTHEST, FURTHEST)
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, low = (x - left).astype(np.float32), (y - top).astype(np.float32)
    columns = [_wrapped(left + i, width, wraps[0]) for i in (0, 1)]
    rows = [_wrapped(top + i, height, wraps[1]) * width for i in (0, 1)]
    weights = (1 - low) * (1 - right), (1 - low) * right, low * (1 - right), low * right
    places = [row + column for row in rows for column in columns]
    # Plane by plane: gathers of single numbers are several times as fast as those of three.
    found = [
        sum(plane.take(place) * weight for place, weight in zip(places, weights, strict=True))
        for plane in texels.reshape(3, -1)
    ]
    return np.stack(found)


def _wrapped(index: NDArray[np.int64], count: int, wrap: Wrap) -> NDArray[np.int64]:
    """Return the texels that lie at indices beyond the image, too."""
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    if wrap == "repeat":
        return index % count
    index = index % (2 * count)
    return np.minimum(index, 2 * count - 1 - index)
