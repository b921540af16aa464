"""The base of everything a scene file can say: frozen, checked on construction, one-line errors."""

import dataclasses
import reprlib
from collections.abc import Callable
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from pydantic import BeforeValidator, ConfigDict, PlainValidator, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from tfm_cl.errors import Fault, Key, SceneError, meant_by, nearest, unknown_key
from tfm_cl.limits import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model_fields import (
    NUMBER,
    Accepts,
    DescribedModel,
    Numbers,
    accepted_by,
    accepts,
    is_choice,
    numbers,
)

T = TypeVar("T")
Triple = tuple[float, float, float]

CLOSEST = 1e-12
"""Of their coordinates, how far apart two points must be to give a direction of three digits in float64."""
SPELLINGS = {"center": "centre"}
"""Key as others spell it -> as it is spelled here."""


class Model(DescribedModel):
    """One section of a scene file, and at the same time the library's class for it.

    Raises
    ------
    SceneError
        On an unknown key (the nearest valid one is named), a wrong type or an impossible value.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, populate_by_name=True, allow_inf_nan=False
    )
    SECTION: ClassVar[str] = ""
    """What messages call it: the section's name in a scene file."""
    WORDS: ClassVar[dict[str, str]] = {}
    """Keys of other programs, small letters and digits alone -> the key here, or what to do instead."""

    def __init__(self, /, **values: Any) -> None:  # "self" may be a key of a file
        try:
            super().__init__(**self._spelled(values))
        except ValidationError as error:
            raise SceneError(*self._faults(error)) from None

    @classmethod
    def from_table(cls, table: dict[str, Any]) -> Self:
        """Make one from a scene file's table, of which the attributes' names in Python are no keys.

        Raises
        ------
        SceneError
            As the constructor.
        """
        known = cls.keys()
        strange = [key for key in table if key in cls.model_fields and key not in known]
        if not strange:
            return cls(**table)
        faults = [cls.unknown(key) for key in strange]
        meant = {f"{cls.SECTION}.{cls.model_fields[key].validation_alias} is missing" for key in strange}
        try:
            cls(**{key: value for key, value in table.items() if key not in strange})
        except SceneError as error:
            faults += [fault for fault in error.args if fault not in meant]
        raise SceneError(*faults)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other values, checked like new ones."""
        # What was left out stays so: other settings may depend on it.
        values = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**{**values, **self._spelled(changes)})

    def __eq__(self, other: object) -> bool:
        """Compare what was said, by its content, not what was made of it since; true is not 1."""
        if type(self) is not type(other) or not isinstance(other, Model):
            return False
        fields = all(same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)
        return fields and same(self.__pydantic_private__, other.__pydantic_private__)

    def __hash__(self) -> int:
        """Hash what of that is small."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        """Kept: a frame asks some dozens of times."""
        values = (getattr(self, name) for name in type(self).model_fields)
        return hash((type(self), *(value for value in values if isinstance(value, _PLAIN))))

    def __repr__(self) -> str:
        """Return what was said, on one line; what is long is shortened."""
        kinds = (name for name, field in type(self).model_fields.items() if is_choice(field))
        said = (name for name in kinds if name in self.model_fields_set)
        words = ", ".join(f"{name}={_SHORT.repr(getattr(self, name))}" for name in said)
        return " ".join(f"{type(self).__name__}({words})".split())

    __str__ = __repr__

    def __getstate__(self) -> dict[Any, Any]:
        """Leave out what was made of the fields: it is made again."""
        state = super().__getstate__()
        kept = {name: value for name, value in state["__dict__"].items() if name in type(self).model_fields}
        return {**state, "__dict__": kept}

    @classmethod
    def keys(cls) -> dict[str, str]:
        """Scene-file keys of this section and the attribute each one sets."""
        return {str(field.validation_alias or name): name for name, field in cls.model_fields.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return the section as a scene file writes it."""
        return {key: _plain(getattr(self, name)) for key, name in self.keys().items()}

    @classmethod
    def _spelled(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Spell keys as this class does."""
        known = cls.keys()
        for other, name in SPELLINGS.items():
            if other in values and name in known:
                if name in values:
                    raise SceneError(f"{cls.SECTION}: has both {other} and {name}, which are one; keep one")
                values = {name if key == other else key: value for key, value in values.items()}
        return values

    @classmethod
    def unknown(cls, key: str) -> Fault:
        """Say that a key is none of this section, and what to write instead."""
        return Fault(unknown_key(key, list(cls.keys()), cls.SECTION, cls._words()), (key,))

    @classmethod
    def _words(cls) -> dict[str, str]:
        """Return `WORDS`, with those of the classes that it is a kind of."""
        return {
            word: said
            for base in reversed(cls.__mro__)
            if issubclass(base, Model)
            for word, said in base.WORDS.items()
        }

    @classmethod
    def _faults(cls, error: ValidationError) -> list[str]:
        """Return one line for each key that something is wrong with."""
        found: dict[Any, Any] = {}
        for details in error.errors(include_url=False):
            found.setdefault(details["loc"][:1], details)
        known, words = list(cls.keys()), cls._words()
        meant = {
            meant_by(str(details["loc"][0]), words) or nearest(str(details["loc"][0]), known)
            for details in found.values()
            if details["type"] == "extra_forbidden"
        }
        lines: list[str] = []
        for details in found.values():
            if details["type"] == "faults":
                key = cls._key(details)
                lines += (Fault(line).below(*key) for line in details["ctx"]["lines"])
            elif details["type"] != "missing" or details["loc"][0] not in meant:
                lines.append(cls._line(details))
        return lines

    @classmethod
    def _key(cls, fault: ErrorDetails) -> Key:
        known = cls.keys()
        # Callers from Python may have used the attributes' names.
        key_of = {name: key for key, name in known.items()} | {key: key for key in known}
        return tuple(
            part if isinstance(part, int) else key_of[part]
            for part in fault["loc"]
            if part in key_of or type(part) is int
        )

    @classmethod
    def _line(cls, fault: ErrorDetails) -> Fault:
        place = cls._key(fault)
        parts = list(map(str, place))
        key = ".".join([cls.SECTION, *parts] if cls.SECTION else parts)
        if fault["type"] == "extra_forbidden":
            return cls.unknown(str(fault["loc"][0]))
        if fault["type"] == "missing":
            return Fault(f"{cls.SECTION}.{fault['loc'][0]} is missing")
        message = fault["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
        if fault["type"] == "greater_than_equal":  # pydantic writes out all zeros of 1e-15
            message = f"should be greater than or equal to {fault['ctx']['ge']:g}"
        if not key or (fault["type"] == "value_error" and not parts):
            return Fault(f"{cls.SECTION}: {message}", place)
        return Fault(f"{key} = {reprlib.repr(fault['input'])}: {message}", place)


def same(one: Any, other: Any) -> bool:
    """Tell whether two values are of the same types and hold the same, arrays number by number."""
    if one is other or type(one) is not type(other):
        return one is other
    if isinstance(one, np.ndarray):
        return bool(one.dtype == other.dtype and np.array_equal(one, other))
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one):
        one, other = vars(one), vars(other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return bool(one == other)


_PLAIN = (bool, int, float, str, tuple, Model, type(None))


class _Short(reprlib.Repr):
    """Of lists only the first few, of objects whatever they say themselves."""

    def repr_instance(self, x: Any, level: int) -> str:
        """Return what a model says whole: it is short."""
        return repr(x) if isinstance(x, Model) else super().repr_instance(x, level)


_SHORT = _Short()


def _plain(value: Any) -> Any:
    """Turn a field into what TOML and JSON can hold."""
    if isinstance(value, Model):
        return value.to_dict()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


@accepts(numbers(3))
def three_numbers(value: Any, largest: float = LARGEST_COORDINATE) -> tuple[float, float, float]:
    """Return x, y, z of a list, a tuple or an array; raises `ValueError` for anything else."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if (
        not isinstance(value, list | tuple)
        or len(value) != 3  # noqa: PLR2004 - x, y, z
        or not all(isinstance(item, int | float | np.number) and not isinstance(item, bool) for item in value)
    ):
        raise ValueError("should be three numbers [x, y, z]")
    if not all(abs(item) <= largest for item in value):  # NaN is not
        raise ValueError(f"should be three finite numbers, at most {largest:g}")
    x, y, z = (float(item) for item in value)
    return x, y, z


