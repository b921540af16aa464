"""Scene files: every section and default, what is placed, a round trip, and arbitrary values."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.device.structs.bodies import body_structs, grid_structs
from tfm_cl.device.structs.light import light_structs
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.device.structs.view import view_struct
from tfm_cl.errors import SceneError, TfmError
from tfm_cl.plan import options, resolution
from tfm_cl.plan.plan import plan
from tfm_cl.scene.fields import fields_of
from tfm_cl.scene.frame_numbers import KEYS as OF_FRAMES
from tfm_cl.scene.movable import STEPS
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.scene_file import SECTIONS, Made, SceneFile
from tfm_cl.scene.scene_file_writer import to_toml
from tfm_cl.scene.settings import ImageSettings

SAMPLES = Path(__file__).resolve().parents[2] / "volumes"

FULL = """
[volume]
file = "clouds/cloud.npz"
grid = "smoke"
density_scale = 2.5
voxel_size = [0.1, 0.2, 0.3]
origin = [1, 2, 3]
transform = [1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 2, 7, 0, 0, 0, 1]
sanitize = true
offset = 0.0
window = [0.0, 1.0]
colour = false
velocity = ["vel.x", "vel.y", "vel.z"]
velocity_scale = 0.5
velocity_fps = 25.0
velocity_outlier_threshold = 0.0
medium = { sigma_s = 0.5, sigma_a = [0.1, 0.2, 0.3], phase = { type = "hg", g = -0.2 }, emission = 0 }

[medium]
preset = "dust"
sigma_s = [1.0, 0.8, 0.5]
sigma_a = 0.25
orders = 1
octaves = 3
attenuation = 0.4
contribution = 0.6
eccentricity = 0.7
phase = { type = "hg", g = 0.3 }
emission = [2.0, 1.0, 0.25]
temperature = "fire"
temperature_offset = 0.5
temperature_scale = 900.0
Le_scale = 2.5
emission_lights = 64

[camera]
from = [0, 0, 5]
to = [1, 0, 0]
up = [0, 0, 1]
fov = 30
haze = 50
res = [64, 48]

[[light]]
type = "spot"
from = [3, 4, 2]
to = [0, 0, 0]
cone = 20.0
blend = 0.5
radius = 0.25
samples = 9
intensity = [1, 2, 3]
falloff = "inverse-square"
reach = 7.5
texture = "slide.png"
name = "key"

[[solid]]
shape = "sphere"
centre = [1, 2, 3]
radius = 0.5
albedo = [0.1, 0.2, 0.3]

[[solid]]
mesh = "knot.ply"

[[light]]
from = [-3, 4, 2]
to = [0, 0, 0]

[ambient]
radiance = [0.1, 0.2, 0.3]

[shadow]
res = 256
filter = "nearest"

[map]
basis = "dct"
coeffs = 6
density_weighting = "auto"
res = 128
steps = 50
storage = "f16"
target = "optical-depth"
fit = "l2"
range = "global"
lookup = "reconstruct"
slicing = "gamma"
blur = 2.5
blur_kernel = "box"
deposits = "depth"
functions = ""

[march]
method = "dual"
steps = 60
sampling = "world"
attenuation = "paper"
max_stretch = 8
cutoff = 0.01
skip_empty = false
voxels = "u8"

[image]
crop = [1, 2, 30, 40]
exposure = -1.5
samples = 4
filter = "gaussian"
background = [0.1, 0.2, 0.3]
view = "aces"
transparent = true
png_bits = 16
dither = false
aov = ["depth", "samples"]
pixel_type = "half"
compression = "piz"
deep_tolerance = 0.02
deep_colour = true
shutter = [-0.25, 0.25]
motion_samples = 5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    (folder / "clouds").mkdir()
    np.savez(folder / "clouds" / "cloud.npz", smoke=blobs(), fire=2 * blobs())
    np.save(folder / "cloud.npy", blobs())
    (folder / "full.toml").write_text(FULL)
    return folder


@pytest.fixture
def read(folder):
    """``read(TOML text, overrides…)`` is the scene file and its scene."""

    def read(text, *overrides):
        path = folder / "scene.toml"
        path.write_text(text)
        file = SceneFile.read(path, overrides)
        return file, file.make(tfm.Scene)

    return read


