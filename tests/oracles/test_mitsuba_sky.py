"""The clear sky against Mitsuba's ``sunsky``, which shares the dataset and no code."""

import numpy as np
import pytest
from oracles.mitsuba_scene import mi

from tfm_cl.scene.lights.clear_sky import LOWEST, SUN_RADIUS, ClearSky, direction_of

pytestmark = pytest.mark.slow

FLOAT32 = 2e-4
"""Of the brightest: Mitsuba evaluates the model in float32, with differences of exponentials in it."""
IRRADIANCE = 3e-3
"""Of the sun's brightest channel: its disk is half a degree high in Mitsuba, and sampled here."""


@pytest.mark.parametrize(("elevation", "turbidity"), [(3, 2.5), (30, 1), (60, 10), (12, 6.2)])
def test_sky_and_sun_equal_mitsubas(elevation, turbidity, rng):
    mi.set_variant("scalar_rgb")
    azimuth, albedo = 0.7, (0.6, 0.3, 0.1)
    sun = direction_of(np.radians(elevation), azimuth)
    sky = ClearSky(tuple(sun), turbidity, albedo)

    def emitter(**scales):
        # Mitsuba's z is up: x, y, z are our z, x, y.
        return mi.load_dict(
            {
                "type": "sunsky",
                "sun_direction": sun[[2, 0, 1]].tolist(),
                "turbidity": turbidity,
                "albedo": {"type": "rgb", "value": list(albedo)},
                **scales,
            }
        )

    def radiance(light, direction):
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f((-direction[[2, 0, 1]]).tolist())
        return np.array(light.eval(interaction))

    directions = direction_of(np.arcsin(rng.uniform(LOWEST, 1, 60)), rng.uniform(0, 2 * np.pi, 60))
    found = np.array([radiance(emitter(sun_scale=0.0), direction) for direction in directions])
    expected = sky.around(directions)
    assert np.abs(found - expected).max() < FLOAT32 * expected.max()

    # The disk: rings of equal area, darker towards its limb.
    light = emitter(sky_scale=0.0, complex_sun=True)
    right = np.cross(sun, (0, 1, 0)) / np.cos(np.radians(elevation))
    radius, angle = SUN_RADIUS * np.sqrt((np.arange(40) + 0.5) / 40), np.arange(8) * np.pi / 4
    offsets = [r * (np.cos(a) * right + np.sin(a) * np.cross(right, sun)) for r in radius for a in angle]
    disk = np.mean([radiance(light, sun + offset) for offset in offsets], axis=0)
    expected = sky.disk(sun[None], np.array([1e-6]))[0]
    assert np.abs(disk - expected).max() < IRRADIANCE * disk.max()