@accepts(NUMBER, numbers(3))
def one_or_three_numbers(value: Any) -> tuple[float, float, float]:
    """As `three_numbers`, of which one stands for three that are the same."""
    is_one = isinstance(value, int | float) and not isinstance(value, bool)
    try:
        return three_numbers((value,) * 3 if is_one else value)
    except ValueError as error:
        raise ValueError(str(error).replace("three", "one number or three", 1)) from None


@accepts({"type": "number", "minimum": 0}, numbers(3, minimum=0))
def as_colour(value: Any) -> tuple[float, float, float]:
    """Return three channels ≥ 0; raises `ValueError` for what is neither a number nor three of them."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = (value, value, value)
    try:
        rgb = three_numbers(value, LARGEST_COLOUR)
    except ValueError as error:
        raise ValueError(
            f"should be one number (grey) or three [r, g, b], at most {LARGEST_COLOUR:g}"
        ) from error
    if min(rgb) < 0:
        raise ValueError("should be ≥ 0 in every channel")
    return rgb


def section_within(parse: Callable[[Any], Any]) -> BeforeValidator:
    """Make the validator of a section within another: its faults are told beside the other's."""

    @accepts(lambda: accepted_by(parse))
    def check(value: Any) -> Any:
        try:
            return parse(value)
        except SceneError as error:
            raise PydanticCustomError("faults", "{lines}", {"lines": error.args}) from None

    return BeforeValidator(check)


