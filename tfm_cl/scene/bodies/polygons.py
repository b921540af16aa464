"""Polygons as opacity: leaves, paper, veils."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.scene.bodies.primitives import colours_of, positions_of, velocities_of
from tfm_cl.scene.bodies.thin import ThinPrimitives, depths_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]

FLATNESS = 1e-3
"""Of the radius of the largest triangle: far more than the place of a crossing is rounded by."""
MEAN_COSINE = 0.5
"""Of the angle between a triangle's normal and rays of all directions: how much of its area is seen."""


class Polygons(ThinPrimitives):
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
    velocity
        [V, 3], of the vertices, world units per second, or None: they move, for motion blur.
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

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        opacity: ArrayLike = 1.0,
        *,
        colour: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        medium: Medium | None = None,
        source: Path | None = None,
    ) -> None:
        self.source, self.chosen = source, {}
        places = positions_of(vertices, "vertices", self.label)
        rows = _rows(faces, len(places), self.label)
        corners = places[rows]
        depths = depths_of(opacity, len(corners), self.label)
        self._fill(corners, depths, colours_of(colour, len(corners), self.label), medium)
        speeds = velocities_of(velocity, len(places), self.label)
        self.velocity = None if speeds is None else speeds[rows]

    @property
    def areas(self) -> Floats:
        """World units squared, [F]."""
        first, second = self._edges
        areas: Floats = np.linalg.norm(np.cross(first, second), axis=1) / 2
        return areas

    @property
    def _edges(self) -> tuple[Floats, Floats]:
        """From the first corner to the others."""
        return self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]

    @property
    def thickness(self) -> float:
        """As `ThinPrimitives.thickness`: what a crossing is rounded by."""
        return FLATNESS * float(self.radii.max())

    @property
    def detail(self) -> float:
        """World units: a triangle's radius, if that is seen."""
        return max(float(np.median(self.radii)), self.least_detail)

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

    def crossed(self, origin: Floats, direction: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """As `ThinPrimitives.crossed`."""
        first, second = self._edges
        normal, away = np.cross(first, second), origin - self.corners[:, 0]
        facing = normal @ direction
        inverse = np.divide(1, facing, out=np.zeros_like(facing), where=facing != 0)
        turned = np.cross(away, direction)
        u, v = -(turned * second).sum(axis=1) * inverse, (turned * first).sum(axis=1) * inverse
        met = (inverse != 0) & (u >= 0) & (v >= 0) & (u + v < 1)
        return met, (-(away * normal).sum(axis=1) * inverse)[met]


def _rows(faces: ArrayLike, vertices: int, label: str) -> NDArray[np.integer]:
    """Check faces [F, 3].

    Raises
    ------
    VolumeError
        Another shape, no integers, or rows that are not there.
    """
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array) or array.dtype.kind not in "iu":  # noqa: PLR2004
        raise VolumeError(
            f"{label}: faces should be integers [F, 3] with F ≥ 1; got the shape {list(array.shape)}"
        )
    if array.min() < 0 or array.max() >= vertices:
        raise VolumeError(
            f"{label}: faces should be rows of the {vertices} vertices, from 0; got {array.min()} to "
            f"{array.max()}"
        )
    return array
