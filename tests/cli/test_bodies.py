"""Mixtures of bodies on the command line: rendered, printed, changed by --set, refused in one line."""

import re
import tomllib

import numpy as np
import PIL.Image
import pytest
from scenes import blobs

import tfm_cl as tfm

SCENE = """
[medium]
sigma_s = [1.0, 0.9, 0.8]
sigma_a = 0.1
[[volume]]
file = "cloud.npy"
density_scale = 0.6
[[volume]]
file = "smoke.npy"
density_scale = 0.5
origin = [4.0, 3.0, 2.0]
medium = { sigma_s = [0.6, 0.4, 0.2], phase = "hg:-0.3" }
[[volume]]
shape = "everywhere"
density = 0.01
medium = { sigma_s = 1.0, sigma_a = 0.0, phase = "hg:0.4" }
[camera]
from = [8, 6, 40]
to = [8, 6, 7]
[[light]]
from = [24, 26, 20]
to = [8, 6, 7]
cone = 30
intensity = 15
"""
FOG = SCENE[SCENE.rindex("[[volume]]") : SCENE.index("[camera]")]


@pytest.fixture
def scene(cloud):
    """``scene(old, new, …)`` writes ``scene.toml`` with some texts replaced."""
    np.save(cloud.with_name("smoke.npy"), blobs((9, 10, 11), 11))

    def write(*replaced):
        text = SCENE
        for old, new in zip(replaced[::2], replaced[1::2], strict=True):
            assert old in text
            text = text.replace(old, new)
        path = cloud.with_name("scene.toml")
        path.write_text(text)
        return path

    return write


@pytest.fixture
def picture(render, folder):
    """``picture(INPUT, …)`` is what is rendered."""

    def run(*arguments):
        render(*arguments, "-o", "picture.npy")
        return np.load(folder / "picture.npy")

    return run


@pytest.mark.slow  # as a picture of the library it is quick
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_mixture_renders(render, scene, folder, method):
    done = render(scene(), "-o", "a.png", "-o", "a.npy", "--method", method)
    assert "warning" not in done.err
    image = np.load(folder / "a.npy")
    assert np.isfinite(image).all()
    assert image[..., :3].max() > 0.05
    assert (image[..., 3] > 0.2).all()  # fog is everywhere
    assert np.asarray(PIL.Image.open(folder / "a.png")).max() > 50


@pytest.mark.slow
def test_each_body_is_seen(picture, scene):
    whole = picture(scene())
    for alone in (
        picture(scene(FOG, "")),
        picture(scene(SCENE[SCENE.index("[[volume]]") : SCENE.index('[[volume]]\nfile = "smoke')], "")),
        picture(scene(SCENE[SCENE.index('[[volume]]\nfile = "smoke') : SCENE.rindex("[[volume]]")], "")),
    ):
        assert np.abs(alone - whole).max() > 0.005


@pytest.mark.slow
def test_both_methods_agree(picture, scene):
    """In 64 texels a side: what is tested is that they show the same, not how well."""
    numbers = ("--map-res", "64", "--light-steps", "64", "--steps", "64")
    tfm_image, dual = (picture(scene(), "--method", method, *numbers) for method in ("tfm", "dual"))
    assert np.abs(tfm_image - dual).mean() < 0.02 * dual.max()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_printed_configuration_is_the_same_picture(cli, picture, scene, folder, tiny, method):
    path = scene()
    done = cli("render", path, "--print-config", "--method", method, *tiny)
    assert done.code == 0, done.err
    (folder / "elsewhere").mkdir()
    printed = folder / "elsewhere" / "printed.toml"
    printed.write_text(done.out)
    table = tomllib.loads(done.out)
    assert ["medium" in volume for volume in table["volume"]] == [False, True, True]
    assert "sigma_a" not in table["volume"][1]["medium"]  # it is [medium]'s
    assert (picture(printed) == picture(path, "--method", method)).all()
    again = cli("render", printed, "--print-config")
    assert tomllib.loads(again.out) == table
    every = tomllib.loads(cli("render", printed, "--print-config", "--all").out)
    assert every["volume"][1]["medium"]["sigma_a"] == [0.1, 0.1, 0.1]


