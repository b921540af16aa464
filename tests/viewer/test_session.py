"""Sessions: what is shown, saved, compared and undone, with a renderer that needs no device."""

import io
import time
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from viewing import TEXT, Client

from tfm_cl.cli import main
from tfm_cl.files.image_io import load_image
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.messages import Undo

BODY = TEXT.partition("[camera]")[0]


def shown(client, after=0):
    """Codes of the next full picture, 0 to 255."""
    return decoded(client.picture("full", after))


def decoded(picture):
    return np.asarray(Image.open(io.BytesIO(picture["data"]))).astype(float)


def test_exposure_and_view_render_nothing(studio):
    client = studio.client()
    count, before = len(studio.renderer.rendered), client.say("show", exposure=-1.0, view="agx")

    picture = client.picture("full", before)

    assert client.state["show"] == {
        "layer": "beauty",
        "exposure": -1.0,
        "stops": None,
        "view": "agx",
        "light": 0,
    }
    assert len(studio.renderer.rendered) == count
    assert picture["revision"] == client.state["revision"]
    assert decoded(picture).mean() != pytest.approx(decoded(client.all("picture")[1]).mean())


def test_a_layer_that_was_not_asked_for_is_rendered(studio):
    client = studio.client()
    before = client.say("show", layer="depth")
    assert client.picture("full", before)["range"]
    count = len(studio.renderer.rendered)

    before = client.say("show", layer="map_error")

    client.picture("full", before)
    assert [aovs for _, _, aovs in studio.renderer.rendered[count:]] == [("map_error",)] * 2
    assert client.state["edits"] == {}
    client.say("edit", changes={"camera.fov": 20})
    before = client.say("show", layer="beauty")
    client.picture("full", before)


def test_full_pictures_have_the_samples_asked_for(studio):
    client = studio.client("scene.toml", ("image.samples", 16))
    assert studio.renderer.samples == [None, 16]
    before = client.say("edit", changes={"image.samples": 4})
    client.picture("full", before)
    assert studio.renderer.samples[-1] == 4


def test_an_automatic_exposure_is_kept_until_it_is_asked_for_again(studio):
    client = studio.client("scene.toml", ("image.exposure", "auto"))
    stops = client.wait_for(lambda _: client.state["show"]["stops"] is not None) and client.state["show"]
    assert stops["exposure"] == "auto"

    before = client.say("edit", changes={"light.0.intensity": 0.25})
    assert shown(client, before).mean() < 150
    assert client.state["show"]["stops"] == stops["stops"]
    before = client.say("show", exposure="auto")
    assert shown(client, before).mean() > 150
    assert client.state["show"]["stops"] == pytest.approx(stops["stops"] + 2)


def test_an_edit_of_the_exposure_is_shown(studio):
    client = studio.client()

    before = client.say("edit", changes={"image.exposure": 1.5, "image.view": "filmic"})

    client.picture("full", before)
    assert (client.state["show"]["exposure"], client.state["show"]["view"]) == (1.5, "filmic")


def test_undo_redo_and_reset(studio):
    client = studio.client()
    for fov in (20, 30):
        before = client.say("edit", changes={"camera.fov": fov})
        client.wait("state", before, edits={"camera.fov": fov})

    for said, edits in (
        ("undo", {"camera.fov": 20}),
        ("undo", {}),
        ("redo", {"camera.fov": 20}),
        ("reset", {}),
        ("undo", {"camera.fov": 20}),
    ):
        before = client.say(said)
        client.wait("state", before, edits=edits)


def test_lights_are_added_and_removed(studio):
    client = studio.client()
    light = client.state["options"]["light"][0]

    before = client.say("edit", changes={"light": [light, light | {"type": "sun", "name": "two"}]})
    assert len(client.wait("state", before)["options"]["light"]) == 2
    before = client.say("edit", changes={"light.1.intensity": 3})
    assert client.wait("state", before)["options"]["light"][1]["intensity"] == [3, 3, 3]
    before = client.say("edit", changes={"light": []})
    assert client.wait("state", before)["options"]["light"] == []
    before = client.say("edit", changes={"solid": [{"shape": "sphere", "center": [0, 0, 0], "radius": 1}]})
    assert client.wait("state", before)["options"]["solid"][0]["radius"] == 1
    assert not client.all("failed")


