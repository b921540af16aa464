"""The JSON Schema of scene files: what is right passes, what is wrong does not, and no key is missing."""

import tomllib
from copy import deepcopy
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from tfm_cl.scene.bodies.homogeneous import SHAPES
from tfm_cl.scene.bodies.primitive_settings import CurvesSettings, PointsSettings, PolygonsSettings
from tfm_cl.scene.lights import LIGHTS
from tfm_cl.scene.phases import PHASES
from tfm_cl.scene.scene_file import SECTIONS
from tfm_cl.scene.schema import scene_schema
from tfm_cl.scene.solids import SOLIDS, MeshSolid

SAMPLES = Path(__file__).resolve().parents[2] / "volumes"
BODIES = (*SHAPES.values(), PointsSettings, CurvesSettings, PolygonsSettings)
MODELS = (*SECTIONS.values(), *BODIES, *LIGHTS.values(), *PHASES.values(), *SOLIDS.values(), MeshSolid)


@pytest.fixture(scope="module")
def schema():
    return scene_schema()


@pytest.fixture(scope="module")
def validator(schema):
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.mark.parametrize("path", sorted(SAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_samples_pass(validator, path):
    validator.validate(tomllib.loads(path.read_text(encoding="utf-8")))


RIGHT = """
[[volume]]
file = "a.npy"
density_scale = "auto"
voxel_size = 0.1
colour = false
medium = { sigma_s = 0.5, phase = "hg:0.3" }
translate = [0, 1, 0]
rotate = [0, 90, 0]
scale = 2
[[volume]]
shape = "sphere"
center = [1, 2, 3]
[medium]
sigma_a = [0.1, 0, 0]
phase = { type = "mix", phases = ["mie:8", { type = "rayleigh" }], weights = [1, 2] }
[camera]
up = "z"
focal_length = 35
[map]
coeffs = "auto"
res = 64
bytes = 9
[image]
background = "environment"
exposure = "auto"
aov = ["depth", "lights"]
[[light]]
from = [1, 2, 3]
to = [0, 0, 0]
[[light]]
type = "sky"
[[solid]]
mesh = "a.ply"
smooth = 30
albedo = "a.png"
[[solid]]
shape = "ground"
up = "auto"
height = 1
transform = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""


def test_every_spelling_passes(validator):
    validator.validate(tomllib.loads(RIGHT))


CHANGING = """
[volume]
file = "smoke.####.vdb"
frame_offset = 100
frame_step = 0.5
before = "empty"
density_scale = [{ frame = 1, value = 2 }, { frame = 9.5, value = 3, interpolation = "smooth" }]
[medium]
phase = { type = "hg", g = [{ frame = 1, value = 0.3 }] }
[camera]
from = [{ frame = 1, value = [0, 0, 9] }]
[[light]]
type = "sky"
elevation = [{ frame = 1, value = 5, interpolation = "step" }]
[[solid]]
mesh = "rock.####.ply"
after = "hold"
transform = [{ frame = 1, value = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }]
"""


def test_keyframes_pass_wherever_a_value_does(validator):
    validator.validate(tomllib.loads(CHANGING))


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (("camra",), {}),
        (("volume",), []),
        (("volume", 0, "file"), 3),
        (("volume", 0, "shape"), "box"),
        (("volume", 0, "transform"), [1] * 16),
        (("volume", 0, "density_scale"), -1),
        (("volume", 0, "medium"), {"sigma_s": "much"}),
        (("volume", 1, "centre"), [1, 2, 3]),
        (("volume", 1, "radius"), 0),
        (("medium", "albedo"), 0.9),
        (("medium", "sigma_a"), [1, 2]),
        (("medium", "sigma_a"), [1, 2, -3]),
        (("medium", "phase"), "hgg:0.3"),
        (("medium", "phase"), {"type": "hg", "g": 1}),
        (("medium", "phase"), {"g": 0.3}),
        (("camera", "up"), "w"),
        (("camera", "fov"), 30),
        (("camera", "res"), [0.5, 3]),
        (("map", "coeffs"), "many"),
        (("map", "res"), 1.5),
        (("image", "samples"), 3),
        (("image", "aov"), ["deep"]),
        (("image", "background"), "sky"),
        (("light", 0, "type"), "sun lamp"),
        (("light", 0, "cone"), 90),
        (("light", 1, "cone"), 30),
        (("light", 1, "name"), "a key"),
        (("solid", 0, "smooth"), 200),
        (("solid", 0, "albedo"), 1.5),
        (("solid", 1, "shape"), "cone"),
        (("solid", 1, "height"), [{"frame": 1}]),
        (("solid", 1, "height"), [{"value": 1}]),
        (("solid", 1, "height"), [{"frame": "1", "value": 1}]),
        (("solid", 1, "height"), [{"frame": 1, "value": 1, "interpolation": "cubic"}]),
        (("solid", 1, "height"), [{"frame": 1, "value": 1, "ease": 1}]),
        (("volume", 0, "before"), "stay"),
    ],
)
def test_what_is_wrong_does_not(validator, at, value):
    scene = tomllib.loads(RIGHT)
    before = deepcopy(scene)
    table = scene
    for key in at[:-1]:
        table = table[key]
    table[at[-1]] = value
    assert scene != before
    assert not validator.is_valid(scene)


def test_every_key_is_there_with_its_meaning(schema):
    tables = [
        table for definition in schema["$defs"].values() for table in definition.get("oneOf", [definition])
    ]
    by_name = {table["title"]: table["properties"] for table in tables if "title" in table}
    by_name["VolumeSettings"] = next(
        table["properties"] for table in schema["$defs"]["volume"]["oneOf"] if table["required"] == ["file"]
    )
    assert set(schema["properties"]) == {*SECTIONS, "light", "solid"}
    for model in MODELS:
        properties = by_name[model.__name__]
        assert set(model.keys()) == properties.keys() - {"center"}, model
        for key, said in properties.items():
            if "const" not in said:  # what tells the kind
                assert said.get("description"), (model, key)
            assert said.keys() & {"type", "enum", "const", "anyOf", "oneOf", "$ref"}, (model, key)
        for key, name in model.keys().items():
            field = model.model_fields[name]
            has_default = not field.is_required() and field.default is not None
            assert ("default" in properties[key]) == has_default, (model, key)


def test_defaults_pass(schema):
    """What is written for a key that is left out is right itself."""
    for definition in schema["$defs"].values():
        for table in definition.get("oneOf", [definition]):
            for key, said in table.get("properties", {}).items():
                if "default" in said:
                    one = {"$defs": schema["$defs"], **said}
                    assert Draft202012Validator(one).is_valid(said["default"]), key
