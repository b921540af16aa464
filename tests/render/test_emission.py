"""Media that emit light: closed forms, the float64 reference, and what emission leaves as it is."""

import re

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import FAST_MATH, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError

CHORD = 1e-5
"""Relative: where a ray enters and leaves a box is rounded to float32 at a distance of some units."""
BORDERS = 4 * PASS
"""Of the brightest: where bodies overlap, the ends of their chords are rounded, and each step's share is."""
QUADRATURE = 2e-3
"""Relative error of 400 midpoints on one ray: the grid's faces fall inside a step, not on its edge."""

GLOW = (0.5, 1.0, 2.0)
SCENE = make_scene()
GRID, LIGHT = SCENE.bodies[0], SCENE.lights[0]
GLOWING = SCENE.medium.replace(emission=GLOW)
FLAME = tfm.Medium(sigma_s=0, sigma_a=0, emission=GLOW)
GREEN = tfm.Medium(sigma_s=(1, 0, 0.2), sigma_a=0, emission=(0, 1, 0.5))
DARK = SCENE.replace(lights=[], march=SCENE.march.replace(cutoff=0.0))
LENGTH, DENSITY = 2.0, 0.7
BOX = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=DENSITY)
ALONG_Z = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1))
CUBE = tfm.Volume(np.ones((64, 64, 64)), voxel_size=2 / 64, origin=(-1, -1, -1), density_scale=DENSITY)


def slab(sigma, emission=GLOW, density=DENSITY, length=LENGTH):
    """∫ ε D e^{-σ D t} dt over a slab: ε/σ (1 - e^{-σ D L}), and ε D L where σ is 0."""
    depth = np.asarray(sigma, float) * density * length
    share = np.where(depth > 0, -np.expm1(-depth) / np.where(depth > 0, depth, 1), 1)
    return np.asarray(emission) * density * length * share


def grid(**changes):
    return tfm.Volume(blobs(seed=11), world_from_index=GRID.world_from_index, density_scale=3.0, **changes)


# --- closed forms ------------------------------------------------------------------------------------------

SIGMAS = {"none": 0.0, "next to none": 1e-12, "thin": 1e-3, "some": (0.3, 1.0, 4.0), "opaque": 1e4}


@pytest.mark.lanes
@pytest.mark.parametrize("sigma", SIGMAS.values(), ids=SIGMAS)
def test_a_slab_emits_in_closed_form(renderer, sigma):
    medium = tfm.Medium(sigma_s=0, sigma_a=sigma, emission=GLOW)
    result = renderer.render(tfm.Scene(BOX, medium, ALONG_Z, lights=[]))
    np.testing.assert_allclose(result.image[0, 0, :3], slab(sigma), rtol=CHORD)
    np.testing.assert_array_equal(result.aovs["emission"], result.image[..., :3])
    # What only emits hides nothing: its alpha is 0.
    assert result.image[0, 0, 3] == pytest.approx(
        1 - np.exp(-medium.sigma_t * DENSITY * LENGTH).mean(), abs=CHORD
    )


@pytest.mark.quick("0.0")
@pytest.mark.parametrize("sigma", [0.0, (0.3, 1.0, 4.0)])
def test_a_grid_of_constant_density_emits_as_a_slab_does(renderer, sigma):
    medium = tfm.Medium(sigma_s=0, sigma_a=sigma, emission=GLOW)
    scene = tfm.Scene(CUBE, medium, ALONG_Z, lights=[], march=tfm.MarchSettings(steps=400))
    np.testing.assert_allclose(renderer.render(scene).image[0, 0, :3], slab(sigma), rtol=QUADRATURE)


def test_fog_everywhere_is_as_bright_as_what_it_emits_over_what_it_takes(renderer):
    medium = tfm.Medium(sigma_s=0.5, sigma_a=(0.5, 1.5, 3.5), emission=GLOW)
    scene = tfm.Scene(tfm.EverywhereVolume(density=0.3), medium, ALONG_Z, lights=[])
    np.testing.assert_allclose(
        renderer.render(scene).image[0, 0, :3], np.divide(GLOW, medium.sigma_t), rtol=PASS
    )


