"""A ball of constant density."""

import math
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Vec3
from tfm_cl.scene.bodies.homogeneous import Homogeneous


class SphereVolume(Homogeneous):
    """A ball."""

    KIND: ClassVar[int] = 2
    HEADER: ClassVar[str] = "body/sphere.h"
    shape: Literal["sphere"] = "sphere"
    centre: Vec3 = Field(default=(0, 0, 0), validate_default=True, description="centre, world units")
    radius: float = Field(default=1.0, gt=0, le=LARGEST_COORDINATE, description="radius, world units")

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The box around the ball."""
        centre = np.array(self.centre)
        return np.stack([centre - self.radius, centre + self.radius])

    @property
    def content(self) -> float:
        """As `Homogeneous.content`."""
        return 4 / 3 * math.pi * self.radius**3

    def kernel_shape(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Its centre, and its radius first."""
        return self.centre, (self.radius, 0.0, 0.0)

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """As `Homogeneous.contains`."""
        inside: NDArray[np.bool_] = np.linalg.norm(points - np.array(self.centre), axis=-1) <= self.radius
        return inside
