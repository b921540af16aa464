"""``tfm render --frames``: several pictures of one command."""

import json

import numpy as np
import pytest
from PIL import Image
from scenes import blobs

SHOT = """
[volume]
file = "smoke.####.npy"
density_scale = 1.5
[camera]
from = [{ frame = 1, value = [5, 9, 30] }, { frame = 3, value = [-5, 9, 30] }]
to = [0, 0.5, 0]
[[light]]
type = "sun"
from = [1, 2, 3]
to = [0, 0, 0]
intensity = 9
"""


@pytest.fixture
def shot(folder):
    """``shot.toml`` and its volumes of frames 1 to 3."""
    for frame in (1, 2, 3):
        np.save(folder / f"smoke.{frame:04d}.npy", blobs() * frame)
    (folder / "shot.toml").write_text(SHOT)
    return folder / "shot.toml"


def test_frames_are_what_their_scene_files_make(render, shot, folder):
    """Bit by bit: what was decided for all of them is in the files, with what the basis learnt."""
    pictures = ("-o", "out.####.png", "-o", "out.%d.npy", "-o", "out.%d.toml")
    render(shot, "--frames", "3-1x2", *pictures, "--json", "out.json")
    assert "functions = " in (folder / "out.3.toml").read_text()
    render("out.3.toml", "-o", "one.png", "-o", "one.npy")

    names = {path.name for path in folder.iterdir() if path.suffix in {".png", ".npy"}}
    outputs = {"out.0001.png", "out.0003.png", "out.1.npy", "out.3.npy", "one.png", "one.npy"}
    assert names == outputs | {f"smoke.000{frame}.npy" for frame in (1, 2, 3)}
    assert np.array_equal(np.load("out.3.npy"), np.load("one.npy"))
    assert not np.array_equal(np.load("out.1.npy"), np.load("one.npy"))
    assert np.array_equal(Image.open("out.0003.png"), Image.open("one.png"))
    told = json.loads((folder / "out.json").read_text())["frames"]
    assert [report["frame"] for report in told] == [3, 1]
    assert told[0]["options"]["camera"]["from"] == [-5, 9, 30]


def test_a_frame_may_be_printed_and_written_as_a_scene(render, cli, shot):
    printed = cli("render", shot, "--frame", 2.5, "--print-config")
    render(shot, "--frames", "1-2", "-o", "frame.##.toml")

    assert "from = [-2.5, 9.0, 30.0]" in printed.out
    assert "smoke.0002.npy" in printed.out
    assert "frame_step" not in printed.out
    assert "from = [0.0, 9.0, 30.0]" in shot.with_name("frame.02.toml").read_text()


def test_other_commands_take_a_frame(cli, shot, folder, tiny):
    asked = ("--what", "map", "--map-res", 8, "--light-steps", 8, "--coeffs", 2, *tiny[10:])

    assert "--frame 1" in cli("bake", shot, "-o", "maps", *asked).err
    done = cli("bake", shot, "-o", "maps", "--frame", 2, *asked)

    assert done.code == 0, done.err
    assert (folder / "maps" / "maps.json").exists()


def test_nothing_is_no_matter_where_it_was_asked_for(render, shot):
    shot.write_text(SHOT.replace('npy"', 'npy"\nafter = "empty"'))

    done = render(shot, "--frame", 9, "-o", "out.png", "-o", "out.npy")

    assert "warning" not in done.err
    assert not np.load("out.npy").any()


def test_warnings_and_what_is_chosen_are_told_once(render, shot):
    shot.write_text(SHOT.replace("density_scale = 1.5", "density_scale = 1e-9").replace("####", "0001"))

    done = render(shot, "--frames", "1-3", "-o", "out.#.png")

    assert done.err.count("the picture shows nothing of the medium") == 1


def test_a_turntable_needs_no_scene_file(render, cloud):
    done = render(cloud, "--turntable", 2, "-o", "turn.#.npy", "--json", "-")

    cameras = [report["options"]["camera"] for report in done.json["frames"]]
    (x, y, z), (other_x, other_y, other_z) = (camera["from"] for camera in cameras)
    middle_x, _, middle_z = cameras[0]["to"]
    assert (other_x, other_y, other_z) == pytest.approx((2 * middle_x - x, y, 2 * middle_z - z))
    assert cameras[0]["to"] == cameras[1]["to"]
    assert cloud.with_name("turn.0002.npy").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "a.png"), "shot.toml:6: camera.from: changes from frame to frame"),
        (("-o", "a.####.png"), "a.####.png: is a name of many frames; say which: --frames 1-24"),
        (
            ("-o", "a.deep.exr", "--frames", "1-50"),
            "a.deep.exr: 50 frames, one name; add ####, as a.####.deep.exr",
        ),
        (("-o", "a.#.png", "-o", "a.%04d.png", "--frames", "1-2"), "a.0001.png: is written twice"),
        (("-o", "a.#.png", "--frames", "1-2", "--frame", "1"), "--frame is one frame, --frames are several"),
        (("-o", "a.#.png", "--frames", "1..2"), "--frames: '1..2': is no range of frames"),
        (("-o", "a.png", "--frame", "nan"), "--frame nan: should be a number"),
        (("-o", "a.#.png", "--frame", "1.5"), "a.#.png: has no place for frame 1.5"),
        (("-o", "a.png", "--frame", "4"), "volume.file: frame 4: there is no smoke.0004.npy"),
        (("-o", "smoke.%04d.npy", "--frames", "1-9"), "smoke.0001.npy: is the input of a frame"),
        (("-o", "smoke.0007.npy", "--frame", "1"), "smoke.0007.npy: is the input of a frame"),
        (("-o", "a.#.png", "--frames", "1-2", "--json", "a.#.json"), "a.#.json: --json is one file for all"),
        (("--print-config", "--frames", "1-2"), "--print-config is of one frame"),
        (("-o", "a.png", "--turntable", "0"), "--turntable 0: should be a number of frames from 1"),
        (("-o", "a.#.png", "--turntable", "2000000"), "--turntable: '1-2000000': more than 1,000,000 frames"),
    ],
)
def test_what_cannot_be_meant_is_refused(refused, shot, arguments, said):
    assert said in refused("render", shot, *arguments)


def test_keyframes_may_be_set(render, shot):
    keyframes = "camera.fov=[{frame=1,value=20},{frame=9,value=40}]"

    done = render(shot, "--set", keyframes, "--frame", 3, "-o", "a.npy", "--json", "-")

    assert done.json["options"]["camera"]["fov"] == 25
    assert done.json["frame"] == 3
