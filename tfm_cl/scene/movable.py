"""What is moved to its place, by a matrix or in steps."""

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from tfm_cl.errors import SceneError
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Model, Triple, Vec3, one_or_three_numbers
from tfm_cl.model_fields import NUMBER, Accepts, Numbers, accepts, numbers
from tfm_cl.scene.transform import Matrix, Rows, affine

ROUNDED = 1e-15
"""A cosine or sine below is 0, of a quarter turn in degrees."""
STEPS = ("translate", "rotate", "scale")
"""Keys that say in steps what ``transform`` says as a matrix."""


def outdone(key: str) -> tuple[str, ...]:
    """Return the keys that say in another way what a key says of where something is, which came later."""
    return STEPS if key == "transform" else ("transform",) if key in STEPS else ()


@accepts(NUMBER, numbers(3))
def _factors(value: Any) -> Any:
    factors = one_or_three_numbers(value)
    if min(map(abs, factors)) < 1 / LARGEST_COORDINATE:
        raise ValueError(f"should be at least {1 / LARGEST_COORDINATE:g} along every axis: it makes all flat")
    return factors


class Movable(Model):
    """What is moved to its place, by a matrix or in steps: scaled, then turned, then shifted.

    ``transform`` can be read in either case: it is T · Rz · Ry · Rx · S.
    """

    transform: Accepts[Rows | None, Matrix | None] = Field(
        default=None, validate_default=True, description="4x4, 16 numbers row by row"
    )
    translate: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="instead of transform: by how much it is shifted, last, world units",
    )
    rotate: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="instead of transform: degrees by which it is turned about the world's x, then y, then z "
        "axis, as Blender's XYZ Euler; before translate, after scale",
    )
    scale: Accepts[float | Numbers, Annotated[Triple, BeforeValidator(_factors)]] = Field(
        default=(1.0, 1.0, 1.0),
        validate_default=True,
        description="instead of transform: factor of its size, one number or x,y,z along its own axes; first",
    )

    @model_validator(mode="before")
    @classmethod
    def _is_placed_once(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        # `to_dict` writes None for keys that have no say.
        silent = {key for key in ("transform", *STEPS) if values.get(key) is None}
        steps = [key for key in STEPS if key not in silent]
        if "transform" in values and "transform" not in silent and steps:
            line = f"{cls.SECTION}: transform and {steps[0]} both say where it is; keep one"
            raise PydanticCustomError("faults", "{lines}", {"lines": [line]})
        return {key: value for key, value in values.items() if key not in silent}

    @model_validator(mode="after")
    def _follows_steps(self) -> Self:
        if not self.is_moved_in_steps:
            return self
        self.__dict__["transform"] = affine(_in_steps(self.translate, self.rotate, self.scale))
        self.model_fields_set.discard("transform")  # it is not said, but follows
        return self

    @property
    def is_moved_in_steps(self) -> bool:
        """Whether `translate`, `rotate` or `scale` say where it is."""
        fields = type(self).model_fields
        return any(getattr(self, key) != fields[key].default for key in STEPS)

    def replace(self, **changes: Any) -> Self:
        """As `Model.replace`; what says in another way where it is, is given up for what is new."""
        dropped = {key for name, value in changes.items() if value is not None for key in outdone(name)}
        kept = {name: getattr(self, name) for name in self.model_fields_set - dropped}
        return type(self)(**kept | self._spelled(changes))

    def to_dict(self) -> dict[str, Any]:
        """Return the section as a scene file writes it; None for the keys that have no say."""
        unsaid = ("transform",) if self.is_moved_in_steps else STEPS
        return super().to_dict() | dict.fromkeys(unsaid)


def _in_steps(translate: Triple, rotate: Triple, scale: Triple) -> NDArray[np.float64]:
    """T · Rz · Ry · Rx · S, 4×4; quarter turns are exact."""
    angles = np.radians(np.fmod(rotate, 360.0))
    cosines, sines = (np.where(np.abs(part) < ROUNDED, 0, part) for part in (np.cos(angles), np.sin(angles)))
    matrix = np.eye(4)
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(4)
        turn[one, one] = turn[other, other] = cosines[axis]
        turn[other, one], turn[one, other] = sines[axis], -sines[axis]
        matrix = turn @ matrix
    matrix[:3, :3] *= scale
    matrix[:3, 3] = translate
    return matrix + 0.0


def said_by(table: dict[str, Any]) -> NDArray[np.float64] | None:
    """Return the matrix, 4×4, that a table of a scene file says; None where it says none, or a wrong one."""
    try:
        moved = Movable(**{key: table[key] for key in ("transform", *STEPS) if key in table})
    except SceneError:
        return None
    return None if moved.transform is None else np.array(moved.transform)
