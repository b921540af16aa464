"""Names of files as users write them, wherever a command takes one: what works, and one line for the rest."""

import os
import shutil
import subprocess

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.files import image_io

LONG = "a" * 300
LOOP = "Too many levels of symbolic links"
NOT_UTF8 = os.fsdecode(b"x\xff")


@pytest.fixture
def bad(refused, tiny):
    """``bad(…)`` is a ``tfm render`` of ``cloud.npy`` that must be refused; returns the line."""
    return lambda *arguments, source="cloud.npy", out="a.png": refused(
        "render", source, "-o", out, "-q", *tiny, *arguments
    )


@pytest.fixture
def looped(cloud):
    """Beside ``cloud.npy``, links to themselves."""
    for name in ("loop.npy", "loop.toml", "loop.png", "loop.ply", "loop.json"):
        cloud.with_name(name).symlink_to(name)
    return cloud


READ = {
    "volume": lambda name, bad: bad(source=f"{name}.npy"),
    "scene": lambda name, bad: bad(source=f"{name}.toml"),
    "texture": lambda name, bad: bad("--set", f"light.texture={name}.png"),
    "colour": lambda name, bad: bad("--set", f"volume.colour={name}.npy"),
}


@pytest.mark.parametrize("kind", READ)
@pytest.mark.parametrize(("name", "reason"), [(LONG, "File name too long"), ("loop", LOOP)])
def test_render_reads(bad, looped, kind, name, reason):
    assert looped.exists()
    line = READ[kind](name, bad)
    assert name in line
    assert f"cannot be read ({reason})" in line


@pytest.mark.parametrize(("name", "reason"), [(LONG, "File name too long"), ("loop", LOOP)])
def test_render_reads_a_mesh(bad, looped, name, reason):
    looped.with_name("scene.toml").write_text(
        f'[volume]\nfile = "cloud.npy"\n[[solid]]\nmesh = "{name}.ply"\n'
    )
    assert f"{name}.ply: cannot be read ({reason})" in bad(source="scene.toml")


@pytest.mark.parametrize(("name", "reason"), [(LONG, "File name too long"), ("loop", LOOP)])
def test_render_writes(bad, looped, name, reason):
    assert f"{name}.png: cannot be written ({reason})" in bad(out=f"{name}.png")
    assert f"{name}.json: cannot be written ({reason})" in bad("--json", f"{name}.json")
    assert looped.with_name("loop.png").is_symlink()


@pytest.mark.parametrize(("name", "reason"), [(LONG, "File name too long"), ("loop", LOOP)])
def test_the_other_commands(refused, looped, name, reason):
    np.save(looped.with_name("a.npy"), np.zeros((5, 5, 4), np.float32))
    for line in (
        refused("info", f"{name}.npy"),
        refused("compare", f"{name}.png", "a.npy"),
        refused("compare", "a.npy", f"{name}.npy"),
    ):
        assert f"cannot be read ({reason})" in line
    folder = name if name == LONG else "loop.npy"
    assert f"cannot be made ({reason})" in refused("sweep", "cloud.npy", "-o", folder)


