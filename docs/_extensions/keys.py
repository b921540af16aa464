"""The keys of the scene file's sections as Markdown, from the models that check them."""

import json
import re
import tomllib
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from entries import Entry, definition_list
from pydantic.fields import FieldInfo

from tfm_cl.model import Model
from tfm_cl.model_fields import bounds_of, complaints, has_check
from tfm_cl.scene.bodies.homogeneous import SHAPES
from tfm_cl.scene.bodies.primitive_settings import CurvesSettings, PointsSettings, PolygonsSettings
from tfm_cl.scene.lights import LIGHTS
from tfm_cl.scene.phases import PHASES
from tfm_cl.scene.scene_file import SECTIONS
from tfm_cl.scene.solids import SOLIDS, MeshSolid
from tfm_cl.scene.transform import IDENTITY

EXAMPLES = Path(__file__).parents[1] / "reference" / "examples.toml"
"""Tables of scene files in which every key occurs."""

KINDS: dict[str, dict[str, type[Model]]] = {
    "light": dict(LIGHTS),
    "solid": {"mesh": MeshSolid, **SOLIDS},
    "shape": dict(SHAPES),
    "primitive": {cls.KEY: cls for cls in (PointsSettings, CurvesSettings, PolygonsSettings)},
    "phase": dict(PHASES),
}
"""What there are several kinds of -> the models of the kinds, by the name that tells them apart."""

UNIT = re.compile(
    r"(?:^|, |: |in )(world units|object units|the file's units|degrees|millimetres|µm)\b"
    r"|(?:^|, |: |in )(texels|pixels|stops|steps)\b"
    r"|(?:^|RGB )(radiance|irradiance)\b"
    r"|(per world unit)\b"
)
"""Where the description of a number names its unit."""

WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text"}
"""Type -> as a user calls it."""

MESSAGES = (
    (r"Value error, |Input |should be ", ""),
    (r"^\(?.*(a table) like.*", r"\1"),
    (r"from -1e\+\d+ to 1e\+\d+", ""),
    (r"from (\S+) to 1e\+\d+", r"≥ \1"),
    (r", at most 1e\+\d+", ""),
    (r"^an? ", ""),
    (r"'", '"'),
    (r" +,", ","),
)
"""What becomes of the words of a message where they say what a key takes."""


def keys_of(name: str) -> str:
    """Return the keys of ``SECTION``, of ``KIND/NAME``, or those that all of a kind have: ``KIND/all``."""
    section, _, kind = name.partition("/")
    if not kind:
        return _listed(section, SECTIONS[section], list(SECTIONS[section].keys()))
    models, common = KINDS[section], _common(section)
    if kind == "all":
        return _listed(section, next(iter(models.values())), common)
    own = [key for key in models[kind].keys() if key not in common]  # noqa: SIM118 - no dict
    return _listed(f"{section}-{kind}", models[kind], own)


def every_key() -> list[tuple[type[Model], str]]:
    """Return all that a scene file can say: models and their keys."""
    kinds = (model for models in KINDS.values() for model in models.values())
    return [(model, key) for model in (*SECTIONS.values(), *kinds) for key in model.keys()]  # noqa: SIM118


@cache
def examples() -> list[tuple[type[Model], dict[str, Any]]]:
    """Return tables of scene files with the models that they are for."""
    tables = tomllib.loads(EXAMPLES.read_text(encoding="utf-8"))
    return [(model_of(section, table), table) for section, found in tables.items() for table in found]


def model_of(section: str, table: dict[str, Any]) -> type[Model]:
    """Return the model of a table of a scene file."""
    if section in {"light", "phase"}:
        return KINDS[section][table["type"]]
    if section == "solid":
        return KINDS[section][table.get("shape", "mesh")]
    if section == "volume" and "shape" in table:
        return KINDS["shape"][table["shape"]]
    primitives = KINDS["primitive"] if section == "volume" else {}
    return next((model for key, model in primitives.items() if key in table), SECTIONS.get(section, Model))


def example_of(model: type[Model], key: str) -> str:
    """Return a line of a scene file that sets a key: from `EXAMPLES`, the field's own, or to its default.

    Raises
    ------
    ValueError
        Neither says one.
    """
    field = _field(model, key)
    found = [table[key] for of, table in examples() if of is model and key in table]
    found += field.examples or []
    if not found and (field.is_required() or not _default(field)):
        raise ValueError(f"{EXAMPLES.name}: {model.__name__} needs a table that sets '{key}'")
    return f"{key} = {_toml(found[0]) if found else _default(field)}"


def _common(section: str) -> list[str]:
    """Return the keys that are the same, with the same words and default, in all of a kind."""
    first, *others = KINDS[section].values()
    return [
        key
        for key in [*first.keys()]
        if all(key in {*cls.keys()} and facts_of(cls, key) == facts_of(first, key) for cls in others)
    ]


def _listed(prefix: str, model: type[Model], keys: list[str]) -> str:
    # What has to be there comes first; else they are in the order of the model.
    entries = sorted((_entry(prefix, model, key) for key in keys), key=lambda entry: not entry.required)
    return definition_list(entries) or "It has no keys of its own."


def _field(model: type[Model], key: str) -> FieldInfo:
    return model.model_fields[model.keys()[key]]


def facts_of(model: type[Model], key: str) -> tuple[str, str, str]:
    """Return what a key takes, its default and its meaning."""
    field = _field(model, key)
    # A subclass that narrows a field's type leaves the description to its base.
    fields = (base.model_fields.get(model.keys()[key]) for base in model.__mro__ if issubclass(base, Model))
    meaning = next((found.description for found in fields if found and found.description), "")
    return _takes(field), _default(field), meaning or ""


def _entry(prefix: str, model: type[Model], key: str) -> Entry:
    takes, default, meaning = facts_of(model, key)
    numeric = re.search("number|angle", takes)
    unit = " ".join(found[found.lastindex or 0] for found in UNIT.finditer(meaning)) if numeric else ""
    example, required = example_of(model, key), _field(model, key).is_required()
    return Entry(key, f"{prefix}-{key}", takes, default, meaning, unit, example, required)


def _takes(field: FieldInfo) -> str:
    """Return type and range in words; where a check of our own knows them, in the words of its message."""
    kinds = [kind for kind in get_args(field.annotation) or [field.annotation] if kind is not NoneType]
    if get_origin(field.annotation) is Literal:
        return " | ".join(map(_toml, kinds))
    if len(kinds) == 1 and kinds[0] in WORDS and not has_check(field):
        return ", ".join([WORDS[kinds[0]], *bounds_of(field)])
    return _said(field)


def _said(field: FieldInfo) -> str:
    """Return what the message about an impossible value says that it should be."""
    said = " or ".join(complaints(field))
    if not said:
        raise ValueError(f"{field.description}: takes anything")
    for pattern, instead in MESSAGES:
        said = re.sub(pattern, instead, said)
    if known := re.fullmatch(r"unknown .*; known: (.*)", said):
        return " | ".join(f'"{name}"' for name in known[1].split(", "))
    return said


def _default(field: FieldInfo) -> str:
    return "" if field.is_required() or field.default in {None, "", (), IDENTITY} else _toml(field.default)


def _toml(value: Any) -> str:
    """Write a value on one line."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(item)}' for key, item in value.items())} }}"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
