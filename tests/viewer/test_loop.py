"""The render thread, with a renderer that needs no device."""

import threading
import time
from contextlib import closing

import pytest
from viewing import PATIENCE, TEXT, Client, Studio

from tfm_cl.errors import DeviceError
from tfm_cl.viewer.messages import Edit, Redo, Undo

ENDED = 0.5
"""Seconds within which a full picture ends that has become stale; others may have the cores."""


def test_the_first_client_sees_everything(studio):
    client = studio.client()

    kinds = [found["type"] for found in client.got]
    assert kinds[0] == "welcome"
    assert kinds.index("state") < kinds.index("picture")
    low, full = client.all("picture")
    assert (low["quality"], full["quality"], full["mime"]) == ("low", "full", "image/png")
    assert (full["width"], full["height"]) == (640, 360)
    assert low["width"] < 640
    assert low["width"] / low["height"] == pytest.approx(640 / 360, rel=0.02)
    state = client.state
    assert state["revision"] == low["revision"] == full["revision"]
    assert state["source"] == "scene.toml"
    assert state["options"]["camera"]["res"] == [640, 360]
    assert (state["undo"], state["redo"], state["frames"], state["changing"]) == (False, False, None, [])
    assert state["bounds"] == [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]]
    assert client.wait("cost", quality="full")["resolution"] == [640, 360]
    assert client.wait("clients")["count"] == 1


def ahead(folder, **of_first):
    """Return a studio whose thread renders before anybody looks, as soon as it does."""
    studio = Studio(folder, ahead=True, **of_first)
    end = time.monotonic() + PATIENCE
    while not (studio.renderers and studio.renderer.rendered):
        assert time.monotonic() < end
        time.sleep(0.002)
    return studio


def test_the_first_picture_is_made_ready_before_anybody_looks(tmp_path):
    with closing(ahead(tmp_path)) as studio:
        studio.client()

        (renderer,) = studio.renderers
        assert [quality for quality, *_ in renderer.rendered] == ["low", "low", "full"]
        assert renderer.rendered[0] == renderer.rendered[1]


def test_who_looks_does_not_wait_for_what_is_made_ready(tmp_path):
    with closing(ahead(tmp_path, seconds=10 * PATIENCE)) as studio:
        studio.seconds["low"] = 0.0
        client = studio.client()
        assert [quality for quality, *_ in studio.renderer.rendered] == ["low", "low", "full"]
        assert not client.all("failed")


def test_nothing_is_compiled_before_anybody_looks(tmp_path):
    with closing(ahead(tmp_path, compiles=["light pass", "scatter pass"])) as studio:
        client = studio.client()
        told = [found["stage"] for found in client.all("work") if "kernels" in found["stage"]]
        assert told == ["compiling kernels: scatter pass"]


def test_what_fails_before_anybody_looks_is_tried_again(tmp_path):
    with closing(ahead(tmp_path, errors=[DeviceError("lost")])) as studio:
        client = studio.client()
        assert len(studio.renderers) == 2
        assert studio.renderers[0].closed
        assert not client.all("failed")


def test_welcome_tells_what_there_is(studio):
    welcome = studio.client().wait("welcome")

    assert welcome["schema"]["title"] == "tfm_cl scene"
    assert {"beauty", "depth", "lights"} <= {layer["name"] for layer in welcome["layers"]}
    assert "agx" in {view["name"] for view in welcome["views"]}
    assert "smoke" in {preset["name"] for preset in welcome["presets"]}
    assert (welcome["folder"], welcome["can"]) == (str(studio.folder), {"open": True, "save": True})


def test_an_edit_is_seen_low_and_then_in_full(studio):
    client = studio.client()

    before = client.say("edit", changes={"light.0.intensity": [2, 2, 2]})

    state = client.wait("state", before)
    assert state["edits"] == {"light.0.intensity": [2, 2, 2]}
    assert state["options"]["light"][0]["intensity"] == [2, 2, 2]
    low, full = client.picture("low", before), client.picture("full", before)
    assert low["revision"] == full["revision"] == state["revision"]
    assert low["at"] < full["at"]
    assert [quality for quality, *_ in studio.renderer.rendered] == ["low", "full", "low", "full"]


