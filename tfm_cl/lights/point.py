"""The point light."""

import math
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.lights.area import MOST_SAMPLES, sphere_directions
from tfm_cl.lights.base import TINY, Arrival, Floats, Light, LightFrame, LitCone, Reach, ball_interval
from tfm_cl.model import LARGEST_COORDINATE, Vec3

BORDER = 1 / 32
"""Width of the map's border on every side, in parts of the map.

It repeats the rays from across the seam. A fraction, not a texel, because transmittance map, shadow map and
probes of one light differ in resolution but share u, v. Bilinear look-ups reach half a texel beyond the
octahedron: they see no seam in maps of 16 texels or more, and filters of k more texels on every side none
from 32 k + 16 texels on. In smaller maps the look-up is clamped at the outermost texels' centres.
"""


class PointLight(Light):
    """Light from a point to everywhere; its map is an octahedron unfolded into a square, with a border.

    Light space has the world's axes. The octahedron |x| + |y| + |z| = 1 is projected along z; its lower half
    (z < 0) is folded out into the square's corners (Engelhardt, Dachsbacher, "Octahedron Environment Maps",
    VMV 2008).
    """

    HEADER: ClassVar[str] = "light/point.h"

    type: Literal["point"] = "point"
    from_: Vec3 = Field(alias="from", description="position, world units")
    reach: Reach = Field(
        None,
        description="distance beyond which the light is dark, world units: it fades smoothly to there; left "
        "out: it has no end",
    )
    radius: float = Field(
        0.0, ge=0, description="of a sphere that the light comes from, world units; 0 is a point"
    )
    samples: int = Field(
        16,
        ge=1,
        le=MOST_SAMPLES,
        description=f"points of the sphere, 1 to {MOST_SAMPLES}, each with a map of its own",
    )

    @model_validator(mode="after")
    def _lies_within(self) -> Self:
        if self.radius + max(map(abs, self.from_)) > LARGEST_COORDINATE:
            raise ValueError(f"radius = {self.radius:g}: the sphere should lie within {LARGEST_COORDINATE:g}")
        return self

    def frame(self) -> LightFrame:
        """Light at the origin; shape = the octahedron's part of the map, 0, 0, 1 / reach (0 without)."""
        matrix = np.eye(4)
        matrix[:3, 3] = self.from_
        return LightFrame(matrix, (1 - 2 * BORDER, 0.0, 0.0, 0.0 if self.reach is None else 1 / self.reach))

    def lit_cone(self) -> LitCone:
        """Return the ball it reaches."""
        return LitCone(
            self.frame().world_from_light, math.inf, math.inf if self.reach is None else self.reach
        )

    def footprint(self, distance: float) -> float:
        """Root of the sphere's area, with the border: the width of texels of mean size, side by side."""
        return distance * float(np.sqrt(4 * np.pi)) / (1 - 2 * BORDER)

    def parts(self) -> tuple[Light, ...]:
        """Itself, or with a ``radius`` points on the sphere that share the intensity."""
        if self.radius == 0:
            return (self,)
        part = {"intensity": np.divide(self.intensity, self.samples), "radius": 0.0}
        offsets = self.radius * sphere_directions(self.samples)
        return tuple(self.replace(from_=self.from_ + offset, **part) for offset in offsets)

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """All from the light; in the border those of the folded directions."""
        directions = direction_of((2 * positions - 1) / (1 - 2 * BORDER))
        return np.broadcast_to(np.asarray(self.from_), directions.shape), directions

    def begins(self, points: Floats) -> Floats:
        """At the light."""
        return np.broadcast_to(np.asarray(self.from_), points.shape)

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """As `Light.arrival`."""
        offset = points - np.asarray(self.from_)
        distance = np.linalg.norm(offset, axis=-1)
        position = (1 + (1 - 2 * BORDER) * unfolded(offset)) / 2
        strength = self.falloff_at(distance, nearest) * self.window_at(distance)
        return Arrival(offset / np.maximum(distance, TINY)[:, None], distance, position, strength)

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """Within its reach."""
        distance: Floats = np.linalg.norm(points - np.asarray(self.from_), axis=-1)
        return distance < math.inf if self.reach is None else distance < self.reach

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Within its reach."""
        if self.reach is None:
            return super().interval(origins, directions)
        return ball_interval(origins - np.asarray(self.from_), directions, self.reach)


def direction_of(square: Floats) -> Floats:
    """Return the unit directions [n, 3] of places [n, 2] in the octahedron's square [-1, 1]², or around it.

    Beyond a side the square goes on as its own half turn about the middle of that side, so that neighbours
    have neighbouring directions.
    """
    x, y = square.T
    outside = np.abs(x) > 1
    x, y = np.where(outside, np.copysign(2, x) - x, x), np.where(outside, -y, y)
    outside = np.abs(y) > 1
    x, y = np.where(outside, -x, x), np.where(outside, np.copysign(2, y) - y, y)
    z = 1 - np.abs(x) - np.abs(y)
    lower = z < 0
    x, y = (
        np.where(lower, np.copysign(1 - np.abs(y), x), x),
        np.where(lower, np.copysign(1 - np.abs(x), y), y),
    )
    directions = np.column_stack([x, y, z])
    unit: Floats = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return unit


def unfolded(directions: Floats) -> Floats:
    """Places [n, 2] in the square of directions [n, 3] of any length; the middle where that is 0."""
    size = np.abs(directions).sum(axis=-1)
    x, y, _ = directions.T / np.maximum(size, TINY)
    lower = directions[:, 2] < 0
    return np.column_stack(
        [
            np.where(lower, np.copysign(1 - np.abs(y), x), x),
            np.where(lower, np.copysign(1 - np.abs(x), y), y),
        ]
    )
