"""The ground: a level plane under everything."""

import math
from collections.abc import Callable
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.errors import SceneError
from tfm_cl.files.albedo import read_albedo
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Triple, decided, number_or_auto
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.frames import AXES, Axis
from tfm_cl.scene.solids.base import FlatSolid
from tfm_cl.scene.transform import IDENTITY


class GroundSolid(FlatSolid):
    """The level plane on which the scene stands.

    What is ``"auto"`` is decided when the scene is made.
    """

    shape: Literal["ground"] = "ground"
    up: Axis | Literal["auto"] = Field(
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
            raise ValueError('a ground is not moved: give its height, or use shape = "plane"')
        return self

    def settled(self, axis: Axis, boxes: Callable[[], list[NDArray[np.float64]]]) -> Self:
        """As `Solid.settled`: under everything."""
        ground = self.replace(up=axis) if self.up == "auto" else self
        if ground.height != "auto":
            return ground
        if not boxes():
            raise SceneError(
                'solid.height = "auto": nothing in the scene has a lowest point that a ground could be '
                "under; give a number"
            )
        box = around(boxes())
        extent = float(np.ptp(box, axis=0).max())
        # As many digits as positions that are placed have, and not above anything.
        unit = 10.0 ** (math.floor(math.log10(extent)) - 4) if extent > 0 else 1.0
        lowest = float((box @ np.array(AXES[decided(ground.up)])).min())
        return ground.replace(height=float(f"{math.floor(lowest / unit) * unit:.12g}"))

    def object_plane(self) -> tuple[Triple, Triple]:
        """As `FlatSolid.object_plane`."""
        up = AXES[decided(self.up)]
        x, y, z = (np.array(up) * decided(self.height)).tolist()
        return (x, y, z), up

    @staticmethod
    def read(name: str) -> Mipmap:
        """As `FlatSolid.read`."""
        return read_albedo(name)