def test_what_lies_before_a_flame_dims_it(renderer):
    smoke = tfm.Medium(sigma_s=0.5, sigma_a=(0.5, 1.0, 2.0))
    wall = tfm.BoxVolume(from_=(-1, -1, 2), to=(1, 1, 3), density=0.4, medium=smoke)
    result = renderer.render(tfm.Scene([BOX.with_medium(FLAME), wall], camera=ALONG_Z, lights=[]))
    expected = np.exp(-0.4 * smoke.sigma_t) * slab(0.0)
    np.testing.assert_allclose(result.image[0, 0, :3], expected, rtol=CHORD)


# --- the float64 reference ---------------------------------------------------------------------------------

MIXTURES = {
    "a grid": (GRID,),
    "a grid that only emits": (GRID.with_medium(FLAME),),
    "a colour that is emitted only": (GRID.with_medium(GREEN),),
    "a coloured grid": (grid(colour=np.random.default_rng(3).random((14, 12, 16, 3)).astype(np.float32)),),
    "a flame in smoke": (GRID.with_medium(SCENE.medium), grid(medium=FLAME)),
    "glowing fog around smoke": (
        GRID.with_medium(SCENE.medium),
        tfm.SphereVolume(radius=1.2, density=0.4, medium=FLAME),
        tfm.EverywhereVolume(density=0.1),
    ),
    "particles in a grid": (
        GRID,
        tfm.Points([[0.3, 0.2, 0.1], [-0.5, 0.1, -0.3]], [0.7, 0.6], 1.5, profile="smooth", medium=FLAME),
    ),
}
both_methods = pytest.mark.parametrize("method", ["tfm", "dual"])


def assert_equals_reference(renderer, save_on_failure, scene, method="dual"):
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method)
    brightest = max(1.0, float(expected[..., :3].max()))
    assert layers["emission"].max() > 0.1
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < BORDERS * brightest
    assert np.abs(result.aovs["emission"] - layers["emission"]).max() < BORDERS * brightest
    return result


@pytest.mark.lanes
@pytest.mark.quick("a grid", "a flame in smoke")
@pytest.mark.parametrize("mixture", MIXTURES)
def test_emission_equals_the_reference(renderer, save_on_failure, mixture):
    scene = DARK.replace(volume=MIXTURES[mixture], medium=GLOWING)
    assert_equals_reference(renderer, save_on_failure, scene)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("mixture", MIXTURES)
def test_emission_joins_what_lights_scatter(renderer, mixture, method):
    assert_joins(renderer, DARK.replace(volume=MIXTURES[mixture], lights=[LIGHT], medium=GLOWING), method)


@pytest.mark.slow
def test_emission_joins_lights_that_share_the_camera_s_samples(renderer):
    march = DARK.march.replace(sampling="world")
    scene = DARK.replace(
        volume=MIXTURES["a flame in smoke"], lights=[tfm.PointLight(from_=(2, 2, 2))], march=march
    )
    assert_joins(renderer, scene, "dual")


def assert_joins(renderer, scene, method):
    result = renderer.render(scene, method=method)
    alone = reference.render_with_aovs(scene.replace(lights=[]))[1]["emission"]
    unlit = renderer.render(without_emission(scene), method=method)
    brightest = max(1.0, float(result.image.max()))
    assert np.abs(result.aovs["emission"] - alone).max() < BORDERS * brightest
    sum_of_both = unlit.image[..., :3] + result.aovs["emission"]
    assert np.abs(result.image[..., :3] - sum_of_both).max() < BORDERS * brightest


@pytest.mark.slow
@both_methods
def test_solids_hide_emission_behind_them(renderer, save_on_failure, method):
    solids = [tfm.SphereSolid(centre=(0.2, -0.1, 0.3), radius=0.5, albedo=(0.2, 0.4, 0.8))]
    ambient = tfm.Ambient(radiance=(0.1, 0.2, 0.3))
    scene = DARK.replace(solids=solids, medium=GLOWING, ambient=ambient)
    # Shadow rays of solids are exact; there is no light.
    assert_equals_reference(renderer, save_on_failure, scene, method)


@pytest.mark.slow
def test_emission_beside_light_on_a_lattice(renderer):
    suns = [tfm.SunLight(from_=(1, 2, 0.5), to=(0, 0, 0)), tfm.SunLight(from_=(-1, 2, 3), to=(0, 0, 0))]
    scene = DARK.replace(lights=suns, map=SCENE.map.replace(lookup="lattice"))
    glowing, plain = (
        renderer.render(scene.replace(medium=medium), method="tfm", aovs=["lattice_error", "map_error"])
        for medium in (GLOWING, SCENE.medium)
    )
    sum_of_both = plain.image[..., :3] + glowing.aovs["emission"]
    np.testing.assert_allclose(glowing.image[..., :3], sum_of_both, atol=BORDERS)
    expected = reference.render_with_aovs(scene.replace(medium=GLOWING, lights=[]))[1]["emission"]
    assert np.abs(glowing.aovs["emission"] - expected).max() < BORDERS * expected.max()


