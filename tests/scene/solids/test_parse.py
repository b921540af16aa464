"""Solids as tables of a scene file."""

import numpy as np
import pytest

from tfm_cl.errors import SceneError
from tfm_cl.scene.solids import SOLIDS, BoxSolid, MeshSolid, PlaneSolid, SphereSolid, parse_solid

TURNED = [0, -2, 0, 1, 2, 0, 0, 2, 0, 0, 2, 3, 0, 0, 0, 1]

TABLES = [
    {"shape": "plane"},
    {"shape": "plane", "point": [0, -1, 0], "normal": [0, 2, 1], "albedo": 0.5},
    {"shape": "sphere", "centre": [1, 2, 3], "radius": 2.5, "transform": TURNED},
    {"shape": "box", "from": [0, 0, 0], "to": [1, 2, 3], "albedo": [0.1, 0.2, 1.0]},
    {"shape": "plane", "albedo": "wood.jpg", "texture_scale": 0.5, "holdout": True},
    {"shape": "ground"},
    {"shape": "ground", "up": "-z", "height": 2.5, "albedo": "/images/sand.png", "visible": False},
    {"mesh": "/models/statue.glb"},
    {"mesh": "statue.obj", "albedo": "paint.png", "smooth": 30},
    {"mesh": "statue.obj", "smooth": False},
    {"mesh": "/models/statue.PLY", "albedo": [0, 0.5, 1], "transform": np.eye(4).tolist()},
]


@pytest.mark.parametrize("table", TABLES)
def test_what_is_written_is_read_again(table):
    solid = parse_solid(table)
    written = solid.to_dict()
    assert parse_solid(written) == solid
    assert parse_solid(written).to_dict() == written
    assert {"mesh", "shape"} & set(table) == {"mesh", "shape"} & set(written)
    assert ("albedo" in written) or "mesh" in table  # None is not for TOML


def test_every_shape_needs_only_its_name():
    assert set(SOLIDS) == {"plane", "sphere", "box", "ground"}
    for shape, cls in SOLIDS.items():
        assert type(parse_solid({"shape": shape})) is cls
    assert PlaneSolid().normal == (0, 1, 0)
    np.testing.assert_array_equal(SphereSolid().bounds(), [[-1] * 3, [1] * 3])
    np.testing.assert_array_equal(BoxSolid().bounds(), [[-1] * 3, [1] * 3])
    assert PlaneSolid().bounds() is None


def test_a_transform_is_row_major():
    for transform in (TURNED, np.reshape(TURNED, (4, 4)).tolist(), np.reshape(TURNED, (4, 4))):
        solid = SphereSolid(transform=transform)
        np.testing.assert_array_equal(solid.world_from_object[:3, 3], [1, 2, 3])
        np.testing.assert_array_equal(solid.bounds(), [[-1, 0, 1], [3, 4, 5]])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "solid: should have mesh (a file) or shape (plane, sphere, box, ground)"),
        ({"mesh": "a.ply", "shape": "box"}, "solid: has both mesh and shape"),
        ({"shpae": "box"}, "unknown key 'shpae' in [solid]; did you mean 'shape'?"),
        ({"shape": "spere"}, "solid.shape: unknown shape 'spere'; did you mean 'sphere'?"),
        ({"shape": 3}, "solid.shape: unknown shape '3'"),
        ({"shape": "sphere", "centr": [0, 0, 0]}, "did you mean 'centre'?"),
        ({"shape": "sphere", "normal": [0, 0, 1]}, "unknown key 'normal' in [solid]"),
        ({"shape": "sphere", "radius": 0.0}, "solid.radius = 0.0"),
        ({"shape": "sphere", "radius": float("nan")}, "solid.radius = nan"),
        ({"shape": "plane", "normal": [0, 0, 0]}, "should not be zero"),
        ({"shape": "box", "from": [0, 0, 0], "to": [1, 0, 1]}, "should be below"),
        ({"shape": "box", "from": [0, 0]}, "solid.from = [0, 0]: should be three numbers"),
        ({"shape": "box", "albedo": [0, 0, 1.5]}, "solid.albedo = [0, 0, 1.5]: should be from 0 to 1"),
        ({"mesh": "a.ply", "albedo": -1}, "solid.albedo = -1: should be ≥ 0"),
        ({"shape": "box", "transform": [1, 0, 0]}, "solid.transform = [1, 0, 0]: should be 16 numbers"),
        ({"shape": "box", "transform": [[1, 0, 0, 0]] * 3 + [[1, 0]]}, "should be 16 numbers"),
        ({"shape": "box", "transform": ["a"] * 16}, "should be 16 numbers"),
        ({"shape": "box", "transform": [float("inf")] * 16}, "should be finite numbers"),
        ({"shape": "box", "transform": [1] * 16}, "its last row is 0 0 0 1"),
        (
            {"shape": "box", "transform": [1, 0, 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 1]},
            "makes all flat",
        ),
        ({"shape": "box", "transform": [0] * 15 + [1]}, "makes all flat"),
        ({"mesh": ""}, "should be the name of a file"),
        ({"mesh": 5}, "solid.mesh = 5"),
        ({"mesh": "a\n.ply"}, "without control characters"),
        ({"mesh": "a\0.ply"}, "without control characters"),
        ({"mesh": "model.pkl"}, "known kind: .glb .gltf .obj .off .ply .stl"),
        ({"mesh": "https://example.org/a.zip"}, "known kind"),
        ({"mesh": "a.ply", "radius": 1.0}, "unknown key 'radius'"),
        ({"mesh": "a.ply", "albedo": "a.tga"}, "image of a known kind: .jpeg .jpg .png"),
        ({"mesh": "a.ply", "smooth": 190}, "solid.smooth = 190: should be true, false, or an angle"),
        ({"mesh": "a.ply", "smooth": "yes"}, "should be true, false, or an angle"),
        ({"shape": "sphere", "albedo": "a.png"}, "solid.albedo = 'a.png': should be one number"),
        ({"shape": "plane", "texture_scale": 2.0}, "texture_scale is for an image as albedo"),
        ({"shape": "box", "visible": False, "holdout": True}, "is not seen; keep one"),
        ({"shape": "ground", "height": "high"}, "solid.height = 'high': should be a number from"),
        ({"shape": "ground", "up": "w"}, "solid.up = 'w'"),
        ({"shape": "ground", "transform": TURNED}, "a ground is not moved"),
    ],
    ids=str,
)
def test_one_line_says_what_is_wrong(table, message):
    with pytest.raises(SceneError) as caught:
        parse_solid(table)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mesh_of_arrays_is_not_written():
    solid = MeshSolid.from_arrays(np.eye(3), [[0, 1, 2]])
    with pytest.raises(SceneError, match="cannot be written to a scene file"):
        solid.to_dict()


def test_a_model_is_made_without_its_file():
    solid = MeshSolid(mesh="/nowhere/at/all.glb")
    with pytest.raises(SceneError, match=r"^/nowhere/at/all.glb: no such file$"):
        solid.load()


def test_a_loaded_solid_is_still_the_same():
    one, other = (MeshSolid(mesh="a.ply"), MeshSolid(mesh="a.ply"))
    one.__dict__["_triangles"] = MeshSolid.from_arrays(np.eye(3), [[0, 1, 2]]).load()
    assert one == other
    assert one.replace(albedo=0.5).albedo == (0.5, 0.5, 0.5)
    assert "_triangles" not in one.replace(albedo=0.5).__dict__
