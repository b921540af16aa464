"""The spot light."""

import math
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.files.texture import Held, ImagePath, texture_for
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Vec3, check_different
from tfm_cl.scene.frame_numbers import OfFrames
from tfm_cl.scene.frames import facing
from tfm_cl.scene.lights.area import MOST_SAMPLES, disk_points
from tfm_cl.scene.lights.base import TINY, Arrival, Floats, Light, LitCone, ball_interval
from tfm_cl.scene.lights.fitting import Cone
from tfm_cl.scene.lights.placed import PlacedLight
from tfm_cl.scene.transform import corners_of, turned


class SpotLight(OfFrames, PlacedLight):
    """A cone of light from a point (TFM section 4).

    With a ``radius`` the light comes from a disk instead; `parts` returns points on it. A ``texture`` is
    projected through the square around the cone. Seen from behind the light, looking along its axis, the
    image is upright and not mirrored.
    """

    HEADER: ClassVar[str] = "light/spot.h"

    type: Literal["spot"] = "spot"
    to: Vec3 = Field(description="point on the axis, world units")
    cone: float = Field(default=25.0, gt=0, lt=90, description="half angle, degrees")
    blend: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="fraction of the half angle over which the edge softens (smoothstep); 0: a hard edge",
    )
    radius: float = Field(
        default=0.0,
        ge=0,
        description="radius of the disk across the axis that emits the light, world units; 0: a point",
    )
    samples: int = Field(
        default=16,
        ge=1,
        le=MOST_SAMPLES,
        description=f"points on the disk, 1 to {MOST_SAMPLES}, each with a map of its own",
    )
    texture: ImagePath = Field(
        default="",
        validate_default=True,
        description="image projected through the square around the cone: .png .exr .npy; empty: none",
    )

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        if self.radius + max(map(abs, self.from_)) > LARGEST_COORDINATE:
            raise ValueError(f"radius = {self.radius:g}: the disk should lie within {LARGEST_COORDINATE:g}")
        return self

    @property
    def _slope(self) -> float:
        """Tangent of the half angle."""
        return math.tan(math.radians(self.cone))

    @property
    def _world_from_cone(self) -> Floats:
        """4×4: apex at the origin, axis along z, x horizontal."""
        return facing(self.from_, self.to)

    def cone_of_light(self) -> Cone:
        """As `PlacedLight.cone_of_light`."""
        return Cone(self._world_from_cone[:3, :3], self._slope)

    def _shape(self) -> tuple[float, float, float]:
        """tan(cone), cone, blend."""
        return self._slope, math.radians(self.cone), self.blend

    def lit_cone(self) -> LitCone:
        """Return the cone."""
        reach = math.inf if self.reach is None else self.reach
        return LitCone(self._world_from_cone, self._slope, reach)

    def is_smooth_in(self, bounds: Floats) -> bool:
        """As `Light.is_smooth_in`: the box lies in the cone, before its edge softens."""
        x, y, z = self._from_apex(corners_of(bounds))[1].T
        within = np.hypot(x, y) <= math.tan(math.radians(self.cone) * (1 - self.blend)) * z
        return bool(((z > 0) & within).all()) and super().is_smooth_in(bounds)

    def parts(self) -> tuple[Light, ...]:
        """Return itself or, with a ``radius``, its ``samples`` points.

        They lie on the disk, which is perpendicular to the axis. Each has its share of the intensity and the
        same cone, turned towards the same ``to``.
        """
        if self.radius == 0:
            return (self,)
        right, up = self._world_from_cone[:3, :2].T
        offsets = self.radius * disk_points(self.samples) @ np.stack([right, up])
        part = {"intensity": np.divide(self.intensity, self.samples), "radius": 0.0}
        return tuple(self.replace(from_=self.from_ + offset, **part) for offset in offsets)

    @cached_property
    def _held(self) -> Held:
        return Held(texture_for(self.texture, self.intensity))

    def read_files(self) -> None:
        """Read the texture, and hold it for as long as the light is there."""
        _ = self._held

    @property
    def is_textured(self) -> bool:
        """Whether it names an image."""
        return bool(self.texture)

    def texture_image(self) -> NDArray[np.float32] | None:
        """As `Light.texture_image`; transparent parts of the image are dark."""
        return texture_for(self.texture, self.intensity)

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """As `Light.arrival`."""
        offset, local = self._from_apex(points)
        distance = np.linalg.norm(offset, axis=-1)
        edge = np.maximum(np.maximum(local[:, 2:], TINY) * self._slope, TINY)
        strength = self.falloff_at(distance, nearest) * self.window_at(distance)
        if self.blend > 0:
            cone, angle = np.radians(self.cone), np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
            x = np.clip((cone - angle) / (cone * self.blend), 0, 1)
            strength *= x * x * (3 - 2 * x)
        return Arrival(
            offset / np.maximum(distance, TINY)[:, None],
            distance,
            self.map_positions(offset),
            strength,
            (local[:, :2] / edge + 1) / 2,
        )

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """As `Light.reaches`: the points in the cone."""
        x, y, z = self._from_apex(points)[1].T
        inside: NDArray[np.bool_] = (z > 0) & (np.hypot(x, y) <= self._slope * z)
        return inside & self.within_reach(np.sqrt(x * x + y * y + z * z))

    @property
    def has_even_depth(self) -> bool:
        """Depth grows along the cone's axis."""
        return False

    def projective_depth(self, points: Floats) -> Floats:
        """As `Light.projective_depth`: the depth along the axis."""
        return np.maximum(self._from_apex(points)[1][:, 2], 0)

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """As `Light.interval`: the part of rays in the solid cone."""
        slope, axes = self._slope, self._world_from_cone[:3, :3]
        origin, direction = self._from_apex(origins)[1], turned(directions, axes)
        # Measured from the ray's point nearest to the apex, the roots keep their precision however far the
        # camera is.
        nearest = -(origin * direction).sum(axis=-1)
        origin = origin + nearest[:, None] * direction
        # Both nappes: z² slope² - x² - y² = a t² + 2 b t + c ≥ 0.
        metric = np.array([-1.0, -1.0, slope**2])
        a, b, c = (
            (one * other * metric).sum(axis=-1)
            for one, other in ((direction, direction), (origin, direction), (origin, origin))
        )
        discriminant = b * b - a * c
        root = -(b + np.copysign(np.sqrt(np.maximum(discriminant, 0)), b))
        # A ray parallel to the surface (a = 0) has one of its roots at infinity.
        one = np.divide(root, a, out=np.copysign(np.inf, -b), where=a != 0)
        other = np.divide(c, root, out=np.zeros_like(c), where=root != 0)
        low, high = np.minimum(one, other), np.maximum(one, other)
        # a ≥ 0: the ray passes from one nappe to the other. a < 0: it crosses at most one nappe.
        steep, forward = a >= 0, direction[:, 2] > 0
        height = origin[:, 2] - np.divide(b, a, out=np.zeros_like(b), where=a != 0) * direction[:, 2]
        begin = np.where(steep, np.where(forward, high, -np.inf), low)
        end = np.where(steep, np.where(forward, np.inf, low), high)
        missed = ~steep & ((discriminant <= 0) | (height <= 0))
        begin, end = np.maximum(begin + nearest, 0), np.where(missed, -np.inf, end + nearest)
        if self.reach is not None:
            low, high = ball_interval(origins - np.asarray(self.from_), directions, self.reach)
            begin, end = np.maximum(begin, low), np.minimum(end, high)
        hit = end > begin
        return np.where(hit, begin, 0), np.where(hit, end, 0)

    def _from_apex(self, points: Floats) -> tuple[Floats, Floats]:
        """Points relative to the apex, in the axes of the world and of the cone."""
        matrix = self._world_from_cone
        offset = points - matrix[:3, 3]
        return offset, turned(offset, matrix[:3, :3])
