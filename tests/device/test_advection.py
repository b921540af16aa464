"""What grids hold, moved by their velocities, against closed forms and the float64 reference."""

import numpy as np
import pytest
from scenes import blobs, turned
from tolerances import ADVECTED

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device import advection
from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.files.volume_io.stored_velocity import Component, StoredVelocity
from tfm_cl.scene.bodies import volume as volumes

FRAMES = 0.4
PLACE = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))


def swirl(shape, size=1.0, seed=3):
    """A smooth velocity [z, y, x, 3], world units per second."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    phases = np.random.default_rng(seed).uniform(0, 6, 3)
    parts = [np.sin(2 * x - y + phases[0]), np.cos(2 * y + z + phases[1]), np.sin(x + 2 * z + phases[2])]
    return (size * np.stack(parts, axis=-1)).astype(np.float32)


def volume_of(data, vectors, place=PLACE, colour=None):
    volume = tfm.Volume(data, world_from_index=place, colour=colour)
    return volume.with_velocity(vectors, outlier_threshold=0)


def later(launcher, volume, frames=FRAMES):
    found = advection.moved(launcher, volume.channel_leaves, volume.leaves, volume.velocity, frames)
    return volume.moved_to(found.channels, found.low)


def uniform(shape, speed):
    return np.broadcast_to(np.float32(speed), (*shape, 3)).copy()


def test_a_uniform_velocity_translates_by_whole_voxels_exactly(launcher):
    data, place = blobs(), np.diag([0.5, 0.25, 2.0, 1.0])
    step = np.array([3 * 0.5, -2 * 0.25, 2.0])  # voxels, world units
    moved = later(launcher, volume_of(data, uniform(data.shape, 24 / FRAMES * step), place))
    there = np.zeros(moved.shape, np.float32)
    z, y, x = (int(n) for n in np.linalg.solve(moved.world_from_index, [*step, 1])[2::-1].round())
    there[z : z + data.shape[0], y : y + data.shape[1], x : x + data.shape[2]] = data
    assert np.abs(moved.data - there).max() < ADVECTED


def test_a_uniform_velocity_keeps_mass_and_centre_of_mass(launcher):
    data = blobs()
    volume = volume_of(data, uniform(data.shape, (9.0, -5.0, 7.0)))
    moved = later(launcher, volume)
    assert moved.mass_in(1.0) == pytest.approx(volume.mass_in(1.0), rel=ADVECTED)
    centres = []
    for one in (volume, moved):
        index = np.stack(np.meshgrid(*map(np.arange, one.shape), indexing="ij")[::-1], axis=-1)
        mean = np.average(index.reshape(-1, 3), axis=0, weights=one.data.ravel().astype(np.float64))
        centres.append(one.world_from_index[:3, :3] @ mean + one.world_from_index[:3, 3])
    assert centres[1] - centres[0] == pytest.approx(np.array([9, -5, 7]) / 24 * FRAMES, abs=ADVECTED)


@pytest.mark.parametrize("coloured", [False, True], ids=["plain", "coloured"])
@pytest.mark.parametrize("frames", [FRAMES, -2.0], ids=["less than a leaf", "far back"])
def test_a_swirl_equals_the_reference(launcher, coloured, frames):
    data = blobs()
    colour = np.random.default_rng(2).random((*data.shape, 3)).astype(np.float32) if coloured else None
    volume = volume_of(data, np.where(data[..., None] > 0, swirl(data.shape, 4.0), 0), colour=colour)
    moved = later(launcher, volume, frames)
    expected, low = reference.moved_voxels(volume, frames)
    assert moved.world_from_index[:3, 3] == pytest.approx(PLACE[:3, :3] @ low + PLACE[:3, 3])
    found = [channel.data for channel in moved.channels] if coloured else [moved.data]
    assert np.abs(np.stack(found) - expected).max() < ADVECTED
    assert np.abs(expected).max() > 0.1


def test_velocities_on_voxels_of_their_own_equal_the_reference(launcher, monkeypatch):
    """Coarser, turned and apart for each axis, as on the faces of voxels; in slabs of a leaf layer."""
    data, coarse = blobs((30, 12, 20)), swirl((9, 7, 8), 6.0)
    components = tuple(
        Component(
            Leaves.from_dense(coarse[..., axis]),
            turned(20 + axis, (2, 1, 0.3), (0.5, 0.6, 0.7), (-1.3, -1.2, -1.1)),
        )
        for axis in range(3)
    )
    monkeypatch.setattr(volumes, "read_velocity", lambda *_: StoredVelocity("three grids", components))
    monkeypatch.setattr(advection, "SLAB_LEAVES", 1)
    volume = tfm.Volume(data, world_from_index=PLACE, source="a file").with_velocity(outlier_threshold=0)
    moved = later(launcher, volume)
    expected, _ = reference.moved_voxels(volume, FRAMES)
    assert np.abs(moved.data - expected[0]).max() < ADVECTED


def test_what_moves_leaves_the_voxels_that_velocities_are_stored_in(launcher):
    data = np.zeros((8, 8, 8), np.float32)
    data[3:5, 3:5, 3:5] = 1.0
    everywhere, inside = uniform(data.shape, (72, 0, 0)), np.zeros((8, 8, 8, 3), np.float32)
    inside[data > 0] = (72, 0, 0)
    ways = [later(launcher, volume_of(data, vectors, np.eye(4)), 1.0) for vectors in (everywhere, inside)]
    assert np.array_equal(ways[0].data, ways[1].data)
    assert ways[0].data.sum() == pytest.approx(8)


def test_what_is_still_stays_the_same(launcher):
    data = blobs()
    volume = volume_of(data, np.zeros((*data.shape, 3), np.float32))
    assert advection.moved(launcher, volume.channel_leaves, volume.leaves, volume.velocity, 1.0) is None


def test_outliers_are_slowed_down():
    data, vectors = blobs((20, 20, 20)), uniform((20, 20, 20), (1, 1, 1))
    vectors[3, 4, 5] = 1e20
    volume = tfm.Volume(data)
    assert volume.with_velocity(vectors).velocity.most == pytest.approx(1)
    with pytest.raises(VolumeError, match=r"moves something by .* voxels in 0\.4 frames; up to 512 are"):
        volume.with_velocity(vectors, outlier_threshold=0).velocity.reach(FRAMES)


def test_velocities_are_finite_or_set_to_0():
    data, vectors = blobs(), swirl((14, 12, 16))
    vectors[1, 2, 3] = np.nan
    with pytest.raises(VolumeError, match=r"array: the velocity holds velocities that are infinite or NaN"):
        _ = tfm.Volume(data).with_velocity(vectors).velocity
    clean = tfm.Volume(data, sanitize=True).with_velocity(vectors).velocity
    assert all(np.isfinite(one.values).all() for one in clean.components)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"source": np.zeros((3, 3, 3, 3))}, r"real numbers \[z, y, x, 3\], \[14, 12, 16, 3\]; got float64"),
        ({"source": np.zeros((14, 12, 16, 3), complex)}, "got complex128"),
        ({"source": None, "fps": 0}, "fps > 0"),
        ({"source": None, "scale": float("nan")}, "scale is a number"),
        ({"source": None, "outlier_threshold": 1}, "from 0 to 1"),
    ],
)
def test_impossible_velocities_are_refused(given, message):
    with pytest.raises(VolumeError, match=message):
        tfm.Volume(blobs()).with_velocity(**given)


def test_a_saved_scene_moves_as_the_one_that_was_saved(tmp_path, launcher):
    data = blobs()
    volume = volume_of(data, swirl(data.shape, 4.0)).transformed(turned(40, (0, 1, 1), (2.0, 2.0, 2.0)))
    volume = volume.with_density_scale(2.0)
    tfm.Scene(volume).save(tmp_path / "scene.toml")
    (loaded,) = tfm.Scene.load(tmp_path / "scene.toml").bodies
    points = np.random.default_rng(1).uniform(*volume.bounds, (500, 3))
    found, expected = (later(launcher, one).densities_at(points) for one in (loaded, volume))
    assert np.abs(found - expected).max() < 2 * ADVECTED  # densities are up to 2
    assert expected.max() > 0.5
    points = tfm.Points([[0.0, 0, 0]], 1.0, velocity=[[1.0, 2, 3]]).with_velocity(scale=2.0, fps=12)
    tfm.Scene(points).save(tmp_path / "points.toml")
    (loaded,) = tfm.Scene.load(tmp_path / "points.toml").bodies
    assert loaded.moved(1.0).positions == pytest.approx(points.moved(1.0).positions)
