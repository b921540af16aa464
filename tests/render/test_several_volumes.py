"""Several volumes whose densities add up."""

import itertools

import numpy as np
import pytest
from scenes import blobs, make_scene, turned
from tolerances import PASS, SKIPPING

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.cli import main
from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import PlaneSolid, SphereSolid

pytestmark = pytest.mark.lanes

ROUNDED = {"f16": 2e-3, "u8": 1e-2}
"""Of the brightest: 2^-11 of a density, or 1/510 of the largest near it, times optical depths of some
units."""
ORDER = PASS
"""Sums of the same densities in another order."""

FIRST = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))
SECOND = turned(-40, (0.3, 1, 2), (0.08, 0.1, 0.12), (-0.2, -0.6, -0.3))
APART = turned(70, (1, 0, 1), (0.06, 0.05, 0.07), (-1.0, -0.9, 1.2))
FAR = turned(10, (0, 1, 0), (0.3, 0.3, 0.3), (-2, -3, -12))
LIGHT = make_scene().lights[0]


def one(matrix, scale=4.0, seed=7, shape=(14, 12, 16)):
    return tfm.Volume(blobs(shape, seed), world_from_index=matrix, density_scale=scale)


SETS = {
    "overlapping": [one(FIRST), one(SECOND, 3.0, 11, (9, 20, 11))],
    "apart": [one(SECOND), one(APART, 6.0, 3)],
    "a gap between": [one(FIRST), one(FAR, 0.5, 5)],
    "a small one": [one(FIRST), tfm.Volume(np.ones((1, 1, 1)), voxel_size=0.4, origin=(0.2, 0.3, 0.9))],
    "five": [one(FIRST), one(SECOND), one(APART), one(FAR, 0.2), one(FIRST @ turned(90, (0, 0, 1)), 1.0, 2)],
}


def joined_scene(volumes, **changes):
    return make_scene(volume=list(volumes), **changes)


