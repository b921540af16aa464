import json
import os
import shlex
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scenes import blobs

import tfm_cl
from tfm_cl.files.image_io import load_image

SCENE = """
[volume]
file = "cloud.npy"
density_scale = 1.5
voxel_size = [0.5, 1.0, 1.0]
origin = [-4, -6, -7]

[medium]
sigma_s = [1.0, 0.8, 0.5]
phase = {type = "hg", g = 0.4}

[camera]
from = [5, 9, 30]
to = [0, 0.5, 0]

[[light]]
from = [20, 30, 10]
to = [0, 0, 0]
cone = 12
intensity = 9

[[light]]
from = [-30, 0, 5]
to = [1, 0, 0]
blend = 0.3
falloff = "inverse-square"
intensity = [900, 0, 300]

[map]
density_weighting = "auto"
storage = "u8"

[march]
sampling = "world"

[image]
crop = [1, 2, 14, 8]
aov = ["depth"]
"""


@pytest.fixture
def scene(cloud):
    path = cloud.with_name("scene.toml")
    path.write_text(SCENE)
    return path


def pixels(name="a.npy"):
    return np.load(name)


def test_every_output_holds_the_picture(render, cloud):
    render(cloud, "-o", "a.npy", "-o", "a.exr", "-o", "a.PNG", "--no-dither")
    picture = pixels()
    assert picture.shape == (9, 16, 4)
    assert picture.dtype == np.float32
    assert 0.3 < picture[..., 3].max() <= 1
    np.testing.assert_array_equal(OpenEXR.File("a.exr").channels()["RGBA"].pixels, picture)
    colour = np.clip(picture[..., :3], 0, 1)
    srgb = np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * colour ** (1 / 2.4) - 0.055)
    with Image.open("a.PNG") as png:
        assert np.abs(np.asarray(png, float)[..., :3] - 255 * srgb).max() <= 0.51


def test_the_picture_is_the_librarys(render, cloud, new_renderer):
    render(cloud, "-o", "a.npy")
    scene = tfm_cl.Scene.load(cloud)
    scene = scene.replace(
        map=tfm_cl.MapSettings(res=16, steps=8),
        march=tfm_cl.MarchSettings(steps=8),
        camera=scene.camera.replace(res=(16, 9)),
    )
    # The camera was placed for another frame, of the same aspect.
    with new_renderer(lanes=1) as renderer:
        np.testing.assert_array_equal(pixels(), renderer.render(scene).image)


@pytest.mark.parametrize(
    ("array", "placed"),
    [
        (blobs(), ()),
        (np.ones((4, 4, 4)), ()),  # centre 2,2,2: three equal numbers are still a point
        (np.ones((4, 4, 4)), ("--set", "volume.origin=300000,-2e5,0", "--set", "volume.voxel_size=0.01")),
        (1e-4 * np.ones((4, 4, 4)), ("--sigma-s", "0.1,0.2,0.3", "--fov", "20")),
    ],
)
def test_what_was_chosen_can_be_given_as_flags(render, folder, array, placed):
    np.save(folder / "cloud.npy", array)
    first = render("cloud.npy", "-o", "a.npy", *placed)
    told, _, flags = first.err.partition("chosen for cloud.npy: ")
    assert told == ""
    again = render("cloud.npy", "-o", "b.npy", *placed, *shlex.split(flags))
    assert again.err == ""
    assert pixels("a.npy")[4, 8, 3] > 0.2
    assert (folder / "a.npy").read_bytes() == (folder / "b.npy").read_bytes()


def test_what_was_counted_is_told_and_written(cli, cloud, device_name):
    device = ("--device", device_name) if device_name else ()
    first = cli(
        "render",
        cloud,
        "-o",
        "a.npy",
        "-o",
        "a.exr",
        "--res",
        "16x9",
        "--steps",
        "20",
        "--look",
        "plain",
        "--json",
        "-",
        *device,
    )
    options, flags = first.json["options"], shlex.split(first.err)
    chosen = {flag: flags[flags.index(flag) + 1] for flag in ("--map-res", "--light-steps")}
    assert "--steps" not in flags
    assert chosen == {
        "--map-res": str(options["map"]["res"]),
        "--light-steps": str(options["map"]["steps"]),
    }
    assert options["march"]["steps"] == 20
    assert first.json["map_bytes"] == options["map"]["res"] ** 2 * 8 * 4
    assert json.loads(OpenEXR.File("a.exr").header()["tfm_cl:options"]) == options


