"""Map resolution and steps of "auto": what they follow, their limits, who resolves them, what they cost."""

import math

import numpy as np
import pytest
from scenes import blobs, make_scene, turned

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.metrics import compare
from tfm_cl.plan import resolution
from tfm_cl.plan.marched import Marched, voxel_depth
from tfm_cl.plan.resolution import DEPTH_PER_STEP, STEPS, TEXEL_POWER, TEXELS

CAMERA = tfm.Camera(from_=(0, 0, 100), to=(0, 0, 0), fov=30, res=(16000, 8000))
ADDED_ERROR = 0.012
"""Relative RMSE that "auto" may add: 1 % is what its documentation states of larger volumes and images."""


def cube(edge, count, **settings):
    """A full cube of ``count``³ voxels, ``edge`` wide, around the origin."""
    return tfm.Volume(
        np.ones((count,) * 3, np.float32), voxel_size=edge / count, origin=(-edge / 2,) * 3, **settings
    )


def spot(**settings):
    return tfm.SpotLight(**{"from_": (0, 10, 0), "to": (0, 0, 0), "cone": 10, **settings})


def resolved(volume, light=None, camera=None, *, sigma_t=1e-6):
    """A scene in which all was "auto"; so thin that optical depth does not matter, unless told."""
    light, camera = light or spot(), camera or CAMERA
    scene = tfm.Scene(volume, tfm.Medium(sigma_s=sigma_t), camera=camera, lights=[light])
    return resolution.resolved(auto(scene))


def map_res_for(volume, light, camera):
    return resolved(volume, light, camera).map.res


def steps_for(volume):
    numbers = resolved(volume)
    assert numbers.map.steps == numbers.march.steps
    return numbers.march.steps


def auto(scene):
    return scene.replace(
        map=scene.map.replace(res="auto", steps="auto"), march=scene.march.replace(steps="auto")
    )


# --------------------------------------------------------------------------------- map resolution


def test_footprint_is_the_width_of_the_cone():
    light = spot(cone=30)
    assert light.footprint(3) == pytest.approx(6 * math.tan(math.radians(30)))
    # A point at the edge of the map, at that depth, is that far from the one at the other edge.
    left, right = (reference.texel_rays(light, 100).directions[row] for row in (5000, 5099))
    across = np.linalg.norm(left / left[1] - right / right[1]) * 3
    assert across == pytest.approx(light.footprint(3), rel=0.02)  # the outer texels' centres: 99 of 100


def test_two_texels_a_voxel():
    volume, light = cube(2.0, 40), spot(cone=6)
    # The map is the cone, which lies within the cube, half of 1/20 a texel, at the distance of the middle.
    far = math.hypot(11.05, 1.05, 1.05)
    width = 2 * math.tan(math.radians(6)) * (8.95 + far) / 2
    assert map_res_for(volume, light, CAMERA) == 32 * math.ceil(width * 1.01 / 0.025 / 32)


@pytest.mark.parametrize(
    "change",
    [{"volume": cube(2.0, 40)}, {"light": spot(cone=math.degrees(math.atan(math.tan(0.1) / 4)))}],
    ids=["voxels", "cone"],
)
def test_texels_follow(change):
    given = {"volume": cube(2.0, 160), "light": spot(cone=math.degrees(0.1)), "camera": CAMERA}
    assert map_res_for(**given | change) == pytest.approx(map_res_for(**given) / 4, abs=32)


@pytest.mark.parametrize("light", [spot(cone=80), spot(cone=89.999), tfm.PointLight(from_=(0, 10, 0))])
def test_a_wide_light_asks_for_no_more_than_the_medium(light):
    """The cone does not count where it is wider than what it lights."""
    narrow = map_res_for(cube(2.0, 40), spot(cone=12), CAMERA)
    assert map_res_for(cube(2.0, 40), light, CAMERA) == narrow


