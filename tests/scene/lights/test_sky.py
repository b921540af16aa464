"""A clear sky: its parts' sum, its colours, and what the camera sees of it."""

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl.scene.lights import SkyLight, SunLight
from tfm_cl.scene.lights.clear_sky import SUN_RADIUS, ClearSky, direction_of

SUMMED = 4e-3
"""Of the light: sums over cells of 1° by 2° against quadrature; the halo and the horizon are the worst."""
ON_A_PLANE = 0.04
"""Of the mean irradiance on planes: 64 directions for all, those of each cell's luminance in each channel."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def quadrature(rows=120, columns=360):
    """Directions all around and their solid angles: Gauss and Legendre's elevations above and below."""
    x, weights = np.polynomial.legendre.leggauss(rows)
    elevation = np.concatenate([(x + 1) * np.pi / 4, -(x + 1) * np.pi / 4])
    azimuth = (np.arange(columns) + 0.25) / columns * 2 * np.pi
    solid_angle = np.tile(weights * np.pi / 4, 2) * np.cos(elevation) * 2 * np.pi / columns
    return direction_of(elevation[:, None], azimuth).reshape(-1, 3), np.repeat(solid_angle, columns)


def seen(light, directions, width=1e-3):
    directions = np.atleast_2d(np.asarray(directions, np.float64))
    return light.radiance(directions, np.full(len(directions), width))


@pytest.mark.parametrize("elevation", [2.0, 45.0])
@pytest.mark.parametrize("samples", [1, 64])
def test_parts_are_all_the_light_of_sky_and_ground(elevation, samples):
    sky = SkyLight(
        elevation=elevation,
        azimuth=130,
        turbidity=3.4,
        ground_albedo=(0.3, 0.2, 0.1),
        samples=samples,
        sun=False,
    )
    directions, solid_angle = quadrature()
    light = seen(sky, directions) * solid_angle[:, None]

    parts = sky.parts()

    assert len(parts) == samples
    assert all(isinstance(part, SunLight) for part in parts)
    intensities = np.array([part.intensity for part in parts])
    np.testing.assert_allclose(intensities.sum(axis=0), light.sum(axis=0), rtol=SUMMED)
    if samples > 1:
        from_ = np.array([part.from_ for part in parts])
        np.testing.assert_allclose(np.linalg.norm(from_, axis=1), 1, rtol=ROUNDED)
        for normal in ((0, 1, 0), (0, -1, 0), (0.6, 0, 0.8), (-0.6, 0.64, 0.48)):
            found = np.maximum(from_ @ normal, 0) @ intensities
            expected = np.maximum(directions @ normal, 0) @ light
            assert (np.abs(found - expected) < ON_A_PLANE * light.sum(axis=0) / 4).all()
        shares = intensities @ LUMINANCE
        assert shares.max() < 2 * shares.mean()


def test_the_last_part_is_the_sun():
    keys = {"elevation": 10, "azimuth": 90, "samples": 8, "intensity": (2, 1, 0.5)}
    *others, sun = SkyLight(**keys).parts()
    assert tuple(others) == SkyLight(**keys, sun=False).parts()
    np.testing.assert_allclose(sun.from_, direction_of(np.radians(10), np.pi / 2), atol=ROUNDED)
    np.testing.assert_allclose(sun.intensity, ClearSky(sun.from_, 3, (0.2,) * 3).sun_irradiance * (2, 1, 0.5))


def test_parts_have_small_maps_and_the_sun_a_whole_one():
    *parts, sun = SkyLight(samples=6, map_res=128).parts()
    bounds = np.array([[-1.0, -1, -1], [1, 1, 1]])

    assert [part.fitted(bounds).replace(intensity=2).most_texels for part in parts] == [128] * 6
    assert sun.most_texels is None


def test_the_sun_reddens_and_the_sky_is_blue():
    suns = np.array([SkyLight(elevation=degrees).parts()[-1].intensity for degrees in (2, 10, 45, 90)])
    assert (np.diff(suns, axis=0) > 0).all()
    assert (np.diff(suns[:, 2] / suns[:, 0]) > 0).all()
    zenith = seen(SkyLight(elevation=30), (0, 1, 0))[0]
    assert zenith[2] > 2 * zenith[0]
    # At sunset it is red around the sun.
    low = seen(SkyLight(elevation=2, sun=False), direction_of(np.radians(4), 0))[0]
    assert low[0] > 1.5 * low[2]
    # In much haze the sun sets in it: no map for what is dark.
    assert len(SkyLight(elevation=0, turbidity=10, samples=4).parts()) == 4


@pytest.mark.parametrize("width", [0.1, 0.8, 2.5, 10], ids=lambda width: f"{width} radii")
def test_the_disk_has_the_suns_light_whatever_the_pixels(width):
    """Pixels as large as the sun, and larger."""
    sky, width = ClearSky((0.0, 1.0, 0.0), 3, (0, 0, 0)), width * SUN_RADIUS
    middles = (np.arange(4000) + 0.5) / 4000 * (SUN_RADIUS + width)
    ring = 2 * np.pi * np.sin(middles) * (middles[1] - middles[0])
    disk = sky.disk(direction_of(np.pi / 2 - middles, 0), np.full(len(middles), width))
    np.testing.assert_allclose(ring @ disk, sky.sun_irradiance, rtol=1e-3)


def test_up_turns_everything():
    upright, z_up = (SkyLight(elevation=20, azimuth=50, up=up, samples=6) for up in ((0, 1, 0), (0, 0, 3)))
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    for one, other in zip(upright.parts(), z_up.parts(), strict=True):
        np.testing.assert_allclose(other.from_, turn @ one.from_, atol=ROUNDED)
        np.testing.assert_allclose(other.intensity, one.intensity)
    directions = quadrature(3, 5)[0]
    np.testing.assert_allclose(seen(z_up, directions @ turn.T), seen(upright, directions), rtol=1e-9)


def test_the_ground_is_its_albedo_below_and_haze_far_away():
    dark, bright = (
        SkyLight(elevation=40, ground_albedo=albedo, sun=False) for albedo in (0, (0.5, 0.3, 0.1))
    )
    down, edge = (0, -1, 0), direction_of(np.radians([0.01, -0.01]), 1.0)
    ratio = (seen(bright, down) - seen(dark, down)) / seen(bright, down)
    assert (ratio > 0.5).all()
    assert seen(bright, down)[0, 0] > 3 * seen(bright, down)[0, 2]
    above, below = seen(bright, edge)
    np.testing.assert_allclose(below, above, rtol=1e-6)