def test_a_light_that_was_placed_stays_when_the_camera_moves(studio):
    studio.write("bare.toml", BODY)
    client = studio.client("bare.toml")
    state = client.state

    before = client.say("edit", changes={"camera.from": [9, 1, 1]})

    moved = client.wait("state", before)["options"]
    assert moved["light"] == state["options"]["light"]
    assert moved["camera"]["to"] == state["options"]["camera"]["to"]
    before = client.say("edit", changes={"light.0.intensity": 7})
    assert client.wait("state", before)["options"]["light"][0]["intensity"] == [7, 7, 7]
    before = client.say("edit", changes={"light": [{"type": "sun", "from": [1, 1, 1], "to": [0, 0, 0]}]})
    assert client.wait("state", before)["options"]["light"][0]["type"] == "sun"


def test_what_is_saved_is_what_a_command_writes(studio, tmp_path):
    client = studio.client("scene.toml", ("camera.res", [64, 36]))
    before = client.say("edit", changes={"light.0.intensity": [1, 2, 3]})
    client.say("show", exposure=0.5)
    client.say("save", what="scene", name="saved.toml")
    assert client.wait("saved", before)["path"] == str(tmp_path / "saved.toml")

    command = ["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "command.toml")]
    command += ["--res", "64x36", "--set", "light.0.intensity=[1, 2, 3]", "--exposure", "0.5"]
    assert main([*command, "--look", "plain"]) == 0
    assert (tmp_path / "saved.toml").read_text() == (tmp_path / "command.toml").read_text()

    client.say("save", what="png", name="picture")
    client.say("save", what="exr", name="picture.exr")
    client.wait("saved", before, what="exr")
    sizes = [load_image(tmp_path / name).shape[:2] for name in ("picture.png", "picture.exr")]
    assert sizes == [(36, 64)] * 2


def test_what_was_asked_for_is_saved_whatever_comes_then(studio, tmp_path):
    client = studio.client()
    before = client.say("edit", changes={"light.0.intensity": 2})
    client.say("save", what="scene", name="a.toml")
    client.say("edit", changes={"light.0.intensity": 3})

    client.wait("saved", before)

    assert Shot(tmp_path / "a.toml").scene().lights[0].intensity == (2, 2, 2)


def test_b_is_what_was_kept_seen_by_the_camera_of_now(studio):
    client = studio.client()
    before = client.say("compare", **{"with": "kept"})
    assert "nothing is kept" in client.wait("failed", before)["line"]
    client.say("edit", changes={"light.0.intensity": 2})
    client.say("keep")
    client.say("edit", changes={"light.0.intensity": 1, "camera.fov": 33})
    before = client.say("compare", **{"with": "kept"})

    compared = client.wait("compared", before)

    assert compared["with"] == "kept"
    assert compared["rmse"] > 0
    scene = studio.renderer.rendered[-1][1]
    assert (scene.lights[0].intensity, scene.camera.fov) == ((2, 2, 2), 33)
    assert decoded(client.picture(which="b", after=before)).mean() > decoded(client.picture()).mean()
    assert client.picture(which="error", after=before)["gain"] > 0
    before = client.say("compare", **{"with": "nothing"})
    before = client.say("edit", changes={"camera.fov": 20})
    client.picture("full", before)
    time.sleep(0.1)
    assert not [one for one in client.all("picture", which="b") if one["at"] > client.got[before - 1]["at"]]


def test_the_dual_march_follows_every_full_picture(studio):
    client = studio.client()
    before = client.say("compare", **{"with": "dual"})
    client.wait("compared", before)
    assert studio.renderer.rendered[-1][1].march.method == "dual"

    before = client.say("edit", changes={"camera.fov": 20})

    assert client.wait("compared", before)["revision"] == client.state["revision"]


def test_who_asks_alone_gets_the_curve(studio):
    session = studio.session()
    one, other = Client(session), Client(session)
    one.picture("full")

    before = one.say("pick", x=0.25, y=0.5, light=0)

    assert one.wait("curve", before)["depth"] == [360, 640]
    before = one.say("map", light=1, coefficient=0)
    assert one.wait("failed", before)["line"] == "light 1: the scene has 1, counted from 0"
    before = one.say("map", light=0, coefficient=0)
    assert "constant density" in one.wait("failed", before)["line"]
    assert not other.all("curve")


def test_a_file_that_changed_is_opened_again(studio):
    client = studio.client()
    studio.write("scene.toml", TEXT.replace("640, 360", "320, 160"))

    before = client.say("open", path="scene.toml")

    assert client.picture("full", before)["width"] == 320
    assert len(client.all("opened")) == 1


def test_frames(studio):
    fov = "fov = [{ frame = 1, value = 20 }, { frame = 5, value = 40 }]"
    studio.write("keys.toml", TEXT.replace("res = ", f"{fov}\nres = "))
    client = studio.client("keys.toml")
    state = client.state
    assert (state["frame"], state["frames"], state["changing"]) == (1, [1, 5], ["camera.fov"])

    before = client.say("frame", frame=3)

    state = client.wait("state", before)
    assert (state["frame"], state["options"]["camera"]["fov"]) == (3, 30)
    before = client.say("edit", changes={"light.0.intensity": 2})
    assert client.wait("state", before)["frame"] == 3


def test_a_scene_of_one_frame_cannot_move(studio):
    fov = "fov = [{ frame = 1, value = 20 }, { frame = 5, value = 40 }]"
    studio.write("keys.toml", TEXT.replace("res = ", f"{fov}\nres = "))
    client = studio.client("keys.toml")
    client.say("edit", changes={"image.shutter": [-0.5, 0.5]})

    before = client.say("save", what="scene", name="kept")

    assert "camera.fov moves meanwhile" in client.wait("failed", before)["line"]
    assert not (studio.folder / "kept.toml").exists()
    client.say("edit", changes={"image.shutter": [0, 0]})
    before = client.say("save", what="scene", name="kept")
    assert client.wait("saved", before)["path"].endswith("kept.toml")


def test_a_slow_picture_tells_how_far_it_is(studio):
    studio.seconds["full"] = 1.0
    client = Client(studio.session())

    told = client.wait("work", stage="view pass")

    assert told["fraction"] == 0.5
    client.picture("full")
    client.wait("work", fraction=1.0)


def test_what_is_compiled_is_told_at_once(studio):
    client = studio.client()
    studio.renderer.compiles = ["light pass"]
    studio.seconds["low"] = 0.5

    before = client.say("edit", changes={"camera.fov": 20})

    told = client.wait("work", before)
    assert (told["stage"], told["fraction"]) == ("compiling kernels: light pass", 0)
    client.wait("work", before, fraction=1.0)


def test_any_field_of_a_map_is_shown(studio):
    client = studio.client()
    studio.renderer.maps = [
        SimpleNamespace(coefficients=np.full((4, 4, 2), value, np.float32)) for value in (1, 2)
    ]

    for said, shown in ((1, 1), (2, 1), (0, 0)):
        before = client.say("map", light=0, coefficient=1, field=said)
        found = client.wait("picture", before, which="map")
        assert (found["field"], found["fields"], found["range"]) == (shown, 2, [shown + 1, shown + 1])


def test_no_page_gets_as_many_pixels_as_it_likes(studio):
    client = studio.client()

    before = client.say("edit", changes={"camera.res": [16384, 16384]})

    assert client.wait("failed", before)["line"] == (
        "camera.res = [16384, 16384]: the viewer shows at most 33,554,432 pixels; set fewer, and let tfm "
        "render make the larger picture"
    )
    assert client.state["options"]["camera"]["res"] == [640, 360]
    assert all(scene.camera.res <= (640, 360) for _, scene, _ in studio.renderer.rendered)


def test_pages_that_drag_at_once_undo_each_as_one_step(studio):
    one = studio.client()
    other = Client(one.session)
    for part in range(4):
        before = one.say("edit", changes={"camera.fov": 20 + part}, drag=part < 3)
        other.say("edit", changes={"light.0.intensity": 2 + part}, drag=part < 3)
    one.wait_for(lambda found: found.get("edits", {}).get("light.0.intensity") == 5, before)

    one.say("undo")
    one.wait_for(lambda found: found.get("edits") == {"camera.fov": 23})
    one.say("undo")
    one.wait_for(lambda found: found.get("edits") == {} and not found["undo"] and found["redo"])


def test_too_much_at_once_is_refused(studio):
    client = studio.client()
    studio.seconds["low"] = 1.0
    before = client.say("edit", changes={"camera.fov": 20})
    time.sleep(0.1)

    for _ in range(2100):
        client.session.say(Undo(), client.mailbox)

    assert "too much" in client.wait("failed", before)["line"]
