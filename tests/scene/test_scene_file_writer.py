"""Scenes that are saved load as the same, in as few words as that takes."""

import tomllib
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import scene_text, to_toml, without_defaults
from tfm_cl.scene.settings import ImageSettings

SAMPLES = Path(__file__).resolve().parents[2] / "volumes"
PARTS = [field.name for field in fields(tfm.Scene) if field.name not in {"bodies", "flames"}]

ARRAYS = ("data", "colour", "world_from_index", "density_scale", "positions", "radii", "densities")


def check_same(copy, scene):
    """All that a picture is made from is the same, to the last bit."""
    for part in PARTS:
        assert getattr(copy, part) == getattr(scene, part), part
    for one, other in zip(copy.bodies, scene.bodies, strict=True):
        assert type(one) is type(other)
        assert one.own_medium == other.own_medium
        np.testing.assert_array_equal(one.bounds, other.bounds)
        for name in (
            "data",
            "colour",
            "world_from_index",
            "density_scale",
            "positions",
            "radii",
            "densities",
        ):
            if hasattr(other, name):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("name", ["mixed", "foggy_room", "fire", "sky", "smoke_and_solids", "tree"])
def test_a_saved_sample_is_the_same_scene(tmp_path, name):
    scene = tfm.Scene.load(SAMPLES / f"{name}.toml")
    scene.save(tmp_path / "copy.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["copy.toml"]
    check_same(tfm.Scene.load(tmp_path / "copy.toml"), scene)


@pytest.fixture
def scene(tmp_path):
    """Of arrays and files, with names relative to the working directory and to nothing."""
    np.save(tmp_path / "cloud.npy", blobs())
    rng = np.random.default_rng(3)
    slide = tmp_path / "slide.png"
    slide.write_bytes((SAMPLES / "window.png").read_bytes())
    bodies = [
        tfm.Volume(
            blobs(),
            colour=rng.uniform(0, 1, (*blobs().shape, 3)),
            voxel_size=(0.1, 0.2, 0.3),
            origin=(1 / 3, 2, 3),
            density_scale=2.5,
            medium=tfm.Medium(sigma_s=0.3, phase=tfm.HenyeyGreenstein(0.3)),
        ),
        tfm.Volume.load(tmp_path / "cloud.npy", voxel_size=0.1, origin=(1, 2, 3)).transformed(
            [[0, -2, 0, 1], [2, 0, 0, 0], [0, 0, 2, 1 / 3], [0, 0, 0, 1]]
        ),
        tfm.Points(
            rng.normal(size=(20, 3)).astype(np.float32),
            np.float32(0.1),
            rng.uniform(0, 1, 20).astype(np.float32),
            colour=(0.5, 0.25, 1),
            profile="gaussian",
        ),
        tfm.BoxVolume(density=0.1),
    ]
    camera = tfm.Camera(from_=(1, 2, 5), to=(0, 0, 0), focal_length=35.0, res=(32, 18))
    lights = [tfm.SpotLight(from_=(3, 4, 5), to=(0, 0, 0), texture=str(slide)), tfm.SkyLight(samples=4)]
    solids = [tfm.GroundSolid(), tfm.SphereSolid(translate=(0, 1, 0), rotate=(0, 90, 0), scale=2)]
    return tfm.Scene(
        bodies,
        tfm.Medium(preset="dust", sigma_a=0.1),
        camera,
        lights,
        tfm.MapSettings(max_error=0.1),
        solids=solids,
        ambient=tfm.Ambient(radiance=0.1),
    )


def test_what_is_of_arrays_is_written_beside(tmp_path, scene):
    (tmp_path / "saved").mkdir()
    path = tmp_path / "saved" / "scene.toml"
    scene.save(path, image=ImageSettings(view="agx"))
    assert sorted(file.name for file in path.parent.iterdir()) == [
        "scene.toml",
        "scene.volume.0.npz",
        "scene.volume.2.npz",
    ]
    check_same(tfm.Scene.load(path), scene)
    assert SceneFile.read(path).image == ImageSettings(view="agx")
    said = tomllib.loads(path.read_text(encoding="utf-8"))
    assert said["volume"][1]["file"] == "../cloud.npy"
    assert said["light"][0]["texture"] == "../slide.png"
    assert said["medium"] == {"preset": "dust", "sigma_a": [0.1, 0.1, 0.1]}
    assert said["volume"][0]["medium"]["preset"] == ""  # it has nothing of the scene's
    assert said["solid"][1] == {
        "shape": "sphere",
        "translate": [0.0, 1.0, 0.0],
        "rotate": [0.0, 90.0, 0.0],
        "scale": [2.0, 2.0, 2.0],
    }

    # It can be moved with its files.
    path.parent.rename(tmp_path / "moved")
    check_same(tfm.Scene.load(tmp_path / "moved" / "scene.toml").replace(lights=scene.lights), scene)
    tfm.Scene.load(tmp_path / "moved" / "scene.toml").save(tmp_path / "moved" / "scene.toml")


CURVES = tfm.Curves([[0, 0, 0], [1, 1, 1]], [2], 0.1)
MESH = tfm.MeshSolid.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
BOX = tfm.BoxVolume()


@pytest.mark.parametrize(
    ("body", "solids", "name", "message"),
    [
        (CURVES, (), "a.toml", "volume: curves is of arrays"),
        (BOX, (MESH,), "a.toml", "solid.mesh: a mesh made from arrays cannot be written"),
        (BOX, (), "a.json", "a.json: a scene file is called .toml"),
        (BOX, (), "none/a.toml", "a.toml: there is no directory"),
    ],
)
def test_what_cannot_be_saved_is_refused_in_one_line(tmp_path, body, solids, name, message):
    scene = tfm.Scene(body, solids=solids)
    with pytest.raises(SceneError) as caught:
        scene.save(tmp_path / name)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_curves_that_are_changed_are_no_longer_those_of_their_file(tmp_path):
    scene = tfm.Scene.load(SAMPLES / "hair.toml")
    scene = scene.replace(volume=[scene.bodies[0].with_density(2), *scene.bodies[1:]])
    with pytest.raises(SceneError, match=r"volume.0: .*straight.npz is of arrays, or has been changed"):
        scene.save(tmp_path / "a.toml")


# --------------------------------------------------------------------------- text


def test_vectors_are_on_one_line_and_what_is_no_table_comes_first():
    table = {
        "map": {"res": 3, "bytes": None},
        "light": [],
        "solid": [{"transform": [[1.0, 0.0], [0.0, 1e-9]], "mesh": 'a "b"\\c.ply'}],
        "volume": {"medium": {"phase": {"type": "hg", "g": 0.3}, "sigma_s": (1, 2, 3)}},
    }
    text = to_toml(table)
    assert text.splitlines() == [
        "light = []",
        "",
        "[map]",
        "res = 3",
        "",
        "[[solid]]",
        "transform = [[1.0, 0.0], [0.0, 1e-09]]",
        'mesh = "a \\"b\\"\\\\c.ply"',
        "",
        "[volume]",
        'medium = {phase = {type = "hg", g = 0.3}, sigma_s = [1, 2, 3]}',
    ]
    assert tomllib.loads(text)["solid"][0]["mesh"] == 'a "b"\\c.ply'


def test_a_default_that_says_something_stays():
    """A body's medium overrides the scene's by its defaults, too; with an error asked for, steps are open."""
    said = {
        "volume": [{"shape": "box", "density": 1.0, "medium": {"sigma_a": [0.0, 0.0, 0.0], "octaves": 1}}],
        "medium": {"sigma_a": [0.5, 0.5, 0.5], "octaves": 1},
        "camera": {"from": [0, 0, 5], "to": [0, 0, 0], "fov": 40.0},
        "light": [],
        "solid": [],
        "map": {"max_error": 0.1, "res": 1024, "steps": "auto", "coeffs": "auto"},
        "march": {"steps": 100, "cutoff": 1e-4},
    }
    assert without_defaults(said) == {
        "volume": [{"shape": "box", "medium": {"sigma_a": [0.0, 0.0, 0.0]}}],
        "medium": {"sigma_a": [0.5, 0.5, 0.5]},
        "camera": {"from": [0, 0, 5], "to": [0, 0, 0]},
        "light": [],
        "map": {"max_error": 0.1, "res": 1024, "steps": "auto"},
        "march": {"steps": 100},
    }


def test_files_on_another_branch_of_the_disk_keep_their_whole_names(tmp_path):
    (tmp_path / "a").mkdir()
    file = tmp_path / "cloud.npy"
    np.save(file, blobs())
    values = {"volume": {"file": str(file), "grid": "/density"}, "light": [], "solid": []}
    assert f'file = "../{file.name}"' in scene_text(values, tmp_path / "a")
    assert 'grid = "/density"' in scene_text(values, tmp_path / "a")
    assert f'file = "{file}"' in scene_text(values, Path("/proc"))
    assert f'file = "{file}"' in scene_text(values)