def test_a_scene_counts_by_itself_only_when_asked(cli, scene):
    printed = tomllib.loads(cli("render", scene, "--print-config").out)
    assert (printed["map"]["res"], printed["map"]["steps"], printed["march"]["steps"]) == (1024, 100, 100)
    asked = cli("render", scene, "--print-config", "--set", "march.steps=auto")
    steps = tomllib.loads(asked.out)["march"]["steps"]
    assert asked.err == f"chosen for scene.toml: --steps {steps}\n"


@pytest.mark.slow
def test_cutoff_and_voxels_reach_the_render(render, cloud):
    render(cloud, "-o", "a.npy", "--density-scale", "0.05")
    render(cloud, "-o", "b.npy", "--density-scale", "0.05", "--cutoff", "0.9")
    render(cloud, "-o", "c.npy", "--density-scale", "0.05", "--voxels", "u8")
    render(cloud, "-o", "d.npy", "--density-scale", "0.05", "--set", "march.skip_empty=false")
    opacity = pixels("a.npy")[..., 3]
    assert np.mean((opacity > 0) & (opacity < 0.09)) > 0.05
    np.testing.assert_allclose(pixels("b.npy")[..., 3], np.where(opacity > 0.1, 1, opacity), atol=1e-5)
    assert 0 < np.abs(pixels("c.npy") - pixels("a.npy")).max() < 0.02
    # Only what rounding makes of other loops.
    np.testing.assert_allclose(pixels("d.npy"), pixels("a.npy"), atol=1e-5)


@pytest.mark.slow
def test_deep_images_have_one_ray_a_pixel_and_that_is_told(render, cloud):
    done = render(cloud, "-o", "a.deep.exr", "-o", "a.npy", "--deep-tolerance", "0.1", "--samples", "4")
    assert "tfm: note: a.deep.exr: has one ray a pixel, through its centre (--samples 4 is" in done.err
    few = OpenEXR.File("a.deep.exr", separate_channels=True).parts[0].channels["A"].pixels
    render(cloud, "-o", "b.deep.exr", "--deep-tolerance", "0", "--deep-colour", "--crop", "3,1,13,8")
    channels = OpenEXR.File("b.deep.exr", separate_channels=True).parts[0].channels
    assert [*channels] == ["A", "B", "G", "R", "Z", "ZBack"]
    many = channels["A"].pixels
    assert few.shape == (9, 16)
    assert many.shape == (7, 10)
    counts = [sum(len(pixel) for pixel in part.ravel() if pixel is not None) for part in (few, many)]
    assert 0 < counts[0] < counts[1]


def test_a_volume_far_from_the_origin_looks_the_same(render, folder):
    np.save(folder / "cloud.npy", blobs())
    render("cloud.npy", "-o", "a.npy", "-q")
    render("cloud.npy", "-o", "b.npy", "-q", "--set", "volume.origin=1e6,-1e6,5e5")
    np.testing.assert_allclose(pixels("b.npy"), pixels("a.npy"), atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["cloud.npy", "scene.toml"])
def test_the_printed_configuration_reproduces_the_picture(render, scene, folder, source):
    printed = render(scene.with_name(source), "-o", "a.npy", "--print-config", "--set", "march.max_stretch=2")
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "printed.toml").write_text(printed.out)
    again = render(elsewhere / "printed.toml", "-o", "b.npy", "--print-config")
    assert (folder / "a.npy").read_bytes() == (folder / "b.npy").read_bytes()
    assert pixels().max() > 0
    assert again.out == printed.out
    assert "chosen for" not in again.err


