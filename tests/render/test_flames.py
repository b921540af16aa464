"""Flames in pictures: against the float64 reference, and apart from the smoke's density."""

import numpy as np
import pytest
from scenes import blobs, make_scene, turned
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference

MAP_PASS = 20 * PASS
"""Of the brightest, with a map: the power α amplifies its rounding, as in the view pass's own tests."""

SCENE = make_scene()
SMOKE = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=0.2)
FIRE = SMOKE.replace(temperature="heat", temperature_scale=2000, Le_scale=3)
CLEAR = FIRE.replace(sigma_s=0, sigma_a=0)


@pytest.fixture(scope="module")
def fire(tmp_path_factory):
    """Smoke, and heat that reaches beyond it."""
    path = tmp_path_factory.mktemp("fire") / "fire.npz"
    np.savez(path, density=blobs(), heat=np.roll(blobs(seed=11), 2, axis=1), voxel_size=(0.15, 0.2, 0.14))
    volume = tfm.Volume.load(path, density_scale=4.0)
    return volume.transformed(turned(25, (1, 2, 0.5), offset=(-1.1, -1.0, -0.9)))


def scene_of(volume, medium=FIRE, **changes):
    return SCENE.replace(volume=volume, medium=medium, march=SCENE.march.replace(cutoff=0.0), **changes)


@pytest.mark.lanes
@pytest.mark.quick("tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_flame_equals_the_reference(renderer, save_on_failure, fire, method):
    scene = scene_of(fire)
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method)
    assert layers["emission"].max() > 0.2
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < MAP_PASS
    assert np.abs(result.aovs["emission"] - layers["emission"]).max() < PASS


@pytest.mark.lanes
@pytest.mark.slow
def test_a_flame_among_other_bodies_equals_the_reference(renderer, save_on_failure, fire):
    others = [
        tfm.Points([[0.3, 0.2, 0.1], [-0.5, 0.1, -0.3]], [0.7, 0.6], 1.5, profile="smooth"),
        tfm.EverywhereVolume(density=0.1),
    ]
    scene = scene_of([fire.with_medium(FIRE), *others], SCENE.medium)
    expected = reference.render(scene, "dual").astype(np.float32)
    image = renderer.render(scene, method="dual").image
    with save_on_failure(image, expected):
        assert np.abs(image - expected).max() < MAP_PASS * expected.max()


def test_thicker_smoke_does_not_thicken_the_flame(one_lane_renderer, fire):
    of_scale = [
        one_lane_renderer.render(scene_of(fire.with_density_scale(scale), CLEAR, lights=[])).aovs["emission"]
        for scale in (1.0, 50.0)
    ]
    assert of_scale[0].max() > 0.3
    np.testing.assert_array_equal(*of_scale)
    # In smoke that absorbs, more of it hides more.
    thin, thick = (
        one_lane_renderer.render(scene_of(fire.with_density_scale(scale), lights=[])).aovs["emission"].sum()
        for scale in (1.0, 50.0)
    )
    assert thick < 0.8 * thin


def test_flames_change_without_a_new_map(new_renderer, fire):
    with new_renderer(lanes=1) as session:
        plain = session.render(scene_of(fire, SMOKE))
        maps_of_plain = plain.stats.made["map"]
        burning = session.render(scene_of(fire))
        brighter = session.render(scene_of(fire, FIRE.replace(Le_scale=6)))
        hotter = session.render(scene_of(fire, FIRE.replace(temperature_scale=2500)))
    assert maps_of_plain == 1
    # Its voxels lie beside those of the density.
    assert burning.stats.made == hotter.stats.made == {"bricks": 1}
    assert brighter.stats.made == {}
    np.testing.assert_allclose(
        brighter.aovs["emission"], 2 * burning.aovs["emission"], rtol=PASS, atol=PASS**2
    )
    lit = burning.image[..., :3] - burning.aovs["emission"]
    np.testing.assert_allclose(lit, plain.image[..., :3], atol=MAP_PASS)


def test_what_is_too_cold_is_told(renderer, fire):
    result = renderer.render(scene_of(fire, CLEAR.replace(temperature_scale=1), lights=[]))
    assert any("up to 500 K nothing glows" in warning for warning in result.warnings)
    assert not result.image[..., :3].any()
