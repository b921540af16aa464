"""What is chosen for a bare file, and for what a scene leaves out."""

from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.cli.options import as_flags
from tfm_cl.errors import SceneError
from tfm_cl.plan import options
from tfm_cl.plan.plan import plan
from tfm_cl.scene.looks import FILLED, LOOKS
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import scene_text

DENSITY = 3 * blobs((12, 14, 16))


def bare(folder, name="cloud.npz", **grids):
    path = folder / name
    np.savez(path, **{"density": DENSITY, "voxel_size": 0.1, **grids})
    return path


def dressed(path, *overrides, look="auto"):
    file = SceneFile.read(path, overrides, look)
    return file, file.make(tfm.Scene)


@pytest.mark.parametrize(
    ("name", "grids", "look"),
    [
        ("Big_Cumulus_03.npz", {}, "cloud"),
        ("smoke.npz", {}, "smoke"),
        ("desert_sandstorm.npz", {}, "dust"),
        ("mist.npz", {}, "fog"),
        ("vapor.npz", {}, "steam"),
        ("a.npz", {}, "cloud"),
        ("smoke.npz", {"Flame": DENSITY}, "fire"),
    ],
)
def test_a_bare_file_has_the_look_that_fits(tmp_path, name, grids, look):
    chosen = SceneFile.read(bare(tmp_path, name, **grids), (), "auto").look
    assert (chosen.name, bool(chosen.why)) == (look, True)


def test_strands_are_hair(tmp_path):
    np.savez(tmp_path / "a.npz", positions=np.eye(3), counts=[3], width=0.1)
    file, scene = dressed(tmp_path / "a.npz")
    assert file.look.name == "hair"
    assert scene.medium.phase.type == "kajiya-kay"


def test_what_one_scene_changes_no_other_has(tmp_path):
    np.savez(tmp_path / "a.npz", positions=np.eye(3), counts=[3], width=0.1)
    dressed(tmp_path / "a.npz", ("medium.octaves", 2))
    assert dressed(tmp_path / "a.npz")[1].medium.octaves == 1


@pytest.mark.parametrize("look", [look for look in LOOKS if look not in {"fire", "hair"}])
def test_a_look_sets_a_stage(tmp_path, look):
    file, scene = dressed(bare(tmp_path), look=look)
    assert scene.medium == Medium(preset=look, octaves=4)
    (sky,) = scene.lights
    assert (sky.type, file.image.background) == ("sky", "environment")
    assert len(scene.solids) == LOOKS[look].has_ground
    assert sky.samples == (32 if scene.solids else 16)
    away = np.linalg.norm(np.subtract(scene.camera.from_, scene.camera.to))
    assert scene.camera.haze == (pytest.approx(10 * away, rel=0.01) if scene.solids else None)
    assert plan(scene, file=file).told["look"] == look