def test_every_key_arrives(folder):
    file = SceneFile.read(folder / "full.toml")
    scene = file.make(tfm.Scene)
    np.testing.assert_array_equal(scene.bodies[0].data, blobs())
    # Twice as high, and moved.
    np.testing.assert_allclose(scene.bodies[0].voxel_size, (0.1, 0.2, 0.6))
    np.testing.assert_allclose(scene.bodies[0].world_from_index @ [0, 0, 0, 1], (6.05, 8.1, 13.3, 1))
    assert scene.bodies[0].density_scale == 2.5
    fire = {
        "temperature": "fire",
        "temperature_offset": 0.5,
        "temperature_scale": 900.0,
        "Le_scale": 2.5,
        "emission_lights": 64,
    }
    assert scene.bodies[0].medium == scene.medium.replace(  # what it does not name is the scene's
        sigma_s=0.5, sigma_a=(0.1, 0.2, 0.3), phase=tfm.HenyeyGreenstein(-0.2), emission=0
    )
    (flame,) = scene.flames
    np.testing.assert_array_equal(flame.world_from_index, scene.bodies[0].world_from_index)
    assert scene.medium_of(flame) == tfm.Medium(sigma_s=0, emission=2.5, emission_lights=64)
    assert scene.ambient == tfm.Ambient(radiance=(0.1, 0.2, 0.3))
    assert scene.shadow == tfm.ShadowSettings(res=256, filter="nearest")
    sphere = tfm.SphereSolid(centre=(1, 2, 3), radius=0.5, albedo=(0.1, 0.2, 0.3))
    mesh = tfm.MeshSolid(mesh=str(folder / "knot.ply"))
    assert scene.solids == (sphere, mesh)
    assert scene.medium == tfm.Medium(
        preset="dust",
        sigma_s=(1, 0.8, 0.5),
        sigma_a=(0.25,) * 3,
        octaves=3,
        attenuation=0.4,
        contribution=0.6,
        eccentricity=0.7,
        phase=tfm.HenyeyGreenstein(0.3),
        emission=(2.0, 1.0, 0.25),
        **fire,
    )
    assert scene.camera == tfm.Camera(
        from_=(0, 0, 5), to=(1, 0, 0), up=(0, 0, 1), fov=30, haze=50, res=(64, 48)
    )
    spot = tfm.SpotLight(
        from_=(3, 4, 2),
        to=(0, 0, 0),
        cone=20,
        blend=0.5,
        radius=0.25,
        samples=9,
        intensity=(1, 2, 3),
        falloff="inverse-square",
        reach=7.5,
        texture=str(folder / "slide.png"),
        name="key",
    )
    assert scene.lights == (spot, tfm.SpotLight(from_=(-3, 4, 2), to=(0, 0, 0)))
    assert scene.map == tfm.MapSettings(
        basis="dct",
        coeffs=6,
        density_weighting="auto",
        res=128,
        steps=50,
        storage="f16",
        target="optical-depth",
        fit="l2",
        range="global",
        lookup="reconstruct",
        slicing="gamma",
        blur=2.5,
        blur_kernel="box",
        deposits="depth",
    )
    assert scene.march == tfm.MarchSettings(
        method="dual",
        steps=60,
        sampling="world",
        attenuation="paper",
        max_stretch=8,
        cutoff=0.01,
        skip_empty=False,
        voxels="u8",
    )
    assert file.image == ImageSettings(
        crop=(1, 2, 30, 40),
        exposure=-1.5,
        samples=4,
        filter="gaussian",
        background=(0.1, 0.2, 0.3),
        view="aces",
        transparent=True,
        png_bits=16,
        dither=False,
        aov=("depth", "samples"),
        pixel_type="half",
        compression="piz",
        deep_tolerance=0.02,
        deep_colour=True,
        shutter=(-0.25, 0.25),
        motion_samples=5,
    )
    assert plan(scene, file=file).told == {}


def without_place(line):
    """What is wrong, without file and line."""
    return re.sub(r"^\S*\.toml(:\d+)?: ", "", line)


def test_the_full_scene_has_every_key(folder):
    table = tomllib.loads((folder / "full.toml").read_text())
    for name, model in SECTIONS.items():
        # Instead of coeffs, fov, transform, and from, to and up; and of files of many frames.
        other = {"bytes", "max_error", "focal_length", "sensor_width", "matrix", *STEPS, *OF_FRAMES}
        assert set(table[name]) == set(model.keys()) - other, name
    assert set(table["light"][0]) == set(tfm.SpotLight.keys()) - set(OF_FRAMES)


def test_defaults_are_those_of_the_interface(read):
    _, scene = read('[volume]\nfile = "cloud.npy"\n')
    assert scene.bodies[0].density_scale == 1
    assert scene.medium == tfm.Medium(sigma_s=(1, 1, 1), sigma_a=(0, 0, 0), phase=tfm.Isotropic())
    assert (scene.camera.up, scene.camera.fov, scene.camera.res) == ((0, 1, 0), 40, (1280, 720))
    assert (scene.map.basis, scene.map.coeffs, scene.map.density_weighting) == ("auto", "auto", "auto")
    assert (scene.map.res, scene.map.steps, scene.map.storage) == (1024, 100, "f32")
    assert (scene.march.method, scene.march.steps, scene.march.sampling) == ("tfm", 100, "projective")
    assert (scene.march.cutoff, scene.march.skip_empty, scene.march.voxels) == (1e-4, True, "f32")


