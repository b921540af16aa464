"""Rays, intervals of them, and where the steps of a march lie."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tfm_cl.plan.orders import Lattice

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Interval = tuple[Floats, Floats]

CHUNK = 1 << 13
"""Rays at a time: bounds the memory, and keeps the arrays in the cache."""
FAR = 1e30
"""Stands for infinity, world units: times an extinction of 0 it is still 0 (``kernels/fog.h``)."""


class Rays(NamedTuple):
    """Origins and unit directions ``[rays, 3]``, world space."""

    origins: Floats
    directions: Floats

    def at(self, distance: Floats) -> Floats:
        """Points ``[rays, 3]`` at distances ``[rays]``."""
        return self.origins + distance[:, None] * self.directions

    def part(self, which: slice | Integers) -> Rays:
        """Take some of the rays."""
        return Rays(self.origins[which], self.directions[which])


def interval(begin: Floats, end: Floats) -> Interval:
    """Begin no earlier than at 0; (0, 0) where nothing is left."""
    begin = np.maximum(begin, 0)
    hit = end > begin
    return np.where(hit, begin, 0), np.where(hit, end, 0)


def intersection(one: Interval, other: Interval) -> Interval:
    """Return what is in both."""
    return interval(np.maximum(one[0], other[0]), np.minimum(one[1], other[1]))


def hull(rays: int, intervals: Iterable[Interval]) -> Interval:
    """From where the first of the intervals begins to where the last one ends."""
    first, last = np.full(rays, np.inf), np.full(rays, -np.inf)
    for begin, end in intervals:
        met = end > begin
        first = np.minimum(first, np.where(met, begin, np.inf))
        last = np.maximum(last, np.where(met, end, -np.inf))
    return interval(first, last)


def overlap(inside: Interval, begin: Floats, end: Floats) -> Floats:
    """Length of [begin, end] inside an interval."""
    length: Floats = np.maximum(np.minimum(inside[1], end) - np.maximum(inside[0], begin), 0)
    return length


def box_interval(
    low: Floats, high: Floats, origins: Floats, directions: Floats, limit: Floats | float
) -> Interval:
    """Part of rays, up to ``limit``, between the corners ``[3]`` of a box along the axes."""
    along = directions != 0
    to_low = np.divide(low - origins, directions, out=np.full(origins.shape, -np.inf), where=along)
    to_high = np.divide(high - origins, directions, out=np.full(origins.shape, np.inf), where=along)
    passes = (along | ((origins >= low) & (origins <= high))).all(axis=-1)
    begin, end = np.minimum(to_low, to_high).max(axis=-1), np.maximum(to_low, to_high).min(axis=-1)
    return interval(begin, np.where(passes, np.minimum(end, limit), -np.inf))


def ball_interval(
    centre: Floats, radius: float, origins: Floats, directions: Floats, limit: Floats | float
) -> Interval:
    """Part of rays, up to ``limit``, inside a ball."""
    # From the ray's point nearest to the centre, where the terms do not cancel.
    middle = ((centre - origins) * directions).sum(axis=-1)
    passing = origins + middle[:, None] * directions - centre
    square = radius**2 - (passing * passing).sum(axis=-1)
    half = np.sqrt(np.maximum(square, 0))
    return interval(middle - half, np.where(square > 0, np.minimum(middle + half, limit), -np.inf))


def edges(
    begin: Floats, end: Floats, steps: int, w: Interval | None = None, max_stretch: float = 1.0
) -> tuple[Floats, Floats]:
    """Step boundaries ``[rays, steps + 1]`` and sample distances ``[rays, steps]``; see `warped`."""
    w = w and (w[0][:, None], w[1][:, None])
    ends = begin[:, None], end[:, None]
    return (
        warped(*ends, np.arange(steps + 1) / steps, w, max_stretch),
        warped(*ends, (np.arange(steps) + 0.5) / steps, w, max_stretch),
    )


def warped(
    begin: Floats, end: Floats, part: Floats, w: Interval | None = None, max_stretch: float = 1.0
) -> Floats:
    """Return the distance at which a ``part`` of an interval's steps is done.

    Uniform in the projective space of a light with depths ``w`` ≥ 0 along its axis at the two ends (TFM
    section 4.2); uniform in the world without, or when the two are equal. Both are first raised to the
    larger one / ``max_stretch``, so that no step is longer than ``max_stretch`` mean ones; where neither
    is > 0 (both ends at the light) the steps are uniform in the world.
    """
    w_begin, w_end = w or (np.ones_like(begin), np.ones_like(begin))
    least = np.maximum(w_begin, w_end) / max_stretch
    w_begin, w_end = (np.where(least > 0, np.maximum(depth, least), 1) for depth in (w_begin, w_end))
    return begin + (end - begin) * (part * w_begin / (part * w_begin + (1 - part) * w_end))


def corners(size: int, positions: Floats) -> list[tuple[Integers, Integers, Floats]]:
    """Columns, rows and weights ``[points, 1]`` of the four texels around positions ``[points, 2]``.

    Positions are in [0, 1]² of a square of ``size`` × ``size`` texels; beyond the outermost centres it goes
    on as it is there.
    """
    at = np.clip(positions * size - 0.5, 0, size - 1)
    low = np.floor(at).astype(np.intp)
    (x0, y0), (x1, y1), (x, y) = low.T, np.minimum(low + 1, size - 1).T, (at - low).T[:, :, None]
    return [
        (x0, y0, (1 - x) * (1 - y)),
        (x1, y0, x * (1 - y)),
        (x0, y1, (1 - x) * y),
        (x1, y1, x * y),
    ]


def between(values: Floats, lattice: Lattice, points: Floats) -> Floats:
    """Interpolate ``[x, y, z, RGB]`` at world points ``[n, 3]``."""
    at = np.clip((points - lattice.origin) / lattice.spacing, 0, np.subtract(lattice.size, 1))
    low = np.minimum(at.astype(np.intp), np.subtract(lattice.size, 2))
    part = at - low
    total = np.zeros(points.shape)
    for corner in product((0, 1), repeat=3):
        weight = np.where(corner, part, 1 - part).prod(axis=-1)
        total += weight[:, None] * values[tuple((low + corner).T)]
    return total
