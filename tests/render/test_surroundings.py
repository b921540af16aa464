"""Light from all around, in media that scatter it forwards."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import FLOAT32, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.plan.surroundings import lattice_of
from tfm_cl.render.surroundings import SurroundingsLattice, beside_hidden

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


AT_POINTS = 0.03
"""Relative RMSE of light that is looked up at points a voxel apart, linear as a logarithm in between."""
SKY = tfm.EnvironmentLight(samples=5, intensity=(0.2, 0.3, 0.4), lookup="points")
"""Of few parts: where points are is another matter."""
SUN = tfm.SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), intensity=(3, 2.5, 2))
FINE = tfm.MapSettings(basis="dct", coeffs=8, density_weighting=10.0, res=48, steps=48)
MARCH = tfm.MarchSettings(steps=60, cutoff=0.0)
WAVES = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), phase="hg:0.6", octaves=3)
FLOOR = tfm.PlaneSolid(point=(0, -0.6, 0))
BOX = tfm.BoxVolume(
    from_=(-1, -1, -1), to=(1, -0.3, 1), density=0.4, medium=tfm.Medium(sigma_s=(0.2, 0.5, 1), octaves=2)
)


def beneath_a_sky(**changes):
    scene = make_scene(medium=WAVES, lights=[SKY, SUN], map=FINE, march=MARCH)
    return scene.replace(**changes)


def at_samples(scene):
    return scene.replace(
        lights=[light.replace(lookup="samples") if light.surrounds else light for light in scene.lights]
    )


def relative_rmse(image, expected):
    return float(np.sqrt(((image - expected) ** 2).mean() / (expected**2).mean()))


SURROUNDED = {
    "octaves": {},
    "grey, no sun": {"medium": tfm.Medium(phase="mie:20"), "lights": [SKY]},
    "solids": {"solids": [FLOOR]},
    "several media": {"volume": [make_scene().volume, BOX]},
    "a fire": {"medium": WAVES.replace(emission=(0.3, 0.2, 0.1)), "solids": [FLOOR]},
}


@pytest.mark.quick("octaves")
@pytest.mark.parametrize("case", SURROUNDED)
def test_light_at_points_is_nearly_that_at_every_sample(one_lane_renderer, save_on_failure, case):
    scene = beneath_a_sky(**SURROUNDED[case])
    found, expected = one_lane_renderer.render(scene), one_lane_renderer.render(at_samples(scene))
    with save_on_failure(found.image, expected.image):
        assert 0 < relative_rmse(found.image, expected.image) < AT_POINTS
    for name in ("transmittance", "light_transmittance"):
        assert relative_rmse(found.aovs[name], expected.aovs[name]) < AT_POINTS
    assert found.warnings == expected.warnings == ()


@pytest.mark.slow
def test_in_an_even_medium_it_is_exact(renderer):
    """The optical depth of ways grows evenly there, and but for edges light falls off in equal factors."""
    even = np.ones((24, 24, 24), np.float32)
    volume = tfm.Volume(even, voxel_size=0.1, origin=(-1.15, -1.15, -1.15))
    camera = tfm.Camera(from_=(0, 0, 40), to=(0, 0, 0), fov=1.5, res=(12, 12))
    thin = tfm.Medium(sigma_s=0.05, octaves=3, phase="hg:0.6")
    scene = beneath_a_sky(volume=volume, camera=camera, medium=thin)
    found, expected = renderer.render(scene).image, renderer.render(at_samples(scene)).image
    assert np.abs(found / expected - 1).max() < 2e-3


def test_what_arrives_at_points_stays_while_the_camera_moves(new_renderer):
    scene = beneath_a_sky()
    moved = scene.replace(camera=scene.camera.replace(from_=(3.6, 0.8, 2.4)))
    with new_renderer() as session:
        first = session.render(scene)
        assert first.stats.made["light at points"] == 1
        again = session.render(moved)
        assert "light at points" not in again.stats.made
        assert "map" not in again.stats.made
        lights = [SKY.replace(intensity=(0.4, 0.3, 0.2)), SUN]
        recoloured = session.render(scene.replace(lights=lights))
        assert "light at points" not in recoloured.stats.made
        thicker = session.render(scene.replace(volume=scene.volume.with_density_scale(5.0)))
        assert thicker.stats.made["light at points"] == 1
    with new_renderer() as session:
        assert np.array_equal(session.render(moved).image, again.image)
        assert not np.array_equal(recoloured.image, first.image)


def test_small_maps_of_parts_stay_where_others_become_finer(new_renderer):
    scene = beneath_a_sky(lights=[SKY.replace(map_res=16), SUN])
    finer = scene.replace(map=FINE.replace(res=64))
    with new_renderer() as session:
        assert session.render(scene).stats.made["map"] == 6
        found = session.render(finer)
        assert found.stats.made == {"map": 1}
        kept = [light_map for light in (0, 1) for light_map in session.maps_of(finer, light)]
    assert [light_map.requested for light_map in kept] == 2 * [finer.map]
    with new_renderer() as session:
        assert np.array_equal(session.render(finer).image, found.image)


def test_maps_that_are_given_are_looked_up_at_points(renderer):
    scene = beneath_a_sky()
    given = renderer.render(scene, maps=renderer.build_maps(scene))
    assert np.array_equal(given.image, renderer.render(scene).image)


def test_one_march_serves_the_camera_a_sun_and_the_sky(renderer, monkeypatch):
    """What it finds is what marches of their own do: the layers of lights add up to it."""
    monkeypatch.setattr(
        SurroundingsLattice, "see", lambda *_, **__: pytest.fail("the sky is marched by itself")
    )
    assert renderer.render(beneath_a_sky()).image.max() > 0


@pytest.mark.slow
def test_deep_samples_have_what_that_march_finds(renderer, monkeypatch):
    monkeypatch.setattr(
        SurroundingsLattice, "see", lambda *_, **__: pytest.fail("the sky is marched by itself")
    )
    scene = beneath_a_sky(medium=WAVES.replace(octaves=1))
    result = renderer.render(scene, deep=0.01, deep_colour=True)
    np.testing.assert_array_equal(result.image, renderer.render(scene).image)
    flat, colours = result.deep.flattened()[..., :3], result.image[..., :3]
    assert np.abs(flat - colours).max() < 20 * FLOAT32 * colours.max()  # sums in another order


@pytest.mark.slow
@pytest.mark.parametrize("few", [True, False])
def test_layers_of_lights_add_up(renderer, monkeypatch, few):
    """One march serves the camera, a sun and the sky here too, where all of the sky is in one layer."""
    marches, see = [], SurroundingsLattice.see
    monkeypatch.setattr(SurroundingsLattice, "see", lambda *args: marches.append(1) or see(*args))
    lights = [SKY, SUN] if few else [SKY, SUN, SKY.replace(intensity=0.3, samples=4)]
    scene = beneath_a_sky(lights=lights)
    plain, layered = renderer.render(scene), renderer.render(scene, aovs=["lights", "map_error"])
    layers = [layered.aovs[f"light.{number}"] for number in range(1, len(lights) + 1)]
    rounding = 20 * PASS * plain.image.max()
    assert np.abs(layered.image - plain.image).max() < rounding
    assert np.abs(sum(layers) - layered.image[..., :3]).max() < rounding
    assert all(layer.max() > 0.01 for layer in layers)
    assert bool(marches) != few
    # The sky's is what a march of its own finds, whether or not the sun's samples serve it.
    alone = renderer.render(beneath_a_sky(lights=[SKY])).image
    assert np.abs(layers[0] - alone[..., :3]).max() < rounding


def test_antialiased_pixels_see_the_same_points(renderer):
    scene = beneath_a_sky()
    found, expected = (renderer.render(one, samples=4) for one in (scene, at_samples(scene)))
    assert found.stats.refined_pixels > 0
    assert relative_rmse(found.image, expected.image) < AT_POINTS


@pytest.mark.slow
def test_the_error_of_points_is_told(renderer):
    """As that of a lattice of voxels."""
    scene = beneath_a_sky()
    found, exact = renderer.render(scene, aovs=["lattice_error"]), renderer.render(at_samples(scene))
    one, other = found.image[..., :3].astype(np.float64), exact.image[..., :3]
    largest = np.maximum(one, other).sum(axis=-1)
    expected = np.abs(one - other).sum(axis=-1) / np.where(largest > 0, largest, 1)
    assert expected.max() > 1e-3
    assert np.abs(found.aovs["lattice_error"] - expected).max() < 0.01 * expected.max()


@pytest.mark.slow
def test_it_goes_with_a_lattice_of_voxels(renderer):
    """Which holds other lights; the error of both is told."""
    lights = [SKY, SUN, SUN.replace(from_=(-1, 2, 3)), SUN.replace(from_=(2, 1, -1))]
    scene = beneath_a_sky(lights=lights, map=FINE.replace(lookup="lattice"))
    exact = renderer.render(at_samples(scene.replace(map=FINE)))
    found = renderer.render(scene, aovs=["lattice_error"])
    of_voxels = renderer.render(scene.replace(lights=lights[1:]), aovs=["lattice_error"])
    assert found.warnings == ()
    assert 0 < relative_rmse(found.image, exact.image) < 2 * AT_POINTS
    errors = [np.mean(one.aovs["lattice_error"]) for one in (of_voxels, found)]
    assert 0 < errors[0] != errors[1]
    one, other = found.image[..., :3].astype(np.float64), exact.image[..., :3]
    largest = np.maximum(one, other).sum(axis=-1)
    expected = np.abs(one - other).sum(axis=-1) / np.where(largest > 0, largest, 1)
    assert np.abs(found.aovs["lattice_error"] - expected).max() < 0.05 * expected.max()


@pytest.mark.slow
def test_primitives_are_too_fine_for_points(renderer):
    points = tfm.Points(np.zeros((1, 3), np.float32), radius=0.2)
    scene = beneath_a_sky(volume=[make_scene().volume, points], medium=tfm.Medium())
    with pytest.warns(tfm.TfmWarning, match="every sample: points, curves and polygons are finer"):
        found = renderer.render(scene)
    assert np.array_equal(found.image, renderer.render(at_samples(scene)).image)


def test_what_brings_nothing_is_black(one_lane_renderer):
    """Though points hold logarithms: in every colour by itself."""
    image = one_lane_renderer.render(beneath_a_sky(lights=[SKY.replace(intensity=(0.2, 0, 0.4))])).image
    assert (image[..., 1] == 0).all()
    assert image[..., 0].max() > 0.01


BESIDE_SOLIDS = 0.03
"""As `AT_POINTS`, in smoke around a ball: edges of its shadows lie between points. It is .2 where points
within the ball are taken for those beside it."""


@pytest.mark.slow
def test_points_within_solids_do_not_darken_what_is_beside_them(renderer, save_on_failure):
    ball = tfm.SphereSolid(centre=(0.2, 0.1, 0.3), radius=0.5, albedo=0)
    scene = beneath_a_sky(solids=[ball], lights=[SKY.replace(samples=16)])
    found, expected = renderer.render(scene).image, renderer.render(at_samples(scene)).image
    with save_on_failure(found, expected):
        assert relative_rmse(found, expected) < BESIDE_SOLIDS


def test_a_neighbour_that_is_seen_stands_for_a_point_that_is_hidden():
    numbers = np.array([0, 1, 2, 3, 5, 7, 8], np.int32)  # of a plane of 3×3 points; 4 and 6 do not count
    hidden = np.isin(numbers, [3, 5, 7, 8])
    ways = np.tile([0.6, -0.8, 0.0], (7, 1))
    stands = numbers[beside_hidden((3, 3, 1), numbers, hidden, ways)]
    # Of 3 (0, 1) and 5 (2, 1) the nearest are those below; 7 and 8 have none.
    assert stands.tolist() == [0, 1, 2, 0, 2, 7, 8]
    none = np.zeros(7, bool)
    assert beside_hidden((3, 3, 1), numbers, none, ways).tolist() == list(range(7))
    assert beside_hidden((3, 3, 1), numbers, ~none, ways).tolist() == list(range(7))


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.slow
def test_a_camera_may_stand_at_a_point(renderer):
    """From where no way leads to it."""
    ball = tfm.SphereSolid(centre=(9, 0, 0), radius=0.5)
    scene = beneath_a_sky(solids=[ball], lights=[SKY])
    lattice, _ = lattice_of(scene)
    place = lattice.positions([lattice.points // 2])[0]
    camera = scene.camera.replace(from_=tuple(place), to=tuple(place + 1.0))
    image = renderer.render(scene.replace(camera=camera)).image
    assert np.isfinite(image).all()
    assert image[..., 0].max() > 0.01
