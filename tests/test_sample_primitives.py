"""Particles, hair and the tree in ``volumes/``: what the files hold, and that generators make just that."""

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import tfm_cl
from tfm_cl.files.curves_io import read_curves
from tfm_cl.files.points_io import read_points
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.curves import Curves
from tfm_cl.scene.bodies.points import Points
from tfm_cl.scene.bodies.polygons import Polygons
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.scene_file import SceneFile

FOLDER = Path(__file__).parent.parent / "volumes"
LARGEST = 250_000
"""Bytes of a file."""
STYLES = ("straight", "wavy", "curly", "fur")
ROUNDED = 2e-3
"""Of a float16 below 2, twice: sines and powers differ in their last bit between machines."""


@pytest.fixture(scope="module")
def modules():
    """The generators' modules, which import each other as scripts do."""
    names = ("noise", "cumulus", "figure", "plume", "ply", "particles", "hair", "tree", "generate")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        yield {name: importlib.import_module(name) for name in names}
    for each in names:
        del sys.modules[each]


@pytest.fixture(scope="module")
def tree_files():
    return {name: trimesh.load(FOLDER / f"{name}.ply", process=False) for name in ("wood", "leaves")}


def kept(name):
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as archive:
        return dict(archive)


def assert_same(made, name):
    expected = kept(name)
    assert made.keys() == expected.keys()
    for key, values in expected.items():
        assert made[key].dtype == values.dtype
        np.testing.assert_allclose(
            made[key].astype(np.float64), values.astype(np.float64), rtol=ROUNDED, atol=ROUNDED, err_msg=key
        )


@pytest.mark.parametrize(
    "name", ["particles.npz", "spirals.npz", *(f"{style}.npz" for style in STYLES), "wood.ply", "leaves.ply"]
)
def test_files_are_small(name):
    assert 50_000 < (FOLDER / name).stat().st_size <= LARGEST


# -------------------------------------------------------------------------------------------- particles


@pytest.mark.slow
def test_plume_is_reproduced(modules):
    assert_same(modules["particles"].smoke_plume().arrays(), "particles")


def test_spirals_are_reproduced(modules):
    assert_same(modules["particles"].spirals().arrays(), "spirals")


@pytest.mark.parametrize("name", ["particles", "spirals"])
def test_there_are_as_many_particles_as_in_the_paper(name):
    points = read_points(FOLDER / f"{name}.npz")
    assert len(points.positions) == 16_384
    assert points.radii.min() > 0
    assert 0 < points.opacities.min() < points.opacities.max() < 1


def test_puffs_grow_thin_out_and_spread_as_they_rise():
    points = read_points(FOLDER / "particles.npz")
    height = points.positions[:, 1]
    low, high = (height > -0.9) & (height < -0.5), (height > 0.7) & (height < 1.4)
    assert points.radii[high].mean() > 2 * points.radii[low].mean()
    assert points.opacities[high].mean() < points.opacities[low].mean() / 2
    assert points.positions[high][:, ::2].std() > 2 * points.positions[low][:, ::2].std()


def test_smoke_curls(modules):
    # Only vortices bring smoke down: in a column that merely rises none would.
    particles = modules["particles"]
    rings = particles._rings(np.random.default_rng(1))
    smoke = kept("particles")["positions"].T.astype(np.float64)
    velocity = particles._velocity(smoke, particles.DURATION, rings)
    assert 0.01 < np.mean(velocity[1] < 0) < 0.4


def test_spirals_have_thin_and_dense_parts():
    points = read_points(FOLDER / "spirals.npz")
    cells = np.histogramdd(points.positions, bins=24, weights=points.opacities * points.radii**2)[0]
    filled = cells[cells > 0]
    assert np.mean(cells > 0) < 0.25
    assert np.percentile(filled, 98) > 30 * np.percentile(filled, 20)


# -------------------------------------------------------------------------------------------- hair


@pytest.mark.parametrize("style", STYLES)
def test_hair_is_reproduced(style, modules):
    assert_same(modules["hair"].STYLES[style].tuft(), style)


@pytest.mark.slow
@pytest.mark.parametrize("style", ["straight", "wavy", "curly"])
def test_full_hair_has_as_many_strands_and_segments_as_in_the_paper(style, modules):
    arrays = modules["hair"].STYLES[style].full_tuft()
    assert len(arrays["counts"]) == 10_000
    assert len(arrays["points"]) - 10_000 >= 340_000


@pytest.mark.parametrize("style", STYLES)
def test_strands_grow_out_of_the_ball_and_taper(style, modules):
    curves = read_curves(FOLDER / f"{style}.npz")
    away = np.linalg.norm(curves.positions, axis=1).reshape(len(curves.counts), -1)
    widths = curves.widths.reshape(away.shape)
    ball = modules["hair"].BALL
    np.testing.assert_allclose(away[:, 0], 1.01 * ball, atol=1e-3)
    assert away.min() > ball
    assert (np.diff(widths, axis=1) <= 0).all()
    np.testing.assert_allclose(widths[:, -1], widths[:, 0] / 4, rtol=1e-2)