def test_while_it_moves_only_the_newest_is_rendered(studio):
    client = studio.client()
    studio.seconds["low"] = 0.05
    count = len(studio.renderer.rendered)

    for number in range(40):
        before = client.say("edit", changes={"light.0.intensity": 1 + number}, drag=number < 39)
        time.sleep(0.004)

    client.picture("full", before)
    rendered = studio.renderer.rendered[count:]
    assert 3 <= len(rendered) < 20
    assert [quality for quality, *_ in rendered[:-1]] == ["low"] * (len(rendered) - 1)
    assert rendered[-1][1].lights[0].intensity == (40, 40, 40)
    assert client.state["undo"]
    client.say("undo")
    client.wait_for(lambda found: found["type"] == "state" and found["edits"] == {} and found["revision"] > 1)


def test_a_full_picture_that_is_stale_ends(studio):
    client = studio.client()
    studio.seconds["full"] = 20.0
    client.say("edit", changes={"light.0.intensity": 2})
    assert studio.renderer.busy.wait(10)

    asked = time.monotonic()
    before = client.say("edit", changes={"light.0.intensity": 3})

    while studio.renderer.busy.is_set():
        assert time.monotonic() - asked < ENDED
    assert client.picture("low", before)["revision"] == client.state["revision"]
    studio.seconds["full"] = 0.0
    assert client.picture("full", before)


def test_what_was_asked_for_besides_waits_for_low_pictures_only(studio):
    client, other = studio.client(), studio.client()
    studio.seconds["full"] = 20.0
    client.say("edit", changes={"light.0.intensity": 2})
    assert studio.renderer.busy.wait(10)

    before = other.say("edit", changes={"light.0.intensity": 3})  # ends the other's full picture

    assert other.picture("low", before)
    studio.seconds["full"] = 0.0
    other.picture("full", before)
    assert client.wait_for(lambda found: found.get("quality") == "full" and found["revision"] == 2)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"map.coefs": 8}, "unknown key 'coefs' in [map]; did you mean 'coeffs'?"),
        ({"light.3.intensity": 8}, "light.3.intensity: the scene has 1 [[light]] tables"),
        ({"light": 3}, "light: should be SECTION.KEY"),
        ({"light": {"type": "sun"}}, "light should be [[light]] tables"),
        ({"solid": [{"mesh": "secret.ply", "albedo": 1}]}, "secret: is outside the folder"),
        ({"camera.fov": 500}, "camera.fov = 500: should be less than 180"),
    ],
)
def test_an_edit_that_is_none_changes_nothing(studio, changes, line):
    client = studio.client()
    state = client.state

    before = client.say("edit", changes=changes)

    failed = client.wait("failed", before)
    assert line in failed["line"]
    assert "\n" not in failed["line"]
    client.say("edit", changes={"camera.fov": 20})
    client.wait("cleared", before)
    assert client.state["edits"] == {"camera.fov": 20}
    assert client.state["revision"] == state["revision"] + 1
    client.say("undo")
    client.wait_for(lambda found: found["type"] == "state" and found["edits"] == {}, before)


def test_of_edits_at_once_those_that_are_right_count(studio):
    client = studio.client()
    studio.seconds["low"] = 0.2
    client.say("edit", changes={"camera.fov": 30})
    time.sleep(0.05)
    client.say("edit", changes={"camera.fov": 999})
    before = client.say("edit", changes={"light.0.intensity": 2})

    client.picture("full", before)

    assert client.state["edits"] == {"camera.fov": 30, "light.0.intensity": 2}
    assert len(client.all("failed")) == 1


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (DeviceError("PoCL: scatter_pass failed"), "PoCL: scatter_pass failed"),
        (RuntimeError("boom\nat line 3"), "the renderer failed (RuntimeError: boom at line 3)"),
        (MemoryError(), "out of memory"),
    ],
)
def test_a_renderer_that_fails_is_made_anew(studio, error, line):
    client = studio.client()
    first = studio.renderer
    first.errors = [error]

    before = client.say("edit", changes={"light.0.intensity": 2})

    assert line in client.wait("failed", before)["line"]
    client.picture("full", before)
    assert first.closed
    assert studio.renderer is not first
    assert client.state["edits"] == {}  # as it was before
    after = client.say("edit", changes={"light.0.intensity": 3})
    client.wait("cleared", after)
    assert client.state["edits"] == {"light.0.intensity": 3}