def decided(value: T | Literal["auto"] | None) -> T:
    """Return a setting that has been decided; one that is still open is a mistake of the caller's."""
    if value is None or value == "auto":
        raise ValueError("a setting is still open; tfm_cl.plan decides it")
    return value


def number_or_auto(lowest: float, largest: float) -> BeforeValidator:
    """Make the validator of a number in a range that may also be ``"auto"``."""

    @accepts({"type": "number", "minimum": lowest, "maximum": largest}, {"const": "auto"})
    def check(value: Any) -> Any:
        if value == "auto":
            return value
        if isinstance(value, bool) or not isinstance(value, int | float) or not lowest <= value <= largest:
            raise ValueError(f"should be a number from {lowest:g} to {largest:g}, or 'auto'")
        return float(value)

    return BeforeValidator(check)


def number_or_none(lowest: float, largest: float) -> BeforeValidator:
    """Make the validator of a number in a range that may also be left out."""

    @accepts({"type": "number", "minimum": lowest, "maximum": largest})
    def check(value: Any) -> Any:
        if value is None:
            return value
        if isinstance(value, bool) or not isinstance(value, int | float) or not lowest <= value <= largest:
            raise ValueError(f"should be a number from {lowest:g} to {largest:g}")
        return float(value)

    return BeforeValidator(check)


def in_words(counts: tuple[int, ...]) -> str:
    """Write whole numbers as ``1 to 32`` or ``5 or 7``."""
    if len(counts) > 2 and counts == tuple(range(counts[0], counts[-1] + 1)):  # noqa: PLR2004
        return f"{counts[0]} to {counts[-1]}"
    step = counts[1] - counts[0] if len(counts) > 1 else 0
    if len(counts) > 2 and counts == tuple(range(counts[0], counts[-1] + 1, step)):  # noqa: PLR2004
        return f"{counts[0]}, {counts[1]}, … {counts[-1]}"
    return " or ".join(map(str, counts))


def count_or_auto(largest: int, *, least: int = 1) -> PlainValidator:
    """Make the validator of a whole number in a range that may also be ``"auto"``."""

    @accepts({"type": "integer", "minimum": least, "maximum": largest}, {"const": "auto"})
    def check(value: Any) -> Any:
        if value == "auto" or (type(value) is int and least <= value <= largest):
            return value
        raise ValueError(f"should be a whole number from {least} to {largest}, or 'auto'")

    return PlainValidator(check)


Point = Annotated[Triple, BeforeValidator(three_numbers)]
Vec3 = Accepts[Numbers, Point]
"""A point or vector in world units; lists, tuples and arrays are accepted."""

RGB = Accepts[float | Numbers, Annotated[Triple, BeforeValidator(as_colour)]]
"""Three channels ≥ 0, scene-linear Rec. 709; one number means grey."""


def check_different(one: Triple, other: Triple, what: str) -> None:
    """Raise `ValueError` when two points give no direction."""
    distance = float(np.linalg.norm(np.subtract(one, other)))
    largest = float(np.abs([one, other]).max())
    if distance <= 1e-39:  # noqa: PLR2004 - beyond float32
        raise ValueError(f"{what} are the same point {list(one)}: no direction")
    if distance <= CLOSEST * largest:
        raise ValueError(
            f"{what} are {distance:g} apart, too little for a direction at coordinates of {largest:g}; "
            "move the scene nearer to the origin"
        )