def test_a_small_image_needs_no_fine_map():
    volume, light = cube(2.0, 200), spot()
    fine = map_res_for(volume, light, CAMERA)
    assert map_res_for(volume, light, CAMERA.replace(res=(20000, 10000))) == fine
    small = [map_res_for(volume, light, CAMERA.replace(res=(2 * n, n))) for n in (512, 1024)]
    assert small[0] == pytest.approx(small[1] / 2, abs=32)
    assert small[1] < fine
    # Four texels a pixel where the cube is nearest: 99 away.
    pixel = 2 * math.tan(math.radians(15)) * 99 / 1024
    width = light.fitted(volume.occupied_bounds).footprint(10)
    assert small[1] == pytest.approx(width / (pixel / 4), abs=32)


def test_a_camera_inside_asks_for_what_the_voxels_hold():
    inside = CAMERA.replace(from_=(0, 0, 0.5), res=(20, 10))
    assert map_res_for(cube(2.0, 200), spot(), inside) == map_res_for(cube(2.0, 200), spot(), CAMERA)


def test_a_light_inside_is_measured_by_the_far_side():
    volume = cube(2.0, 200)
    inside = map_res_for(volume, spot(from_=(0, 0.5, 0), cone=45), CAMERA)
    far = math.sqrt(1 + 1 + 1.5**2)
    assert inside == pytest.approx(2 * 1.01 * (far / 2) / 0.005, abs=48)


def test_empty_space_does_not_count():
    density = np.zeros((64, 64, 64), np.float32)
    density[:4, :4, :4] = 1
    volume = tfm.Volume(density, voxel_size=1 / 32)
    light = spot(from_=(0, 1, 0), to=(0, 0, 0), cone=40)
    full = tfm.Volume(np.ones_like(density), voxel_size=1 / 32)
    assert map_res_for(volume, light, CAMERA) < map_res_for(full, light, CAMERA)


@pytest.mark.parametrize(
    ("volume", "light", "expected"),
    [
        (cube(2.0, 1), spot(), TEXELS[0]),
        (cube(2.0, 40), spot(cone=1e-300), TEXELS[0]),
        (
            tfm.Volume(np.ones((1, 1, 3000)), origin=(-1500, 0, 0)),
            spot(from_=(0, 4000, 0), cone=30),
            TEXELS[1],
        ),
    ],
)
def test_limits_of_texels(volume, light, expected):
    res = map_res_for(volume, light, CAMERA)
    assert res == expected
    assert type(res) is int


# ------------------------------------------------------------------------------------------ steps


def test_steps_of_the_diagonal():
    # From border to border 51 voxels along each axis.
    assert steps_for(cube(2.0, 50)) == math.ceil(51 * math.sqrt(3) / 1.5)
    assert steps_for(cube(2000.0, 50)) == steps_for(cube(2.0, 50))


def test_the_smallest_edge_counts():
    shape = (30, 40, 50)
    flat = tfm.Volume(np.ones(shape), voxel_size=(4.0, 2.0, 1.0))
    diagonal = math.hypot(4 * 51, 2 * 41, 1 * 31)
    assert steps_for(flat) == math.ceil(diagonal / 1.5)


def test_turning_changes_nothing_and_shear_takes_the_longest_diagonal():
    shape = (30, 40, 50)
    turned_matrix = turned(33, (1, 2, 3), (1.0, 1.0, 1.0))
    assert steps_for(tfm.Volume(np.ones(shape), world_from_index=turned_matrix)) == steps_for(
        tfm.Volume(np.ones(shape))
    )
    for sign in (1, -1):
        sheared = np.eye(4)
        sheared[0, 1] = sign
        assert steps_for(tfm.Volume(np.ones(shape), world_from_index=sheared)) == math.ceil(
            math.hypot(51 + 41, 41, 31) / 1.5
        )