CHANGES = {
    "volume.1.medium.sigma_s=0.9": ("sigma_s = [0.6, 0.4, 0.2]", "sigma_s = 0.9"),
    "volume.1.medium.phase=isotropic": ('phase = "hg:-0.3"', 'phase = "isotropic"'),
    "volume.1.medium.sigma_a=[0.9,0.1,0.5]": (
        ', phase = "hg:-0.3"',
        ', phase = "hg:-0.3", sigma_a = [0.9, 0.1, 0.5]',
    ),
    "volume.0.medium.sigma_s=0.3": ("density_scale = 0.6", "density_scale = 0.6\nmedium = { sigma_s = 0.3 }"),
    "volume.2.density=0.03": ("density = 0.01", "density = 0.03"),
    "medium.sigma_s=0.2": ("sigma_s = [1.0, 0.9, 0.8]", "sigma_s = 0.2"),
}


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_set_does_what_the_file_would(picture, scene, change):
    before, changed = picture(scene()), picture(scene(), "--set", change)
    assert (changed == picture(scene(*CHANGES[change]))).all()
    assert np.abs(changed - before).max() > 1e-3


def test_a_flag_of_the_medium_leaves_the_media_of_bodies(cli, scene):
    done = cli("render", scene(), "--print-config", "--sigma-s", "3", "--phase", "hg:0.9")
    table = tomllib.loads(done.out)
    assert table["medium"]["sigma_s"] == [3, 3, 3]
    assert [volume["medium"]["sigma_s"] for volume in table["volume"][1:]] == [[0.6, 0.4, 0.2], [1, 1, 1]]
    assert [volume["medium"]["phase"]["g"] for volume in table["volume"][1:]] == [-0.3, 0.4]


@pytest.mark.slow
def test_layers_and_statistics_of_a_mixture(cli, scene, folder, tiny):
    done = cli(
        *("render", scene(), "-o", "a.exr", "--aov", "depth,transmittance,light_transmittance,map_error"),
        *("--json", "-", *tiny),
    )
    assert done.code == 0, done.err
    told = done.json
    assert told["map_bytes"] > 0
    assert told["samples"]["light_pass"] > 0
    assert [volume.get("shape") for volume in told["options"]["volume"]] == [None, None, "everywhere"]
    assert (folder / "a.exr").stat().st_size > 0


@pytest.mark.slow
def test_two_fields_have_twice_the_numbers(cli, scene, tiny):
    def map_bytes(*replaced):
        done = cli("render", scene(*replaced), "-o", "a.npy", "--json", "-", "--basis", "dct", *tiny)
        assert done.code == 0, done.err
        return done.json["map_bytes"]

    one = map_bytes('medium = { sigma_s = [0.6, 0.4, 0.2], phase = "hg:-0.3" }\n', "")
    assert map_bytes() == 2 * one > 0


@pytest.mark.slow
def test_max_error_is_for_mixtures_too(cli, scene, device_name):
    """The numbers are chosen by what is measured; the picture they make is small."""
    device = ("--device", device_name) if device_name else ()
    done = cli(
        *("render", scene(), "-o", "a.npy", "--res", "16x9", "--max-error", "0.05", "--json", "-", *device)
    )
    assert done.code == 0, done.err
    assert 0 < done.json["error_estimate"] <= 0.05


# --- no light ----------------------------------------------------------------------------------------------

LIGHTS = SCENE[SCENE.index("[[light]]") :]
DARK = (LIGHTS, "", "\n[medium]", "\nlight = []\n[medium]")


@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("fog", [FOG, ""], ids=["mixture", "grids"])
def test_no_light_is_a_black_picture_that_says_why(render, scene, folder, method, fog):
    done = render(scene(FOG, fog, *DARK), "-o", "a.png", "-o", "a.npy", "--method", method)
    (line,) = [line for line in done.err.splitlines() if "warning" in line]
    assert line == "tfm: warning: the picture is black: the scene has no light and no ambient"
    image = np.load(folder / "a.npy")
    assert (image[..., :3] == 0).all()
    assert image[..., 3].max() > 0.2


def test_ambient_light_alone_is_a_picture(render, picture, scene):
    path = scene(*DARK)
    image = picture(path, "--set", "ambient.radiance=0.5")
    assert image[..., :3].max() > 0.1
    assert "warning" not in render(path, "-o", "a.png", "--set", "ambient.radiance=0.5").err


def test_a_light_that_is_not_there_has_no_keys(refused, scene):
    line = refused("render", scene(*DARK), "-o", "a.png", "--cone", "30")
    assert "light.cone: the scene has 0 [[light]] tables" in line


