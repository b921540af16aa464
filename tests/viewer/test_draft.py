"""Low and full pictures of a device: which maps are made, and that full ones are those of ``tfm render``."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from memory import resident
from scenes import blobs
from viewing import Client, FakeFiles

from tfm_cl.cli import main
from tfm_cl.files.image_io import load_image
from tfm_cl.sequence.frame import read
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.curve import curve_at
from tfm_cl.viewer.draft import Draft, depends_on, scaled_crop
from tfm_cl.viewer.loop import RenderLoop

TEXT = """
[volume]
file = "cloud.npy"
voxel_size = 0.1
density_scale = 4.0
[medium]
sigma_s = [1.0, 0.8, 0.5]
sigma_a = [0.1, 0.3, 0.2]
[camera]
res = [320, 180]
[[light]]
type = "spot"
from = [3, 4, 2]
to = [0.8, 0.6, 0.7]
cone = 24
intensity = 30
[map]
basis = "dct"
coeffs = 8
density_weighting = 10
res = 128
steps = 24
[march]
steps = 30
"""

SKY = "light", [{"type": "sky", "samples": 64, "elevation": 30}]


@pytest.fixture
def folder(tmp_path):
    np.save(tmp_path / "cloud.npy", blobs())
    (tmp_path / "scene.toml").write_text(TEXT)
    return tmp_path


@pytest.fixture
def client(folder, new_renderer):
    """Of a session on a device, which has seen its first full picture."""
    loop = RenderLoop(lambda: new_renderer(launch_seconds=0.03), read, curve_at)
    loop.start()
    client = Client(loop.session(Shot(folder / "scene.toml"), FakeFiles(folder)))
    client.picture("full")
    yield client
    loop.close()
    loop._thread.join(60)


def frame(folder, *overrides):
    return read(Shot(folder / "scene.toml", overrides).scene_file(), None)


def rendered(read_frame, renderer):
    return read_frame.render(renderer, ()).result


class Full:
    """Stands for a full picture."""

    def __init__(self, scene):
        self.scene = scene


def test_maps_depend_on_neither_camera_nor_colours(folder):
    before = frame(folder)
    for overrides, stays in (
        ([("camera.from", [9, 9, 9])], True),
        ([("light.0.intensity", [1, 2, 3])], True),
        ([("medium.sigma_s", [0.9, 0.9, 0.6]), ("medium.sigma_a", [0.2, 0.2, 0.1])], True),
        ([("medium.phase", "hg:0.5"), ("march.steps", 10), ("ambient.radiance", 1)], True),
        ([("light.0.from", [3, 4, 3])], False),
        ([("medium.sigma_s", 3.0)], False),
        ([("volume.density_scale", 2.0)], False),
        ([("map.coeffs", 4)], False),
        ([("solid", [{"shape": "sphere", "center": [0, 0, 0], "radius": 0.1}])], False),
    ):
        file = Shot(folder / "scene.toml", overrides).scene_file()
        assert (depends_on(read(file, None, before).scene) == depends_on(before.scene)) == stays, overrides


def test_low_pictures_keep_the_maps_of_the_full_one(folder):
    draft, before = Draft(10.0), frame(folder)
    first = draft.scene(before)
    assert (first.map.res, first.march) == (64, before.planned.scene.march)
    draft.rendered(before, Full(before.planned.scene))

    moved = draft.scene(read(Shot(folder / "scene.toml", [("camera.fov", 9)]).scene_file(), None, before))
    assert moved.map == before.planned.scene.map
    assert moved.camera.fov == 9
    turned = draft.scene(read(Shot(folder / "scene.toml", [("light.0.cone", 9)]).scene_file(), None, before))
    assert turned.map.res == 64


def test_low_pictures_take_half_the_steps_where_these_are_left_open(folder):
    draft, before = Draft(10.0), frame(folder, ("march.steps", "auto"))
    steps = before.planned.scene.march.steps
    assert draft.scene(before).march == before.planned.scene.march.replace(steps=math.ceil(steps / 2))
    draft.rendered(before, Full(before.planned.scene))
    assert draft.scene(before).march.steps == math.ceil(steps / 2)


def took(draft, scene, seconds, **made):
    stats = SimpleNamespace(made=made, seconds={"view_pass": seconds / 2})
    draft.took(seconds, SimpleNamespace(scene=scene, stats=stats))


def test_lights_that_are_many_are_fewer_while_maps_take_long(folder):
    draft, before = Draft(10.0), frame(folder, SKY)
    scene = draft.scene(before)
    assert scene.lights[0].samples == 64
    for _ in range(8):
        took(draft, scene, 1.0, map=64)

    later = draft.scene(frame(folder, ("light", [SKY[1][0] | {"elevation": 31}])))

    assert (later.lights[0].samples, later.lights[0].lookup) == (8, "samples")
    draft.rendered(before, Full(before.planned.scene))
    assert draft.scene(before).lights[0].samples == 64


def test_lights_that_are_many_are_fewer_where_small_pictures_take_long(folder):
    draft, before, spot = Draft(10.0), frame(folder, SKY), frame(folder)
    draft.rendered(before, Full(before.planned.scene))
    for _ in range(12):
        scene = draft.scene(before)
        took(draft, scene, 1e-5 * math.prod(scene.camera.res))
    assert scene.camera.res == (160, 90)
    assert scene.lights[0].samples == 64  # 0.144 s
    took(draft, scene, 0.2)

    scene = draft.scene(before)

    assert (scene.lights[0].samples, scene.map.res) == (16, 64)
    assert draft.scene(frame(folder, SKY, ("camera.fov", 9))).map == scene.map  # no new map
    draft.rendered(spot, Full(spot.planned.scene))
    assert draft.scene(spot).map == spot.planned.scene.map


def test_an_error_asked_for_is_measured_for_full_pictures_only(folder):
    draft, before = Draft(10.0), frame(folder, ("map.max_error", 0.02))
    assert draft.scene(before).map.max_error is None


def test_a_low_crop_shows_what_the_full_one_does(folder):
    image = frame(folder, ("image.crop", [10, 20, 30, 41])).file.image

    assert scaled_crop(image, (320, 180), (160, 90)) == (5, 10, 15, 21)
    assert scaled_crop(image.replace(crop=None), (320, 180), (160, 90)) is None


@pytest.mark.slow
def test_cameras_and_colours_make_no_map(client):
    before = len(client.got)
    for number in range(6):
        after = client.say("edit", changes={"camera.from": [3, 1, 4 + 0.1 * number]}, drag=True)
        client.picture("low", after)
        after = client.say("edit", changes={"light.0.intensity": 20 + number}, drag=number < 5)
        client.picture("low", after)
    client.wait("cost", after, quality="full")  # follows the picture

    costs = [found for found in client.all("cost") if found["at"] > client.got[before - 1]["at"]]
    assert len(costs) >= 13
    assert not any("map" in cost["made"] for cost in costs)
    after = client.say("edit", changes={"light.0.from": [3, 4, 3]})
    assert client.wait("cost", after, quality="low")["made"]["map"] == 1
    assert client.wait("cost", after, quality="full")["made"]["map"] == 1


@pytest.mark.slow
def test_what_is_saved_reproduces_the_picture_bit_for_bit(client, folder, renderer):
    for changes in ({"camera.from": [3, 1, 4]}, {"medium.sigma_s": 2.0}, {"light.0.from": [3, 3, 3]}):
        after = client.say("edit", changes=changes)
        client.picture("low", after)
    client.picture("full", after)
    client.say("save", what="exr", name="view.exr")
    client.say("save", what="scene", name="view.toml")
    client.say("save", what="png", name="view.png")
    client.wait("saved", after, what="png")

    for name in ("view.exr", "view.png"):
        assert main(["render", str(folder / "view.toml"), "-q", "-o", str(folder / f"command.{name}")]) == 0
        saved, command = load_image(folder / name), load_image(folder / f"command.{name}")
        assert np.array_equal(saved, command)
    result = rendered(frame(folder, *client.state["edits"].items()), renderer)
    assert np.array_equal(result.image, load_image(folder / "view.exr"))


@pytest.mark.slow
def test_memory_is_level_over_many_steps(client):
    """Two hundred steps that each make new maps, low pictures and at times full ones."""

    def steps(count):
        for number in range(count):
            changes = [
                {"light.0.from": [3, 4, 2 + 0.01 * number]},
                {"camera.from": [3, 1, 4 + 0.01 * number]},
                {"volume.density_scale": 4 + 0.01 * number},
                {"medium.sigma_s": [1.0, 0.8, 0.5 + 0.001 * number]},
            ][number % 4]
            after = client.say("edit", changes=changes, drag=number % 20 > 0)
            client.picture("low", after)
            if number % 20 == 0:
                client.picture("full", after)
        client.got.clear()

    steps(60)
    before = resident()
    steps(200)

    assert resident() - before < 40 << 20