def test_a_scene_file_is_written_with_names_relative_to_it(cli, scene, folder):
    (folder / "kept").mkdir()
    done = cli("render", scene, "-o", "kept/kept.toml", "--fov", "33")
    assert (done.code, done.out) == (0, "")
    kept = tomllib.loads((folder / "kept" / "kept.toml").read_text(encoding="utf-8"))
    printed = tomllib.loads(cli("render", scene, "--print-config", "--fov", "33").out)
    assert Path(printed["volume"]["file"]).is_absolute()
    assert kept["volume"]["file"] == f"../{Path(printed['volume']['file']).name}"
    assert printed | {"volume": kept["volume"]} == kept
    assert kept["camera"]["fov"] == 33
    # Keys at their default are there when they are asked for, and make no difference.
    everything = cli("render", scene, "--print-config", "--all", "--fov", "33")
    assert cli("render", "kept/kept.toml", "--print-config", "--all").out == everything.out
    assert tomllib.loads(everything.out)["march"]["cutoff"] == 1e-4
    assert "cutoff" not in printed["march"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "a.png", "--all"), "--all is of a scene file"),
        (("-o", "scene.toml"), "scene.toml: is the input itself"),
        (("-o", "none/a.toml"), "none/a.toml: there is no directory"),
    ],
)
def test_scene_files_that_are_not_written(cli, scene, arguments, message):
    before = scene.read_bytes()
    done = cli("render", scene.name, *arguments)
    assert (done.code, done.out) == (2, "")
    assert message in done.err
    assert scene.read_bytes() == before


def test_print_config_alone_renders_nothing(render, cloud, folder, monkeypatch):
    monkeypatch.setattr("tfm_cl.device.device._all_devices", list)  # nor does it need a device
    done = render(cloud, "--print-config", "-q")
    assert tomllib.loads(done.out)["camera"]["res"] == [16, 9]
    assert [path.name for path in folder.iterdir()] == ["cloud.npy"]


def test_crop_is_those_pixels_of_the_frame(render, cloud):
    render(cloud, "-o", "a.npy")
    render(cloud, "-o", "b.npy", "-o", "b.exr", "--crop", "3,1,13,8")
    np.testing.assert_array_equal(pixels("b.npy"), pixels()[1:8, 3:13])
    header = OpenEXR.File("b.exr").header()
    np.testing.assert_array_equal(header["dataWindow"], [(3, 1), (12, 7)])
    np.testing.assert_array_equal(header["displayWindow"], [(0, 0), (15, 8)])


def test_layers_that_a_file_has_no_room_for_are_told(render, cloud):
    done = render(cloud, "-o", "a.exr", "-o", "a.png", "-o", "a.npy", "--aov", "depth,samples")
    notes = [line for line in done.err.splitlines() if "note" in line]
    assert notes == [
        f"tfm: note: a.{suffix}: has no room for layers: depth, samples (.exr has)"
        for suffix in ("png", "npy")
    ]
    assert "note" not in render(cloud, "-o", "a.png", "--aov", "depth", "-q").err
    assert "note" not in render(cloud, "-o", "a.exr", "--aov", "depth").err
    assert "note" not in render(cloud, "-o", "a.png").err


def test_aovs_and_header_of_an_exr(render, cloud):
    done = render(
        cloud, "-o", "a.exr", "--aov", "depth,transmittance,light_transmittance,samples", "--json", "-"
    )
    file = OpenEXR.File("a.exr", separate_channels=True)
    assert set(file.channels()) == {
        *("R", "G", "B", "A", "depth", "samples"),
        *(f"{name}.{c}" for name in ("transmittance", "light_transmittance") for c in "RGB"),
    }
    alpha = file.channels()["A"].pixels
    transmittance = [file.channels()[f"transmittance.{c}"].pixels for c in "RGB"]
    np.testing.assert_allclose(1 - np.mean(transmittance, axis=0), alpha, atol=1e-6)
    assert json.loads(file.header()["tfm_cl:options"]) == done.json["options"]
    assert file.header()["software"] == f"tfm_cl {tfm_cl.__version__}"


def test_half_precision_exr(render, cloud):
    render(cloud, "-o", "a.exr", "--set", "image.pixel_type=half")
    assert OpenEXR.File("a.exr").channels()["RGBA"].pixels.dtype == np.float16


def test_exposure_is_stops_and_png_only(render, cloud):
    dim = ("--intensity", "1")
    render(cloud, "-o", "a.png", "-o", "a.npy", *dim, "--exposure", "3")
    render(cloud, "-o", "b.png", "-o", "b.npy", "--intensity", "8")
    np.testing.assert_allclose(8 * pixels("a.npy")[..., :3], pixels("b.npy")[..., :3], rtol=1e-5)
    with Image.open("a.png") as bright, Image.open("b.png") as same:
        assert np.abs(np.asarray(bright, int) - np.asarray(same, int)).max() <= 1


