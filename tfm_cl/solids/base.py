"""What a solid is to the rest of the project."""

from abc import abstractmethod
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from tfm_cl.model import LARGEST_COORDINATE, RGB, Model

DEFAULT_ALBEDO = (0.8, 0.8, 0.8)
"""Of a solid that nothing says more about."""

FLATTEST = 1e-6
"""Least volume of a transform's axes, each brought to length 1: below, it is flat within float32."""

IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _reflects_no_more_than_all(rgb: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(rgb) > 1:
        raise ValueError("should be from 0 to 1 in every channel")
    return rgb


def _affine(value: Any) -> tuple[tuple[float, ...], ...]:
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(numbers, list | tuple) and len(numbers) == 4:  # noqa: PLR2004 - rows
        if not all(isinstance(row, list | tuple) and len(row) == 4 for row in numbers):  # noqa: PLR2004
            raise ValueError("should be 16 numbers, row by row, or 4 rows of 4")
        numbers = [item for row in numbers for item in row]
    if (
        not isinstance(numbers, list | tuple)
        or len(numbers) != 16  # noqa: PLR2004 - 4 x 4
        or not all(isinstance(item, int | float) and not isinstance(item, bool) for item in numbers)
    ):
        raise ValueError("should be 16 numbers, row by row, or 4 rows of 4")
    if not all(abs(item) <= LARGEST_COORDINATE for item in numbers):  # NaN is not
        raise ValueError(f"should be finite numbers, at most {LARGEST_COORDINATE:g}")
    matrix = np.array(numbers, dtype=np.float64).reshape(4, 4)
    if not np.array_equal(matrix[3], (0, 0, 0, 1)):
        raise ValueError(f"should be affine: its last row is 0 0 0 1, not {matrix[3].tolist()}")
    axes = matrix[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if lengths.min() < 1 / LARGEST_COORDINATE or abs(np.linalg.det(axes / lengths)) < FLATTEST:
        raise ValueError("cannot be inverted: it makes the solid flat")
    return tuple(map(tuple, matrix.tolist()))


Albedo = Annotated[RGB, AfterValidator(_reflects_no_more_than_all)]
"""Diffuse reflectance, linear Rec. 709, each channel in 0..1; one number means grey."""

Transform = Annotated[tuple[tuple[float, ...], ...], BeforeValidator(_affine)]
"""4×4, affine and invertible; 16 numbers row by row, 4 rows or an array are accepted."""


class Solid(Model):
    """An opaque, diffuse (Lambertian) surface."""

    SECTION: ClassVar[str] = "solid"

    transform: Transform = Field(IDENTITY, description="world_from_object: 16 numbers row by row")

    @cached_property
    def world_from_object(self) -> NDArray[np.float64]:
        """4×4, read only."""
        matrix = np.array(self.transform, dtype=np.float64)
        matrix.flags.writeable = False
        return matrix

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as a scene file writes it; `parse_solid` reads it."""
        return {key: value for key, value in super().to_dict().items() if value is not None}

    @abstractmethod
    def bounds(self) -> NDArray[np.float64] | None:
        """Low and high corner, [2, 3], world units; None for what has no end."""


class AnalyticSolid(Solid):
    """A shape that rays meet in closed form, in its own (object) space and in float64.

    Directions are transformed without bringing them to unit length: distances along a ray are the world's.
    """

    shape: str = Field(description="kind of solid")
    albedo: Albedo = Field(DEFAULT_ALBEDO, description="diffuse reflectance, linear RGB, 0 to 1")

    @cached_property
    def _object_axes(self) -> NDArray[np.float64]:
        """3×3 object-from-world without the offset."""
        return np.linalg.inv(self.world_from_object[:3, :3]).astype(np.float64)

    def object_rays(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take world rays, [N, 3] each, to object space."""
        axes = self._object_axes.T
        # The offset goes first: far from the world's origin little is left to round.
        return (origins - self.world_from_object[:3, 3]) @ axes, directions @ axes

    def world_normals(self, normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take object normals [N, 3] of any length to unit ones of the world (inverse transpose)."""
        world = normals @ self._object_axes
        unit: NDArray[np.float64] = world / np.linalg.norm(world, axis=1, keepdims=True)
        return unit

    @abstractmethod
    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """First distance > 0 along object rays [N, 3], [N]; inf without."""

    @abstractmethod
    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Object normals [N, 3] at points [N, 3] of the surface, either side, any length."""
