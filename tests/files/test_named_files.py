"""Files that other files name."""

import json
import os

import pytest

from tfm_cl.files.mesh_io import gltf_limits, obj_library
from tfm_cl.files.named_files import named_by
from tfm_cl.scene.scene_file import SceneFile


def gltf(*uris, image="bark.png"):
    return json.dumps({"buffers": [{"uri": uri} for uri in uris], "images": [{"uri": image}]})


def nrrd(*lines):
    fields = "type: float\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n"
    return f"NRRD0004\n{fields}data file: " + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("name", "text", "named"),
    [
        ("a.gltf", gltf("a.bin", "data:;base64,AA"), ["a.bin", "bark.png"]),
        ("a.gltf", gltf("a%20b.bin", "a%20b.bin"), ["a b.bin", "bark.png"]),
        ("a.gltf", gltf("../a.bin", "/a.bin", ""), ["bark.png"]),
        ("a.gltf", '{"buffers": 3}', []),
        ("a.gltf", "[" * 100_000, []),
        ("a.glb", "glTF", []),
        ("a.obj", "v 0 0 0\nmtllib  a.mtl\nf 1 1 1\n", ["a.mtl", "wood one.png", "stone.png"]),
        ("a.obj", "mtllib no.mtl", ["no.mtl"]),
        ("a.obj", "", []),
        ("a.obj", "mtllib ../a.mtl", []),
        ("a.nhdr", nrrd("a.raw"), ["a.raw"]),
        ("a.nhdr", nrrd("a%d.raw 9 7 -1"), ["a9.raw", "a8.raw", "a7.raw"]),
        ("a.nrrd", nrrd("LIST", "x.raw", "y.raw"), ["x.raw", "y.raw"]),
        ("a.nhdr", nrrd("a%d.raw 1 999999999 1"), None),
        ("a.nhdr", "NRRD0004\n\n", []),
        ("a.vdb", "mtllib a.mtl", []),
    ],
)
def test_names(tmp_path, name, text, named):
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 1 1\n  map_Kd wood one.png\nMAP_KD\tstone.png\nmap_Kd\n")
    (tmp_path / name).write_text(text)
    found = named_by(tmp_path / name)
    if named is None:
        assert 0 < len(found) < 100_000
    else:
        assert [str(path.relative_to(tmp_path)) for path in found] == named


def test_a_file_that_is_not_there_names_none(tmp_path):
    assert named_by(tmp_path / "a.gltf") == named_by(tmp_path) == ()


def test_names_are_read_again_when_a_file_changes(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text(gltf("a.bin"))
    os.utime(path, ns=(0, 0))
    assert named_by(path)[0].name == "a.bin"
    path.write_text(gltf("b.bin"))
    assert named_by(path)[0].name == "b.bin"


def test_images_are_named_again_when_only_the_materials_change(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib a.mtl")
    for image in ("oak.png", "pine.png"):
        (tmp_path / "a.mtl").write_text(f"newmtl m\nmap_Kd {image}\n")
        assert [path.name for path in named_by(tmp_path / "a.obj")] == ["a.mtl", image]


@pytest.mark.parametrize("before", range(5))
def test_the_name_of_materials_is_found_wherever_a_part_of_the_file_ends(tmp_path, monkeypatch, before):
    monkeypatch.setattr(obj_library, "AT_ONCE", 5)
    (tmp_path / "a.obj").write_text("#" * before + "\nv 0 0 0\nmtllib wood.mtl\nmtllib other.mtl\n")
    assert [path.name for path in named_by(tmp_path / "a.obj")] == ["wood.mtl"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders")
@pytest.mark.parametrize("name", ["a.obj", "a.gltf", "a.nhdr"])
def test_what_is_no_plain_file_is_not_opened(tmp_path, name):
    os.mkfifo(tmp_path / "pipe.mtl")
    (tmp_path / "b.obj").write_text("mtllib pipe.mtl")
    os.mkfifo(tmp_path / name)
    assert named_by(tmp_path / name) == ()  # and does not wait for who writes it
    assert [path.name for path in named_by(tmp_path / "b.obj")] == ["pipe.mtl"]


def test_a_file_that_is_too_large_for_a_mesh_is_not_read(tmp_path):
    with (tmp_path / "a.gltf").open("wb") as file:
        file.write(gltf("a.bin").encode())
        file.truncate(gltf_limits.MAX_BYTES + 1)  # of holes
    assert named_by(tmp_path / "a.gltf") == ()


def test_a_scene_tells_them_too(tmp_path):
    (tmp_path / "a.nhdr").write_text(nrrd("a.raw"))
    (tmp_path / "a.gltf").write_text(gltf("a.bin"))
    (tmp_path / "s.toml").write_text('[volume]\nfile = "a.nhdr"\n[[solid]]\nmesh = "a.gltf"\n')
    names = [path.name for path in SceneFile.read(tmp_path / "s.toml").files()]
    assert names == ["a.nhdr", "a.gltf", "a.raw", "a.bin", "bark.png"]