def test_a_crash_that_is_nobodys_fault_is_tried_once_more(studio):
    client = studio.client()
    studio.renderer.errors = [None, DeviceError("lost")]  # the full picture of what is shown already

    before = client.say("edit", changes={"camera.fov": 20})

    client.wait("failed", before)
    assert client.picture("full", before)["revision"] == client.state["revision"]


def test_what_always_fails_is_left_alone(studio):
    studio.refuses = True
    client = Client(studio.session())
    assert client.wait("failed")["line"] == "no OpenCL device"
    time.sleep(0.3)
    assert len(client.all("failed")) <= 2

    studio.refuses = False
    before = client.say("edit", changes={"camera.fov": 20})

    client.picture("full", before)
    client.wait("cleared", before)


def test_a_scene_that_cannot_be_read_can_be_mended(studio):
    studio.write("wrong.toml", TEXT.replace("intensity", "intensty"))
    client = Client(studio.session("wrong.toml"))
    assert "unknown key 'intensty'" in client.wait("failed")["line"]

    before = client.say("open", path="scene.toml")

    client.picture("full", before)
    client.wait("cleared", before)
    assert client.state["source"] == "scene.toml"


def test_another_file_is_opened(studio):
    studio.write("other.toml", TEXT.replace("640, 360", "320, 160"))
    client = studio.client()
    client.say("edit", changes={"camera.fov": 20})

    before = client.say("open", path="other.toml")

    assert client.picture("full", before)["width"] == 320
    assert client.state["edits"] == {}
    before = client.say("open", path="missing.toml")
    assert "missing.toml" in client.wait("failed", before)["line"]
    assert client.state["source"] == "other.toml"


def test_when_nobody_looks_the_device_is_given_back(studio):
    client = studio.client()
    picture = client.picture("full")

    client.session.leave(client.mailbox)

    end = time.monotonic() + 10
    while not studio.renderer.closed:
        assert time.monotonic() < end
        time.sleep(0.01)
    again = Client(client.session)
    again.take()
    assert again.picture("full")["data"] == picture["data"]  # at once
    again.wait_for(lambda found: found["type"] == "picture" and found["picture"] > picture["picture"] + 1)
    assert len(studio.renderers) == 2


def test_leaving_ends_the_work(studio):
    client = studio.client()
    studio.seconds["full"] = 20.0
    client.say("edit", changes={"light.0.intensity": 2})
    assert studio.renderer.busy.wait(10)

    client.session.leave(client.mailbox)

    end = time.monotonic() + 5
    while studio.renderer.busy.is_set():
        assert time.monotonic() < end


def test_clients_of_one_session_see_the_same(studio):
    session = studio.session()
    one, other = Client(session), Client(session)
    one.picture("full")
    other.picture("full")
    assert other.wait("clients", count=2)

    one.say("edit", changes={"camera.fov": 20})

    assert other.wait("state", edits={"camera.fov": 20})
    one.say("list", path="", kind="phase")
    one.wait("listing")
    session.leave(one.mailbox)
    other.wait_for(lambda _: other.all("clients")[-1]["count"] == 1)
    assert not other.all("listing")


def test_a_client_that_takes_nothing_holds_nobody(studio):
    session = studio.session()
    fast, slow = Client(session), Client(session)
    fast.picture("full")

    for number in range(30):
        before = fast.say("edit", changes={"light.0.intensity": number + 1})
        fast.picture("low", before)
    fast.picture("full", before)

    slow.take()
    pictures = slow.all("picture")
    assert len(pictures) == 1  # until it has seen that
    assert pictures[0]["revision"] == fast.state["revision"]
    assert len(slow.all("state")) == 1


def test_closing_is_quick_and_may_be_repeated(studio):
    client = studio.client()
    studio.seconds["full"] = 20.0
    client.say("edit", changes={"light.0.intensity": 2})
    assert studio.renderer.busy.wait(10)

    begun = time.monotonic()
    studio.loop.close()
    studio.loop.close()

    assert time.monotonic() - begun < 2


def test_threads_may_say_anything_at_once(studio):
    client = studio.client()

    said = [Edit(changes={"camera.fov": 20}), Undo(), Edit(changes={"camera.up": "y"}), Redo()]

    def say(number):
        for step in range(30):
            client.session.say(said[(step + number) % len(said)])

    threads = [threading.Thread(target=say, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    before = client.say("edit", changes={"camera.fov": 33})

    client.wait_for(lambda _: client.state["edits"].get("camera.fov") == 33, before)
    assert not client.all("failed")
