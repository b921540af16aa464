"""Fields of models: those that are given in several forms, and what `help` and a JSON Schema tell of all."""

import inspect
import re
import textwrap
from collections.abc import Callable, Sequence
from types import NoneType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Generic,
    Literal,
    Self,
    TypeVar,
    get_args,
    get_origin,
    overload,
)

from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, PlainValidator, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

Given = TypeVar("Given")
Kept = TypeVar("Kept")

F = TypeVar("F", bound=Callable[..., Any])

NUMBER = {"type": "number"}
TEXT = {"type": "string"}
SECTION = "x-section"
"""In the words of JSON Schema: key of the name of a section whose forms these are."""

Numbers = Sequence[float] | NDArray[Any]
"""What is accepted for several numbers."""

WIDTH = 88
"""Columns of a docstring."""
LARGEST = 1e9
"""A limit so far out only keeps float32 from overflowing, and is not told."""
BOUNDS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
MESSAGES = (
    (r"^.*should be (an? )?", ""),
    (r",? (at most|from -1e\+\d+ to) 1e\+\d+", ""),
    (r"from (\S+) to 1e\+\d+", r"≥ \1"),
    (r"^.*unknown .*; known: ", "one of "),
)
"""What becomes of the words of a message where they say what a field takes."""

if TYPE_CHECKING:

    class Accepts(Generic[Given, Kept]):
        """A field that is given in several forms and kept in one: ``field: Accepts[Given, Kept]``.

        Type checkers are told that the constructor takes the first and the attribute is the second. A default
        needs ``validate_default=True``: it is one of those given.
        """

        @overload
        def __get__(self, instance: None, owner: type) -> Self: ...
        @overload
        def __get__(self, instance: object, owner: type) -> Kept: ...
        def __get__(self, instance: object, owner: type) -> Any: ...
        def __set__(self, instance: object, value: Given) -> None: ...
else:

    class Accepts:
        """At run time a field is of the type that is kept, whose validators take the others."""

        def __class_getitem__(cls, types: tuple[Any, Any]) -> Any:
            """Return the second."""
            return types[1]


def accepts(*forms: dict[str, Any] | Callable[[], dict[str, Any]]) -> Callable[[F], F]:
    """Say which values a validator accepts: those of any of the forms, each a JSON Schema.

    `tfm_cl.scene.schema` puts it into the schema of the key that is validated. What depends on what plugins
    bring is made when it is asked for.
    """

    def said(validator: F) -> F:
        validator.__dict__["accepts"] = forms
        return validator

    return said


def accepted_by(validator: Callable[..., Any]) -> dict[str, Any]:
    """Return the JSON Schema of what a validator accepts, as `accepts` said it; empty where it did not."""
    forms = [form() if callable(form) else form for form in getattr(validator, "accepts", ())]
    return forms[0] if len(forms) == 1 else {"anyOf": forms} if forms else {}


def numbers(count: int, kind: str = "number", **limits: float) -> dict[str, Any]:
    """Say that it is an array of so many numbers, each of which has these limits."""
    return {"type": "array", "items": {"type": kind, **limits}, "minItems": count, "maxItems": count}


def docstring_of(model: type[BaseModel]) -> str | None:
    """Return a model's docstring with its fields, as numpydoc writes parameters; None without one."""
    text: str | None = vars(model).get("__doc__")
    entries = [_entry(name, field) for name, field in _fields(model)]
    if text is None or not entries:
        return text
    return "\n".join([inspect.cleandoc(text), "", "Parameters", "----------", *entries])


def signature_of(model: type[BaseModel]) -> inspect.Signature:
    """Return a model's signature without types, which its docstring tells in words."""
    named = {name: _parameter(name, field) for name, field in _fields(model)}
    # What its own `__init__` takes by position comes first.
    for name, own in inspect.signature(model.__init__).parameters.items():
        if name in named and own.kind is own.POSITIONAL_OR_KEYWORD:
            named[name] = named[name].replace(kind=own.kind)
    return inspect.Signature(sorted(named.values(), key=lambda parameter: parameter.kind))


def is_choice(field: FieldInfo) -> bool:
    """Tell whether a field may have several values; `type`, which names a class, has one."""
    return get_args(field.annotation) != (field.default,)


def takes(field: FieldInfo) -> str:
    """Return what a field takes: where a check of our own knows it, in the words of its message."""
    kinds = [kind for kind in get_args(field.annotation) or [field.annotation] if kind is not NoneType]
    if get_origin(field.annotation) is Literal:
        return "{" + ", ".join(map(repr, kinds)) + "}"
    if has_check(field) or len(kinds) > 1 or not isinstance(kinds[0], type):
        said = complaints(field) or ["anything"]
        for pattern, instead in MESSAGES:
            said = [re.sub(pattern, instead, message) for message in said]
        return " or ".join(dict.fromkeys(said))
    return " ".join([kinds[0].__name__, " and ".join(bounds_of(field))]).strip()


def has_check(field: FieldInfo) -> bool:
    """Tell whether a field has a check of our own, whose messages say what it takes."""
    return any(isinstance(limit, BeforeValidator | PlainValidator) for limit in field.metadata)


def bounds_of(field: FieldInfo) -> list[str]:
    """Return the limits of a number, as ``≥ 0``."""
    return [
        f"{sign} {getattr(limit, name):g}"
        for limit in field.metadata
        for name, sign in BOUNDS.items()
        if hasattr(limit, name) and abs(getattr(limit, name)) < LARGEST
    ]


def complaints(field: FieldInfo) -> list[str]:
    """Return what is said of an impossible value; nothing where any is possible."""
    declared: Any = field.annotation
    for limit in field.metadata:
        declared = Annotated[declared, limit]
    try:
        TypeAdapter(declared).validate_python(object())
    except ValidationError as error:
        return [fault.get("ctx", {}).get("lines", [fault["msg"]])[0] for fault in error.errors()]
    return []


def _fields(model: type[BaseModel]) -> list[tuple[str, FieldInfo]]:
    """Return the fields that there is a choice of, those that are required first."""
    fields = [(name, field) for name, field in model.model_fields.items() if is_choice(field)]
    return sorted(fields, key=lambda found: not found[1].is_required())


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    default = inspect.Parameter.empty if field.is_required() else field.default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default)


def _entry(name: str, field: FieldInfo) -> str:
    facts = [takes(field)]
    if not field.is_required():
        facts.append("optional" if field.default is None else f"default {field.default!r}")
    meaning = textwrap.indent(textwrap.fill(field.description or "", WIDTH), "    ")
    return f"{name} : {', '.join(facts)}\n{meaning}"


if TYPE_CHECKING:
    DescribedModel = BaseModel
else:

    class _Described(type(BaseModel)):
        __doc__ = property(docstring_of)
        """Of each model; made when it is asked for."""

        def __dir__(cls) -> list[str]:
            """Return what is of use, and leave pydantic's own out."""
            return [name for name in super().__dir__() if not name.startswith("__pydantic_")]

    class _Signature:
        def __get__(self, instance: object, owner: type[BaseModel]) -> inspect.Signature:
            return signature_of(owner)

    class DescribedModel(BaseModel, metaclass=_Described):
        """A model of which `help` tells all."""

        @classmethod
        def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
            """Put the signature in the place of pydantic's."""
            super().__pydantic_init_subclass__(**kwargs)
            cls.__signature__ = _Signature()
