"""The box; with a transform, any parallelepiped."""

from itertools import product
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.files.mesh_io.triangles import DEFAULT_ALBEDO
from tfm_cl.model import Vec3
from tfm_cl.scene.solids.base import Albedo, AnalyticSolid

SMALLEST = 1e-290
"""Substitute for a zero component of a direction: quotients become practically infinite, but never 0/0."""


class BoxSolid(AnalyticSolid):
    """The six faces between two corners; visible from outside and inside."""

    shape: Literal["box"] = "box"
    albedo: Albedo = Field(
        default=DEFAULT_ALBEDO, validate_default=True, description="diffuse reflectance, linear RGB, 0 to 1"
    )
    from_: Vec3 = Field(
        default=(-1.0, -1.0, -1.0),
        validate_default=True,
        validation_alias="from",
        description="low corner, object units",
    )
    to: Vec3 = Field(default=(1.0, 1.0, 1.0), validate_default=True, description="high corner, object units")

    @model_validator(mode="after")
    def _has_a_volume(self) -> Self:
        if not all(low < high for low, high in zip(self.from_, self.to, strict=True)):
            raise ValueError(f"from {list(self.from_)} should be below to {list(self.to)} along every axis")
        return self

    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slab method: where the ray enters the last slab or, from inside, where it leaves the first."""
        steps = np.where(np.abs(directions) < SMALLEST, SMALLEST, directions)
        with np.errstate(over="ignore"):
            low, high = (self.from_ - origins) / steps, (self.to - origins) / steps
        # Component by component: short axes are slow to reduce.
        into, out = np.minimum(low, high).T, np.maximum(low, high).T
        enter = np.maximum(np.maximum(into[0], into[1]), into[2])
        leave = np.minimum(np.minimum(out[0], out[1]), out[2])
        nearest = np.where(enter > 0, enter, leave)
        return np.where((enter <= leave) & (nearest > 0), nearest, np.inf)

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.normals`: of the face that is nearest relative to the size of the box."""
        half = np.subtract(self.to, self.from_) / 2
        place = (points - self.from_) / half - 1
        axis = np.abs(np.abs(place) - 1).argmin(axis=1)
        normals = np.zeros(points.shape)
        rows = np.arange(len(points))
        normals[rows, axis] = np.copysign(1.0, place[rows, axis])
        return normals

    def bounds(self) -> NDArray[np.float64]:
        """Bounds of its eight corners."""
        corners = np.array(list(product(*zip(self.from_, self.to, strict=True))))
        matrix = self.world_from_object
        world = corners @ matrix[:3, :3].T + matrix[:3, 3]
        return np.stack([world.min(axis=0), world.max(axis=0)])