def test_samples_and_filter_reach_the_renderer(render, cloud):
    told = render(cloud, "-o", "a.npy", "--samples", "4", "--filter", "gaussian", "--json", "-", "--stats")
    refined = json.loads(told.out)["refined_pixels"]
    assert refined > 0
    assert f"refined      {refined:8,} pixels" in told.err
    render(cloud, "-o", "b.npy", "--filter", "gaussian")
    assert (pixels("a.npy") != pixels("b.npy")).any()


def test_a_background_is_behind_the_picture(render, cloud):
    render(cloud, "-o", "a.npy", "-o", "a.exr", "--aov", "transmittance")
    behind = ("--background", "0.5,1,20", "--aov", "transmittance")
    told = render(cloud, "-o", "b.npy", "-o", "b.exr", "-o", "b.png", *behind, "-q").err
    assert told == ""
    layers = [OpenEXR.File(name, separate_channels=True).channels() for name in ("a.exr", "b.exr")]
    through = np.stack([layers[0][f"transmittance.{c}"].pixels for c in "RGB"], axis=-1)
    expected = pixels("a.npy")
    expected[..., :3] += (0.5, 1, 20) * through
    np.testing.assert_allclose(pixels("b.npy"), expected, rtol=1e-6)
    np.testing.assert_array_equal(load_image("b.exr"), pixels("b.npy"))
    np.testing.assert_array_equal(layers[1]["transmittance.R"].pixels, through[..., 0])
    assert load_image("b.png")[0, 0, 1] == 1
    # With alpha it is left out, also of what the exposure goes by.
    look = ("--transparent", "--exposure", "auto")
    render(cloud, "-o", "a.png", *look)
    told = render(cloud, "-o", "b.png", *look, *behind).err
    assert "note: b.png: has alpha in place of the background (--no-transparent shows it)" in told
    np.testing.assert_array_equal(load_image("b.png"), load_image("a.png"))


@pytest.mark.slow
def test_a_sky_is_behind_the_picture_it_lights(render, cloud):
    sky = ("--light-type", "sky", "--set", "light.samples=3")
    render(cloud, "-o", "a.npy", *sky)
    render(cloud, "-o", "b.npy", "-o", "b.png", *sky, "--background", "environment", "--exposure", "auto")
    a, b = pixels("a.npy"), pixels("b.npy")
    np.testing.assert_array_equal(a[..., 3], b[..., 3])
    empty = a[..., 3] == 0
    assert empty.any()
    assert not a[empty].any()
    assert (b[empty][:, :3] > 0.05).all()
    assert "note: c.png: has alpha in place of the background" in (
        render(cloud, "-o", "c.png", *sky, "--background", "environment", "--transparent").err
    )


def test_a_dark_picture_before_a_background_is_no_warning(render, cloud):
    dark = ("--density-scale", "1", "--intensity", "0")
    assert "the picture is black" in render(cloud, "-o", "a.png", *dark).err
    assert "warning" not in render(cloud, "-o", "a.png", *dark, "--background", "1").err
    # Where its own light is shown, that is what counts.
    faint = ("--density-scale", "1", "--intensity", "1e-6", "--background", "1")
    assert "the picture is black" in render(cloud, "-o", "a.png", *faint, "--transparent").err


def test_an_automatic_exposure_is_told_and_repeated(render, cloud, folder):
    look = ("--view", "agx", "--transparent", "--png-bits", "16")
    done = render(cloud, "-o", "a.png", "-o", "a.exr", "--exposure", "auto", *look, "--json", "-", "-v")
    stops = done.json["plan"]["image.exposure"]["value"]
    assert done.json["options"]["image"]["exposure"] == stops
    assert "what is lit" in done.json["plan"]["image.exposure"]["why"]
    assert f"chosen for --exposure auto: --exposure {stops:g}\n" in done.err
    render(cloud, "-o", "b.png", "--exposure", str(stops), *look)
    assert (folder / "a.png").read_bytes() == (folder / "b.png").read_bytes()
    # The alpha is that of the other files.
    np.testing.assert_allclose(
        load_image("a.png")[..., 3], OpenEXR.File("a.exr").channels()["RGBA"].pixels[..., 3], atol=1e-5
    )
    other = render(cloud, "-o", "c.npy", "--exposure", "auto", "--json", "-")
    assert "image.exposure" not in other.json["plan"]  # nothing needed it
    assert "chosen for --exposure" not in other.err
    assert "tfm: note: --exposure auto is of .png, and none is written\n" in other.err


