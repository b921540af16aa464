"""What `tfm render` warns of on stderr."""

import numpy as np
import PIL.Image
import pytest
from scenes import blobs


@pytest.fixture
def lump(folder):
    """A scene file that leaves the density scale to its default, which is far too dense."""
    np.save(folder / "cloud.npy", 100 * blobs())
    path = folder / "scene.toml"
    path.write_text('[volume]\nfile = "cloud.npy"')
    return path


def test_a_missing_density_scale_is_told_before_rendering(render, lump):
    said = [line for line in render(lump, "-o", "a.npy").err.splitlines() if "warning" in line]
    assert len(said) == 1
    assert said[0].startswith(f"tfm: warning: {lump}: volume.density_scale is not given: 1 is used; ")
    assert "warning" in render(lump, "--print-config").err


def test_a_missing_density_scale_is_not_told_with_q_nor_where_it_is_given(render, lump):
    assert render(lump, "-o", "a.npy", "-q").err == ""
    for given in ("auto", "1"):
        assert "warning" not in render(lump, "-o", "a.npy", "--density-scale", given).err


def black(done):
    """Return what is said of a black picture, once."""
    (line,) = [line for line in done.err.splitlines() if line.startswith("tfm: warning: ")]
    return line.removeprefix("tfm: warning: ")


def test_an_empty_grid_is_told(render, cli, folder):
    np.savez(folder / "fire.npz", flame=np.zeros((4, 5, 6)))
    reason = "fire.npz: grid 'flame': all voxels are 0"
    assert black(render("fire.npz", "-o", "a.png", "-o", "b.exr")) == f"the picture is black: {reason}"
    assert render("fire.npz", "-o", "a.png", "-q").err == ""
    (grid,) = cli("info", "fire.npz", "--json").json["grids"]
    assert grid["renders"] == "the picture is black: all voxels are 0"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--density-scale", "0"), "cloud.npy: grid 'density': density_scale is 0"),
        (("--sigma-s", "0"), "medium.sigma_s and sigma_a are 0"),
        (("--camera-from", "0,0,99", "--camera-to", "0,0,199"), "the medium, around"),
        (("--intensity", "0"), "light.intensity is 0"),
        (
            ("--light-to", "999,0,0", "--cone", "1"),
            "no light reaches the medium: the cone of light 1 misses it",
        ),
        (("--cone", "0.001"), "the cone of light 1 is only "),
        (("--intensity", "1e-6"), "its brightest value, "),
        (("--exposure", "-20"), "its brightest value, "),
    ],
    ids=lambda each: " ".join(each) if isinstance(each, tuple) else "",
)
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_black_picture_says_why_once(render, cloud, folder, arguments, reason, method):
    # Dithered, a value of 1/100 of a step would be one in 1 of 100 pixels.
    done = render(cloud.name, "-o", "a.png", *arguments, "--method", method, "--no-dither")
    assert np.asarray(PIL.Image.open(folder / "a.png")).max() == 0
    assert black(done).startswith(f"the picture is black: {reason}")


def test_what_a_png_cannot_show_is_no_matter_of_other_files(render, cloud):
    assert "warning" not in render(cloud, "-o", "a.exr", "-o", "a.npy", "--intensity", "1e-6").err


def test_the_exposure_proposed_shows_it(render, cloud, folder):
    said = black(render(cloud, "-o", "a.png", "--intensity", "1e-6"))
    stops = said.split("--exposure ")[1].split()[0]
    assert "warning" not in render(cloud, "-o", "a.png", "--intensity", "1e-6", "--exposure", stops).err
    assert 80 < np.asarray(PIL.Image.open(folder / "a.png")).max() < 200


def test_a_picture_that_shows_something_is_no_warning(render, cloud):
    assert "warning" not in render(cloud, "-o", "a.png").err


def test_light_that_no_lattice_holds_is_told_where_it_was_asked_for(render, cloud):
    said = render(cloud, "-o", "a.npy", "--lookup", "lattice", "--density-scale", "1").err
    assert "warning" not in said  # the cone that is placed holds the grid
    options = ("--light-from", "0,50,0", "--light-to", "0,0,0", "--cone", "1", "--density-scale", "1")
    lines = render(cloud, "-o", "a.npy", "--lookup", "lattice", *options).err.splitlines()
    why = "1 of 1 lights have an edge in the grids or are near them"
    what = 'map.lookup = "lattice" cannot hold all light; the rest is looked up at every sample'
    assert [line for line in lines if "lattice" in line] == [f"tfm: warning: {what}: {why}"]
    for quiet in (("--lookup", "auto"), ("--lookup", "lattice", "--method", "dual")):
        assert "lattice" not in render(cloud, "-o", "a.npy", *quiet, *options).err


@pytest.mark.parametrize(
    ("output", "flags", "told"),
    [
        ("a.npy", ("--exposure", "1"), "tfm: note: --exposure 1 is of .png, and none is written\n"),
        ("a.png", ("--deep-colour",), "tfm: note: --deep-colour is of .deep.exr, and none is written\n"),
        ("a.png", ("--exposure", "1"), ""),
    ],
)
def test_options_of_pictures_that_are_not_written(render, lump, output, flags, told):
    lines = render(lump, "-o", output, *flags).err.splitlines(keepends=True)
    assert "".join(line for line in lines if "note" in line) == told


KEYS = "volume.translate=[{ frame = 1, value = [0, 0, 0] }, { frame = 3, value = [2, 0, 0] }]"


@pytest.mark.parametrize(
    ("flags", "moves"),
    [
        (("--shutter", "-0.5,0.5", "--set", KEYS), "volume.translate"),
        (("--shutter", "-0.5,0.5", "--turntable", "9"), "camera"),
        (("--shutter", "0,0", "--set", KEYS), None),
        (("--shutter", "-0.5,0.5"), None),
    ],
)
def test_a_scene_of_one_frame_that_would_stand_still_is_told(render, cloud, folder, flags, moves):
    frames = ("--frames", "2") if "--turntable" in flags else ("--frame", "2")
    done = render(cloud, "-o", "a.toml", *flags, *frames)

    why = f"image.shutter = [-0.5, 0.5]: {moves} moves meanwhile, which a scene of one frame cannot say"
    line = f"tfm: warning: {why}; the scene file leaves it out"
    assert [said for said in done.err.splitlines() if "warning" in said] == ([line] if moves else [])
    assert "shutter" in (folder / "a.toml").read_text()
    printed = render(cloud, "--print-config", *flags, *frames)
    assert (line in printed.err) == bool(moves)
    assert "[camera]" in printed.out
