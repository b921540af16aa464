"""Scenes as large as the settings allow: memory follows what there is, and nothing breaks on the way."""

from pathlib import Path

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import LIGHTS, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.files.volume_io.leaves import LEAF, Leaves

pytestmark = pytest.mark.slow

MIB = 1 << 20
FIXED = 600 * MIB
"""What a renderer takes whatever the scene: compiler, driver, a slab of leaves and NumPy's batches."""


@pytest.fixture(autouse=True)
def _no_dense_array(monkeypatch):
    """A dense array of a large volume would not fit: whoever asks for it is told here."""

    def refused(self):
        if np.prod(self.shape, dtype=np.int64) > 1 << 28:
            raise AssertionError(f"a dense array of {self.shape} was asked for")
        return self._voxels.dense

    monkeypatch.setattr(tfm.Volume, "data", property(refused))


class Peak:
    """The most memory that this process held at once since it was made, over what it held then."""

    def __init__(self):
        self._status = Path("/proc/self/status")
        try:
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        except OSError:
            pytest.skip("no measure of the peak memory on this system")
        self._before = self._read("VmRSS")

    def _read(self, name):
        lines = self._status.read_text(encoding="ascii").splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith(name))

    @property
    def growth(self):
        return self._read("VmHWM") - self._before