def turning(arrays):
    """Largest angle between two segments of a strand, for most strands, degrees."""
    points = arrays["points"].astype(np.float64).reshape(len(arrays["counts"]), -1, 3)
    steps = np.diff(points, axis=1)
    steps /= np.linalg.norm(steps, axis=-1, keepdims=True)
    cosines = (steps[:, 1:] * steps[:, :-1]).sum(axis=-1)
    # By the root the ball and the comb turn a strand at once.
    return np.degrees(np.arccos(np.percentile(np.clip(cosines[:, cosines.shape[1] // 3 :], -1, 1), 5)))


def test_curls_are_smooth_and_there_are_more_of_them_than_waves(modules):
    full = {name: modules["hair"].STYLES[name].full_tuft() for name in ("straight", "wavy", "curly")}
    assert all(turning(arrays) < 30 for arrays in full.values())

    def detour(arrays):
        points = arrays["points"].astype(np.float64).reshape(10_000, -1, 3)
        length = np.linalg.norm(np.diff(points, axis=1), axis=-1).sum(axis=1)
        coarse = points[:, np.linspace(0, points.shape[1] - 1, 4).astype(int)]
        return np.mean(length / np.linalg.norm(np.diff(coarse, axis=1), axis=-1).sum(axis=1))

    straight, wavy, curly = (detour(full[name]) for name in ("straight", "wavy", "curly"))
    assert straight < wavy < curly


# -------------------------------------------------------------------------------------------- tree


def test_tree_is_reproduced(tmp_path, tree_files):
    subprocess.run([sys.executable, FOLDER / "generate.py", "tree", "-o", tmp_path], check=True, timeout=300)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["leaves.ply", "wood.ply"]
    for name, expected in tree_files.items():
        made = trimesh.load(tmp_path / f"{name}.ply", process=False)
        np.testing.assert_array_equal(made.faces, expected.faces)
        np.testing.assert_allclose(made.vertices, expected.vertices, atol=1)


def test_leaves_hang_on_twigs(tree_files):
    wood, leaves = (tree_files[name].vertices * 1e-4 for name in ("wood", "leaves"))
    stalks = leaves[::4]
    nearest = np.sqrt(((stalks[::50, None] - wood[None]) ** 2).sum(axis=-1).min(axis=1))
    assert nearest.max() < 0.08
    assert wood[:, 1].min() == pytest.approx(0, abs=0.02)
    assert 1.8 < leaves[:, 1].max() < 2.6


@pytest.mark.slow
def test_full_tree_has_twenty_thousand_triangles_of_leaves(tmp_path, modules):
    modules["generate"].write("tree", tmp_path, full=True)
    leaves = trimesh.load(tmp_path / "leaves_full.ply", process=False)
    assert len(leaves.faces) >= 20_000


# -------------------------------------------------------------------------------------------- script


@pytest.mark.parametrize("name", ["plume", "afro"])
def test_script_refuses_a_full_size_that_there_is_not(name):
    script = [sys.executable, FOLDER / "generate.py", name, "--full"]
    result = subprocess.run(script, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert f"no full size named '{name}'; known: straight, wavy, curly, fur, tree" in result.stderr


@pytest.mark.slow
def test_full_files_do_not_replace_the_small_ones(tmp_path, modules):
    modules["generate"].write("fur", tmp_path, full=True)
    assert [path.name for path in tmp_path.iterdir()] == ["fur_full.npz"]


# -------------------------------------------------------------------------------------------- scenes

SCENES = {
    "particles": [Points],
    "spirals": [Points],
    "mixed": [Volume, Points, Curves, BoxVolume],
    "hair": [Curves, Curves, Curves],
    "tree": [Polygons, BoxVolume],
}


def sample_scene(name, **changes):
    scene = SceneFile.read(FOLDER / f"{name}.toml").make(tfm_cl.Scene)
    return scene.replace(
        camera=replaced(scene.camera, res=(48, 27)), map=replaced(scene.map, res=64, steps=40), **changes
    )


def replaced(settings, **changes):
    return settings.model_copy(update=changes)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_hold_their_bodies(name):
    assert [type(body) for body in sample_scene(name).bodies] == SCENES[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_every_body_is_seen_in_its_scene(one_lane_renderer, name):
    scene = sample_scene(name)
    image = one_lane_renderer.render(scene).image
    assert np.isfinite(image).all()
    assert 0.01 < image[..., :3].mean() < 1

    for number in range(len(scene.bodies)):
        rest = scene.bodies[:number] + scene.bodies[number + 1 :]
        if not rest:
            assert image[..., 3].max() > 0.5
            continue
        without = one_lane_renderer.render(sample_scene(name, volume=rest)).image
        assert np.abs(image - without)[..., :3].mean() > 0.02 * image[..., :3].mean(), scene.bodies[number]