@pytest.mark.parametrize("cells", [(1.0, 1.0, 1.0), (1.0, 1.0, 2.0)])
def test_steps_and_texels_follow_the_optical_depth_of_a_voxel(cells):
    volume = tfm.Volume(np.ones((30, 30, 30)), voxel_size=cells)
    light = spot(from_=(15, 90, 30), to=(15, 15, 30))
    camera = CAMERA.replace(from_=(15, 15, 400), res=(4000, 4000))
    thin, thick, thicker = (resolved(volume, light, camera, sigma_t=sigma) for sigma in (1e-6, 1.0, 2.0))
    ratio = 1.5 / DEPTH_PER_STEP
    assert thick.march.steps == pytest.approx(ratio * thin.march.steps, abs=ratio)
    assert thicker.march.steps == pytest.approx(min(2 * ratio * thin.march.steps, STEPS[1]), abs=2 * ratio)
    assert thicker.map.res == pytest.approx(2**TEXEL_POWER * thick.map.res, abs=64)
    assert thin.map.res < thick.map.res < thicker.map.res
    assert thin.map.steps < thick.map.steps < thicker.map.steps < thicker.march.steps


def test_the_depth_of_a_voxel_is_that_of_the_body():
    density = np.zeros((20, 20, 20))
    density[5:15, 5:15, 5:15] = 3.0
    density[:, :, 0] = 1e-3  # a veil over a part as large counts for nothing
    volume = tfm.Volume(density, voxel_size=(2.0, 1.0, 4.0), density_scale=0.5)
    assert voxel_depth([Marched(volume, 2.0)]) == pytest.approx(3.0 * 0.5 * 1.0 * 2.0, rel=1e-3)
    sparse = tfm.Volume(
        Leaves.from_dense(density.astype(np.float32)), voxel_size=(2.0, 1.0, 4.0), density_scale=0.5
    )
    assert voxel_depth([Marched(sparse, 2.0)]) == pytest.approx(voxel_depth([Marched(volume, 2.0)]))
    assert voxel_depth([Marched(tfm.Volume(np.zeros((3, 3, 3))), 1.0)]) == 0


def test_auto_tells_where_it_stops(renderer):
    thick = tfm.Volume(np.ones((6, 6, 6)), voxel_size=0.3, origin=(-0.9,) * 3, density_scale=2000.0)
    camera = tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), res=(4, 4))
    scene = auto(tfm.Scene(thick, camera=camera, lights=[spot()]))
    found = [warning for warning in renderer.render(scene, method="dual").warnings if "auto" in warning]
    assert len(found) == 2
    assert found[0].startswith('map.res = "auto": 2048 is its upper limit, ')
    assert found[1].startswith('march.steps = "auto": 1024 is its upper limit, ')
    thin = auto(tfm.Scene(thick.with_density_scale(1.0), camera=camera, lights=[spot()]))
    assert not renderer.render(thin, method="dual").warnings


def test_limits_of_steps():
    assert steps_for(cube(1.0, 2)) == STEPS[0]
    assert steps_for(tfm.Volume(np.ones((1, 1, 2000)))) == STEPS[1]


# --------------------------------------------------------------------------------------- resolving


def test_numbers_are_left_alone():
    scene = make_scene()
    assert resolution.resolved(scene) is scene


def test_resolved_has_numbers_only():
    scene = auto(make_scene())
    numbers = resolution.resolved(scene)
    assert all(type(n) is int for n in (numbers.map.res, numbers.map.steps, numbers.march.steps))
    assert resolution.resolved(numbers) is numbers
    assert (numbers.bodies, numbers.camera, numbers.lights) == (scene.bodies, scene.camera, scene.lights)
    assert scene.map.res == "auto"


def test_each_is_resolved_by_itself():
    every = resolution.resolved(auto(make_scene()))
    scene = resolution.resolved(
        make_scene(
            map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=33, steps="auto"),
            march=tfm.MarchSettings(steps=7),
        )
    )
    assert (scene.map.res, scene.march.steps) == (33, 7)
    assert scene.map.steps == every.map.steps