def test_what_is_left_out_is_placed_and_told(read):
    file, scene = read('[volume]\nfile = "cloud.npy"\ndensity_scale = "auto"\n[camera]\nfov = 20\n')
    chosen = plan(scene, file=file).told
    assert list(chosen) == [
        *("volume.density_scale", "camera.from", "camera.to"),
        *("light.from", "light.to", "light.cone", "light.intensity"),
    ]
    assert chosen["volume.density_scale"] == scene.bodies[0].density_scale
    assert tuple(chosen["camera.from"]) == scene.camera.from_
    assert chosen["light.cone"] == scene.lights[0].cone
    again_file, again = read('[volume]\nfile = "cloud.npy"\n', ("camera.fov", 20), *chosen.items())
    assert plan(again, file=again_file).told == {}
    assert again.camera == scene.camera
    assert again.lights == scene.lights


def test_a_section_may_be_set_as_a_whole(read):
    text = '[volume]\nfile = "cloud.npy"\n[camera]\nfov = 20\n[[light]]\nfrom = [1, 2, 3]\nto = [0, 0, 0]\n'
    sun = {"type": "sun", "from": [1, 1, 1], "to": [0, 0, 0]}

    # Whatever the order, single keys come after.
    _, scene = read(text, ("light.1.intensity", 5), ("light", [sun, sun]), ("camera", {"from": [0, 0, 9]}))

    assert [light.type for light in scene.lights] == ["sun", "sun"]
    assert scene.lights[1].intensity == (5, 5, 5)
    assert (scene.camera.from_, scene.camera.fov) == ((0, 0, 9), 40)
    assert "intensity" not in sun
    assert read(text, ("light", []))[1].lights == ()
    assert read('[volume]\nfile = "cloud.npy"\n', ("light", [sun]))[1].lights[0].type == "sun"
    solids = [{"shape": "sphere", "center": [0, 0, 0], "radius": 1}]
    assert read(text, ("solid", solids))[1].solids[0].radius == 1
    bodies = [{"file": "cloud.npy"}, {"shape": "box", "from": [0, 0, 0], "to": [1, 1, 1]}]
    assert len(read(text, ("volume", bodies))[1].bodies) == 2


@pytest.mark.parametrize(
    ("override", "line"),
    [
        (("light", {"type": "sun"}), r"light should be \[\[light\]\] tables"),
        (("camera", [1]), r"camera should be a table \[camera\]"),
        (("camera", 1), "camera: should be SECTION.KEY"),
        (("cameras", {}), "cameras: should be SECTION.KEY"),
        (("light", [{"cone": 500}]), "light 0: light.cone = 500"),
        (("light", [3]), "light 0: light should be a table"),
    ],
)
def test_a_whole_section_is_checked(read, override, line):
    with pytest.raises(SceneError, match=line):
        read('[volume]\nfile = "cloud.npy"\n', override)


def test_of_another_scene_only_what_is_read_alike_is_taken(folder):
    """What is chosen by a grid's values is chosen as if the file were read anew."""

    def made(*overrides, like=None):
        file = SceneFile.read(folder / "cloud.npy", overrides)
        return Made(file, file.make(tfm.Scene, like).bodies, is_moment=False)

    first = made()
    assert made(("camera.fov", 30.0), like=first).bodies[0] is first.bodies[0]
    for overrides in (
        [("medium.preset", "fog")],
        [("volume.transform", np.diag([2.0, 1.0, 1.0, 1.0]).ravel().tolist())],
        [("volume.density_scale", 3.0)],
        [("volume.medium.preset", "fog"), ("volume.window", [0.2, 0.9])],
    ):
        alike, anew = made(*overrides, like=first).bodies[0], made(*overrides).bodies[0]
        assert alike.density_scale == anew.density_scale
        assert alike.equals(anew)
        assert made(*overrides, like=made(*overrides)).bodies[0].equals(anew)
    two = made(("volume", [{"file": "cloud.npy"}, {"file": "cloud.npy"}]), like=first)
    assert len(two.bodies) == 2