def shells_and_balls(edge):
    """Leaves of a grid of edge³ voxels: two thin shells around its middle, and balls.

    Made layer by layer, and only where a surface is near.
    """
    middle = np.full(3, edge / 2 - 0.5)
    rng = np.random.default_rng(12)
    balls = [(middle + edge * rng.uniform(-0.3, 0.3, 3), part * edge) for part in (0.03, 0.05, 0.06)]
    surfaces = [(middle, 0.4 * edge, 3.0), (middle, 0.31 * edge, 3.0)]
    surfaces += [(centre, 0.0, radius) for centre, radius in balls]
    y, x = np.divmod(np.arange((edge // LEAF) ** 2), edge // LEAF)
    within = np.stack(np.indices((LEAF,) * 3), axis=-1).astype(np.float32)
    half = (LEAF - 1) / 2
    coordinates, values = [], []
    for z in range(edge // LEAF):
        places = np.stack([np.full_like(x, z), y, x], axis=-1)
        density = np.zeros((len(places), LEAF, LEAF, LEAF), np.float32)
        for centre, radius, width in surfaces:
            offset = LEAF * places - centre
            reach = np.abs(np.linalg.norm(offset + half, axis=1) - radius)
            near = np.flatnonzero(reach < width + half * np.sqrt(3))
            voxels = offset[near, None, None, None].astype(np.float32) + within
            distance = np.abs(np.sqrt(np.einsum("...i,...i", voxels, voxels)) - np.float32(radius))
            density[near] = np.maximum(density[near], np.clip((width - distance) / 2, 0, 1))
        kept = density.any(axis=(1, 2, 3))
        coordinates.append(places[kept].astype(np.int32))
        values.append(density[kept])
    return Leaves((edge,) * 3, (0, 0, 0), np.concatenate(coordinates), np.concatenate(values))


def test_a_thousand_cubed_voxels_of_which_few_are_there(device_name):
    edge = 1024
    leaves = shells_and_balls(edge)
    assert 0.015 < leaves.active() / edge**3 < 0.03
    scene = make_scene(
        volume=tfm.Volume(leaves, voxel_size=2 / edge, origin=(-1, -1, -1), density_scale=30.0),
        camera=tfm.Camera(from_=(0.7, 0.6, 3.4), to=(0, 0, 0), fov=38, res=(160, 90)),
        lights=[tfm.SpotLight(from_=(2.0, 2.6, 1.2), to=(0, 0, 0), cone=22, intensity=(3, 2.5, 2))],
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=256, steps=400),
        march=tfm.MarchSettings(steps=600),
    )
    peak = Peak()

    with tfm.Renderer(device_name) as renderer:
        result = renderer.render(scene)
        growth = peak.growth
        bricks = renderer._media.of(scene, None).bricks

    stored = bricks.nbytes + result.stats.map_bytes + result.image.nbytes
    assert bricks.nbytes < 4 * edge**3 / 2
    assert growth <= 1.5 * stored + FIXED
    assert np.isfinite(result.image).all()
    assert 0.05 < result.image[..., 3].mean() < 0.95
    assert result.image[..., :3].max() > 0.01
    # Straight through the middle there are four walls, and between them little is read.
    assert 0 < result.stats.samples["view_pass"] < 0.5 * 160 * 90 * 2 * 600


def test_64_lights_of_16_coefficients_add_up(device_name, rng):
    directions = rng.normal(size=(64, 3))
    places = 3.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    lights = [
        tfm.SpotLight(from_=tuple(place), to=(0.05, 0, 0.02), cone=cone, intensity=tuple(colour))
        for place, cone, colour in zip(
            places, rng.uniform(8, 30, 64), rng.uniform(0.1, 1, (64, 3)), strict=True
        )
    ]
    settings = tfm.MapSettings(basis="dct", density_weighting=10.0, res=32, steps=24, coeffs=16)

    with tfm.Renderer(device_name) as renderer:
        together = renderer.render(make_scene(lights=lights, map=settings))
        single = [renderer.render(make_scene(lights=[light], map=settings)) for light in lights]

    total = np.sum([result.image[..., :3].astype(np.float64) for result in single], axis=0)
    assert min(result.image[..., :3].max() for result in single) > 1e-3
    assert np.abs(together.image[..., :3] - total).max() <= LIGHTS * total.max()
    assert (together.image[..., 3] == single[0].image[..., 3]).all()
    assert together.stats.map_bytes == 64 * 32 * 32 * 16 * 4


def test_a_map_of_4096_texels_a_side(device_name, rng):
    res, steps = 4096, 4
    scene = make_scene(
        map=tfm.MapSettings(basis="dct", res=res, steps=steps, coeffs=1, density_weighting=1.0)
    )
    volume = scene.volume

    with tfm.Renderer(device_name) as renderer:
        (light_map,) = renderer.build_maps(scene)
        coefficients, occupied = light_map.coefficients, light_map.occupied

    assert coefficients.shape == (res, res, 1)
    assert light_map.nbytes == 4 * res * res
    assert 0 < coefficients.min() < coefficients.max() <= 1
    # Some texels by hand, the corners among them: the mean of e^-τ in the middle of the steps.
    at = rng.integers(0, res, (20_000, 2))
    at[:4] = (0, 0), (0, res - 1), (res - 1, 0), (res - 1, res - 1)
    origins, directions = light_map.light.rays((at[:, ::-1] + 0.5) / res)
    k_in, k_out = reference.march_bounds(volume, origins, directions)
    length, depth, mean = (k_out - k_in) / steps, np.zeros(len(at)), np.zeros(len(at))
    for n in range(steps):
        points = origins + (k_in + (n + 0.5) * length)[:, None] * directions
        half = reference.density(volume, points) * length / 2
        mean += np.exp(-(depth + half)) / steps
        depth += 2 * half
    assert np.abs(coefficients[at[:, 0], at[:, 1], 0] - mean).max() <= 4 * PASS
    assert mean.min() < 0.8
    assert (occupied[..., 0] <= occupied[..., 1]).all()


def test_a_frame_of_4096_pixels_in_two_crops(device_name):
    width, height = 4096, 2304
    scene = make_scene(
        volume=tfm.Volume(blobs(), voxel_size=0.15, origin=(-1, -1, -1), density_scale=4.0),
        camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=38, res=(width, height)),
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=64, steps=16),
        march=tfm.MarchSettings(steps=6),
    )
    split = 1543  # between tiles

    with tfm.Renderer(device_name) as renderer:
        maps = renderer.build_maps(scene)
        whole = renderer.render(scene, maps=maps)
        for crop in ((0, 0, split, height), (split, 0, width, height)):
            part = renderer.render(scene, maps=maps, crop=crop)
            columns = slice(crop[0], crop[2])
            assert (part.image == whole.image[:, columns]).all()
            assert (part.aovs["samples"] == whole.aovs["samples"][:, columns]).all()

    assert whole.image.shape == (height, width, 4)
    assert whole.image[..., 3].max() > 0.5
    assert (whole.image[[0, 0, -1, -1], [0, -1, 0, -1]] == 0).all()
