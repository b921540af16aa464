"""The infinite plane."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tfm_cl.files.albedo import read_albedo
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.model import Triple, Vec3
from tfm_cl.scene.solids.base import FlatSolid


class PlaneSolid(FlatSolid):
    """The plane through ``point`` perpendicular to ``normal``; visible from both sides."""

    shape: Literal["plane"] = "plane"
    point: Vec3 = Field(
        default=(0.0, 0.0, 0.0), validate_default=True, description="a point on the plane, object units"
    )
    normal: Vec3 = Field(
        default=(0.0, 1.0, 0.0),
        validate_default=True,
        description="direction perpendicular to the plane, of any length",
    )

    @model_validator(mode="after")
    def _has_a_normal(self) -> Self:
        if float(np.linalg.norm(self.normal)) < 1e-30:  # noqa: PLR2004 - its square is no number
            raise ValueError(f"normal = {list(self.normal)}: should not be zero")
        return self

    def object_plane(self) -> tuple[Triple, Triple]:
        """As `FlatSolid.object_plane`."""
        return self.point, self.normal

    @staticmethod
    def read(name: str) -> Mipmap:
        """As `FlatSolid.read`."""
        return read_albedo(name)