def without_emission(scene):
    return scene.replace(
        medium=scene.medium.replace(emission=0),
        volume=[
            body.with_medium(body.own_medium and body.own_medium.replace(emission=0)) for body in scene.bodies
        ],
    )


# --- what emission leaves as it is -------------------------------------------------------------------------


def test_the_picture_is_linear_in_emission(renderer):
    once, thrice = (
        renderer.render(DARK.replace(medium=SCENE.medium.replace(emission=tuple(np.multiply(n, GLOW))))).image
        for n in (1, 3)
    )
    np.testing.assert_allclose(thrice[..., :3], 3 * once[..., :3], rtol=FAST_MATH)
    np.testing.assert_array_equal(thrice[..., 3], once[..., 3])


@pytest.mark.slow
def test_emission_may_change_without_a_new_map(new_renderer):
    with new_renderer() as session:
        session.render(SCENE.replace(volume=[GRID, GRID.with_medium(SCENE.medium)]))
        again = session.render(SCENE.replace(volume=[GRID, GRID.with_medium(GLOWING)]))
    assert again.stats.made == {}
    assert again.aovs["emission"].max() > 0


def test_without_emission_the_layer_is_black_and_made_only_when_asked_for(renderer):
    assert "emission" not in renderer.render(SCENE).aovs
    asked = renderer.render(SCENE, aovs=["emission"]).aovs["emission"]
    assert asked.shape == (18, 24, 3)
    assert not asked.any()


# --- bad input, and black pictures -------------------------------------------------------------------------

BAD = {
    "negative": ((-1, 0, 0), "medium.emission = .*: should be ≥ 0 in every channel"),
    "not finite": ((float("nan"), 0, 0), "medium.emission = .*: should be one number .* or three"),
    "not a colour": ("red", "medium.emission = 'red': should be one number .* or three"),
}


@pytest.mark.parametrize(("value", "fault"), BAD.values(), ids=BAD)
def test_emission_is_a_colour(value, fault):
    with pytest.raises(SceneError, match=fault):
        tfm.Medium(emission=value)


def test_fog_everywhere_must_take_of_every_colour_that_it_emits():
    fog = tfm.EverywhereVolume(density=0.1, medium=GREEN)
    with pytest.raises(SceneError, match=r"^volume\.1\.medium\.emission = .* infinitely bright; give it"):
        tfm.Scene([BOX, fog], lights=[])
    with pytest.raises(SceneError, match=r"^volume\.medium\.emission = "):
        tfm.Scene([fog], camera=ALONG_Z, lights=[])
    # Fog that takes of it, or of no density, may.
    tfm.Scene([fog, tfm.EverywhereVolume(density=0.1)], camera=ALONG_Z, lights=[])
    tfm.Scene([fog.replace(density=0)], camera=ALONG_Z, lights=[])


BLACK = {
    "looks away": (
        DARK.replace(medium=FLAME, camera=SCENE.camera.replace(to=(0.6, 0.8, 9))),
        "the medium, around .*, is behind the camera",
    ),
    "behind what absorbs": (
        DARK.replace(
            volume=[
                GRID.with_medium(FLAME),
                tfm.BoxVolume(
                    from_=(-9, -9, 3), to=(9, 9, 3.5), density=1e4, medium=tfm.Medium(sigma_s=0, sigma_a=1)
                ),
            ]
        ),
        "what emits light lies behind volume.1 .*, which only absorbs it",
    ),
    "too faint": (
        DARK.replace(medium=FLAME.replace(emission=1e-37)),
        "too little light .*: raise medium.emission or ambient.radiance",
    ),
}


@pytest.mark.quick("looks away")
@pytest.mark.parametrize(("scene", "reason"), BLACK.values(), ids=BLACK)
def test_why_a_picture_of_a_flame_is_black(renderer, scene, reason):
    (warning,) = renderer.render(scene).warnings
    assert warning.startswith("the picture is black")
    assert re.search(reason, warning), warning