@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_json_report(render, cloud, folder, method, device_name):
    done = render(cloud, "-o", "a.npy", "--json", "report.json", "--method", method)
    assert done.out == ""
    report = json.loads((folder / "report.json").read_text())
    of_picture = {"samples", "refined_pixels", "map_bytes", "error_estimate"}
    assert set(report) == {"options", "plan", "device", "seconds", *of_picture}
    assert report["refined_pixels"] == 0
    assert set(report["seconds"]) == {"load", "compile", "light_pass", "view_pass", "host", "save", "total"}
    assert set(report["samples"]) == {"light_pass", "view_pass"}
    assert set(report["options"]) == {
        *("volume", "medium", "camera", "light", "solid", "ambient", "shadow", "map", "march", "image")
    }
    assert report["options"]["march"]["method"] == method
    assert report["options"]["camera"]["res"] == [16, 9]
    assert report["options"]["volume"]["file"] == str(cloud)
    with tfm_cl.Renderer(device_name) as renderer:
        assert report["device"] == {"name": renderer.device_name}
    dual = method == "dual"
    assert set(report["plan"]) >= {"volume.density_scale", "camera.from", "light.from"}
    assert all(set(decision) == {"value", "why"} for decision in report["plan"].values())
    assert all(decision["why"] and decision["value"] is not None for decision in report["plan"].values())
    assert report["plan"].get("map.basis", {}).get("value") == (None if dual else "klt")
    assert report["map_bytes"] == (0 if dual else 16 * 16 * 8 * 4)
    assert (report["seconds"]["light_pass"] == 0) is dual
    assert (report["samples"]["light_pass"] == 0) is dual
    assert report["samples"]["light_pass"] <= 16 * 16 * 8
    assert report["samples"]["view_pass"] > 0
    assert report["seconds"]["view_pass"] > 0
    parts = sum(seconds for name, seconds in report["seconds"].items() if name != "total")
    assert parts <= report["seconds"]["total"]


@pytest.mark.slow
def test_json_tells_the_weighting_that_auto_chose(render, scene):
    options = render(scene, "-o", "a.npy", "--basis", "dct", "--json", "-").json["options"]
    assert 1 <= options["map"]["density_weighting"] <= 16


def test_quiet_prints_nothing_at_all(render, cloud):
    # So thin a medium that float32 maps lose its shadows: a warning.
    warned = ("--sigma-s", "0.001", "--density-scale", "5000", "--basis", "dct", "--density-weighting", "1")
    assert "warning: " in render(cloud, "-o", "a.npy", *warned).err
    done = render(cloud, "-o", "a.npy", "-q", *warned)
    assert (done.out, done.err) == ("", "")


def test_statistics_go_to_stderr(render, cloud):
    done = render(cloud, "-o", "a.npy", "--stats")
    assert done.out == ""
    for name in ("device", "load", "compile", "light_pass", "view_pass", "host", "save", "total", "maps"):
        assert f"\n{name} " in done.err


def test_verbose_prints_every_option(render, cloud):
    done = render(cloud, "-o", "a.npy", "-v")
    assert done.out == ""
    told = done.err.partition("\n")[2]
    assert tomllib.loads(told)["map"]["basis"] == "klt"
    assert "\n# map.basis = klt: the most accurate at equal bytes\n" in done.err
    assert "\n# camera.from = " in done.err


@pytest.mark.slow
def test_a_lattice_that_was_chosen_is_told(render, cloud):
    lights = "".join(f'[[light]]\ntype = "sun"\nfrom = [{x}, 3, 1]\nto = [0, 0, 0]\n' for x in (1, 2, 3))
    scene = cloud.with_name("suns.toml")
    camera = "[camera]\nfrom = [8, 6, 60]\nto = [8, 6, 7]\nfov = 5\n"  # with pixels narrower than voxels
    scene.write_text(f'[volume]\nfile = "{cloud.name}"\ndensity_scale = 0.1\n{camera}{lights}')

    done = render(scene, "-o", "a.npy", "-v", "--json", "-")

    chosen = done.json["plan"]["map.lookup"]
    assert chosen["value"] == done.json["options"]["map"]["lookup"] == "lattice"
    assert chosen["why"].startswith("3 lights once a voxel")
    assert f"# map.lookup = lattice: {chosen['why']}" in done.err.splitlines()
    config = render(scene, "--print-config").out
    assert tomllib.loads(config)["map"]["lookup"] == "lattice"
    assert "warning" not in done.err