@pytest.mark.parametrize("name", ["pipe.npy", "pipe.toml", "pipe.exr", "pipe.png"])
def test_a_pipe_is_not_waited_for(cloud, program, name):
    os.mkfifo(cloud.with_name(name))
    commands = {
        ".npy": ("info", name),
        ".toml": ("render", name, "--print-config"),
        ".exr": ("compare", name, cloud),
        ".png": ("render", cloud, "-o", "a.npy", "-q", "--set", f"light.texture={name}"),
    }
    done = subprocess.run(
        program(*commands[name[4:]]), capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 2
    assert f"{name}: is not a file but a pipe or device" in done.stderr
    assert done.stderr.count("\n") == 1


def test_names_as_long_as_names_can_be(render, cli, cloud):
    stem = "b" * 251
    shutil.copy(cloud, f"{stem}.npy")
    render(f"{stem}.npy", "-q", "-o", f"{stem}.exr", "-o", f"{stem}.png", "--json", f"{stem}.jso")
    values = cli("compare", f"{stem}.exr", f"{stem}.exr", "--json").json
    assert values["rmse"] == 0
    assert sorted(path.suffix for path in cloud.parent.glob("b*")) == [".exr", ".jso", ".npy", ".png"]


def test_names_that_are_not_utf_8(render, cli, cloud):
    shutil.copy(cloud, f"{NOT_UTF8}.npy")
    outputs = [f"o{NOT_UTF8}.{suffix}" for suffix in ("exr", "png", "npy")]
    arguments = [argument for name in outputs for argument in ("-o", name)]
    done = render(f"{NOT_UTF8}.npy", *arguments, "--json", f"o{NOT_UTF8}.json", "-v")
    assert "x\\udcff.npy" in done.err
    render("cloud.npy", "-o", "plain.exr", "-q")
    expected = image_io.load_image("plain.exr")
    for name in (outputs[0], outputs[2]):
        np.testing.assert_array_equal(image_io.load_image(name), expected)
    assert cli("compare", outputs[0], outputs[2], "--json").json["rmse"] == 0
    assert cli("info", f"{NOT_UTF8}.npy", "--json").json["file"] == f"{NOT_UTF8}.npy"
    render("cloud.npy", "-o", "a.png", "-q", "--set", f"light.texture={outputs[1]}")


def test_a_scene_file_cannot_hold_a_name_that_is_not_utf_8(cli, cloud):
    shutil.copy(cloud, f"{NOT_UTF8}.npy")
    done = cli("render", f"{NOT_UTF8}.npy", "--print-config")
    assert (done.code, done.out) == (2, "")
    assert 'x\\udcff.npy": a name that is not UTF-8 cannot be in a scene file; rename it' in done.err


@pytest.mark.slow
def test_a_sweep_of_a_name_that_is_not_utf_8(cli, cloud, tiny):
    shutil.copy(cloud, f"{NOT_UTF8}.npy")
    done = cli(
        "sweep", f"{NOT_UTF8}.npy", "-o", NOT_UTF8, "--bases", "dct", "--coeffs", "4", "--density-weighting",
        "1", "--no-converged", "-q", *tiny[2:],  # a sweep has no look
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "x\\udcff" in (cloud.parent / NOT_UTF8 / "sweep.csv").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["a\nb.npy", "a\x1b[2Jb.npy", ""])
def test_names_that_would_break_a_message(bad, refused, cloud, name):
    if name:
        shutil.copy(cloud, name)
    for line in (
        bad(source=name),
        bad(out=name),
        refused("info", name),
        refused("compare", name, name),
        refused("sweep", cloud, "-o", name),
    ):
        assert "should be the name of a file" in line


def test_the_home_directory(render, cloud, monkeypatch):
    monkeypatch.setenv("HOME", str(cloud.parent / "home"))
    home = cloud.parent / "home"
    home.mkdir()
    np.save(home / "cloud.npy", blobs())
    image_io.save(home / "white.png", image_io.Image(rgba=np.ones((2, 2, 4), np.float32)))
    (cloud.parent / "scene.toml").write_text(
        '[volume]\nfile = "~/cloud.npy"\n'
        '[[light]]\nfrom = [20, 20, 20]\nto = [8, 6, 7]\ntexture = "~/white.png"\n'
    )
    render("scene.toml", "-o", "~/a.npy", "--json", "~/a.json", "-q")
    assert sorted(path.name for path in home.iterdir()) == ["a.json", "a.npy", "cloud.npy", "white.png"]
    assert not (cloud.parent / "~").exists()


def test_a_scene_file_from_windows(render, cloud):
    (cloud.parent / "files").mkdir()
    np.save(cloud.parent / "files" / "cloud.npy", blobs())
    image_io.save("files/white.png", image_io.Image(rgba=np.ones((2, 2, 4), np.float32)))
    text = (
        "[volume]\r\nfile = 'files\\cloud.npy'\r\n"
        "[[light]]\r\nfrom = [20, 20, 20]\r\nto = [8, 6, 7]\r\ntexture = 'files\\white.png'\r\n"
    )
    (cloud.parent / "scene.toml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    shown = render("scene.toml", "--print-config").out
    assert f'file = "{cloud.parent}/files/cloud.npy"' in shown
    render("scene.toml", "-o", "a.png", "-q")


def test_results_do_not_take_each_other_s_place(bad, cloud):
    assert "a.npy: is written twice; choose another name" in bad("-o", "./a.npy", out="a.npy")
    assert "a.npy: is written twice; choose another name" in bad("--json", "a.npy", out="a.npy")
    assert "cloud.npy: is the input itself; choose another name" in bad("--json", cloud.name)
