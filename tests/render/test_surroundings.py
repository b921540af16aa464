"""Light from all around, in media that scatter it forwards."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference

RIPPLE = 0.06
"""That 32 directions, each a part of the sky, leave of an even one; 1,000 where they were points."""
THIN = tfm.SphereVolume(centre=(0, 0, 0), radius=1, density=0.01)


def test_an_even_sky_lights_evenly_whatever_the_phase_function(renderer):
    """Thin and white: what is scattered towards the camera is what it hides of the sky."""
    camera = tfm.Camera(from_=(0.3, 0.2, 4), to=(0, 0, 0), fov=30, res=(24, 24))
    scene = tfm.Scene(THIN, tfm.Medium(phase="mie:20"), camera, [tfm.EnvironmentLight(intensity=2)])
    image = renderer.render(scene).image
    ball = image[..., 3] > 1e-3
    assert np.abs(image[ball, 0] / (2 * image[ball, 3]) - 1).max() < RIPPLE


def lit_by_a_part_of_the_sky_and_a_spot():
    lights = [*tfm.EnvironmentLight(samples=4).parts(), *make_scene().lights]
    return make_scene(medium=tfm.Medium(phase="hg:0.9"), lights=lights)


@pytest.mark.slow
def test_two_media_equal_the_reference(renderer, save_on_failure):
    scene = lit_by_a_part_of_the_sky_and_a_spot()
    other = THIN.replace(density=0.5, medium=tfm.Medium(phase="hg:-0.5"))
    scene = scene.replace(volume=(*scene.bodies, other))
    found, expected = renderer.render(scene, method="dual").image, reference.render(scene, "dual")
    with save_on_failure(found, expected.astype(np.float32)):
        assert np.abs(found - expected).max() < 20 * PASS * max(1.0, float(expected.max()))


@pytest.mark.slow
def test_a_lattice_knows_how_wide_lights_are(renderer):
    scene = lit_by_a_part_of_the_sky_and_a_spot()
    at_samples, on_lattice = (
        renderer.render(scene.replace(map=scene.map.replace(lookup=lookup))).image[..., :3]
        for lookup in ("interpolate", "lattice")
    )
    assert np.abs(on_lattice - at_samples).mean() < 0.03 * at_samples.mean()
