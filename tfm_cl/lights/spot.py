"""The spot light."""

import math
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.lights.area import MOST_SAMPLES, disk_points
from tfm_cl.lights.base import TINY, Arrival, Floats, Light, LightFrame, LitCone, Reach, ball_interval, facing
from tfm_cl.lights.texture import ImagePath, texture_for
from tfm_cl.model import LARGEST_COORDINATE, Vec3, check_different
from tfm_cl.transform import turned


class SpotLight(Light):
    """A cone of light from a point; its map is the square around the cone (TFM section 4).

    With a ``radius`` it comes from a disk instead, of which `parts` makes points. A ``texture`` is thrown
    through that square: upright and not mirrored for who stands behind the light and looks along it.
    """

    HEADER: ClassVar[str] = "light/spot.h"

    type: Literal["spot"] = "spot"
    from_: Vec3 = Field(alias="from", description="position, world units")
    to: Vec3 = Field(description="point on the axis, world units")
    cone: float = Field(25.0, gt=0, lt=90, description="half angle, degrees")
    blend: float = Field(
        0.0,
        ge=0,
        le=1,
        description="part of the half angle over which the edge softens (smoothstep); 0 is a hard edge",
    )
    reach: Reach = Field(
        None,
        description="distance beyond which the light is dark, world units: it fades smoothly to there; left "
        "out: it has no end",
    )
    radius: float = Field(
        0.0,
        ge=0,
        description="of a disk across the axis that the light comes from, world units; 0 is a point",
    )
    samples: int = Field(
        16,
        ge=1,
        le=MOST_SAMPLES,
        description=f"points of the disk, 1 to {MOST_SAMPLES}, each with a map of its own",
    )
    texture: ImagePath = Field(
        "", description="image thrown through the square around the cone: .png .exr .npy; empty: none"
    )

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        if self.radius + max(map(abs, self.from_)) > LARGEST_COORDINATE:
            raise ValueError(f"radius = {self.radius:g}: the disk should lie within {LARGEST_COORDINATE:g}")
        return self

    def frame(self) -> LightFrame:
        """Apex at the origin, axis along z; shape = tan(cone), cone, blend, 1 / reach (0 without)."""
        cone = np.radians(self.cone)
        end = 0.0 if self.reach is None else 1 / self.reach
        return LightFrame(facing(self.from_, self.to), (float(np.tan(cone)), float(cone), self.blend, end))

    def lit_cone(self) -> LitCone:
        """Return the cone."""
        reach = math.inf if self.reach is None else self.reach
        return LitCone(facing(self.from_, self.to), math.tan(math.radians(self.cone)), reach)

    def footprint(self, distance: float) -> float:
        """Width of the cone there."""
        return 2 * distance * float(np.tan(np.radians(self.cone)))

    def parts(self) -> tuple[Light, ...]:
        """Itself, or with a ``radius`` its ``samples`` points.

        They lie on the disk, which faces the axis; each has its part of the intensity and the same cone,
        turned to look at the same ``to``.
        """
        if self.radius == 0:
            return (self,)
        right, up = self.frame().world_from_light[:3, :2].T
        offsets = self.radius * disk_points(self.samples) @ np.stack([right, up])
        part = {"intensity": np.divide(self.intensity, self.samples), "radius": 0.0}
        return tuple(self.replace(from_=self.from_ + offset, **part) for offset in offsets)

    def texture_image(self) -> NDArray[np.float32] | None:
        """As `Light.texture_image`; what is transparent in the image is dark."""
        return texture_for(self.texture, self.intensity)

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """All from the apex."""
        matrix = self.frame().world_from_light
        x, y = ((2 * positions - 1) * np.tan(np.radians(self.cone))).T[:, :, None]
        directions = x * matrix[:3, 0] + y * matrix[:3, 1] + matrix[:3, 2]
        directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(matrix[:3, 3], directions.shape), directions

    def begins(self, points: Floats) -> Floats:
        """At the apex."""
        return np.broadcast_to(np.asarray(self.from_), points.shape)

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """As `Light.arrival`."""
        offset, local = self._from_apex(points)
        distance = np.linalg.norm(offset, axis=-1)
        edge = np.maximum(np.maximum(local[:, 2:], TINY) * np.tan(np.radians(self.cone)), TINY)
        strength = self.falloff_at(distance, nearest) * self.window_at(distance)
        if self.blend > 0:
            cone, angle = np.radians(self.cone), np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
            x = np.clip((cone - angle) / (cone * self.blend), 0, 1)
            strength *= x * x * (3 - 2 * x)
        return Arrival(
            offset / np.maximum(distance, TINY)[:, None], distance, (local[:, :2] / edge + 1) / 2, strength
        )

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """In the cone."""
        x, y, z = self._from_apex(points)[1].T
        inside: NDArray[np.bool_] = (z > 0) & (np.hypot(x, y) <= np.tan(np.radians(self.cone)) * z)
        if self.reach is not None:
            inside &= np.sqrt(x * x + y * y + z * z) < self.reach
        return inside

    def projective_depth(self, points: Floats) -> Floats:
        """Along the axis."""
        return np.maximum(self._from_apex(points)[1][:, 2], 0)

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """In the solid cone."""
        slope, axes = np.tan(np.radians(self.cone)), self.frame().world_from_light[:3, :3]
        origin, direction = self._from_apex(origins)[1], turned(directions, axes)
        # From the ray's point nearest to the apex the roots keep their digits however far the camera is.
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
        # A ray parallel to the side (a = 0) has one of its roots at infinity.
        one = np.divide(root, a, out=np.copysign(np.inf, -b), where=a != 0)
        other = np.divide(c, root, out=np.zeros_like(c), where=root != 0)
        low, high = np.minimum(one, other), np.maximum(one, other)
        # a ≥ 0: the ray runs from one nappe into the other. a < 0: it crosses one nappe, if any.
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
        """Points relative to the apex, in the world's axes and in the light's."""
        matrix = self.frame().world_from_light
        offset = points - matrix[:3, 3]
        return offset, turned(offset, matrix[:3, :3])
