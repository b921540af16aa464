"""The ground: a level plane under everything."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tfm_cl.files.albedo import read_albedo
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Triple, decided, number_or_auto
from tfm_cl.scene.solids.base import FlatSolid
from tfm_cl.scene.transform import IDENTITY

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
UPS: dict[Up, Triple] = {
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""The world's axes by their names."""


class GroundSolid(FlatSolid):
    """The level plane on which the scene stands.

    `tfm_cl.scene.placement` decides what is ``"auto"`` when the scene is made.
    """

    shape: Literal["ground"] = "ground"
    up: Up | Literal["auto"] = Field(
        default="auto",
        description="the world's axis that points upwards; auto: the nearest to camera.up, y with "
        "camera.matrix",
    )
    height: Annotated[float | Literal["auto"], number_or_auto(-LARGEST_COORDINATE, LARGEST_COORDINATE)] = (
        Field(
            default="auto",
            description="along that axis, world units; auto: the lowest of what has density and of solids",
        )
    )

    @model_validator(mode="after")
    def _is_level(self) -> Self:
        if self.transform != IDENTITY:
            raise ValueError('a ground has no transform: give its height, or use shape = "plane"')
        return self

    def object_plane(self) -> tuple[Triple, Triple]:
        """As `FlatSolid.object_plane`."""
        up = UPS[decided(self.up)]
        x, y, z = (np.array(up) * decided(self.height)).tolist()
        return (x, y, z), up

    @staticmethod
    def read(name: str) -> Mipmap:
        """As `FlatSolid.read`."""
        return read_albedo(name)