def test_a_bare_volume_is_a_scene(folder):
    bare, written = SceneFile.read(folder / "cloud.npy"), folder / "bare.toml"
    written.write_text(
        '[volume]\nfile = "cloud.npy"\ndensity_scale = "auto"\n'
        '[map]\nres = "auto"\nsteps = "auto"\n[march]\nsteps = "auto"\n'
    )
    file = SceneFile.read(written)
    assert options_of(bare) == options_of(file)


def options_of(file):
    return options.table(file, plan(file.make(tfm.Scene)).scene)


COUNTS = ["map.res", "map.steps", "march.steps"]


def test_a_bare_volume_counts_by_itself_and_tells(folder):
    file = SceneFile.read(folder / "cloud.npy")
    scene = file.make(tfm.Scene)
    numbers = resolution.resolved(scene)
    chosen = plan(scene, file=file).told
    assert list(chosen)[-3:] == COUNTS
    assert [chosen[key] for key in COUNTS] == [numbers.map.res, numbers.map.steps, numbers.march.steps]
    assert all(type(chosen[key]) is int for key in COUNTS)
    table = options.table(file, plan(scene).scene)
    assert {key: table[key.split(".")[0]][key.split(".")[1]] for key in COUNTS} == {
        key: chosen[key] for key in COUNTS
    }


@pytest.mark.parametrize("key", COUNTS)
def test_a_number_given_is_not_chosen(folder, key):
    file = SceneFile.read(folder / "cloud.npy", [(key, 33)])
    scene = file.make(tfm.Scene)
    assert [name for name in COUNTS if name in plan(scene, file=file).told] == [
        name for name in COUNTS if name != key
    ]
    assert options.table(file, scene)[key.split(".")[0]][key.split(".")[1]] == 33


@pytest.mark.parametrize("name", ["full.toml", "cloud.npy"])
def test_resolved_toml_is_the_same_scene(folder, tmp_path, name):
    file = SceneFile.read(folder / name)
    scene = file.make(tfm.Scene)
    written = tmp_path / "written.toml"  # elsewhere: the volume's path must not be relative
    written.write_text(to_toml(options.table(file, plan(scene).scene)), encoding="utf-8")
    again = SceneFile.read(written)
    copy = again.make(tfm.Scene)
    for part in ("medium", "camera", "lights", "map", "march"):
        assert getattr(copy, part) == getattr(resolution.resolved(scene), part), part
    assert again.image == file.image
    np.testing.assert_array_equal(copy.bodies[0].data, scene.bodies[0].data)
    np.testing.assert_array_equal(copy.bodies[0].world_from_index, scene.bodies[0].world_from_index)
    assert copy.bodies[0].density_scale == scene.bodies[0].density_scale
    assert copy.bodies[0].own_medium == scene.bodies[0].own_medium
    assert plan(copy, file=again).told == {}


def test_overrides_make_tables_that_are_missing(read):
    overrides = [("map.res", 7), ("medium.phase.type", "hg"), ("medium.phase.g", 0.5), ("light.cone", 9)]
    _, scene = read('[volume]\nfile = "cloud.npy"\n', *overrides)
    assert scene.map.res == 7
    assert scene.medium.phase == tfm.HenyeyGreenstein(0.5)
    assert scene.lights[0].cone == 9


def test_scene_load_is_the_same(folder):
    scene, truth = tfm.Scene.load(folder / "full.toml"), SceneFile.read(folder / "full.toml").make(tfm.Scene)
    assert (scene.camera, scene.lights, scene.map) == (truth.camera, truth.lights, truth.map)


def test_a_path_with_letters_of_any_kind(folder, tmp_path):
    odd = tmp_path / 'a "quoted" – é\\ñ'
    odd.mkdir()
    (odd / "cloud.npy").write_bytes((folder / "cloud.npy").read_bytes())
    file = SceneFile.read(odd / "cloud.npy")
    table = tomllib.loads(to_toml(options.table(file, file.make(tfm.Scene))))
    assert table["volume"]["file"] == str(odd / "cloud.npy")


def test_center_is_centre_in_files_and_overrides(read):
    volume = '[volume]\nshape = "sphere"\ncenter = [1, 2, 3]\n'
    solid = '[[solid]]\nshape = "sphere"\ncenter = [4, 5, 6]\n'
    for key in ("center", "centre"):
        file, scene = read(volume + solid, (f"volume.{key}", [7, 8, 9]))
        assert scene.bodies[0].centre == (7, 8, 9)
        assert scene.solids[0].centre == (4, 5, 6)
        assert "center" not in to_toml(options.table(file, scene))
        assert read(volume + solid, (f"solid.0.{key}", [7, 8, 9]))[1].solids[0].centre == (7, 8, 9)


# --------------------------------------------------------------------------- bodies and their media

