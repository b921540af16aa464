"""What a light is to the rest of the project."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.model import RGB, Model


@dataclass(frozen=True)
class LightFrame:
    """Where a light's map lies in the world, as the kernels need it."""

    world_from_light: NDArray[np.float64]
    """4×4 with orthonormal axes: x right, y up, z where the light looks."""
    shape: tuple[float, ...]
    """Up to four numbers that the light's kernel header finds in ``params->light_shape``."""


class Light(Model):
    """A light with a projective space: every point it reaches lies on one ray of its map."""

    SECTION: ClassVar[str] = "light"
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, with the functions that ``kernels/light/README.md`` names."""

    type: str = Field(description="kind of light")
    intensity: RGB = Field((1.0, 1.0, 1.0), description="RGB; its unit depends on falloff")
    falloff: Literal["none", "inverse-square"] = Field(
        "none",
        description="none: the papers' (intensity is irradiance everywhere); "
        "inverse-square: intensity is per steradian, distance in world units",
    )

    @abstractmethod
    def frame(self) -> LightFrame:
        """Place the light's map in the world."""

    @abstractmethod
    def footprint(self, distance: float) -> float:
        """Width of what the map covers at a distance from the light's origin, world units."""

    def map_key(self) -> tuple[object, ...]:
        """All of the light that its transmittance map depends on: not its colour."""
        frame = self.frame()
        return (self.type, frame.world_from_light.tobytes(), frame.shape)