@pytest.mark.parametrize(("hottest", "kelvin"), [(1.0, 1900), (12.5, 1900), (1750.0, 1750)])
def test_a_fire_is_as_hot_as_fires_are(tmp_path, hottest, kelvin):
    medium = dressed(bare(tmp_path, temperature=hottest * (DENSITY / DENSITY.max())))[1].medium
    assert (medium.preset, medium.temperature) == ("fire", "temperature")
    assert medium.emission_lights > 1
    assert hottest * medium.temperature_scale == pytest.approx(kelvin, rel=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_impossible_temperatures_are_told_by_their_reader(tmp_path, value):
    hot = np.where(DENSITY > 1, value, 0).astype(np.float32)
    medium = SceneFile.read(bare(tmp_path, temperature=hot), (("volume.sanitize", True),), "auto").medium
    assert medium.temperature_scale > 0


@pytest.mark.parametrize(
    "placed",
    [
        ("volume.voxel_size", 1e-4),
        ("volume.transform", np.diag([1e-4, 1e-4, 1e-4, 1]).ravel().tolist()),
    ],
)
def test_a_fire_is_as_bright_in_any_unit(tmp_path, placed):
    path = tmp_path / "fire.npz"
    np.savez(path, density=DENSITY, temperature=DENSITY)
    small, large = (SceneFile.read(path, overrides, "auto").medium for overrides in ([placed], []))
    assert small.Le_scale == pytest.approx(1e4 * large.Le_scale, rel=0.01)
    for key in ("volume.voxel_size", "volume.transform"):
        with pytest.raises(SceneError, match=key):
            SceneFile.read(path, ((key, [[1], ["a", 2]]),), "auto")


def test_a_fire_without_a_hot_grid_says_what_to_do(tmp_path):
    with pytest.raises(tfm.errors.VolumeError, match=r"medium\.temperature.*no grid named.*preset 'smoke'"):
        dressed(bare(tmp_path), look="fire")


def test_there_is_no_level_ground_where_up_is_no_axis(tmp_path):
    assert dressed(bare(tmp_path), ("camera.up", (0, 1, 1)), look="smoke")[1].solids == ()


@pytest.mark.parametrize("section", ["camera", "image"])
def test_what_is_no_table_is_refused(tmp_path, section):
    bare(tmp_path)
    (tmp_path / "scene.toml").write_text(f'{section} = 3\n[volume]\nfile = "cloud.npz"\n')
    with pytest.raises(SceneError, match=rf"{section} should be a table"):
        SceneFile.read(tmp_path / "scene.toml", (), "smoke")


def test_plain_is_what_scenes_and_the_library_have(tmp_path):
    path = bare(tmp_path)
    plain, library = dressed(path, look="plain")[1], tfm.Scene.load(path)
    assert (plain.medium, plain.camera, plain.lights) == (library.medium, library.camera, library.lights)
    (tmp_path / "scene.toml").write_text('[volume]\nfile = "cloud.npz"\ndensity_scale = 1\n')
    assert SceneFile.read(tmp_path / "scene.toml", (), "auto").look.name == "plain"


def test_a_scene_gets_what_it_leaves_out(tmp_path):
    bare(tmp_path)
    text = '[volume]\nfile = "cloud.npz"\n[medium]\nsigma_s = 0.5\n[image]\nview = "aces"\n'
    (tmp_path / "scene.toml").write_text(text)
    file, scene = dressed(tmp_path / "scene.toml", look="smoke")
    assert scene.medium == Medium(sigma_s=0.5)
    assert (file.image.view, file.image.exposure, scene.lights[0].type) == ("aces", "auto", "sky")


@pytest.mark.parametrize("key", ["medium.sigma_s", "medium.phase"])
def test_who_says_what_it_is_made_of_gets_that(tmp_path, key):
    value = {"medium.sigma_s": 2.0, "medium.phase": "hg:0.1"}[key]
    path = bare(tmp_path)
    (given, plain) = (dressed(path, (key, value), look=look)[1] for look in ("auto", "plain"))
    assert given.medium == plain.medium
    assert given.lights[0].type == "sky"


@pytest.mark.parametrize("key", ["light.from", "light.type", "light.0.cone"])
def test_who_says_how_it_is_lit_gets_that(tmp_path, key):
    value = {"light.from": (9.0, 9, 9), "light.type": "point", "light.0.cone": 20.0}[key]
    file, scene = dressed(bare(tmp_path, "smoke.npz"), (key, value))
    assert scene.lights[0].type in {"spot", "point"}
    assert (scene.solids, file.image.has_background) == ((), False)


def test_the_sky_may_be_changed(tmp_path):
    changes = (("light.elevation", 70.0), ("light.0.turbidity", 5.0), ("medium.orders", 3))
    _, scene = dressed(bare(tmp_path), *changes, ("camera.up", (0, 0, 1)))
    assert (scene.lights[0].elevation, scene.lights[0].turbidity) == (70, 5)
    assert scene.lights[0].up == (0, 0, 1)
    assert (scene.medium.orders, scene.medium.octaves) == (3, 1)


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)])
@pytest.mark.parametrize("res", [(64, 36), (30, 50)])
def test_what_is_seen_fills_the_frame(tmp_path, up, res):
    _, scene = dressed(bare(tmp_path), ("camera.up", up), ("camera.res", res))
    camera, points = scene.camera, scene.volume.outline()
    places = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(camera.world_from_camera).T
    clip = places @ camera.ndc_from_camera.T
    ndc = clip[:, :2] / clip[:, 3:]
    assert np.abs(ndc).max() == pytest.approx(FILLED, abs=0.01)
    assert ndc.max(axis=0) + ndc.min(axis=0) == pytest.approx([0, 0], abs=0.01)


def test_the_scene_file_that_is_printed_is_the_same_scene(tmp_path):
    file, scene = dressed(bare(tmp_path, "dust.npz"))
    (tmp_path / "b.toml").write_text(scene_text(options.table(file, scene)))
    again, other = dressed(tmp_path / "b.toml")
    assert (other.camera, other.lights, other.medium) == (scene.camera, scene.lights, scene.medium)
    assert (other.solids, again.image) == (scene.solids, file.image)
    assert "--look dust" in as_flags(plan(scene, file=file).told)


def test_a_look_that_is_unknown_names_the_nearest(tmp_path):
    with pytest.raises(SceneError, match="unknown look 'clowd'; did you mean 'cloud'"):
        SceneFile.read(bare(tmp_path), (), "clowd")


def test_a_missing_file_is_told_by_its_reader():
    with pytest.raises(tfm.errors.TfmError, match=r"nowhere\.vdb"):
        SceneFile.read(Path("nowhere.vdb"), (), "auto").make(tfm.Scene)
