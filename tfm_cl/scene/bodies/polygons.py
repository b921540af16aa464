"""Polygons as opacity: leaves, paper, veils."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import MOST_OPACITY
from tfm_cl.errors import VolumeError
from tfm_cl.scene.bodies.primitives import Primitives, colours_of, numbers_of, positions_of, rigid_scale
from tfm_cl.scene.medium import parse_medium

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]

TEXELS_ACROSS = 512
"""Texels, as they should be, across the bounds of triangles that are smaller than that."""
MEAN_COSINE = 0.5
"""Of the angle between a triangle's normal and rays of all directions: how much of its area is seen."""


class Polygons(Primitives):
    """Triangles of which each takes a part of the light that crosses it, from either side.

    Parameters
    ----------
    vertices
        [V, 3], world.
    faces
        [F, 3], integers: rows of ``vertices``.
    opacity
        Part of the light that one crossing takes at sigma_t = 1, from 0 to 1; one number, or [F].
    colour
        RGB, or [F, RGB]: extinction relative to that, of scattering and absorption alike; None: 1.
    medium
        What they alone are made of; None: the scene's medium.
    source
        The file they came from, if any.

    Raises
    ------
    VolumeError
        Arrays of other shapes, numbers that are not finite or out of range, rows that are not there.

    Attributes
    ----------
    corners
        float64 [F, 3, 3]: of each triangle, world.
    """

    HEADER: ClassVar[str] = "primitive/triangle.h"
    DENSITY_KEY: ClassVar[str] = "opacity"

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        opacity: ArrayLike = 1.0,
        *,
        colour: ArrayLike | None = None,
        medium: Medium | None = None,
        source: Path | None = None,
    ) -> None:
        self.source, self.chosen = source, {}
        places = positions_of(vertices, "vertices", self.label)
        corners = places[_rows(faces, len(places), self.label)]
        taken = numbers_of(opacity, len(corners), "opacity", self.label, most=1.0)
        depths = -np.log1p(-np.minimum(taken, MOST_OPACITY))
        self._fill(corners, depths, colours_of(colour, len(corners), self.label), medium)

    def _fill(
        self, corners: Floats, depths: Floats, colour: NDArray[np.float32] | None, medium: Medium | None
    ) -> None:
        """Keep triangles that have been checked."""
        self.corners, self.densities, self._colour = corners, depths, colour
        self.positions = corners.mean(axis=1)
        self.radii = np.linalg.norm(corners - self.positions[:, None], axis=2).max(axis=1)
        self.areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        self.medium = parse_medium(medium)

    @property
    def detail(self) -> float:
        """World units: a triangle's radius, or twice the width of as many texels as `TEXELS_ACROSS`."""
        low, high = self.bounds
        return max(float(np.median(self.radii)), 2 * float((high - low).max()) / TEXELS_ACROSS)

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
        masses: Floats = MEAN_COSINE * self.areas * self.densities
        return masses

    def fill_sources(self, structs: NDArray[Any], origin: Floats) -> None:
        """As `Primitives.fill_sources`."""
        for corner, name in enumerate("abc"):
            structs[name] = self.corners[:, corner] - origin
        structs["amount"] = self.densities

    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> Floats:
        """As `MarchedBody.depths_along`."""
        first, second = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        normal, away = np.cross(first, second), origin - self.corners[:, 0]
        facing = normal @ direction
        inverse = np.divide(1, facing, out=np.zeros_like(facing), where=facing != 0)
        turned = np.cross(away, direction)
        u, v = -(turned * second).sum(axis=1) * inverse, (turned * first).sum(axis=1) * inverse
        met = (inverse != 0) & (u >= 0) & (v >= 0) & (u + v < 1)
        distances = (-(away * normal).sum(axis=1) * inverse)[met]
        colour = np.ones((int(met.sum()), 1)) if self.colour is None else self.colour[met].astype(np.float64)
        depths = np.zeros((len(edges) - 1, colour.shape[1]))
        step = np.searchsorted(edges, distances) - 1
        within = (step >= 0) & (step < len(depths))
        np.add.at(depths, step[within], (self.densities[met, None] * colour)[within])
        return depths

    def transformed(self, world_from_body: ArrayLike) -> Self:
        """As `Primitives.transformed`."""
        matrix = np.asarray(world_from_body, dtype=np.float64)
        rigid_scale(matrix, self.label)
        return self._like(self.corners @ matrix[:3, :3].T + matrix[:3, 3], self.densities)

    def with_density(self, factor: float) -> Self:
        """As `Primitives.with_density`."""
        return self._like(self.corners, self.densities * factor)

    def _like(self, corners: Floats, depths: Floats) -> Self:
        other = object.__new__(type(self))
        other.source, other.chosen = self.source, dict(self.chosen)
        other._fill(corners, depths, self._colour, self.medium)  # noqa: SLF001 - one of its own
        return other

    def __repr__(self) -> str:
        coloured = "" if self._colour is None else "coloured, "
        return f"Polygons({self.label}, {len(self.corners)} triangles, {coloured}opacity up to {self.opacity:g})"


def _rows(faces: ArrayLike, vertices: int, label: str) -> NDArray[np.integer]:
    """Check faces [F, 3].

    Raises
    ------
    VolumeError
        Another shape, no integers, or rows that are not there.
    """
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array) or array.dtype.kind not in "iu":  # noqa: PLR2004
        raise VolumeError(f"{label}: faces should be integers [F, 3] with F ≥ 1; got the shape {list(array.shape)}")
    if array.min() < 0 or array.max() >= vertices:
        raise VolumeError(f"{label}: faces should be rows of the {vertices} vertices, from 0; got {array.min()} to {array.max()}")
    return array
