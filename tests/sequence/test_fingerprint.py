"""What a frame is made from, as a number."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.sequence import fingerprint
from tfm_cl.sequence.shot import Shot

SCENE = """
[volume]
file = "v.####.npy"
[camera]
from = [{ frame = 1, value = [0, 0, 50] }, { frame = 3, value = [0, 9, 50] }]
to = [8, 6, 7]
[[light]]
type = "environment"
texture = "sky.png"
"""
PICTURES = (Path("a.0001.exr"), Path("a.0001.png"))


@pytest.fixture
def folder(tmp_path):
    """A scene of two frames whose files lie beside it."""
    made = tmp_path / "one"
    made.mkdir()
    for frame in (1, 2):
        np.save(made / f"v.{frame:04d}.npy", blobs())
    (made / "sky.png").write_bytes(b"any")
    (made / "shot.toml").write_text(SCENE)
    return made


def of(folder, frame=1, pictures=PICTURES, **asked):
    return fingerprint.of_frame(Shot(folder / "shot.toml", **asked).scene_file(frame), pictures)


def test_the_same_is_the_same(folder):
    assert of(folder) == of(folder)
    assert len(of(folder)) == 64


def test_wherever_the_folder_is(folder, tmp_path):
    """Two machines may see it under two names."""
    shutil.copytree(folder, tmp_path / "two")  # with times
    assert of(folder) == of(tmp_path / "two")


def test_remarks_and_other_frames_make_no_difference(folder):
    before = of(folder)
    (folder / "shot.toml").write_text("# seen\n" + SCENE.replace("frame = 3", "frame = 30"))
    np.save(folder / "v.0002.npy", np.ones((3, 3, 3)))
    assert of(folder) == before


@pytest.mark.parametrize(
    "change", ["frame", "keyframe", "override", "decided", "size", "time", "gone", "texture", "names"]
)
def test_what_differs_is_told(folder, change):
    before, asked = of(folder), {}
    volume = folder / "v.0001.npy"
    if change == "frame":
        asked = {"frame": 2}
    elif change == "keyframe":
        (folder / "shot.toml").write_text(SCENE.replace("[0, 0, 50]", "[0, 0, 51]"))
    elif change == "override":
        asked = {"overrides": [("medium.sigma_s", 2.0)]}
    elif change == "decided":
        asked = {"decided": [("map.res", 64)]}
    elif change == "size":
        time = volume.stat().st_mtime_ns
        volume.write_bytes(volume.read_bytes() + b"0")
        os.utime(volume, ns=(time, time))
    elif change == "time":
        os.utime(volume, (0, 0))
    elif change == "gone":
        volume.rename(folder / "v.npy")
        (folder / "shot.toml").write_text(SCENE.replace("v.####.npy", "v.npy"))
    elif change == "texture":
        (folder / "sky.png").write_bytes(b"other")
    else:
        asked = {"pictures": PICTURES[:1]}
    assert of(folder, **asked) != before


def test_the_version_is_part_of_it(folder, monkeypatch):
    before = of(folder)
    monkeypatch.setattr(fingerprint, "__version__", "0")
    assert of(folder) != before


def test_plugins_are_part_of_it(folder, monkeypatch):
    before = of(folder)
    (folder / "plugin.py").write_text("")
    monkeypatch.setenv("TFM_CL_PLUGINS", str(folder / "plugin.py"))
    assert of(folder) != before


def test_what_a_mesh_names_counts(folder):
    (folder / "shot.toml").write_text(SCENE + '[[solid]]\nmesh = "rock.obj"\n')
    (folder / "rock.obj").write_text("mtllib rock.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "rock.mtl").write_text("newmtl m\nmap_Kd rock.png\n")
    before = of(folder)
    (folder / "rock.png").write_bytes(b"a picture")
    assert of(folder) != before
