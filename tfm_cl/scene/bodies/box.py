"""A box of constant density."""

from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.model import Vec3
from tfm_cl.scene.bodies.homogeneous import Homogeneous


class BoxVolume(Homogeneous):
    """A box along the world's axes."""

    KIND: ClassVar[int] = 1
    HEADER: ClassVar[str] = "body/box.h"
    shape: Literal["box"] = "box"
    from_: Vec3 = Field(
        default=(-1, -1, -1),
        validate_default=True,
        validation_alias="from",
        description="low corner, world units",
    )
    to: Vec3 = Field(default=(1, 1, 1), validate_default=True, description="high corner, world units")

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if not all(low < high for low, high in zip(self.from_, self.to, strict=True)):
            raise ValueError(f"from = {list(self.from_)} should be below to = {list(self.to)} on every axis")
        return self

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The box."""
        return np.array([self.from_, self.to])

    @property
    def content(self) -> float:
        """As `Homogeneous.content`."""
        low, high = self.bounds
        return float((high - low).prod())

    def kernel_shape(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Its middle, and half of its edges."""
        low, high = self.bounds
        x, y, z = ((low + high) / 2).tolist()
        half_x, half_y, half_z = ((high - low) / 2).tolist()
        return (x, y, z), (half_x, half_y, half_z)

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """As `Homogeneous.contains`."""
        low, high = self.bounds
        inside: NDArray[np.bool_] = np.all((points >= low) & (points <= high), axis=-1)
        return inside
