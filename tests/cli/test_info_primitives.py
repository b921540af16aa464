"""``tfm info`` and wrong inputs of files of points and curves; scenes of them on the command line."""

import tomllib

import numpy as np
import pytest
from primitive_files import HAIR, write_files

POINTS = ["plume.npz", "points.ply", "plume.bgeo"]
CURVES = ["tuft.npz", "tuft.hair"]


@pytest.fixture
def files(folder):
    write_files(folder)
    return folder


@pytest.mark.parametrize("name", POINTS)
def test_json_of_points(cli, files, name):
    done = cli("info", files / name, "--json")
    assert done.code == 0
    assert set(done.json) == {"file", "points"}
    report = done.json["points"]
    assert report["count"] == 3
    assert report["bounds"] == [[0, 0, 0], [1, 2, 0]]
    assert report["radii"] == [0.25, 1]
    assert report["spacing"] == 1
    assert [report[name] for name in ("densities", "opacities", "colours", "velocities")] == [None] * 4
    assert report["device_bytes"] % 3 == 0
    assert 0 < report["device_bytes"] / 3 <= 200


@pytest.mark.parametrize(("name", "widths"), [("tuft.npz", [0.1, 0.5]), ("tuft.hair", [0.25, 0.25])])
def test_json_of_curves(cli, files, name, widths):
    done = cli("info", files / name, "--json")
    assert done.code == 0
    assert set(done.json) == {"file", "curves"}
    report = done.json["curves"]
    assert (report["count"], report["segments"]) == (2, 3)
    assert report["bounds"] == [[0, 0, 0], [1, 1, 3]]
    assert report["widths"] == pytest.approx(widths)
    assert report["opacities"] == [0.5, 0.5]
    assert report["device_bytes"] % 3 == 0


def test_text_of_curves(cli, files):
    done = cli("info", files / "tuft.hair")
    assert done.code == 0
    assert done.err == ""
    lines = [" ".join(line.split()) for line in done.out.splitlines()]
    assert lines[:2] == [str(files / "tuft.hair"), "curves"]
    assert "count 2" in lines
    assert "segments 3" in lines
    assert "bounds (0, 0, 0) to (1, 1, 3)" in lines
    assert "colours 0 × 1" in lines


def test_text_of_points_leaves_out_what_the_file_does_not_say(cli, files):
    lines = [line.split()[0] for line in cli("info", files / "plume.npz").out.splitlines()[1:]]
    assert lines == ["points", "count", "bounds", "radii", "spacing", "device"]


def test_an_archive_of_a_volume_stays_one(cli, files):
    assert [grid["name"] for grid in cli("info", files / "cloud.npz", "--json").json["grids"]] == ["density"]


def test_one_point_has_no_spacing(cli, folder):
    np.savez(folder / "one.npz", positions=np.zeros((1, 3)))
    assert cli("info", folder / "one.npz", "--json").json["points"]["spacing"] is None


# --- wrong inputs ------------------------------------------------------------------------------------------

WRONG = {
    "hair cut off": ("a.hair", HAIR[:-3]),
    "no hair": ("a.hair", b"BALD" + HAIR[4:]),
    "2^31 points": ("a.hair", HAIR[:8] + b"\0\0\0\x80" + HAIR[12:]),
    "points that are not numbers": ("a.hair", HAIR[:-4] + np.float32(np.nan).tobytes()),
    "no header": ("a.ply", b"plywood"),
    "no houdini": ("a.bgeo", b"Bgeo"),
    "nothing": ("a.npz", b""),
}


@pytest.mark.parametrize("more", [("info",), ("render", "-o", "a.png")], ids=["info", "render"])
@pytest.mark.parametrize("wrong", WRONG)
def test_damaged_files_are_one_line(refused, folder, wrong, more):
    name, data = WRONG[wrong]
    (folder / name).write_bytes(data)
    assert name in refused(*more, folder / name)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("volume.opacity=2", "opacity"),
        ("volume.radius=-1", "radius"),
        ("volume.profile=cube", "profile"),
        ("volume.width=1", "width"),
        ("volume.colour=[1,1]", "colour"),
        ("volume.transform=[1]", "transform"),
    ],
)
def test_wrong_settings_are_one_line(refused, files, setting, message):
    assert message in refused("render", files / "plume.npz", "-o", "a.png", "--set", setting)


def test_two_kinds_at_once_are_one_line(refused, files):
    (files / "scene.toml").write_text('[volume]\npoints = "plume.npz"\ncurves = "tuft.hair"\n')
    assert "two kinds of bodies" in refused("render", files / "scene.toml", "-o", "a.png")


# --- printed configurations --------------------------------------------------------------------------------

SCENE = """
[medium]
sigma_s = 1.0
phase = "kajiya-kay:0.4:20"
[[volume]]
points = "plume.npz"
radius = "auto"
[[volume]]
curves = "tuft.hair"
width = "auto"
[[volume]]
mesh = "leaves.ply"
opacity = 0.5
colour = [1.0, 0.5, 0.2]
[camera]
from = [3, 4, 9]
to = [0.5, 0.5, 1]
[[light]]
from = [6, 8, 4]
to = [0.5, 0.5, 1]
cone = 40
intensity = 15
"""


def test_a_printed_configuration_says_what_was_chosen(cli, files, tiny):
    (files / "scene.toml").write_text(SCENE)
    done = cli("render", files / "scene.toml", "--print-config", "--all", *tiny)
    assert done.code == 0, done.err
    points, curves, mesh = tomllib.loads(done.out)["volume"]
    assert points["points"] == str((files / "plume.npz").resolve())
    assert (points["radius"], points["profile"]) == (2.0, "smooth")
    assert isinstance(points["density"], float)
    assert isinstance(curves["width"], float)
    assert (mesh["opacity"], mesh["colour"]) == (0.5, [1.0, 0.5, 0.2])
    (files / "printed.toml").write_text(done.out)
    assert tomllib.loads(
        cli("render", files / "printed.toml", "--print-config", "--all").out
    ) == tomllib.loads(done.out)


@pytest.mark.slow
def test_a_printed_configuration_is_the_same_picture(cli, render, files, tiny):
    (files / "scene.toml").write_text(SCENE)
    (files / "printed.toml").write_text(cli("render", files / "scene.toml", "--print-config", *tiny).out)
    for name in ("scene", "printed"):
        render(files / f"{name}.toml", "-o", f"{name}.npy")
    image = np.load(files / "scene.npy")
    assert image[..., :3].max() > 0.05
    assert (np.load(files / "printed.npy") == image).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*POINTS, *CURVES])
def test_bare_files_render(render, files, name):
    done = render(files / name, "-o", "a.npy")
    assert "warning" not in done.err
    image = np.load(files / "a.npy")
    assert np.isfinite(image).all()
    assert image[..., :3].max() > 0.01
