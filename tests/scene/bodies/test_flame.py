"""Flames: from a grid of temperatures to a volume that only emits, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.scene.blackbody import rgb_of
from tfm_cl.scene.bodies.flame import flame_of

SEVERAL = Path(__file__).resolve().parents[2] / "files" / "volume_io" / "data" / "several.vdb"
"""Leaves; ``shared`` has voxels half as wide as ``density[0]``, elsewhere."""
HEAT = blobs(seed=11)
TABLE = 1e-3
"""Relative to the strongest channel, of a table of temperatures a thousandth apart, in float32."""


@pytest.fixture(scope="module")
def fire(tmp_path_factory):
    path = tmp_path_factory.mktemp("fire") / "fire.npz"
    colour = np.ones((*HEAT.shape, 3), np.float32)
    broken = np.where(0.9 * HEAT.max() < HEAT, np.nan, HEAT).astype(np.float32)
    np.savez(
        path,
        density=blobs(),
        heat=HEAT,
        rgb=colour,
        broken=broken,
        small=HEAT[1:],
        voxel_size=(0.1, 0.2, 0.3),
    )
    return path


def medium(temperature="heat", **changes):
    return tfm.Medium(temperature=temperature, **{"temperature_scale": 2000.0, **changes})


def flame(fire, medium, **of_volume):
    return flame_of(tfm.Volume.load(fire, "density", **of_volume), medium)


def test_voxels_are_black_bodies_of_their_temperature(fire):
    found = flame(fire, medium(temperature_offset=0.1, Le_scale=3.0), density_scale=7.0)
    kelvin = (HEAT.astype(np.float64).ravel() - np.float64(0.1)) * 2000
    expected = np.where(kelvin[:, None] > 500, rgb_of(np.maximum(kelvin, 500)), 0)
    rgb = np.stack([channel.data.ravel() for channel in found.channels], axis=-1)
    assert (np.abs(rgb - expected) <= TABLE * expected.max(axis=1, keepdims=True) + 1e-12).all()
    # What it emits is apart from the density's gain, and from the voxels.
    assert found.density_scale == 1
    assert found.own_medium == tfm.Medium(sigma_s=0, emission=3.0)
    assert found.notes == ()


def test_colour_times_data_are_the_channels(fire):
    found = flame(fire, medium())
    assert found.colour is not None
    for c, channel in enumerate(found.channels):
        np.testing.assert_allclose(found.data * found.colour[..., c], channel.data, rtol=1e-6)


def test_a_flame_moves_with_its_volume_and_is_read_once(fire, monkeypatch):
    volume = tfm.Volume.load(fire, "density")
    still = flame_of(volume, medium())
    monkeypatch.setattr("tfm_cl.files.volume_io.read_stored", lambda *_: pytest.fail("read again"))
    matrix = np.diag([2.0, 1, 1, 1])
    moved = flame_of(volume.transformed(matrix).with_density_scale(3), medium(Le_scale=2))
    np.testing.assert_array_equal(moved.world_from_index, matrix @ still.world_from_index)
    assert moved.content == still.content
    assert flame_of(volume, medium(Le_scale=0)) is None
    assert flame_of(volume, tfm.Medium()) is None


def test_a_grid_of_leaves_lies_where_its_file_puts_it():
    volume = tfm.Volume.load(SEVERAL, "density[0]")
    shared = tfm.Volume.load(SEVERAL, "shared")
    moved = np.array([[0, 1, 0, 5], [1, 0, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1.0]])
    found = flame_of(volume.transformed(moved), medium("shared", temperature_scale=3000 / shared.largest))
    np.testing.assert_allclose(found.world_from_index, moved @ shared.world_from_index, atol=1e-12)
    assert len(found.channel_leaves) == 3
    hottest = rgb_of(np.array([3000.0]))[0]
    np.testing.assert_allclose(found.largest_density, hottest, rtol=TABLE)


def test_a_grid_that_is_too_cold_says_so(fire):
    found = flame(fire, medium(temperature_scale=1.0))
    (note,) = found.notes
    assert note.startswith("medium.temperature: ")
    assert note.endswith("K hot, and up to 500 K nothing glows: raise medium.temperature_scale")


def test_sanitized_temperatures(fire):
    found = flame(fire, medium("broken"), sanitize=True)
    hot = np.isfinite(np.load(fire)["broken"])
    assert (found.data[~hot] == 0).all()
    assert found.data[hot].max() > 0


BAD = {
    "no such grid": (medium("flame"), VolumeError, "no grid named 'flame'; it has .*'heat'"),
    "a colour": (medium("rgb"), VolumeError, "rgb"),
    "not finite": (medium("broken"), VolumeError, "'broken' holds temperatures that are infinite or NaN"),
    "hot space": (medium(temperature_offset=-1), SceneError, "temperature_offset = -1: .* all of it glows"),
    "too hot": (medium(temperature_scale=1e9), SceneError, "temperature_scale = 1e.09: .* limit is 1e.06 K"),
}


@pytest.mark.parametrize(("bad", "error", "fault"), BAD.values(), ids=BAD)
def test_bad_temperatures(fire, bad, error, fault):
    with pytest.raises(error, match=fault) as caught:
        tfm.Scene(tfm.Volume.load(fire, "density"), bad)
    assert len(caught.value.args) == 1
    assert "\n" not in str(caught.value)


def test_without_a_transform_it_has_the_density_s_shape(tmp_path):
    np.savez(tmp_path / "bare.npz", density=HEAT, heat=HEAT, small=HEAT[1:])
    volume = tfm.Volume.load(tmp_path / "bare.npz", "density", voxel_size=0.5)
    np.testing.assert_array_equal(flame_of(volume, medium()).world_from_index, volume.world_from_index)
    with pytest.raises(VolumeError, match=r"'small' has the shape \[13, 12, 16\]; expected \[14, 12, 16\]"):
        flame_of(volume, medium("small"))


def test_only_volumes_of_files_have_temperatures(fire):
    with pytest.raises(SceneError, match=r"temperature = 'heat': array has no file that holds such a grid"):
        tfm.Scene(tfm.Volume(HEAT), medium())
    bodies = [tfm.Volume.load(fire, "density"), tfm.BoxVolume()]
    with pytest.raises(SceneError, match="temperature = 'heat': box has no file"):
        tfm.Scene(bodies, medium())
    own = tfm.Scene([bodies[0].with_medium(medium()), bodies[1]])
    assert len(own.flames) == 1
    assert own.emits


BAD_KEYS = {
    "a scale alone": ({"Le_scale": 2.0}, "Le_scale = 2 does nothing without temperature"),
    "an offset alone": (
        {"temperature_offset": 2.0},
        "temperature_offset = 2 does nothing without temperature",
    ),
    "a number": ({"temperature": 3}, "medium.temperature = 3"),
    "negative": ({"temperature": "heat", "Le_scale": -1.0}, "medium.Le_scale = -1.0"),
    "infinite": (
        {"temperature": "heat", "temperature_scale": float("inf")},
        "medium.temperature_scale = inf",
    ),
}


@pytest.mark.parametrize(("keys", "fault"), BAD_KEYS.values(), ids=BAD_KEYS)
def test_bad_keys(keys, fault):
    with pytest.raises(SceneError, match=fault):
        tfm.Medium(**keys)