BODIES = """
[medium]
sigma_s = [1.0, 0.8, 0.5]
sigma_a = 0.25
phase = "hg:0.3"
[[volume]]
file = "cloud.npy"
[[volume]]
file = "cloud.npy"
medium = { sigma_a = [0.1, 0.2, 0.4] }
[[volume]]
shape = "sphere"
medium = { sigma_s = 0.5, phase = { type = "hg", g = -0.6 } }
[[volume]]
shape = "box"
"""
OF_SCENE = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=0.25, phase=tfm.HenyeyGreenstein(0.3))


def test_the_medium_of_a_body_overrides_the_scene_s_key_by_key(read):
    _, scene = read(BODIES)
    assert scene.medium == OF_SCENE
    assert [scene.medium_of(body) for body in scene.bodies] == [
        OF_SCENE,
        OF_SCENE.replace(sigma_a=(0.1, 0.2, 0.4)),
        OF_SCENE.replace(sigma_s=0.5, phase=tfm.HenyeyGreenstein(-0.6)),
        OF_SCENE,
    ]
    # Those without stay the scene's, also when it changes.
    assert [body.own_medium is None for body in scene.bodies] == [True, False, False, True]
    other = tfm.Medium(sigma_s=7)
    changed = scene.replace(medium=other)
    assert [changed.medium_of(body) == other for body in changed.bodies] == [True, False, False, True]


def test_without_a_scene_s_medium_the_defaults_are_overridden(read):
    _, scene = read('[volume]\nshape = "box"\nmedium = { sigma_a = 2 }\n')
    assert scene.medium_of(scene.bodies[0]) == tfm.Medium(sigma_a=2)


def test_an_empty_table_is_the_scene_s_medium(read):
    _, scene = read('[volume]\nshape = "box"\nmedium = {}\n[medium]\nsigma_s = 3\n')
    assert scene.bodies[0].own_medium == tfm.Medium(sigma_s=3)


@pytest.mark.parametrize(
    ("override", "number", "medium"),
    [
        (("volume.0.medium.sigma_s", [1, 2, 3]), 0, {"sigma_s": (1, 2, 3)}),
        (("volume.1.medium.sigma_s", 4), 1, {"sigma_s": 4, "sigma_a": (0.1, 0.2, 0.4)}),
        (("volume.2.medium.phase", "isotropic"), 2, {"sigma_s": 0.5, "phase": tfm.Isotropic()}),
        (("volume.2.medium.phase.g", 0.1), 2, {"sigma_s": 0.5, "phase": tfm.HenyeyGreenstein(0.1)}),
        (("volume.1.medium", {"sigma_s": 9}), 1, {"sigma_s": 9}),
        (("volume.3.medium", {}), 3, {}),
        # A key of the scene's reaches those that do not set it.
        (("medium.sigma_a", 5), 2, {"sigma_s": 0.5, "sigma_a": 5, "phase": tfm.HenyeyGreenstein(-0.6)}),
        (("medium.sigma_a", 5), 1, {"sigma_a": (0.1, 0.2, 0.4)}),
    ],
    ids=str,
)
def test_overrides_reach_the_medium_of_one_body(read, override, number, medium):
    _, before = read(BODIES)
    _, scene = read(BODIES, override)
    assert scene.medium_of(scene.bodies[number]) == OF_SCENE.replace(**medium)
    if override[0].startswith("volume"):
        others = [i for i in range(4) if i != number]
        assert [scene.medium_of(scene.bodies[i]) for i in others] == [
            before.medium_of(before.bodies[i]) for i in others
        ]