def test_the_most_demanding_light_decides():
    scene = auto(make_scene())
    narrow, within = (light.replace(cone=2.0) for light in scene.lights), tfm.PointLight(from_=(0, 0, 0))
    narrow = tuple(narrow)
    alone = [resolution.resolved(scene.replace(lights=lights)).map.res for lights in (narrow, (within,))]
    assert alone[0] < alone[1]
    for lights in ((*narrow, within), (within, *narrow)):
        assert resolution.resolved(scene.replace(lights=lights)).map.res == alone[1]


def test_maps_of_an_auto_scene_serve_it(renderer):
    scene = auto(make_scene(volume=cube(3.0, 60)))
    scene = scene.replace(camera=scene.camera.replace(res=(8, 6)))
    maps = renderer.build_maps(scene)
    assert maps[0].coefficients.shape[0] == resolution.resolved(scene).map.res
    own, given = renderer.render(scene), renderer.render(scene, maps=maps)
    np.testing.assert_array_equal(own.image, given.image)
    np.testing.assert_array_equal(own.image, renderer.render(resolution.resolved(scene)).image)
    # For a larger image a map would be made finer; the one there serves all the same.
    other = scene.replace(camera=scene.camera.replace(res=(96, 72)))
    assert resolution.resolved(other).map.res != resolution.resolved(scene).map.res
    numbers = other.replace(map=resolution.resolved(scene).map)
    np.testing.assert_array_equal(renderer.render(other, maps=maps).image, renderer.render(numbers).image)
    with pytest.raises(SceneError, match="map settings"):
        renderer.render(scene.replace(map=scene.map.replace(coeffs=5)), maps=maps)


def test_the_dual_march_takes_auto(renderer):
    scene = auto(make_scene())
    image = renderer.render(scene, method="dual").image
    np.testing.assert_array_equal(image, renderer.render(resolution.resolved(scene), method="dual").image)


def test_the_reference_takes_auto():
    scene = auto(make_scene())
    scene = scene.replace(
        camera=scene.camera.replace(res=(4, 3)), map=scene.map.replace(density_weighting="auto")
    )
    for method in ("tfm", "dual"):
        np.testing.assert_array_equal(
            reference.render(scene, method), reference.render(resolution.resolved(scene), method)
        )
    assert reference.density_weighting(scene) == reference.density_weighting(resolution.resolved(scene))
    light, points = scene.lights[0], np.zeros((1, 3))
    np.testing.assert_array_equal(
        reference.light_optical_depth(scene, light, points),
        reference.light_optical_depth(resolution.resolved(scene), light, points),
    )
    assert reference.build_map(scene, light).shape[0] == resolution.resolved(scene).map.res


# --------------------------------------------------------------------------------- the error added


@pytest.mark.parametrize("size", [(64, 48), pytest.param((320, 240), marks=pytest.mark.slow)])
def test_auto_is_as_good_as_converged(renderer, size):
    volume = tfm.Volume(blobs((56, 48, 64)), voxel_size=1 / 32, density_scale=8.0)
    scene = tfm.Scene(volume)
    scene = scene.replace(
        camera=scene.camera.replace(res=size),
        map=tfm.MapSettings(basis="dct", coeffs=8, density_weighting=4.0),
    )
    chosen = auto(scene)
    fine = scene.replace(map=scene.map.replace(res=1024, steps=800), march=tfm.MarchSettings(steps=800))
    truth = renderer.render(fine).image
    error = compare(renderer.render(chosen).image, truth).lit.rmse
    assert error < ADDED_ERROR
    # Sizes a quarter of those chosen are seen: the bound can be missed.
    numbers = resolution.resolved(chosen)
    coarse = numbers.replace(
        map=numbers.map.replace(res=numbers.map.res // 4, steps=numbers.map.steps // 4),
        march=tfm.MarchSettings(steps=numbers.march.steps // 4),
    )
    assert compare(renderer.render(coarse).image, truth).lit.rmse > ADDED_ERROR
