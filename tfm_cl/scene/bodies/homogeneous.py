"""What bodies of constant density are to the rest of the project.

What lies between two points of one is known in closed form (TFM eq. 5).
"""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.errors import Fault, SceneError, unknown_key, words
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.model import Model
from tfm_cl.scene.bodies.base import OF_BODIES, Body
from tfm_cl.scene.medium import Medium, OwnMedium


class Homogeneous(Model, Body):
    """A body whose density is the same everywhere inside it."""

    SECTION: ClassVar[str] = "volume"
    WORDS: ClassVar[dict[str, str]] = OF_BODIES | words(
        {
            "shape": "type kind",
            "density": "densityscale extinction",
            "centre": "position location translate translation origin",
            "from": "min low minimum boundsmin",
            "to": "max high maximum boundsmax",
            "radius": "size scale",
            "give it from and to, or centre and radius: it is not moved": "transform rotate rotation matrix",
        }
    )
    DENSITY_KEY: ClassVar[str] = "density"
    KIND: ClassVar[int]
    """As kernels know it."""
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, with the function that ``kernels/body/README.md`` describes."""

    shape: str = Field(description="form of the medium")
    density: float = Field(
        default=1.0, ge=0, le=LARGEST_COLOUR, description="density inside; extinction is density * sigma_t"
    )
    medium: OwnMedium = Field(
        default=None,
        validate_default=True,
        description="what this body alone is made of: a table like [medium], whose keys it overrides",
    )

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """World box around the medium, [2, 3]: low and high corner; infinite where it is everywhere."""

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """The same: it is occupied everywhere."""
        return self.bounds

    @abstractmethod
    def kernel_shape(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return what its kernel header finds in ``body->centre``, world, and ``body->size``."""

    @property
    @abstractmethod
    def content(self) -> float:
        """Its volume, world units³; infinite where it is everywhere."""

    def mass_in(self, room: float) -> float:
        """As `Body.mass_in`."""
        return self.density * min(self.content, room)

    @property
    def largest_density(self) -> NDArray[np.float64]:
        """The density that it has everywhere, [3]: the same for red, green and blue."""
        return np.full(3, self.density)

    @property
    def why_empty(self) -> str:
        """Why it has no density at all; empty where it has."""
        return "" if self.density > 0 else "density is 0"

    @abstractmethod
    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Tell whether world points, [n, 3], lie in the body."""

    def equals(self, other: object) -> bool:
        """As `Body.equals`."""
        return self == other

    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere."""
        return isinstance(other, Homogeneous) and self.with_medium(None) == other.with_medium(None)

    def load(self, folder: Path, optical_depth: float, like: Any = None) -> Self:
        """As `BodySettings.load`: it is the body itself."""
        del folder, optical_depth, like
        return self

    def to_table(self) -> dict[str, Any]:
        """As `Body.to_table`."""
        return self.to_dict()

    def sources(self) -> list[str]:
        """As `BodySettings.sources`: none."""
        return []

    def with_medium(self, medium: Medium | None) -> Self:
        """Return the same body of another medium; None: the scene's."""
        return self.replace(medium=medium)

    @property
    def label(self) -> str:
        """What messages call it: its shape."""
        return self.shape


SHAPES: dict[str, type[Homogeneous]] = {}
"""Name in scene files -> class, of all that `tfm_cl.scene.bodies` lists."""


OTHER_SHAPES = words(
    {
        "box": "cube aabb cuboid",
        "sphere": "ball",
        "everywhere": "infinite global fog world constant homogeneous unbounded",
    }
)
"""Shapes in other programs -> the name here."""


def parse_homogeneous(values: dict[str, Any]) -> Homogeneous:
    """Make a homogeneous volume from a scene file's table with a ``shape``.

    Raises
    ------
    SceneError
        Unknown shape, unknown key or impossible value.
    """
    name = values.get("shape")
    if not isinstance(name, str) or name not in SHAPES:
        line = unknown_key(str(name), list(SHAPES), words=OTHER_SHAPES).replace("key", "shape", 1)
        raise SceneError(Fault(f"volume.shape: {line}", ("shape",)))
    return SHAPES[name].from_table(values)
