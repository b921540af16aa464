"""Curves: strands of hair or fur, as polylines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import MOST_OPACITY
from tfm_cl.errors import VolumeError
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.scene.bodies.primitives import Primitives, colours_of, numbers_of, positions_of, rigid_scale
from tfm_cl.scene.medium import parse_medium

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]

LINES_ACROSS = 512
"""Texels, as they should be, across the bounds of strands that are thinner than that."""
MEAN_SINE = np.pi / 4
"""Of the angle between a strand and rays of all directions: how much of its length is seen."""


class Curves(Primitives):
    """Strands: each a polyline of ribbons that face every ray, of one opacity across their width.

    A strand that is narrower than a texel or a pixel covers a part of it.

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
    ends
        float64 [segments, 2, 3]: where each segment begins and ends, world.
    widths
        float64 [segments, 2]: there.
    """

    HEADER: ClassVar[str] = "primitive/segment.h"
    DENSITY_KEY: ClassVar[str] = "opacity"

    def __init__(
        self,
        points: ArrayLike,
        counts: ArrayLike,
        width: ArrayLike,
        density: ArrayLike | None = None,
        *,
        opacity: ArrayLike | None = None,
        colour: ArrayLike | None = None,
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

        def each(values: ArrayLike, what: str, **limits: Any) -> Floats:
            """Return one number for each end of each segment."""
            array = np.asarray(values)
            if array.shape == (strand[-1] + 1,) and len(array) != len(places):
                array = array[strand]
            return numbers_of(array, len(places), what, label, **limits)[segments]

        self.ends = places[segments]
        self.widths = each(width, "width", most=LARGEST_COORDINATE)
        if density is not None:
            depths = (each(density, "density") * self.widths).mean(axis=1)
        else:
            taken = each(1.0 if opacity is None else opacity, "opacity", most=1.0).mean(axis=1)
            depths = -np.log1p(-np.minimum(taken, MOST_OPACITY))
        rgb = np.asarray(colour) if colour is not None else None
        if rgb is not None and rgb.shape == (strand[-1] + 1, 3) and len(rgb) != len(places):
            rgb = rgb[strand]
        shades = colours_of(rgb, len(places), label)
        self._fill(self.ends, self.widths, depths, None if shades is None else shades[segments].mean(axis=1), medium)

    def _fill(
        self, ends: Floats, widths: Floats, depths: Floats, colour: NDArray[np.float32] | None, medium: Medium | None
    ) -> None:
        """Keep segments that have been checked."""
        self.ends, self.widths, self.densities, self._colour = ends, widths, depths, colour
        self.lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.positions = ends.mean(axis=1)
        self.radii = (self.lengths + widths.max(axis=1)) / 2
        self.medium = parse_medium(medium)

    @property
    def detail(self) -> float:
        """World units: twice the width of a strand, or of as many as `LINES_ACROSS`."""
        low, high = self.bounds
        return 2 * max(float(np.median(self.widths)), float((high - low).max()) / LINES_ACROSS)

    @property
    def largest_density(self) -> Floats:
        """As if a ray met all of them, [3]."""
        return super().largest_density / max(self.longest_ray, np.finfo(np.float32).tiny)

    @property
    def opacity(self) -> float:
        """The largest of one crossing."""
        return float(-np.expm1(-self.densities.max()))

    @property
    def masses(self) -> Floats:
        """As `Primitives.masses`: what rays of all directions meet."""
        masses: Floats = MEAN_SINE * self.lengths * self.widths.mean(axis=1) * self.densities
        return masses

    def fill_sources(self, structs: NDArray[Any], origin: Floats) -> None:
        """As `Primitives.fill_sources`."""
        structs["a"], structs["b"] = self.ends[:, 0] - origin, self.ends[:, 1] - origin
        structs["radius"], structs["amount"] = self.widths / 2, self.densities

    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> Floats:
        """As `MarchedBody.depths_along`: a strand is met where the ray passes its axis."""
        along, beside = self.ends[:, 1] - self.ends[:, 0], self.ends[:, 0] - origin
        across = along - (along @ direction)[:, None] * direction
        square = (across**2).sum(axis=1)
        offset = beside - (beside @ direction)[:, None] * direction
        u = np.divide(-(offset * across).sum(axis=1), square, out=np.full(len(square), -1.0), where=square > 0)
        reach = (self.widths[:, 0] + u * (self.widths[:, 1] - self.widths[:, 0])) / 2
        met = (u >= 0) & (u < 1) & (((offset + u[:, None] * across) ** 2).sum(axis=1) < reach**2)
        distances = (beside @ direction + u * (along @ direction))[met]
        colour = np.ones((int(met.sum()), 1)) if self.colour is None else self.colour[met].astype(np.float64)
        depths = np.zeros((len(edges) - 1, colour.shape[1]))
        step = np.searchsorted(edges, distances) - 1
        within = (step >= 0) & (step < len(depths))
        np.add.at(depths, step[within], (self.densities[met, None] * colour)[within])
        return depths

    def transformed(self, world_from_body: ArrayLike) -> Self:
        """As `Primitives.transformed`."""
        matrix = np.asarray(world_from_body, dtype=np.float64)
        scale = rigid_scale(matrix, self.label)
        return self._like(self.ends @ matrix[:3, :3].T + matrix[:3, 3], self.widths * scale, self.densities)

    def with_density(self, factor: float) -> Self:
        """As `Primitives.with_density`."""
        return self._like(self.ends, self.widths, self.densities * factor)

    def _like(self, ends: Floats, widths: Floats, depths: Floats) -> Self:
        other = object.__new__(type(self))
        other.source, other.chosen = self.source, dict(self.chosen)
        other._fill(ends, widths, depths, self._colour, self.medium)  # noqa: SLF001 - one of its own
        return other

    def __repr__(self) -> str:
        coloured = "" if self._colour is None else "coloured, "
        return f"Curves({self.label}, {len(self.ends)} segments, {coloured}opacity up to {self.opacity:g})"


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
