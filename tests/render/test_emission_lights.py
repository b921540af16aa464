"""What media emit, as light on media and solids: against point lights, and the float64 reference."""

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference

MAP_PASS = 20 * PASS
"""Of the brightest, with a map: the power α amplifies its rounding, as in the view pass's own tests."""
ON_LATTICE = 0.03
"""Relative RMSE of light that is looked up at points two voxels apart, and of what solids reflect of it."""
FLOOR = tfm.PlaneSolid(point=(0, -2, 0))
BLOCK = tfm.BoxSolid(from_=(0.9, -2.0, 0.3), to=(1.4, -0.6, 0.8))
SCENE = make_scene()
GLOWING = SCENE.medium.replace(emission=(3, 2, 1), emission_lights=3)
HOT = tfm.Medium(sigma_s=0, sigma_a=1e-4, emission=(300, 200, 100), emission_lights=1)
BALL = tfm.SphereVolume(centre=(0, -1.5, 0), radius=0.1, medium=HOT)
INTENSITY = tuple(4 / 3 * np.pi * 0.1**3 * np.array(HOT.emission))


def relative_rmse(image, expected):
    return float(np.sqrt(((image - expected) ** 2).mean() / (expected**2).mean()))


def scene_of(medium, **changes):
    march = SCENE.march.replace(cutoff=0.0)
    return SCENE.replace(**{"medium": medium, "march": march, "lights": [], **changes})


@pytest.mark.slow
def test_a_hot_ball_lights_smoke_and_a_solid_as_a_point_light_does(renderer):
    """A solid, exactly; thin smoke around, but for the lattice."""
    thin = [BALL, SCENE.volume.with_density_scale(0.2)]
    scene = scene_of(SCENE.medium, volume=thin, solids=[FLOOR, BLOCK])
    hot = renderer.render(scene)
    lamp = tfm.PointLight(from_=BALL.centre, intensity=INTENSITY, falloff="inverse-square")
    dark = [BALL.with_medium(HOT.replace(emission_lights=0)), thin[1]]
    lit = renderer.render(scene.replace(volume=dark, lights=[lamp]))
    # What the camera sees of the ball itself is the same, and told apart.
    assert np.array_equal(hot.aovs["emission"], lit.aovs["emission"])
    of_lights = [one.image[..., :3] - one.aovs["emission"] for one in (hot, lit)]
    assert relative_rmse(*of_lights) < ON_LATTICE
    assert of_lights[0].sum() > 0.1 * hot.aovs["emission"].sum()


BESIDES = {"solids": [FLOOR, BLOCK], "lights": SCENE.lights}
CASES = {
    "alone": ("tfm", {}),
    "solids, lights": ("tfm", BESIDES),
    "dual": ("dual", BESIDES),
    "several media": (
        "dual",
        {
            "volume": [
                SCENE.volume,
                tfm.BoxVolume(
                    from_=(-2, -1, -2),
                    to=(2, 0, 2),
                    density=0.3,
                    medium=tfm.Medium(sigma_s=(0.2, 0.5, 1), octaves=2),
                ),
            ]
        },
    ),
    "every sample": ("dual", {"march": SCENE.march.replace(attenuation="paper", cutoff=0.0)}),
}


@pytest.mark.lanes
@pytest.mark.quick("alone")
@pytest.mark.parametrize("case", CASES)
def test_it_equals_the_reference(renderer, save_on_failure, case):
    method, changes = CASES[case]
    scene = scene_of(GLOWING, **changes)
    result = renderer.render(scene, method=method)
    expected = reference.render(scene, method)
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < MAP_PASS * expected.max()
    seen = result.image[..., :3] - result.aovs["emission"]
    assert seen.sum() > 0.05 * result.aovs["emission"].sum()


@pytest.mark.slow
def test_fire_lights_its_smoke_as_the_reference_says(renderer, save_on_failure, tmp_path):
    path = tmp_path / "fire.npz"
    np.savez(path, density=blobs(), heat=np.roll(blobs(seed=11), 2, axis=1), voxel_size=(0.15, 0.2, 0.14))
    glow = {"temperature": "heat", "temperature_scale": 2000, "Le_scale": 3, "emission_lights": 3}
    # Of a part of the sky, media show another phase function.
    lights = [*SCENE.lights, tfm.EnvironmentLight(samples=3, intensity=0.3)]
    fire = SCENE.medium.replace(phase="hg:0.6", **glow)
    scene = scene_of(fire, volume=tfm.Volume.load(path, density_scale=4.0), lights=lights)
    result = renderer.render(scene, method="dual")
    expected = reference.render(scene, "dual")
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < MAP_PASS * expected.max()


@pytest.mark.slow
def test_small_maps_are_built_once(new_renderer):
    """They stay for the next frame, beside larger ones, and can be given."""
    scene = scene_of(GLOWING, lights=SCENE.lights)
    with new_renderer() as session:
        first = session.render(scene)
        assert first.stats.made["map"] == 4
        again = session.render(scene)
        assert again.stats.made.get("map", 0) == 0
        maps = session.build_maps(scene.replace(map=scene.map.replace(res=96)))
        assert [light_map.settings.res for light_map in maps] == [96, 64, 64, 64]
        session.render(scene.replace(map=scene.map.replace(res=96)), maps=maps)
    assert np.array_equal(first.image, again.image)


def test_what_arrives_at_points_stays_while_the_camera_moves(new_renderer):
    scene = scene_of(GLOWING)
    moved = scene.replace(camera=scene.camera.replace(from_=(3.6, 0.8, 2.4)))
    with new_renderer(lanes=1) as session:
        first = session.render(scene)
        assert first.stats.made["light at points"] == 1
        again = session.render(moved)
        assert not {"light at points", "map"} & again.stats.made.keys()
        # As bright as it glows, whatever stayed.
        brighter = session.render(scene_of(GLOWING.replace(emission=(6, 4, 2))))
        assert "light at points" not in brighter.stats.made
        np.testing.assert_allclose(brighter.image[..., :3], 2 * first.image[..., :3], rtol=PASS)
        thicker = session.render(scene.replace(volume=scene.volume.with_density_scale(5.0)))
        assert thicker.stats.made["light at points"] == 1
    with new_renderer(lanes=1) as session:
        np.testing.assert_array_equal(session.render(moved).image, again.image)