def test_negative_coordinates_are_values(render, cloud):
    done = render(
        cloud,
        *("--print-config", "--camera-from", "-5,-1,-20", "--light-from", "-1e1,2,-3"),
        *("--set", "volume.origin=-1,-2,-3"),
    )
    config = tomllib.loads(done.out)
    assert config["camera"]["from"] == [-5, -1, -20]
    assert config["light"][0]["from"] == [-10, 2, -3]
    assert config["volume"]["origin"] == [-1, -2, -3]


def test_sanitize_renders_a_damaged_density(render, folder):
    density = blobs()
    whole = density.copy()
    density[3, 4, 5], density[6, 7, 8], whole[3, 4, 5], whole[6, 7, 8] = np.nan, -1, 0, 0
    np.save(folder / "damaged.npy", density)
    np.save(folder / "whole.npy", whole)
    render("damaged.npy", "-o", "a.npy", "--set", "volume.sanitize=true")
    render("whole.npy", "-o", "b.npy")
    np.testing.assert_array_equal(pixels("a.npy"), pixels("b.npy"))


def test_a_failed_write_leaves_the_old_picture(render, cli, tiny, cloud, folder, monkeypatch):
    render(cloud, "-o", "a.npy")
    old = (folder / "a.npy").read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tfm_cl.files.image_io.npy.write", full)
    done = cli("render", cloud, "-o", "a.npy", "-q", *tiny, "--fov", "30")
    assert done.code == 2
    assert done.err == "tfm: a.npy: cannot be written (No space left on device)\n"
    assert (folder / "a.npy").read_bytes() == old
    assert sorted(path.name for path in folder.iterdir()) == ["a.npy", "cloud.npy"]


def test_as_a_program_stdout_holds_what_was_asked(cloud, program, tiny):
    done = subprocess.run(
        program("render", "cloud.npy", "-o", "a.npy", "--json", "-", "--stats", *tiny),
        capture_output=True,
        text=True,
        check=True,
        cwd=cloud.parent,
    )
    assert json.loads(done.stdout)["options"]["map"]["res"] == 16
    assert done.stderr.startswith("chosen for cloud.npy: ")
    assert "%" not in done.stderr  # no progress bar: stderr is no terminal


@pytest.mark.parametrize("quiet", [False, True])
def test_progress_on_a_terminal(cloud, program, tiny, quiet):
    termios = pytest.importorskip("termios", reason="no pseudo-terminals here")
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (25, 80))
    arguments = program("render", "cloud.npy", "-o", "a.npy", *(["-q"] if quiet else []), *tiny)
    with os.fdopen(ours, "rb", buffering=0) as terminal, os.fdopen(theirs, "wb") as stderr:
        done = subprocess.run(arguments, stdout=subprocess.PIPE, stderr=stderr, check=True, cwd=cloud.parent)
        os.set_blocking(ours, False)
        shown = b"".join(iter(lambda: terminal.read(4096), None)).decode()
    assert done.stdout == b""
    if quiet:
        assert shown == ""
    else:
        assert "light pass: " in shown
        assert "view pass, light 1: " in shown


@pytest.mark.parametrize(
    "part",
    [
        '[[solid]]\nmesh = "missing.ply"',
        '[[light]]\nfrom = [0, 0, 9]\nto = [0, 0, 0]\ntexture = "missing.png"',
    ],
    ids=["mesh", "texture"],
)
def test_files_are_read_before_a_device_is_looked_for(cli, cloud, folder, part):
    (folder / "scene.toml").write_text(f'[volume]\nfile = "{cloud.name}"\ndensity_scale = 1\n{part}\n')
    done = cli("render", "scene.toml", "-o", "a.npy", "--device", "abacus", "-q")
    assert done.code == 2
    assert "missing." in done.err
    assert "abacus" not in done.err
