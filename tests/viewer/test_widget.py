"""`tfm.view`, before anything is rendered: what is shown, what is shared, and what is left behind."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from scenes import make_scene

import tfm_cl as tfm
from tfm_cl.viewer import widget
from tfm_cl.viewer.loop import RenderLoop
from tfm_cl.viewer.session import Work

VIEW = "0" * 32


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """Where temporary folders are."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert list(folder.iterdir()) == []
    assert widget._loops == {}


@pytest.fixture
def scene():
    return make_scene()


def say(viewer, **said):
    """Say something as a page does, and do it at once, in the render thread's place."""
    viewer._handle_custom_msg({"view": VIEW, "said": json.dumps(said)}, [])
    session = viewer._shown.session
    session.do(Work.LISTEN, None, None)
    if said["type"] == "save":
        session.do(Work.ASKED, None, lambda *_: None)


@pytest.fixture
def idle(monkeypatch):
    """No thread renders."""
    monkeypatch.setattr(RenderLoop, "start", lambda _: None)


def test_a_scene_of_arrays_stays_what_it_is(scene, tmp_path):
    with tfm.view(scene, folder=tmp_path) as viewer:
        assert viewer.scene == scene
        assert viewer.scene.volume is scene.volume


@pytest.mark.usefixtures("idle")
def test_the_scene_is_as_it_was_changed(scene, tmp_path):
    with tfm.view(scene, folder=tmp_path) as viewer:
        say(viewer, type="edit", changes={"camera.fov": 20.0, "volume.density_scale": 3.0})
        changed = viewer.scene

    assert changed.camera == scene.camera.replace(fov=20.0)
    assert changed.volume.density_scale == 3.0
    assert changed.volume.to_table() is None  # no file has it
    np.testing.assert_array_equal(changed.volume.data, scene.volume.data)


@pytest.mark.usefixtures("idle")
def test_arrays_are_saved_beside_the_scene(scene, tmp_path):
    with tfm.view(scene, folder=tmp_path) as viewer:
        say(viewer, type="edit", changes={"camera.fov": 20.0})
        say(viewer, type="save", what="scene", name="changed")
        changed = viewer.scene

    assert (tmp_path / "changed.volume.0.npz").is_file()
    assert tfm.Scene.load(tmp_path / "changed.toml") == changed


@pytest.mark.parametrize("kind", [str, Path, tfm.Shot])
def test_what_can_be_shown(scene, tmp_path, kind):
    scene.save(tmp_path / "scene.toml")
    with tfm.view(kind(tmp_path / "scene.toml"), folder=tmp_path, height="300px") as viewer:
        assert viewer.scene == scene
        assert viewer.height == "300px"


def test_viewers_of_a_device_share_what_renders(scene, tmp_path):
    first, second = (tfm.view(scene, folder=tmp_path) for _ in range(2))
    ((loop, _),) = widget._loops.values()
    first.close()
    assert not loop._is_closed
    second.close()
    assert loop._is_closed


def test_what_changes_from_frame_to_frame_begins_at_its_first_frame(scene, tmp_path):
    scene.save(tmp_path / "scene.toml")
    keys = [{"frame": 3, "value": 20.0}, {"frame": 5, "value": 40.0}]
    shot = tfm.Shot(tmp_path / "scene.toml", [("camera.fov", keys)])
    for frame, fov in ((None, 20.0), (4, 30.0)):
        with tfm.view(shot, frame, folder=tmp_path) as viewer:
            assert viewer.scene.camera.fov == fov


@pytest.mark.parametrize(
    ("source", "options", "line"),
    [
        ("no.toml", {}, "no such file"),
        (3, {}, "should be the name of a file"),
        (make_scene(), {"folder": "no folder"}, "is not a folder"),
        (make_scene(), {"height": 300}, "height = 300: should be a length as CSS says it"),
        (make_scene(volume=tfm.Curves(np.eye(3), [3], 0.1)), {}, "no scene file holds it"),
    ],
    ids=["no file", "no name", "no folder", "no height", "curves of arrays"],
)
def test_what_cannot_be_shown_is_told_in_a_line(source, options, line):
    with pytest.raises(tfm.InputError, match=line):
        tfm.view(source, **options)
