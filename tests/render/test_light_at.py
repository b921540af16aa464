"""Lights at points against their maps and closed forms."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl.errors import SceneError

pytestmark = pytest.mark.lanes

LOOKED_UP = 10 * FLOAT32
"""The same look-ups, and an exponential, in vectors of another width."""
SUMMED = 40 * FLOAT32
"""Relative, of a dozen lights that are added in another order."""
CLOSED = 2e-5
"""Optical depths near 1, from a box's sides that float32 places beside a scene of some units."""


def test_equals_the_map_and_the_light_without_media(renderer, small_scene, rng):
    points = rng.uniform(-1.3, 1.3, (400, 3))
    lamp = small_scene.lights[0].replace(name="key", falloff="inverse-square", cone=16.0)
    scene = small_scene.replace(lights=[lamp])
    (light_map,) = renderer.build_maps(scene)
    found = renderer.light_at(scene, points.reshape(20, 20, 3))
    assert found.names == ("key",)
    assert found.transmittance.shape == found.irradiance.shape == (1, 20, 20, 3)
    transmittance, irradiance = (of.reshape(-1, 3) for of in (found.transmittance, found.irradiance))
    expected = light_map.evaluate(points, scene.medium.sigma_t)
    np.testing.assert_allclose(transmittance, expected, atol=LOOKED_UP)
    # Some points are in the cone, behind density, and some are out of it.
    reached = light_map.light.reaches(points)
    assert 0.2 < reached.mean() < 0.8
    assert ((transmittance[reached] > 0.1) & (transmittance[reached] < 0.9)).any()
    away = np.sum((points - lamp.from_) ** 2, axis=-1)[:, None]
    bright = np.where(reached[:, None], np.asarray(lamp.intensity) / away, 0)
    np.testing.assert_allclose(irradiance, bright * expected, rtol=1e-5, atol=LOOKED_UP)
    with pytest.raises(SceneError, match="finite positions of shape"):
        renderer.light_at(scene, [[0, 0, np.nan]])


@pytest.mark.slow
def test_of_primitives(renderer, small_scene, rng):
    points = rng.uniform(-0.8, 0.8, (50, 3))
    balls = tfm.Points([[0.0, 0.3, 0.0], [-0.4, 0.1, -0.3]], [0.5, 0.4], 1.5)
    scene = small_scene.replace(volume=balls)
    (light_map,) = renderer.build_maps(scene)
    found = renderer.light_at(scene, points)
    expected = light_map.evaluate(points, scene.medium.sigma_t)
    np.testing.assert_allclose(found.transmittance[0], expected, atol=LOOKED_UP)
    assert (expected < 0.9).any()


@pytest.mark.slow
def test_bodies_and_solids_without_a_map(renderer):
    medium = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=0.1)
    box = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=0.6)
    ball = tfm.SphereSolid(centre=(0.5, 2.0, 0.0), radius=0.3)
    scene = make_scene(
        volume=box,
        medium=medium,
        lights=[tfm.SunLight(from_=(0, 1, 0), to=(0, 0, 0), intensity=2.0)],
        solids=[ball],
        shadow=tfm.ShadowSettings(res=512),
    )
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.9, 0.9, 19), np.linspace(-1.5, 0.9, 13)))
    points = np.stack([x, y, 0 * x], axis=-1)
    found = renderer.light_at(scene, points)
    depth = 0.6 * np.clip(1 - y, 0, 2)[:, None] * medium.sigma_t
    lit = np.abs(x - 0.5) > 0.3 + 4 / 512  # of the texels of a map over some units
    dark = np.abs(x - 0.5) < 0.3 - 4 / 512
    np.testing.assert_allclose(found.transmittance[0][lit], np.exp(-depth)[lit], rtol=CLOSED)
    np.testing.assert_allclose(found.irradiance[0][lit], 2 * np.exp(-depth)[lit], rtol=CLOSED)
    assert dark.any()
    assert not found.transmittance[0][dark].any()
    assert not found.irradiance[0][dark].any()


@pytest.mark.slow
def test_a_light_of_several_points_is_their_sum(renderer, small_scene, rng):
    points = rng.uniform(-0.8, 0.8, (50, 3))
    sky = tfm.EnvironmentLight(samples=4, intensity=(0.3, 0.2, 0.1), name="sky")
    whole = renderer.light_at(small_scene.replace(lights=[sky]), points)
    parts = [part.model_copy(update={"name": None}) for part in sky.parts()]
    apart = renderer.light_at(small_scene.replace(lights=parts), points)
    assert whole.names == ("sky",)
    assert len(apart.names) == len(parts) > 1
    np.testing.assert_allclose(whole.irradiance[0], apart.irradiance.sum(axis=0), rtol=SUMMED)
    weights = np.array([max(part.intensity) for part in parts])
    mean = np.einsum("l,lpc->pc", weights, apart.transmittance) / weights.sum()
    np.testing.assert_allclose(whole.transmittance[0], mean, rtol=SUMMED)


@pytest.mark.slow
def test_what_media_emit_is_the_last_light(renderer, small_scene):
    glowing = small_scene.medium.replace(emission=1.0, emission_lights=3)
    found = renderer.light_at(small_scene.replace(medium=glowing), [[0.0, 0.1, 0.0]])
    assert found.names == ("1", "emission")
    assert (found.irradiance[1] > 0).all()
    assert (found.transmittance[1] < 1).all()