@pytest.mark.parametrize("key", ["sigma_s", "phase", "phase.g"])
def test_what_every_body_overrides_is_not_set_in_vain(folder, key):
    path, table = folder / "scene.toml", "medium = { sigma_s = 1, phase = { type = 'hg', g = 0 } }\n"
    path.write_text(f'[volume]\nshape = "box"\n{table}')
    top = key.partition(".")[0]
    with pytest.raises(
        SceneError, match=f"medium.{key}: every volume has a {top} of its own: set volume.med"
    ):
        SceneFile.read(path, [(f"medium.{key}", 1)])
    path.write_text(f'[[volume]]\nshape = "box"\n{table}' * 2)
    with pytest.raises(SceneError, match=rf"(?m): set volume.0.medium.{top}$"):
        SceneFile.read(path, [(f"medium.{key}", 1)])
    path.write_text(f'[[volume]]\nshape = "box"\n{table}[[volume]]\nshape = "sphere"\n')
    SceneFile.read(path, [("medium.sigma_s", 1)])


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("medium = 3", ["volume.medium = 3: should be a table like [medium]: "]),
        ("medium = []", ["volume.medium = []: should be a table like [medium]: "]),
        ("medium = { sigma_q = 1 }", ["unknown key 'sigma_q' in [volume.medium]; did you mean 'sigma_s'?"]),
        ("medium = { medium = 1 }", ["unknown key 'medium' in [volume.medium]; "]),
        ("medium = { sigma_s = -1 }", ["volume.medium.sigma_s = -1: should be ≥ 0"]),
        ("medium = { phase = 'hg:2' }", ["volume.medium.phase.g = 2.0: should be less than 1"]),
        ("medium = { phase = 'snow' }", ["volume.medium.phase = 'snow': unknown phase function 'snow'"]),
        (
            "medium = { sigma_q = 1, sigma_a = 'dark' }\ndensty = 2",
            [
                "unknown key 'densty' in [volume]; did you mean 'density'?",
                "unknown key 'sigma_q' in [volume.medium]; ",
                "volume.medium.sigma_a = 'dark': should be one number",
            ],
        ),
    ],
)
@pytest.mark.parametrize("kind", ['shape = "box"', 'file = "cloud.npy"'])
def test_faults_in_the_medium_of_a_body_name_it(folder, kind, text, faults):
    path = folder / "scene.toml"
    for head, prefix in (("[volume]", ""), ('[[volume]]\nshape = "box"\n[[volume]]', "volume 1: ")):
        path.write_text(f"{head}\n{kind}\n{text}\n")
        with pytest.raises(SceneError) as caught:
            SceneFile.read(path)
        told = [without_place(line) for line in caught.value.args]
        assert len(told) == len(faults)
        for line, fault in zip(sorted(told), sorted(f"{prefix}{fault}" for fault in faults), strict=True):
            assert line.replace("density_scale", "density").startswith(fault), line


def test_faults_of_several_media_are_told_together_and_once(folder):
    path = folder / "scene.toml"
    text = BODIES.replace("sigma_a = 0.25", "sigma_a = 'y'").replace("sigma_a = [0.1", "sigma_b = [0.1")
    path.write_text(text.replace("sigma_s = 0.5", "sigma_s = -0.5"))
    with pytest.raises(SceneError) as caught:
        SceneFile.read(path)
    starts = [
        "medium.sigma_a = 'y': should be",
        "volume 1: unknown key 'sigma_b' in [volume.medium]; did you mean 'sigma_",
        "volume 2: volume.medium.sigma_s = -0.5: should be ≥ 0",
    ]
    told = sorted(without_place(line) for line in caught.value.args)
    assert len(told) == len(starts)
    assert all(line.startswith(start) for line, start in zip(told, starts, strict=True)), told


def test_resolved_toml_keeps_each_body_s_medium(folder, tmp_path):
    (folder / "bodies.toml").write_text(BODIES)
    file = SceneFile.read(folder / "bodies.toml", [("light.from", [3, 4, 5])])
    scene = file.make(tfm.Scene)
    text = to_toml(options.table(file, plan(scene).scene))
    (tmp_path / "written.toml").write_text(text)
    again = SceneFile.read(tmp_path / "written.toml")
    copy = again.make(tfm.Scene)
    assert copy.medium == scene.medium
    assert [body.own_medium for body in copy.bodies] == [body.own_medium for body in scene.bodies]
    assert tomllib.loads(to_toml(options.table(again, copy))) == tomllib.loads(text)


def test_no_lights_at_all(folder, tmp_path):
    (folder / "dark.toml").write_text('light = []\n[volume]\nfile = "cloud.npy"\n')
    file = SceneFile.read(folder / "dark.toml")
    scene = file.make(tfm.Scene)
    assert scene.lights == ()
    assert not any(key.startswith("light") for key in plan(scene, file=file).told)
    (tmp_path / "written.toml").write_text(to_toml(options.table(file, plan(scene).scene)))
    assert SceneFile.read(tmp_path / "written.toml").make(tfm.Scene).lights == ()
    with pytest.raises(SceneError, match=r"light.cone: the scene has 0 \[\[light\]\] tables"):
        SceneFile.read(folder / "dark.toml", [("light.cone", 30)])


# --------------------------------------------------------------------------- arbitrary values

ODD = [0, 1, -1, 10**400, 1e300, 1e-300, math.nan, math.inf, True, "", "auto", "hg:2", "\0", [], {}, None]
values = st.recursive(
    st.sampled_from(ODD) | st.integers() | st.floats() | st.booleans() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=5,
)
KEYS = [
    *(f"{name}.{key}" for name, model in SECTIONS.items() for key in model.keys()),  # noqa: SIM118 - no dict
    *(f"light.{key}" for key in tfm.SpotLight.keys()),  # noqa: SIM118 - no dict
]
dotted = (
    st.sampled_from(KEYS)
    | st.sampled_from(
        ["light.1.cone", "light.x", "medium.phase.g", "map.self", "light.self", "camera.volume"]
    )
    | st.builds("{}.{}".format, st.sampled_from([*SECTIONS, "light", "x"]), st.text(max_size=3))
)


