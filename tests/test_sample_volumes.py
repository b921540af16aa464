"""The volumes in ``volumes/``: what the files hold, and that the generators make just that."""

import importlib
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.ndimage import map_coordinates
from skimage.measure import euler_number, label

import tfm_cl.scene.bodies.volume
from tfm_cl.plan import options
from tfm_cl.scene.scene_file import SceneFile

FOLDER = Path(__file__).parent.parent / "volumes"
NAMES = ("cumulus", "figure", "plume")


def load(name):
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as archive:
        return dict(archive)


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def sample(name):
    return load(name)


@pytest.fixture(scope="module")
def density(sample):
    return sample["density"]


@pytest.fixture(scope="module")
def modules():
    """The generators' modules, which import each other as scripts do."""
    names = (
        "noise",
        "flow",
        "cumulus",
        "figure",
        "plume",
        "fire",
        "inks",
        "ply",
        "particles",
        "hair",
        "tree",
        "rising_plume",
        "generate",
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        yield {name: importlib.import_module(name) for name in names}
    for each in names:
        del sys.modules[each]


def test_file_is_small_and_complete(name, sample):
    assert set(sample) == {"density", "voxel_size", "origin"}
    assert sample["density"].dtype == (np.uint8 if name == "figure" else np.float16)
    assert 1.8e6 < sample["density"].size < 2.4e6
    assert (FOLDER / f"{name}.npz").stat().st_size < 600_000


def test_densities_span_zero_to_one(density):
    assert density.min() == 0
    assert density.max() == 1


def test_border_is_empty_and_box_is_tight(density):
    for axis in range(3):
        layers = np.flatnonzero(np.moveaxis(density, axis, 0).reshape(density.shape[axis], -1).any(axis=1))
        assert layers[0] >= 1
        assert layers[-1] <= density.shape[axis] - 2
        assert np.ptp(layers) > 0.65 * density.shape[axis]


def test_corners_are_empty(density):
    eighths = [(slice(n // 8), slice(-(n // 8), None)) for n in density.shape]
    assert not any(density[corner].any() for corner in product(*eighths))


@pytest.mark.parametrize(
    ("name", "low", "high"), [("cumulus", 0.18, 0.26), ("figure", 0.14, 0.21), ("plume", 0.06, 0.12)]
)
def test_occupancy(name, low, high):
    assert low < np.mean(load(name)["density"] > 0) < high


def test_world_box(name, sample):
    size = sample["density"].shape[::-1] * sample["voxel_size"]
    low, high = sample["origin"], sample["origin"] + size
    assert np.ptp(sample["voxel_size"]) == 0
    assert 1.6 < size.max() < 2.2
    centred = [0, 2] if name == "figure" else [0, 1, 2]
    np.testing.assert_allclose((low + high)[centred], 0, atol=1e-12)


def test_library_loads_it(name, sample):
    volume = tfm_cl.scene.bodies.volume.Volume.load(FOLDER / f"{name}.npz")
    np.testing.assert_array_equal(volume.data, sample["density"].astype(np.float32))
    np.testing.assert_allclose(volume.voxel_size, sample["voxel_size"])
    first_centre = volume.world_from_index[:3, 3]
    np.testing.assert_allclose(first_centre, sample["origin"] + sample["voxel_size"] / 2)


def test_cumulus_has_flat_base_and_billowing_top():
    occupied = load("cumulus")["density"] > 0.1
    columns = occupied.any(axis=1)
    bottom = occupied.argmax(axis=1)
    top = occupied.shape[1] - occupied[:, ::-1].argmax(axis=1)
    middle = occupied[:, 12].nonzero()  # columns that stand on the base, not turrets that overhang it
    assert len(middle[0]) > 0.25 * columns.size
    assert bottom[middle].std() < 2
    assert top[middle].std() > 10


def test_cumulus_border_is_soft():
    density = load("cumulus")["density"].astype(np.float32)
    steps = np.abs(np.diff(density, axis=2))
    assert np.percentile(steps[steps > 0], 99) < 0.5
    assert 0.1 < np.mean((density > 0) & (density < 0.3)) / np.mean(density > 0) < 0.6


def test_plume_widens_and_thins():
    density = load("plume")["density"].astype(np.float64)
    height = density.shape[1]
    z, x = (np.arange(n) for n in (density.shape[0], density.shape[2]))

    def spread_and_mean(slab):
        weight = slab.sum(axis=1)
        weight /= weight.sum()
        variance = sum(
            (across * axis**2).sum() - (across * axis).sum() ** 2
            for across, axis in ((weight.sum(axis=1), z), (weight.sum(axis=0), x))
        )
        return np.sqrt(variance), slab[slab > 0].mean()

    low_spread, low_mean = spread_and_mean(density[:, height // 10 : height // 4])
    high_spread, high_mean = spread_and_mean(density[:, 3 * height // 4 : 9 * height // 10])
    assert high_spread > 2 * low_spread
    assert high_mean < low_mean / 3


def test_plume_spans_decades():
    density = load("plume")["density"]
    faint, dense = np.percentile(density[density > 0].astype(np.float32), (2, 99.5))
    assert dense / faint > 200


def test_figure_is_one_solid_with_a_hole():
    density = load("figure")["density"]
    assert set(np.unique(density)) == {0, 1}
    assert label(density, connectivity=1).max() == 1
    assert label(1 - density, connectivity=3).max() == 1  # no cavity inside
    assert euler_number(density, connectivity=1) <= 0  # 1 - tunnels: an arm akimbo makes one


def test_figure_sits_on_the_ground():
    figure = load("figure")
    lowest = np.flatnonzero(figure["density"].any(axis=(0, 2)))[0]
    assert figure["origin"][1] + lowest * figure["voxel_size"][1] == pytest.approx(0, abs=1e-12)


def test_generator_reproduces_every_third_voxel(name, density, modules):
    made = modules["generate"].generate(modules[name], every=3)
    assert made.dtype == density.dtype
    np.testing.assert_array_equal(made, density[1::3, 1::3, 1::3])


def test_fire_is_hot_below_and_smoke_above(modules):
    fire, kept = modules["fire"], load("fire")
    for key, function in (("density", fire.density), ("temperature", fire.temperature)):
        made = modules["generate"].generate(fire, every=3, function=function)
        np.testing.assert_array_equal(made, kept[key][1::3, 1::3, 1::3])
        assert not any(np.moveaxis(kept[key], axis, 0)[[0, -1]].any() for axis in range(3))
    assert (FOLDER / "fire.npz").stat().st_size < 300_000
    heights = np.arange(fire.SHAPE[1])
    heat, smoke = (kept[key].sum(axis=(0, 2), dtype=np.float64) for key in ("temperature", "density"))
    assert (heat @ heights) / heat.sum() + 20 < (smoke @ heights) / smoke.sum()
    scene = tfm_cl.Scene.load(FOLDER / "fire.toml")
    assert scene.medium.temperature_scale == fire.KELVIN
    assert 1 < scene.flames[0].medium.emission[0] * scene.flames[0].largest < 100


@pytest.mark.slow
def test_inks_are_of_three_colours(modules):
    inks, kept = modules["inks"], load("inks")
    for key, function in (("density", inks.density), ("colour", inks.colour)):
        made = modules["generate"].generate(inks, every=3, function=function)
        np.testing.assert_array_equal(made, kept[key][1::3, 1::3, 1::3])
    assert (FOLDER / "inks.npz").stat().st_size < 300_000
    density = kept["density"].astype(np.float64)
    assert not any(np.moveaxis(density, axis, 0)[[0, -1]].any() for axis in range(3))
    for channel in range(3):
        strongest = kept["colour"].argmax(axis=-1) == channel
        assert 0.15 < density[strongest].sum() / density.sum() < 0.6


@pytest.mark.slow
def test_script_reproduces_the_files(tmp_path):
    # The others are compared at every third voxel, above.
    subprocess.run(
        [sys.executable, FOLDER / "generate.py", "figure", "-o", tmp_path], check=True, timeout=300
    )
    assert [path.name for path in tmp_path.iterdir()] == ["figure.npz"]
    with np.load(tmp_path / "figure.npz") as made:
        for key, expected in load("figure").items():
            np.testing.assert_array_equal(made[key], expected)


def test_props_are_reproduced(tmp_path):
    subprocess.run([sys.executable, FOLDER / "props.py", "-o", tmp_path], check=True, timeout=300)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["knot.ply", "lamps.toml", "window.png"]
    assert (tmp_path / "lamps.toml").read_text() == (FOLDER / "lamps.toml").read_text()
    knot, kept = (trimesh.load(folder / "knot.ply", process=False) for folder in (tmp_path, FOLDER))
    np.testing.assert_array_equal(knot.faces, kept.faces)
    # Sines differ in their last bit between machines.
    np.testing.assert_allclose(knot.vertices, kept.vertices, atol=1e-6)
    window, kept = (np.asarray(Image.open(folder / "window.png")) for folder in (tmp_path, FOLDER))
    assert (window != kept).any(axis=-1).mean() < 1e-3


def test_script_refuses_an_unknown_name():
    script = [sys.executable, FOLDER / "generate.py", "stratus"]
    result = subprocess.run(script, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "'stratus'; known: cumulus, figure, plume" in result.stderr


@pytest.fixture(scope="module")
def rising(modules):
    """Density and velocity of a sequence's frame, as `numpy.ndarray`s, by the frame."""
    return modules["rising_plume"].sample


def test_a_plume_rises_drifts_and_grows(rising, modules):
    heights, sides, amounts = [], [], []
    for frame in (1, 12, 24):
        density, velocity = rising(frame)
        assert density.shape == velocity.shape[:3] == modules["rising_plume"].SHAPE
        assert density.min() == 0
        assert density.max() <= 1
        assert not any(np.moveaxis(density, axis, 0)[[0, -1]].any() for axis in range(3))
        amounts.append((density > 0).sum())
        heights.append(np.flatnonzero(density.any(axis=(0, 2)))[-1])
        sides.append(np.average(np.arange(density.shape[2]), weights=density.sum(axis=(0, 1))))
    assert heights == sorted(heights)
    assert sides == sorted(sides)
    assert amounts[2] > 4 * amounts[0]


def test_its_smoke_goes_where_its_velocities_say(rising, modules, monkeypatch):
    """Half a frame on, a density is that which was there before, against the velocity."""
    module = modules["rising_plume"]
    monkeypatch.setattr(module, "OCTAVES", 1)  # finer noise is not interpolated well
    before, after, velocity = rising(16.0)[0], *rising(16.5)
    back = velocity[..., ::-1] * (0.5 / module.FPS / module.VOXEL)  # x, y, z; arrays are z, y, x
    carried = map_coordinates(before, np.indices(module.SHAPE) - np.moveaxis(back, 3, 0), order=3)
    smoke = after > 0.02
    stayed, moved = (np.abs(after - other)[smoke].mean() for other in (before, carried))
    assert moved < 0.2 * stayed


def test_a_sequence_is_written_with_its_scene(tmp_path):
    script = [sys.executable, FOLDER / "generate.py", "rising_plume", "--frames", "2-3", "-o", tmp_path]
    subprocess.run(script, check=True, timeout=300)
    names = ["rising_plume.0002.npz", "rising_plume.0003.npz", "rising_plume.toml"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    file = SceneFile.read(tmp_path / "rising_plume.toml", frame=3)
    scene = file.make(tfm_cl.Scene)
    assert options.warnings(file, scene) == ()
    (volume,) = scene.bodies
    assert volume.bounds[0] == pytest.approx([-0.85 - 0.5 / 28, -0.1 - 0.5 / 28, -1 - 0.5 / 28])
    with np.load(tmp_path / "rising_plume.0003.npz", allow_pickle=False) as archive:
        assert archive["v"].shape == (*archive["density"].shape, 3)


def random_points(rng, count):
    return tuple(rng.uniform(-5, 5, count) for _ in range(3))


def difference(function, points, axis, step=1e-4):
    """Central difference of a function of points."""
    low, high = (tuple(p + sign * step * (i == axis) for i, p in enumerate(points)) for sign in (-1, 1))
    return (function(high) - function(low)) / (2 * step)


def test_noise_is_zero_on_the_lattice_and_near_one_at_most(modules):
    noise = modules["noise"]
    lattice = noise.Lattice.seeded(3)
    whole = tuple(np.arange(-8.0, 8.0) * step for step in (1, 2, 3))
    assert np.abs(noise.gradient_noise(lattice, whole)).max() == 0
    values = noise.gradient_noise(lattice, random_points(np.random.default_rng(1), 20_000))
    assert abs(values.mean()) < 0.02
    assert 0.9 < np.abs(values).max() < 1.3


def test_noise_slope_matches_differences(modules):
    noise = modules["noise"]
    lattice = noise.Lattice.seeded(3)
    points = random_points(np.random.default_rng(2), 500)
    slope = noise.noise_slope(lattice, points)
    for axis in range(3):
        expected = difference(lambda p: noise.gradient_noise(lattice, p), points, axis)
        np.testing.assert_allclose(slope[axis], expected, atol=1e-5)


def test_curl_noise_is_free_of_divergence(modules):
    noise = modules["noise"]
    lattices = noise.Lattice.seeded(3), noise.Lattice.seeded(4)
    points = random_points(np.random.default_rng(3), 500)
    terms = [
        difference(lambda p, i=axis: noise.curl_noise(*lattices, p)[i], points, axis) for axis in range(3)
    ]
    assert np.abs(terms).max() > 1
    np.testing.assert_allclose(sum(terms), 0, atol=1e-4)


def test_cellular_noise_is_the_nearest_point(modules):
    noise = modules["noise"]
    lattice = noise.Lattice.seeded(3)
    table = lattice.permutation[:256]
    features = []
    for i, j, k in product(range(6), repeat=3):
        index = table[(table[(table[i] + j) % 256] + k) % 256]
        features.append((i, j, k) + lattice.offsets[:, index])
    points = np.random.default_rng(4).uniform(2, 4, (200, 3))
    expected = np.linalg.norm(points[:, None] - np.array(features), axis=2).min(axis=1)
    np.testing.assert_allclose(noise.cellular_noise(lattice, tuple(points.T)), expected, rtol=1e-6)


def test_ring_vortex_rolls_without_divergence(modules):
    velocity = np.array((0.3, 1.2, -0.4))
    ring = modules["flow"].ring_vortex
    rng = np.random.default_rng(5)
    directions = rng.standard_normal((3, 300))
    directions /= np.linalg.norm(directions, axis=0)
    inside = tuple(0.95 * rng.random(300) * directions)
    divergence = sum(difference(lambda p, i=axis: ring(p, velocity)[i], inside, axis) for axis in range(3))
    np.testing.assert_allclose(divergence, 0, atol=1e-6)
    np.testing.assert_allclose(ring(tuple(directions), velocity), 0, atol=1e-12)
    np.testing.assert_allclose(ring(tuple(np.zeros((3, 1))), velocity)[1], velocity[1])
    sideways = np.cross(velocity, (1, 0, 0))
    outer = 0.9 * sideways / np.linalg.norm(sideways)
    assert np.dot(np.ravel(ring(tuple(outer[:, None]), velocity)), velocity) < 0  # it sinks outside
