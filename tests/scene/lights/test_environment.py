"""The environment: its suns' sum, and which pixel of an image lies where."""

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl.errors import SceneError
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import Image
from tfm_cl.scene.lights import EnvironmentLight, SunLight
from tfm_cl.scene.lights.area import sphere_directions
from tfm_cl.scene.lights.environment import directions_of, flux_of

SPREAD = 0.6
"""Relative error of the irradiance of smooth light from k directions, times k^½: their cells are alike."""


def directions_of_parts(parts):
    return np.array([part.from_ for part in parts])  # where the light comes from


def pixel_directions(height, width):
    return directions_of((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width)


def write(path, image):
    np.save(path, image.astype(np.float32))
    return str(path)


@pytest.mark.parametrize("samples", [1, 2, 32, 256])
def test_a_constant_sky_sums_to_4_pi(samples):
    light = EnvironmentLight(intensity=(1, 2, 3), samples=samples)

    parts = light.parts()

    assert len(parts) == samples
    assert all(isinstance(part, SunLight) and part.to == (0, 0, 0) for part in parts)
    total = np.sum([part.intensity for part in parts], axis=0)
    np.testing.assert_allclose(total, 4 * np.pi * np.array([1, 2, 3]), rtol=ROUNDED)
    assert light.parts() == parts


@pytest.mark.parametrize("count", [16, 32, 100, 256])
def test_directions_are_spread_evenly(count, rng):
    directions = sphere_directions(count)

    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=ROUNDED)
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    # Caps of half the area that falls to each do not overlap.
    assert np.arccos(nearest.max()) > 2 * np.arccos(1 - 1 / count)
    # Cells have the same size: what random directions are nearest to.
    anywhere = rng.normal(size=(400 * count, 3))
    hits = np.bincount((anywhere @ directions.T).argmax(axis=1), minlength=count)
    assert hits.min() > 250
    assert hits.max() < 550


@pytest.mark.parametrize("shape", [(1, 1), (37, 53), (64, 128), (600, 1100)], ids=str)
def test_an_image_keeps_all_its_light(tmp_path, rng, shape):
    image = rng.uniform(0, 2, (*shape, 3))
    path = write(tmp_path / "sky.npy", image)

    parts = EnvironmentLight(texture=path, samples=32, intensity=(1, 0.5, 2)).parts()

    edges = np.cos(np.pi * np.arange(shape[0] + 1) / shape[0])
    solid_angle = (edges[:-1] - edges[1:]) * 2 * np.pi / shape[1]
    expected = np.einsum("y,yxc->c", solid_angle, image.astype(np.float32).astype(float)) * (1, 0.5, 2)
    np.testing.assert_allclose(np.sum([part.intensity for part in parts], axis=0), expected, rtol=1e-9)


def test_a_white_image_is_a_constant_sky(tmp_path):
    path = write(tmp_path / "white.npy", np.ones((256, 512, 3)))

    parts = EnvironmentLight(texture=path, samples=32).parts()

    cells = np.array([part.intensity[0] for part in parts])
    assert cells.sum() == pytest.approx(4 * np.pi)
    assert cells == pytest.approx(4 * np.pi / 32, rel=0.15)  # the poles' cells differ most


@pytest.mark.parametrize("samples", [32, 128, 256])
def test_irradiance_of_a_smooth_sky(tmp_path, samples, rng):
    # L = 2 + d·a: on a plane with normal n the integral of L max(0, d·n) is π (2 + 2/3 a·n).
    slope = np.array([0.5, 0.9, -0.7])
    image = 2 + pixel_directions(200, 400) @ slope
    path = write(tmp_path / "sky.npy", np.repeat(image[..., None], 3, axis=2))

    parts = EnvironmentLight(texture=path, samples=samples).parts()

    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    weights = np.array([part.intensity[0] for part in parts])
    found = np.maximum(normals @ directions_of_parts(parts).T, 0) @ weights
    expected = np.pi * (2 + 2 / 3 * normals @ slope)
    assert np.abs(found / expected - 1).max() < SPREAD / np.sqrt(samples)
    assert np.ptp(expected) > np.pi  # it does depend on the direction


@pytest.mark.parametrize(
    ("row", "column", "direction"),
    [
        *((0.0, 0.5, (0, 1, 0)), (1.0, 0.5, (0, -1, 0))),
        *((0.5, 0.5, (0, 0, 1)), (0.5, 0.25, (1, 0, 0)), (0.5, 0.75, (-1, 0, 0))),
        *((0.5, 0.0, (0, 0, -1)), (0.5, 1.0, (0, 0, -1))),
    ],
)
def test_orientation(row, column, direction):
    found = directions_of(np.array([row]), np.array([column]))[0, 0]
    np.testing.assert_allclose(found, direction, atol=ROUNDED)


def test_a_bright_pixel_lights_from_its_side(tmp_path):
    image = np.zeros((64, 128, 3), np.float32)
    image[12, 40] = 1
    expected = pixel_directions(64, 128)[12, 40]
    image_io.save(
        tmp_path / "sky.exr",
        Image(rgba=np.dstack([image, np.ones((64, 128), np.float32)])),
        pixel_type="float",
    )

    parts = EnvironmentLight(texture=str(tmp_path / "sky.exr"), samples=256).parts()

    bright = [part for part in parts if max(part.intensity) > 0]
    assert len(bright) == 1
    # A cell of 256 has a radius of about 7°, its corners some 12°.
    assert directions_of_parts(bright)[0] @ expected > np.cos(np.radians(12))


def test_suns_shine_from_where_the_sky_is():
    parts = [part.fitted(np.array([[-1, -1, -1], [1, 1, 1]])) for part in EnvironmentLight(samples=8).parts()]
    for part in parts:
        travel = part.arrival(np.zeros((1, 3))).direction[0]
        np.testing.assert_allclose(travel, -np.asarray(part.from_), atol=ROUNDED)


def test_blocks_of_a_large_image_go_to_the_same_cells(rng):
    coarse = rng.uniform(0, 1, (100, 200, 3)).astype(np.float32)
    fine = coarse.repeat(11, axis=0).repeat(11, axis=1)  # 1100 × 2200: summed to 512 × 1024 first

    one, other = flux_of(coarse, 64), flux_of(fine, 64)

    # Both cut cells along pixels, of a width of 1/200 and 1/1024 of the circle.
    np.testing.assert_allclose(one.sum(axis=0), other.sum(axis=0), rtol=1e-3)
    assert np.abs(one - other).max() < 0.1 * one.max()


def test_it_has_no_map_of_its_own():
    light = EnvironmentLight()
    for use in (
        light.frame,
        light.map_key,
        lambda: light.footprint(1),
        lambda: light.rays(np.zeros((1, 2))),
        lambda: light.begins(np.zeros((1, 3))),
        lambda: light.arrival(np.zeros((1, 3))),
    ):
        with pytest.raises(SceneError, match="no map of its own"):
            use()
    assert light.needs_fitting


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"samples": 257}, "light.samples = 257: should be less than or equal to 256"),
        ({"from_": (0, 0, 0)}, "unknown key 'from_' in [light]"),
        ({"intensity": 1e25}, "light.intensity"),
        ({"texture": "no such sky.exr"}, "light.texture = 'no such sky.exr': cannot be read (No such file"),
    ],
)
def test_impossible_values_are_one_line(keys, message):
    with pytest.raises(SceneError) as raised:
        EnvironmentLight(**keys, **({} if "samples" in keys else {"samples": 1})).parts()

    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)
