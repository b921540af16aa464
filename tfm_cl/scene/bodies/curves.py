"""Curves: strands of hair or fur, as polylines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import BEND_UNIT
from tfm_cl.errors import VolumeError
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.scene.bodies.primitives import colours_of, numbers_of, positions_of, velocities_of
from tfm_cl.scene.bodies.thin import ThinPrimitives, depths_of, each_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]

MEAN_SINE = np.pi / 4
"""Of the angle between a strand and rays of all directions: how much of its length is seen."""
TURNS_BACK = 1e-6
"""Sum of two segments' directions below which the strand turns back: tangents there are these directions."""


class Curves(ThinPrimitives):
    """Strands: each a polyline of ribbons that face every ray, of one opacity across their width.

    A strand that is narrower than a texel or a pixel covers a part of it. What it scatters depends on its
    tangent, which turns along each segment: at a point it is halfway between the directions of the segments
    that meet there. A point that is given twice is a corner.

    Parameters
    ----------
    points
        [n, 3], world, one strand after the other.
    counts
        [strands]: points of each, 2 or more; their sum is n.
    width
        World units, from edge to edge: one number, one for each point, [n], or for each strand.
    density
        Extinction inside a strand at sigma_t = 1: a crossing has the optical depth density * width. One
        number, or one for each point or strand.
    opacity
        Instead: the part of the light that one crossing takes at sigma_t = 1, from 0 to 1; likewise. 1 where
        neither is given.
    colour
        RGB, one for all, for each point, [n, 3], or for each strand: extinction relative to the density, of
        scattering and absorption alike; None: 1.
    velocity
        [n, 3], of the points, world units per second, or None: they move, for motion blur.
    medium
        What these strands alone are made of; None: the scene's medium.
    source
        The file they came from, if any.

    Raises
    ------
    VolumeError
        Arrays of other shapes, numbers that are not finite or out of range, or both density and opacity.

    Attributes
    ----------
    corners
        float64 [segments, 2, 3]: where each begins and ends, world.
    widths
        float64 [segments, 2]: there.
    goes_on
        bool [segments]: whether each begins where the one before it ends, on the same strand.
    """

    HEADER: ClassVar[str] = "primitive/segment.h"

    def __init__(
        self,
        points: ArrayLike,
        counts: ArrayLike,
        width: ArrayLike,
        density: ArrayLike | None = None,
        *,
        opacity: ArrayLike | None = None,
        colour: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        medium: Medium | None = None,
        source: Path | None = None,
    ) -> None:
        self.source, self.chosen = source, {}
        label = self.label
        places = positions_of(points, "points", label)
        strand = _strands(counts, len(places), label)
        if density is not None and opacity is not None:
            raise VolumeError(f"{label}: both density and opacity are given; keep one")
        first = np.flatnonzero(strand[1:] == strand[:-1])
        segments = np.stack([first, first + 1], axis=1)
        count = len(places)
        self.widths = numbers_of(each_of(width, strand), count, "width", label, most=LARGEST_COORDINATE)[
            segments
        ]
        if density is not None:
            depths = numbers_of(each_of(density, strand), count, "density", label)[segments] * self.widths
        else:
            depths = depths_of(each_of(1.0 if opacity is None else opacity, strand), count, label)[segments]
        shades = colours_of(None if colour is None else _rows_of(colour, strand), count, label)
        rgb = None if shades is None else shades[segments].mean(axis=1)
        self.goes_on = np.diff(first, prepend=-2) == 1
        self._fill(places[segments], depths.mean(axis=1), rgb, medium)
        speeds = velocities_of(velocity, count, label)
        self.velocity = None if speeds is None else speeds[segments]

    def _fill(
        self, corners: Floats, depths: Floats, colour: NDArray[np.float32] | None, medium: Medium | None
    ) -> None:
        """Keep segments that have been checked; widths are there."""
        super()._fill(corners, depths, colour, medium)
        self.lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        self.radii = self.radii + self.widths.max(axis=1) / 2

    @property
    def detail(self) -> float:
        """World units: twice the width of a strand, if that is seen."""
        return max(2 * float(np.median(self.widths)), self.least_detail)

    @property
    def thickness(self) -> float:
        """As `ThinPrimitives.thickness`: the largest width."""
        return float(self.widths.max())

    @property
    def narrowest(self) -> float:
        """As `Primitives.narrowest`: half a width."""
        return float(self.widths.min()) / 2

    @property
    def masses(self) -> Floats:
        """As `Primitives.masses`: what rays of all directions meet."""
        masses: Floats = MEAN_SINE * self.lengths * self.widths.mean(axis=1) * self.densities
        return masses

    def fill_sources(self, structs: NDArray[Any], origin: Floats) -> None:
        """As `Primitives.fill_sources`."""
        structs["a"], structs["b"] = self.corners[:, 0] - origin, self.corners[:, 1] - origin
        structs["radius"], structs["amount"] = self.widths / 2, self.densities
        structs["c"] = self._bends().view(np.float32)

    def _bends(self) -> NDArray[np.int32]:
        """Return what unit tangents have beside their segment's direction, [segments, 3], of `BEND_UNIT`.

        That at the first end is in the lower 16 bits, that at the other in the upper ones. The tangent at a
        point is halfway between the directions of both segments, within 90° of either: none between two ends
        points backwards.
        """
        along, lengths = self.corners[:, 1] - self.corners[:, 0], self.lengths[:, None]
        along = np.divide(along, lengths, out=np.zeros_like(along), where=lengths > 0)
        later = np.flatnonzero(self.goes_on)
        halfway = along[later - 1] + along[later]
        length = np.linalg.norm(halfway, axis=1, keepdims=True)
        turns = length[:, 0] > TURNS_BACK
        later, halfway = later[turns], halfway[turns] / length[turns]
        first, second = np.zeros((2, *along.shape), np.int32)
        first[later] = np.rint((halfway - along[later]) / BEND_UNIT)
        second[later - 1] = np.rint((halfway - along[later - 1]) / BEND_UNIT)
        bends: NDArray[np.int32] = first & 0xFFFF | second << 16
        return bends

    def crossed(self, origin: Floats, direction: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """As `ThinPrimitives.crossed`: where the ray passes the axis within the width."""
        along, beside = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 0] - origin
        across = along - (along @ direction)[:, None] * direction
        square = (across**2).sum(axis=1)
        offset = beside - (beside @ direction)[:, None] * direction
        none = np.full(len(square), -1.0)
        u = np.divide(-(offset * across).sum(axis=1), square, out=none, where=square > 0)
        reach = (self.widths[:, 0] + u * (self.widths[:, 1] - self.widths[:, 0])) / 2
        met = (u >= 0) & (u < 1) & (((offset + u[:, None] * across) ** 2).sum(axis=1) < reach**2)
        return met, (beside @ direction + u * (along @ direction))[met]

    def _like(self, corners: Floats, depths: Floats, scale: float) -> Self:
        other = object.__new__(type(self))
        other.source, other.chosen = self.source, dict(self.chosen)
        other.widths, other.goes_on = self.widths * scale, self.goes_on
        other._fill(corners, depths, self._colour, self.medium)
        return other


def _rows_of(colour: ArrayLike, strand: NDArray[np.int64]) -> Any:
    """Give the colour of each strand to each of its points; one of all stays one."""
    array = np.asarray(colour)
    return each_of(array, strand) if array.ndim > 1 else array


def _strands(counts: ArrayLike, points: int, label: str) -> NDArray[np.int64]:
    """Return the number of each point's strand, [points].

    Raises
    ------
    VolumeError
        Counts that are no integers, less than 2, or do not add up.
    """
    array = np.asarray(counts)
    if array.ndim != 1 or not len(array) or array.dtype.kind not in "iu":
        raise VolumeError(f"{label}: counts should be integers [strands], how many points each has")
    if array.min() < 2:  # noqa: PLR2004 - a segment has two ends
        first = int((array < 2).argmax())  # noqa: PLR2004
        raise VolumeError(f"{label}: counts[{first}] = {array[first]}: a strand has 2 points or more")
    total = sum(int(count) for count in array) if array.max() > points else int(array.sum(dtype=np.int64))
    if total != points:
        raise VolumeError(f"{label}: counts add up to {total:,}, but there are {points:,} points")
    return np.repeat(np.arange(len(array)), array)