# --- what is wrong is told ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["sun", "environment"])
def test_light_from_infinity_cannot_cross_fog_everywhere(refused, scene, tiny, kind):
    place = "" if kind == "environment" else "from = [24, 26, 20]\nto = [8, 6, 7]\n"
    path = scene(LIGHTS, f'[[light]]\ntype = "{kind}"\n{place}')
    line = refused("render", path, "-o", "a.png", *tiny)
    assert f"light 1 ({kind}) comes from infinitely far away" in line


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        (("sigma_s = [0.6, 0.4, 0.2]", "sigma = 1"), "volume 1: unknown key 'sigma' in [volume.medium]; did"),
        (
            ('phase = "hg:-0.3"', 'phase = "hg:-3"'),
            "volume 1: volume.medium.phase.g = -3.0: should be greater",
        ),
        (
            ("medium = { sigma_s = [0.6, 0.4, 0.2]", "medium = { sigma_s = -1"),
            "volume 1: volume.medium.sigma_s = ",
        ),
    ],
)
def test_a_fault_in_the_medium_of_a_body_is_one_line(refused, scene, tiny, replaced, message):
    assert message in refused("render", scene(*replaced), "-o", "a.png", *tiny)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "volume.1.medium.sigma_q=3",
            "volume 1: unknown key 'sigma_q' in [volume.medium]; did you mean 'sigma_s'?",
        ),
        ("volume.1.medium=3", "volume 1: volume.medium = 3: should be a table like [medium]"),
        ("volume.1.medium.sigma_s.x=3", "'sigma_s' is not a table"),
        ("volume.3.medium.sigma_s=3", "the scene has 3 [[volume]] tables"),
        ("volume.2.shape=cone", "volume 2: volume.shape: unknown shape 'cone'"),
    ],
)
def test_a_fault_in_set_is_one_line(refused, scene, change, message):
    assert message in refused("render", scene(), "-o", "a.png", "--set", change)


def test_a_flag_that_no_body_would_heed_is_refused(refused, scene):
    every = (*("density_scale = 0.6", 'density_scale = 0.6\nmedium = { sigma_s = 1, phase = "hg:0.1" }'),)
    for flag, value, key in (("--sigma-s", "3", "sigma_s"), ("--phase", "isotropic", "phase")):
        line = refused("render", scene(*every), "-o", "a.png", flag, value)
        assert f"medium.{key}: every volume has a {key} of its own: set volume.0.medium.{key}" in line


def test_several_faults_are_told_in_one_run(cli, scene):
    path = scene(
        *("sigma_a = 0.1", "sigma_a = 'much'"),
        *("sigma_s = [0.6, 0.4, 0.2]", "sigma_t = 1"),
        *("density = 0.01", "density = -1"),
        *("cone = 30", "cone = 300"),
    )
    done = cli("render", path, "-o", "a.png", "--set", "volume.2.medium.phase=snow")
    assert (done.code, done.out) == (2, "")
    told = sorted(re.sub(r"^tfm: \S*\.toml(:\d+)?: ", "", line) for line in done.err.splitlines())
    starts = [
        "light 0: light.cone = 300: should be less than 90",
        "medium.sigma_a = 'much': should be one number",
        "volume 1: unknown key 'sigma_t' in [volume.medium]; here sigma_s + sigma_a: ",
        "volume 2: volume.density = -1: should be greater than or equal to 0",
        "volume 2: volume.medium.phase = 'snow': unknown phase function 'snow'",
    ]
    assert len(told) == len(starts), told
    assert all(line.startswith(start) for line, start in zip(told, starts, strict=True)), told
    assert not path.with_name("a.png").exists()


def test_what_is_black_names_the_body(render, scene):
    path = scene(
        "density_scale = 0.6", "density_scale = 0", "density_scale = 0.5", "density_scale = 0", FOG, ""
    )
    (line,) = [line for line in render(path, "-o", "a.png").err.splitlines() if "warning" in line]
    assert "volume.0 (" in line
    assert "cloud.npy: grid 'density'): density_scale is 0; volume.1 (" in line


def test_the_library_reads_the_same_bodies(scene):
    loaded = tfm.Scene.load(scene())
    assert [body.label.rpartition("/")[2] for body in loaded.bodies] == [
        "cloud.npy: grid 'density'",
        "smoke.npy: grid 'density'",
        "everywhere",
    ]
    brown = tfm.Medium(sigma_s=(0.6, 0.4, 0.2), sigma_a=0.1, phase=tfm.HenyeyGreenstein(-0.3))
    assert loaded.bodies[1].own_medium == brown
    assert loaded.medium_of(loaded.bodies[0]) == tfm.Medium(sigma_s=(1.0, 0.9, 0.8), sigma_a=0.1)
