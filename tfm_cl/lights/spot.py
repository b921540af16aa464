"""The spot light."""

from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tfm_cl.camera import look_at
from tfm_cl.lights.base import Light, LightFrame
from tfm_cl.model import LARGEST_COORDINATE, Vec3, check_different

MOST_SAMPLES = 256
"""Points of an area light: each has a map."""


class SpotLight(Light):
    """A cone of light from a point; its map is the square around the cone (TFM section 4).

    With a ``radius`` it comes from a disk instead: `tfm_cl.lights.area.spread` makes points of it.
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

    @model_validator(mode="after")
    def _has_an_axis(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        if self.radius + max(map(abs, self.from_)) > LARGEST_COORDINATE:
            raise ValueError(f"radius = {self.radius:g}: the disk should lie within {LARGEST_COORDINATE:g}")
        return self

    def frame(self) -> LightFrame:
        """Apex at the origin, axis along z; shape = tan(cone), cone, blend."""
        axis = np.subtract(self.to, self.from_)
        # Any up will do that is not along the axis; this one keeps the map's rows horizontal.
        up = (0.0, 1.0, 0.0) if abs(axis[1]) < 0.99 * np.linalg.norm(axis) else (0.0, 0.0, 1.0)
        cone = np.radians(self.cone)
        return LightFrame(look_at(self.from_, self.to, up), (float(np.tan(cone)), float(cone), self.blend))

    def footprint(self, distance: float) -> float:
        """Width of the cone there."""
        return 2 * distance * float(np.tan(np.radians(self.cone)))