@pytest.mark.quick("overlapping-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("volumes", SETS)
def test_picture_and_layers_equal_the_reference(renderer, save_on_failure, volumes, method):
    scene = joined_scene(SETS[volumes])
    if volumes == "a gap between":
        scene = scene.replace(
            lights=[LIGHT.replace(cone=60)],
            march=scene.march.replace(steps=90),
            map=scene.map.replace(steps=90),
        )

    result = renderer.render(scene, method=method)

    expected, layers = reference.render_with_aovs(scene, method)
    brightest = max(1.0, float(expected[..., :3].max()))
    assert expected[..., 3].max() > 0.1
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < 20 * PASS * brightest
    for name in ("transmittance", "depth"):
        far = max(1.0, float(layers[name].max()))
        assert np.abs(result.aovs[name] - layers[name]).max() < 20 * PASS * far


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_among_solids(renderer, save_on_failure, method):
    solids = [SphereSolid(centre=(0.1, 0.1, 0.2), radius=0.35), PlaneSolid(point=(0, -0.7, 0))]
    for volumes in ("overlapping", "apart"):
        scene = joined_scene(SETS[volumes], solids=solids, shadow=ShadowSettings(res=64))
        result = renderer.render(scene, method=method)
        expected = reference.render(scene, method, shadows="map")
        with save_on_failure(result.image, expected.astype(np.float32)):
            assert np.abs(result.image - expected).max() < (4 * PASS if method == "dual" else 20 * PASS)


@pytest.mark.quick("tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_two_halves_are_one(renderer, method):
    whole = renderer.render(joined_scene([one(FIRST)]), method=method)
    halves = renderer.render(joined_scene([one(FIRST, 2.0), one(FIRST, 2.0)]), method=method)

    assert np.abs(whole.image - halves.image).max() < PASS * max(1.0, whole.image.max())
    assert whole.image[..., :3].max() > 0.02


def test_empty_ones_change_nothing_but_where_steps_lie(renderer):
    nothing = tfm.Volume(np.zeros((4, 4, 4)), world_from_index=FIRST)  # within the first one's box
    alone = renderer.render(joined_scene([one(FIRST)]))
    with_it = renderer.render(joined_scene([one(FIRST), nothing]))

    assert np.abs(alone.image - with_it.image).max() < PASS


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_the_order_does_not_matter(renderer, method):
    images = [
        renderer.render(joined_scene(volumes), method=method).image
        for volumes in itertools.islice(itertools.permutations(SETS["five"][:3]), 0, 6, 2)
    ]

    for image in images[1:]:
        assert np.abs(image - images[0]).max() < ORDER * max(1.0, images[0].max())


@pytest.mark.slow
@pytest.mark.parametrize("voxels", ROUNDED)
@pytest.mark.parametrize("count", [1, 2, 5])
def test_smaller_voxels(renderer, count, voxels):
    scene = joined_scene(SETS["five"][:count])
    exact = renderer.render(scene).image

    image = renderer.render(scene.replace(march=scene.march.replace(voxels=voxels))).image

    assert 0 < np.abs(image - exact).max() < ROUNDED[voxels] * max(1.0, exact.max())


@pytest.mark.quick("overlapping-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("volumes", SETS)
def test_skipping_leaves_no_trace(renderer, volumes, method):
    scene = joined_scene(SETS[volumes])
    skipping = renderer.render(scene, method=method)
    everything = renderer.render(scene.replace(march=scene.march.replace(skip_empty=False)), method=method)

    # Also a step of several volumes sums the same densities in the same order.
    assert np.abs(skipping.image - everything.image).max() <= SKIPPING * max(1.0, everything.image.max())
    assert skipping.stats.samples["view_pass"] < everything.stats.samples["view_pass"]


@pytest.mark.slow
def test_far_ones_are_seen(renderer):
    alone = renderer.render(joined_scene([one(FIRST)])).image
    both = renderer.render(joined_scene(SETS["a gap between"], lights=[LIGHT.replace(cone=60)])).image

    assert (both[..., 3] > alone[..., 3] + 0.05).mean() > 0.02


def test_maps_serve_the_same_volumes_only(renderer):
    scene = joined_scene(SETS["apart"])
    maps = renderer.build_maps(scene)

    for volumes in (SETS["overlapping"], SETS["apart"][:1], SETS["apart"][::-1]):
        with pytest.raises(SceneError, match="another volume"):
            renderer.render(joined_scene(volumes), maps=maps)
    again = renderer.render(joined_scene(SETS["apart"]), maps=maps)
    assert (again.image == renderer.render(scene).image).all()


@pytest.mark.slow
def test_curve_of_a_map_through_several(renderer):
    scene = joined_scene(SETS["overlapping"])
    scene = scene.replace(map=tfm.MapSettings(coeffs=8, res=64, steps=128))
    _, exact, found = renderer.build_maps(scene)[0].curve(0.5, 0.5)

    assert exact[-1] < 0.5 < exact[0]
    assert np.abs(exact - found).max() < 0.05


@pytest.mark.slow
def test_more_than_there_may_be(renderer):
    with pytest.raises(VolumeError, match="a scene has 1 to 16 volumes; got 17"):
        joined_scene([one(FIRST)] * 17)
    sixteen = renderer.render(joined_scene([one(FIRST, 0.25)] * 16), crop=(8, 6, 16, 12)).image
    whole = renderer.render(joined_scene([one(FIRST)]), crop=(8, 6, 16, 12)).image
    assert np.abs(sixteen - whole).max() < 2 * PASS


# --- scene files -------------------------------------------------------------------------------------------


@pytest.fixture
def scene_file(tmp_path):
    np.save(tmp_path / "one.npy", blobs())
    np.save(tmp_path / "two.npy", blobs((9, 20, 11), 11))
    path = tmp_path / "scene.toml"
    path.write_text(
        "[[volume]]\nfile = 'one.npy'\ndensity_scale = 0.4\nvoxel_size = 0.2\n"
        "[[volume]]\nfile = 'two.npy'\ndensity_scale = 0.3\nvoxel_size = 0.1\norigin = [2, 1, 1]\n"
        "[camera]\nres = [8, 6]\n[map]\nres = 16\nsteps = 16\n[march]\nsteps = 16\n",
        encoding="utf-8",
    )
    return path


def test_a_scene_file_names_several(scene_file, renderer):
    scene = tfm.Scene.load(scene_file)

    assert [volume.density_scale for volume in scene.bodies] == [0.4, 0.3]
    low, high = scene.bounds
    each = [volume.bounds for volume in scene.bodies]
    assert (low == np.minimum(each[0][0], each[1][0])).all()
    assert (high == np.maximum(each[0][1], each[1][1])).all()
    assert renderer.render(scene).image[..., 3].max() > 0.1


def test_the_command_line_changes_one_of_them(scene_file, tmp_path, capsys):
    def config(*options):
        assert main(["render", str(scene_file), "--print-config", *options]) == 0
        return capsys.readouterr().out

    changed = config("--set", "volume.1.density_scale=0.7")
    assert changed.count("[[volume]]") == 2
    again = tmp_path / "again.toml"
    again.write_text(changed, encoding="utf-8")
    scene = tfm.Scene.load(again)
    assert [volume.density_scale for volume in scene.bodies] == [0.4, 0.7]
    original = tfm.Scene.load(scene_file)
    assert (scene.bounds == original.bounds).all()
    assert scene.camera == original.camera

    assert main(["render", str(again), "--print-config"]) == 0
    assert capsys.readouterr().out == changed


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("volume.2.density_scale=1", "volume.2.density_scale: the scene has 2 [[volume]] tables"),
        ("volume.1.density_scale=-1", "density_scale"),
        ("volume.1.densty=1", "densty"),
    ],
)
def test_mistakes_are_one_line(scene_file, capsys, key, line):
    assert main(["render", str(scene_file), "--print-config", "--set", key]) != 0
    said = capsys.readouterr().err.strip()
    assert line in said
    assert said.count("\n") == 0


def test_too_many_tables_are_one_line(scene_file, capsys):
    text = scene_file.read_text(encoding="utf-8")
    scene_file.write_text("[[volume]]\nfile = 'one.npy'\n" * 15 + text, encoding="utf-8")

    assert main(["render", str(scene_file), "--print-config"]) != 0
    said = capsys.readouterr().err.strip()
    assert "a scene has 1 to 16 [[volume]] tables; got 17" in said
    assert said.count("\n") == 0
