"""The JSON Schema of a scene file, from the models: what editors complete and check as one is written."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from tfm_cl.model import SPELLINGS, Model
from tfm_cl.model_fields import SECTION, accepted_by
from tfm_cl.scene.bodies.base import BODIES, MOST_BODIES
from tfm_cl.scene.bodies.homogeneous import SHAPES
from tfm_cl.scene.camera import RIVALS, Camera
from tfm_cl.scene.keyframes import INTERPOLATIONS
from tfm_cl.scene.lights.base import LIGHTS
from tfm_cl.scene.movable import STEPS, Movable
from tfm_cl.scene.phases.base import PHASES
from tfm_cl.scene.scene_file import ARRAYS, SECTIONS
from tfm_cl.scene.solids.base import MESHES, SOLIDS

DIALECT = "https://json-schema.org/draft/2020-12/schema"
OF_SECTIONS = {
    "volume": "what fills space with density: a table, or [[volume]] tables of several bodies",
    "medium": "what bodies are made of that have no medium of their own",
    "camera": "where the picture is taken from; what is left out is placed",
    "light": "[[light]] tables; without one, a spot is placed",
    "solid": "[[solid]] tables: what stands in the way of light and sight",
    "ambient": "light from everywhere",
    "shadow": "settings of the solids' shadows in the medium",
    "map": "settings of the light pass",
    "march": "settings of the view pass",
    "image": "settings of the image that is written",
}
"""What editors say of each."""


KEYFRAMES: dict[str, Any] = {
    "type": "array",
    "minItems": 1,
    "items": {
        "type": "object",
        "properties": {
            "frame": {"type": "number", "description": "at which it has the value"},
            "value": {"description": "as the key itself takes it"},
            "interpolation": {
                "enum": list(INTERPOLATIONS),
                "default": INTERPOLATIONS[0],
                "description": "of numbers, from here to the next keyframe; all else keeps its value",
            },
        },
        "required": ["frame", "value"],
        "additionalProperties": False,
    },
}
"""Of any key, in place of a value that stays."""


class _Writer(GenerateJsonSchema):
    """Writes the schema of a model: of each key what its validators accept; TOML has no null."""

    schema_dialect = DIALECT

    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> JsonSchemaValue:
        """Write what the first validator accepts, or else the type."""
        return _taken(schema) or super().function_before_schema(schema)

    def function_plain_schema(self, schema: core_schema.PlainValidatorFunctionSchema) -> JsonSchemaValue:
        """Write what the validator accepts."""
        return _taken(schema) or super().function_plain_schema(schema)

    def function_after_schema(self, schema: core_schema.AfterValidatorFunctionSchema) -> JsonSchemaValue:
        """Write what the last validator accepts, or else what those before it do."""
        return _taken(schema) or super().function_after_schema(schema)

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Write what it is where it is given."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Leave a default of None out: then the key is left out."""
        if schema.get("default") is None and "default_factory" not in schema:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Keys say enough."""
        del schema
        return False


def _taken(schema: Any) -> JsonSchemaValue:
    return dict(accepted_by(schema["function"]["function"]))  # which pydantic changes


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema, draft 2020-12, of scene files.

    Of the alternatives in a place that is one whose ``type``, ``shape`` or key of a file a table has. Every
    key is there, with what it means, its default and range; what follows only from several keys together is
    checked when the file is read.
    """
    properties: dict[str, Any] = {name: {"$ref": f"#/$defs/{name}"} for name in (*SECTIONS, *ARRAYS)}
    one = properties["volume"]
    several = {"type": "array", "items": one, "minItems": 1, "maxItems": MOST_BODIES}
    properties["volume"] = {"anyOf": [one, several]}
    properties |= {name: {"type": "array", "items": properties[name]} for name in ARRAYS}
    definitions = {name: _of_model(model) for name, model in SECTIONS.items()}
    shapes = [_named(model, "shape") for model in SHAPES.values()]
    files = [
        _of_model(model)
        for made_by in BODIES.values()
        if isinstance(model := getattr(made_by, "__self__", None), type)  # of others, SHAPES
    ]
    solids = [_of_model(model) for model in MESHES.values()]
    definitions |= {
        "volume": {"oneOf": [*files, *shapes]},
        "light": {"oneOf": [_named(model, "type", optional="spot") for model in LIGHTS.values()]},
        "solid": {"oneOf": [*solids, *(_named(model, "shape") for model in SOLIDS.values())]},
        "phase": {"oneOf": [_by_name(PHASES), *(_named(model, "type") for model in PHASES.values())]},
        "keyframes": KEYFRAMES,
    }
    return {
        "$schema": DIALECT,
        "title": "tfm_cl scene",
        "type": "object",
        "properties": {
            name: {"description": OF_SECTIONS[name]} | properties[name]
            for name in sorted(properties, key=list(OF_SECTIONS).index)
        },
        "required": ["volume"],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _of_model(model: type[Model]) -> dict[str, Any]:
    schema: dict[str, Any] = _linked(model.model_json_schema(by_alias=True, schema_generator=_Writer))
    properties = schema["properties"]
    for other, name in SPELLINGS.items():
        if name in properties:
            properties[other] = properties[name] | {"description": f"as {name}"}
    schema["properties"] = {name: _or_keyframes(said) for name, said in properties.items()}
    schema["title"] = model.__name__
    schema["description"] = re.sub(r"`+", "", (model.__doc__ or "").partition("\n")[0])
    if issubclass(model, Camera):
        schema.pop("required", None)  # what is left out is placed
    rivals = [(other, name) for other, name in SPELLINGS.items() if name in properties]
    rivals += [("transform", step) for step in STEPS] if issubclass(model, Movable) else []
    rivals += _pairs(RIVALS) if issubclass(model, Camera) else []
    if rivals:
        schema["allOf"] = [{"not": {"required": list(pair)}} for pair in rivals]
    return schema


def _or_keyframes(said: dict[str, Any]) -> dict[str, Any]:
    """Add keyframes to what a key takes, unless it tells of what kind a table is."""
    if "const" in said:
        return said
    told = {name: said[name] for name in ("description", "default", "examples") if name in said}
    value = {name: item for name, item in said.items() if name not in told}
    return told | {"anyOf": [value, {"$ref": "#/$defs/keyframes"}]}


def _linked(value: Any) -> Any:
    """Make references of what names a section."""
    if isinstance(value, dict):
        link = {"$ref": f"#/$defs/{value[SECTION]}"} if SECTION in value else {}
        return {key: _linked(item) for key, item in value.items() if key != SECTION} | link
    return [_linked(item) for item in value] if isinstance(value, list) else value


def _pairs(rivals: Iterable[tuple[tuple[str, ...], tuple[str, ...], str]]) -> list[tuple[str, str]]:
    return [(one, other) for ones, others, _ in rivals for one in ones for other in others]


def _named(model: type[Model], key: str, optional: str = "") -> dict[str, Any]:
    """Write the schema of a model that one of its keys tells; that may be left out of one of them."""
    schema = _of_model(model)
    if schema["properties"][key].get("const") != optional:
        schema["required"] = [key, *schema.get("required", ())]
    return schema


def _by_name(kinds: Iterable[str]) -> dict[str, Any]:
    names = "|".join(map(re.escape, kinds))
    return {
        "type": "string",
        "pattern": f"^({names})(:.*)?$",
        "description": "its name, and its numbers: hg:0.3",
    }
