"""Grids: device functions against float64."""

import numpy as np
import pytest
from kernel_calls import GridCalls
from scenes import blobs, make_scene, turned
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.media import media_on_device

pytestmark = pytest.mark.lanes

COLD = tfm.Medium(sigma_s=(0.2, 0.5, 1.1))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


class Device(GridCalls):
    """Calls with world points and rays; amounts of each medium and channel, where a scene has several."""

    def __init__(self, launcher, scene):
        super().__init__(launcher, scene)
        media = media_on_device(launcher, scene, self.bricks)
        self._defines = media.defines
        self.amounts = media.defines["TFM_MEDIA"], media.defines["TFM_AMOUNTS"]
        self.centre = world_from_device(scene)[:3, 3]

    def local(self, origins, directions=None):
        """In the frame of the device."""
        parts = [origins - self.centre, *([] if directions is None else [directions])]
        return np.concatenate(parts, axis=1)


def rainbow(shape):
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    return np.stack([1.5 - 1.4 * x, 0.6 + 0.5 * np.sin(7 * y + 2 * z), 0.1 + 1.2 * x * z], axis=-1)


def second(**changes):
    matrix = turned(-40, (0.3, 1, 2), (0.12, 0.15, 0.18), (-0.2, -0.6, -0.3))
    return tfm.Volume(blobs(seed=11), world_from_index=matrix, density_scale=2.0, **changes)


def scenes():
    one = make_scene()
    grid = one.grids[0]
    coloured = tfm.Volume(
        blobs(), world_from_index=grid.world_from_index, density_scale=4.0, colour=rainbow(grid.shape)
    )
    return {
        "one grid": one,
        "a coloured grid": one.replace(volume=[coloured]),
        "two grids, two media": one.replace(volume=[grid, second(medium=COLD)]),
        "a coloured grid beside a grey one": one.replace(volume=[second(medium=COLD), coloured]),
    }


SCENES = scenes()
every_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def expected_density(scene, points):
    """[points, media, channels], float64."""
    media = list(dict.fromkeys(scene.medium_of(grid) for grid in scene.grids))
    channels = max(len(grid.channel_leaves) for grid in scene.grids)
    found = np.zeros((*points.shape[:-1], len(media), channels))
    for grid in scene.grids:
        parts = grid.channels if len(grid.channel_leaves) > 1 else [grid]
        of_channels = np.stack([reference.density(part, points) for part in parts], axis=-1)
        found[..., media.index(scene.medium_of(grid)), :] += of_channels
    return found


@every_scene
def test_density_is_trilinear_and_0_outside(launcher, rng, scene):
    device = Device(launcher, scene)
    volume = scene.grids[0]
    index = rng.uniform(-2.5, np.add(volume.shape[::-1], 1.5), (4000, 3))
    points = index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3]

    densities = device("call_densities_at", device.local(points), *device.amounts)

    expected = expected_density(scene, points)
    assert expected.shape == densities.shape
    assert (np.count_nonzero(expected, axis=0) > 500).all()
    # A coordinate is rounded to half an ulp of the grid's width; the slope is at most 4 per voxel.
    assert np.abs(densities - expected).max() < 16 * 4.0 * 1.5 * 16 * FLOAT32


@every_scene
def test_optical_depth_of_a_march(launcher, scene):
    device = Device(launcher, scene)
    origins = scene.grids[0].bounds.mean(axis=0) + np.array([[0.0, 0, 3], [0.2, -0.1, 3], [0, 0.3, 3]])
    directions = unit(np.array([[0, 0, -1.0], [0.02, 0, -1], [-0.05, -0.1, -1]]))

    depths = device(
        "call_march_amounts", device.local(origins, directions), *device.amounts, begin=1, end=5, steps=200
    )

    t = 1 + (np.arange(200) + 0.5) * 4 / 200
    points = origins[:, None] + t[None, :, None] * directions[:, None]
    expected = expected_density(scene, points).sum(axis=1) * 4 / 200
    assert expected.max() > 0.5
    assert np.allclose(depths, expected, rtol=1e-5, atol=1e-5 * expected.max())


@pytest.mark.parametrize("name", ["one grid", "two grids, two media"])
def test_grids_clip(launcher, rng, name):
    scene = SCENES[name]
    device = Device(launcher, scene)
    bounds = np.stack([volume.bounds for volume in scene.grids])
    box = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    size, centre = np.linalg.norm(np.diff(box, axis=0)), box.mean(axis=0)
    origins = centre + rng.normal(size=(5000, 3)) * size
    directions = unit(rng.normal(size=(5000, 3)) * 0.4 + centre - origins)
    origins[:500] = centre + rng.uniform(-0.1, 0.1, (500, 3)) * size  # from inside
    axes = scene.grids[0].world_from_index[:3, :3].T
    directions[:500] = unit(axes[rng.integers(0, 3, 500)])  # along the faces

    intervals = device("call_grids_clip", device.local(origins, directions), 2)

    parts = [np.stack(reference.march_bounds([grid], origins, directions), axis=1) for grid in scene.grids]
    meets = np.array([part[:, 0] < part[:, 1] for part in parts])
    begin = np.min(
        [np.where(hit, part[:, 0], np.inf) for part, hit in zip(parts, meets, strict=True)], axis=0
    )
    end = np.max([np.where(hit, part[:, 1], -np.inf) for part, hit in zip(parts, meets, strict=True)], axis=0)
    expected = np.where(meets.any(axis=0)[:, None], np.column_stack([begin, end]), 0)
    # A grid that is all but missed, or just so: of what misses only the sign is known.
    near_miss = np.any([np.abs(part[:, 1] - part[:, 0]) < 1e-4 * size for part in parts], axis=0)
    missed_closely = near_miss | (~meets.any(axis=0) & (np.abs(intervals).max(axis=1) > 0))
    assert missed_closely.mean() < 0.35
    assert np.abs(intervals - expected)[~near_miss].max() < 1e-5 * size
    assert 1000 < np.count_nonzero(expected[:, 1]) < 5000
