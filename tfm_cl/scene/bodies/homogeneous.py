"""Media of constant density: a box, a sphere or all of space.

Their transmittance is known in closed form (TFM eq. 5).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.errors import SceneError
from tfm_cl.model import LARGEST_COLOUR, LARGEST_COORDINATE, Model, Vec3, section_within, unknown_key
from tfm_cl.scene.bodies.base import Body
from tfm_cl.scene.medium import Medium, parse_medium


class Homogeneous(Model, Body):
    """What a scene has in the place of a volume whose density is the same everywhere inside it."""

    SECTION: ClassVar[str] = "volume"
    DENSITY_KEY: ClassVar[str] = "density"
    KIND: ClassVar[int]
    """As kernels know it."""

    shape: str = Field(description="form of the medium")
    density: float = Field(
        1.0, ge=0, le=LARGEST_COLOUR, description="density inside; extinction is density * sigma_t"
    )
    medium: Annotated[Medium | None, section_within(parse_medium)] = Field(
        None, description="what this body alone is made of: a table like [medium], whose keys it overrides"
    )
    colour: ClassVar[None] = None
    parts: ClassVar[tuple[()]] = ()

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """World box around the medium, [2, 3]: low and high corner; infinite where it is everywhere."""

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """The same: it is occupied everywhere."""
        return self.bounds

    @property
    def largest_density(self) -> NDArray[np.float64]:
        """The density that it has everywhere, [3]: the same for red, green and blue."""
        return np.full(3, self.density)

    @property
    def why_empty(self) -> str:
        """Why it has no density at all; empty where it has."""
        return "" if self.density > 0 else "density is 0"

    @property
    def half_sizes(self) -> NDArray[np.float64]:
        """Half of the bounds' edges, [3]."""
        low, high = self.bounds
        half: NDArray[np.float64] = (high - low) / 2
        return half

    def contains(self, offsets: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Tell whether points, [n, 3] relative to the middle of the bounds, lie in the medium."""
        inside: NDArray[np.bool_] = np.all(np.abs(offsets) <= self.half_sizes, axis=-1)
        return inside

    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere."""
        return isinstance(other, Homogeneous) and self.with_medium(None) == other.with_medium(None)

    def with_medium(self, medium: Medium | None) -> Self:
        """Return the same body of another medium; None: the scene's."""
        return self.replace(medium=medium)

    @property
    def label(self) -> str:
        """What messages call it: its shape."""
        return self.shape


class BoxVolume(Homogeneous):
    """A box along the world's axes."""

    KIND: ClassVar[int] = 1
    shape: Literal["box"] = "box"
    from_: Vec3 = Field((-1, -1, -1), alias="from", description="low corner, world units")
    to: Vec3 = Field((1, 1, 1), description="high corner, world units")

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if not all(low < high for low, high in zip(self.from_, self.to, strict=True)):
            raise ValueError(f"from = {list(self.from_)} should be below to = {list(self.to)} on every axis")
        return self

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The box."""
        return np.array([self.from_, self.to])


class SphereVolume(Homogeneous):
    """A ball."""

    KIND: ClassVar[int] = 2
    shape: Literal["sphere"] = "sphere"
    centre: Vec3 = Field((0, 0, 0), description="world position")
    radius: float = Field(1.0, gt=0, le=LARGEST_COORDINATE, description="world units")

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The box around the ball."""
        centre = np.array(self.centre)
        return np.stack([centre - self.radius, centre + self.radius])

    def contains(self, offsets: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Tell whether points, [n, 3] relative to the centre, lie in the ball."""
        inside: NDArray[np.bool_] = np.linalg.norm(offsets, axis=-1) <= self.radius
        return inside


class EverywhereVolume(Homogeneous):
    """All of space."""

    KIND: ClassVar[int] = 3
    shape: Literal["everywhere"] = "everywhere"

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Infinite."""
        return np.array([[-np.inf] * 3, [np.inf] * 3])


SHAPES: dict[str, type[Homogeneous]] = {
    cls.model_fields["shape"].default: cls for cls in (BoxVolume, SphereVolume, EverywhereVolume)
}
"""Name in scene files -> class."""


def parse_homogeneous(values: dict[str, Any]) -> Homogeneous:
    """Make a homogeneous volume from a scene file's table with a ``shape``.

    Raises
    ------
    SceneError
        Unknown shape, unknown key or impossible value.
    """
    name = values.get("shape")
    if not isinstance(name, str) or name not in SHAPES:
        raise SceneError(f"volume.shape: {unknown_key(str(name), list(SHAPES)).replace('key', 'shape')}")
    return SHAPES[name].from_table(values)
