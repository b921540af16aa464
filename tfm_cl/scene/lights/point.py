"""The point light."""

import math
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.scene.lights.area import MOST_SAMPLES, sphere_directions
from tfm_cl.scene.lights.base import TINY, Arrival, Floats, Light, LitCone, ball_interval
from tfm_cl.scene.lights.placed import PlacedLight


class PointLight(PlacedLight):
    """Light from a point in all directions.

    Its map is an octahedron unfolded into a square or, if the medium lies to one side of the light, a
    narrower view that covers only the medium (`tfm_cl.scene.lights.charts`).
    """

    HEADER: ClassVar[str] = "light/point.h"

    type: Literal["point"] = "point"
    radius: float = Field(
        default=0.0, ge=0, description="radius of the sphere that emits the light, world units; 0: a point"
    )
    samples: int = Field(
        default=16,
        ge=1,
        le=MOST_SAMPLES,
        description=f"points on the sphere, 1 to {MOST_SAMPLES}, each with a map of its own",
    )

    @model_validator(mode="after")
    def _lies_within(self) -> Self:
        if self.radius + max(map(abs, self.from_)) > LARGEST_COORDINATE:
            raise ValueError(f"radius = {self.radius:g}: the sphere should lie within {LARGEST_COORDINATE:g}")
        return self

    def cone_of_light(self) -> None:
        """Return None: the light shines in all directions."""

    def lit_cone(self) -> LitCone:
        """Return the sphere that it reaches, if it has a reach."""
        matrix = np.eye(4)
        matrix[:3, 3] = self.from_
        return LitCone(matrix, math.inf, math.inf if self.reach is None else self.reach)

    def parts(self) -> tuple[Light, ...]:
        """Return itself or, with a ``radius``, points on the sphere that share the intensity."""
        if self.radius == 0:
            return (self,)
        part = {"intensity": np.divide(self.intensity, self.samples), "radius": 0.0}
        offsets = self.radius * sphere_directions(self.samples)
        return tuple(self.replace(from_=self.from_ + offset, **part) for offset in offsets)

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """As `Light.arrival`."""
        offset = points - np.asarray(self.from_)
        distance = np.linalg.norm(offset, axis=-1)
        position = self.map_positions(offset)
        strength = self.falloff_at(distance, nearest) * self.window_at(distance)
        return Arrival(offset / np.maximum(distance, TINY)[:, None], distance, position, strength, position)

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """As `Light.reaches`: the points within its reach."""
        distance: Floats = np.linalg.norm(points - np.asarray(self.from_), axis=-1)
        return self.within_reach(distance)

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """As `Light.interval`: the part within its reach."""
        if self.reach is None:
            return super().interval(origins, directions)
        return ball_interval(origins - np.asarray(self.from_), directions, self.reach)