def check_lines_or_a_scene(make):
    try:
        file = make()
        scene = file.make(tfm.Scene)
    except TfmError as error:
        lines = error.args
        assert lines
        assert all(lines)
        assert not any("\n" in line for line in lines)
    else:
        scene = resolution.resolved(scene)
        # What the kernels get are finite float32.
        bounds = scene.occupied_bounds
        lights = [part.fitted(bounds) for light in scene.lights for part in light.parts()]
        for structs in (
            view_struct(scene, fields_of(scene), (0, 0, 1, 1)),
            light_structs(scene, lights),
            body_structs(scene),
            grid_structs(scene, None),
            medium_structs([scene.medium_of(body) for body in scene.bodies]),
        ):
            assert all(np.isfinite(structs[name]).all() for name in structs.dtype.names)
        assert tomllib.loads(to_toml(options.table(file, scene)))


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    overrides=st.lists(st.tuples(dotted, values), max_size=3),
    name=st.sampled_from(["full.toml", "cloud.npy"]),
)
@example(overrides=[("map.basis", [])], name="cloud.npy")
@example(overrides=[("medium.phase", {"type": "isotropic", "self": 1})], name="full.toml")
@example(overrides=[("medium.phase", {"type": "hg", "self": 1})], name="full.toml")
@example(overrides=[("volume.file", "\n")], name="cloud.npy")
@example(overrides=[("light.type", {})], name="full.toml")
@example(overrides=[("volume.voxel_size", 10**400)], name="cloud.npy")
@example(overrides=[("volume.voxel_size", 1e-300)], name="cloud.npy")
@example(overrides=[("volume.voxel_size", 1e15)], name="cloud.npy")
@example(overrides=[("volume.voxel_size", 1e-15), ("volume.origin", [1e15, 1, 1])], name="cloud.npy")
@example(overrides=[("camera.fov", 1e-300)], name="cloud.npy")
@example(overrides=[("light.cone", 1e-300)], name="cloud.npy")
@example(overrides=[("camera.res", [1, 10**400])], name="cloud.npy")
@example(overrides=[("march.max_stretch", 1e308)], name="cloud.npy")
@example(overrides=[("volume.file", "\0")], name="full.toml")
@example(overrides=[("map.res", "auto"), ("light.from", [1e15, 0, 0])], name="full.toml")
@example(overrides=[("map.res", "auto"), ("light.cone", 89.999999)], name="full.toml")
def test_arbitrary_overrides_give_a_scene_or_lines(folder, overrides, name):
    check_lines_or_a_scene(lambda: SceneFile.read(folder / name, overrides))


toml_values = st.recursive(
    st.sampled_from(["1", "-1", "nan", "inf", "1e999", "true", '"x"', "1979-05-27", "07:32:00", "1" * 400]),
    lambda inner: (
        st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]")
        | inner.map("{{type = {}}}".format)
    ),
    max_leaves=4,
)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    section=st.sampled_from(
        [f"[{name}]" for name in SECTIONS] + ["[[light]]", "[light]", "[[camera]]", "[x]"]
    ),
    key=st.sampled_from([*{key.partition(".")[2] for key in KEYS}, "self", '"a\\nb"']),
    value=toml_values,
)
def test_arbitrary_scene_files_give_a_scene_or_lines(folder, section, key, value):
    path = folder / "arbitrary.toml"
    volume = "" if section == "[volume]" else '[volume]\nfile = "cloud.npy"\n'
    path.write_text(f"{volume}{section}\n{key} = {value}\n")
    check_lines_or_a_scene(lambda: SceneFile.read(path))


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(start=st.integers(0, len(FULL)), length=st.integers(0, 40), new=st.text(max_size=4))
def test_a_damaged_scene_file_gives_a_scene_or_lines(folder, start, length, new):
    path = folder / "damaged.toml"
    path.write_text(FULL[:start] + new + FULL[start + length :], encoding="utf-8")
    check_lines_or_a_scene(lambda: SceneFile.read(path))


def without_density_scale(folder, peak, scene="", override=()):
    """Write a scene file around a cloud without ``density_scale``; return what it is warned of."""
    np.save(folder / "cloud.npy", peak * blobs())
    (folder / "scene.toml").write_text(scene or '[volume]\nfile = "cloud.npy"')
    file = SceneFile.read(folder / "scene.toml", override)
    return options.warnings(file, file.make(tfm.Scene))


