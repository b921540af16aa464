"""The interface of a solid."""

from abc import abstractmethod
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from tfm_cl.files.mesh_io.triangles import DEFAULT_ALBEDO
from tfm_cl.model import RGB, Model
from tfm_cl.scene.transform import IDENTITY, Transform, turned


def _reflects_no_more_than_all(rgb: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(rgb) > 1:
        raise ValueError("should be from 0 to 1 in every channel")
    return rgb


Albedo = Annotated[RGB, AfterValidator(_reflects_no_more_than_all)]
"""Diffuse reflectance, linear Rec. 709, each channel in 0..1; one number means grey."""


class Solid(Model):
    """An opaque, diffuse (Lambertian) surface."""

    SECTION: ClassVar[str] = "solid"

    def __eq__(self, other: object) -> bool:
        """Compare the fields, not the values cached since."""
        return type(self) is type(other) and all(
            getattr(self, name) == getattr(other, name) for name in type(self).model_fields
        )

    def __hash__(self) -> int:
        """Hash the fields that `__eq__` compares."""
        return hash((type(self), *(getattr(self, name) for name in type(self).model_fields)))

    transform: Transform = Field(IDENTITY, description="world-from-object matrix: 16 numbers, row by row")

    @cached_property
    def world_from_object(self) -> NDArray[np.float64]:
        """4×4, read-only."""
        matrix = np.array(self.transform, dtype=np.float64)
        matrix.flags.writeable = False
        return matrix

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as a table for a scene file; `parse_solid` reads it."""
        return {key: value for key, value in super().to_dict().items() if value is not None}

    def read_files(self) -> None:
        """Read what the solid names, so that nothing has to be read later.

        Raises
        ------
        SceneError
            A file that cannot be used.
        """

    @abstractmethod
    def bounds(self) -> NDArray[np.float64] | None:
        """Low and high corner, [2, 3], world units; None for an infinite solid."""


class AnalyticSolid(Solid):
    """A shape whose intersection with rays has a closed form, evaluated in object space in float64.

    Directions are transformed without normalisation, so distances along a ray remain world distances.
    """

    shape: str = Field(description="kind of solid")
    albedo: Albedo = Field(DEFAULT_ALBEDO, description="diffuse reflectance, linear RGB, 0 to 1")

    @cached_property
    def _object_axes(self) -> NDArray[np.float64]:
        """3×3, the linear part of object-from-world."""
        return np.linalg.inv(self.world_from_object[:3, :3]).astype(np.float64)

    def object_rays(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Transform world rays (origins and directions [N, 3]) to object space."""
        axes = self._object_axes.T
        # Subtract the offset first: far from the world's origin this loses the least precision.
        return turned(origins - self.world_from_object[:3, 3], axes), turned(directions, axes)

    def world_normals(self, normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform object normals [N, 3] of any length to unit world normals (inverse transpose)."""
        world = turned(normals, self._object_axes)
        unit: NDArray[np.float64] = world / np.linalg.norm(world, axis=1, keepdims=True)
        return unit

    @abstractmethod
    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """First distance > 0 along object rays [N, 3]: [N]; inf for rays that miss."""

    @abstractmethod
    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Object normals [N, 3] at surface points [N, 3], on either side and of any length."""