def sensible(peak):
    return density_scale_for(tfm.Volume(peak * blobs()))


@pytest.mark.parametrize("peak", [40.0, 0.01])
def test_a_density_scale_that_is_far_from_sensible_is_told_with_the_value_of_auto(tmp_path, peak):
    (told,) = without_density_scale(tmp_path, peak)
    assert told == (
        f'{tmp_path / "scene.toml"}: volume.density_scale is not given: 1 is used; "auto" would take '
        f"{sensible(peak):g}: give one of them"
    )


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.8])
def test_about_the_density_scale_of_auto_is_no_warning(tmp_path, factor):
    assert without_density_scale(tmp_path, factor * sensible(1.0)) == ()


@pytest.mark.parametrize("value", [1.0, 0.5, "auto"])
def test_whoever_says_the_density_scale_is_not_warned(tmp_path, value):
    given = f'[volume]\nfile = "cloud.npy"\ndensity_scale = {value!r}'
    assert without_density_scale(tmp_path, 40.0, given) == ()
    assert without_density_scale(tmp_path, 40.0, override=[("volume.density_scale", value)]) == ()
    given = tmp_path / "scene.toml"
    file = SceneFile.read(given)
    printed = tmp_path / "printed.toml"
    printed.write_text(to_toml(options.table(file, file.make(tfm.Scene))))
    again = SceneFile.read(printed)
    assert options.warnings(again, again.make(tfm.Scene)) == ()


@pytest.mark.parametrize(
    ("sigma", "warned"),
    [("1.0", True), ("100.0", True), ("0.02", False), ("0.0001", False), ("1e-320", False), ("0.0", False)],
)
def test_coefficients_may_say_what_the_density_scale_does_not(tmp_path, sigma, warned):
    """Where sigma_t = 1 asks for a scale of about 0.02, "auto" would not make 0.0001 any better."""
    scene = f'[volume]\nfile = "cloud.npy"\n[medium]\nsigma_s = {sigma}'
    assert bool(without_density_scale(tmp_path, sensible(1.0) * 50, scene)) is warned


@pytest.mark.parametrize(("sigma", "warned"), [("1.0", True), ("1e-36", False)])
def test_densities_beyond_sense_are_told(tmp_path, sigma, warned):
    scene = f'[volume]\nfile = "cloud.npy"\ndensity_scale = 1.0\n[medium]\nsigma_s = {sigma}'
    told = without_density_scale(tmp_path, np.float32(2e38), scene)
    said = (
        f"{tmp_path / 'scene.toml'}: volume.density_scale = 1 makes densities up to 2e+38: light ends where "
        f'the first begins; "auto" would take {sensible(np.float32(2e38)):.2g}'
    )
    assert told == ((said,) if warned else ())


def test_each_of_several_volumes_is_told_by_its_number(tmp_path):
    table = '[[volume]]\nfile = "cloud.npy"\n'
    told = without_density_scale(tmp_path, 40.0, f"{table}{table}density_scale = 2.0\n{table}")
    assert [line.split(": ")[1].split()[0] for line in told] == [
        "volume.0.density_scale",
        "volume.2.density_scale",
    ]


def test_media_without_a_grid_have_no_density_scale_to_tell_of(tmp_path):
    scene = '[volume]\nshape = "box"\ndensity = 1000.0'
    assert without_density_scale(tmp_path, 1.0, scene) == ()


# Volumes of sequences are not there until they are made.
STILL = [path.name for path in sorted(SAMPLES.glob("*.toml")) if "####" not in path.read_text("utf-8")]


@pytest.mark.parametrize("name", STILL)
def test_sample_scenes_are_not_warned(name):
    file = SceneFile.read(SAMPLES / name)
    assert options.warnings(file, file.make(tfm.Scene)) == ()


def test_a_ground_that_was_placed_is_told_and_written(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        '[volume]\nshape = "box"\nfrom = [-1, -2, -1]\n[[light]]\ntype = "environment"\n'
        '[[solid]]\nshape = "sphere"\n[[solid]]\nshape = "ground"\nalbedo = "sand.png"\n'
    )
    file = SceneFile.read(path)
    scene = file.make(tfm.Scene)
    told = plan(scene, file=file).decisions
    assert (told["solid.1.up"].value, told["solid.1.height"].value) == ("y", -2)
    written = options.table(file, scene)["solid"][1]
    assert (written["up"], written["height"]) == ("y", -2)
    assert written["albedo"] == str(tmp_path / "sand.png")
    assert file.files() == [tmp_path / "sand.png"]
