"""Map resolution and steps of "auto": what they follow, their limits, who resolves them, what they cost."""

import math

import numpy as np
import pytest
from scenes import blobs, make_scene, turned

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.metrics import compare
from tfm_cl.resolution import STEPS, TEXELS, map_res_for, steps_for

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
    volume, light = cube(2.0, 40), spot()
    # The cone at the centre over half of 1/20, in whole 32s; the border of a voxel moves the mean a little.
    assert map_res_for(volume, light, CAMERA) == 160
    assert light.footprint(10) / 0.025 == pytest.approx(141, abs=0.1)


@pytest.mark.parametrize(
    ("change", "factor"),
    [
        ({"volume": cube(2.0, 160)}, 4),
        ({"light": spot(from_=(0, 40, 0))}, 4),
        ({"light": spot(cone=math.degrees(math.atan(4 * math.tan(math.radians(10)))))}, 4),
    ],
    ids=["voxels", "distance", "cone"],
)
def test_texels_follow(change, factor):
    before = map_res_for(cube(2.0, 40), spot(), CAMERA)
    arguments = {"volume": cube(2.0, 40), "light": spot(), "camera": CAMERA} | change
    assert map_res_for(**arguments) == pytest.approx(factor * before, abs=32 * factor)


def test_a_small_image_needs_no_fine_map():
    volume, light = cube(2.0, 200), spot()
    fine = map_res_for(volume, light, CAMERA)
    assert map_res_for(volume, light, CAMERA.replace(res=(20000, 10000))) == fine
    small = [map_res_for(volume, light, CAMERA.replace(res=(2 * n, n))) for n in (512, 1024)]
    assert small[0] == pytest.approx(small[1] / 2, abs=32)
    assert small[1] < fine
    # Four texels a pixel where the cube is nearest: 99 away.
    pixel = 2 * math.tan(math.radians(15)) * 99 / 1024
    assert small[1] == pytest.approx(light.footprint(10) / (pixel / 4), abs=32)


def test_a_camera_inside_asks_for_what_the_voxels_hold():
    inside = CAMERA.replace(from_=(0, 0, 0.5), res=(20, 10))
    assert map_res_for(cube(2.0, 200), spot(), inside) == map_res_for(cube(2.0, 200), spot(), CAMERA)


def test_a_light_inside_is_measured_by_the_far_side():
    volume = cube(2.0, 200)
    inside = map_res_for(volume, spot(from_=(0, 0.5, 0), cone=45), CAMERA)
    far = math.sqrt(1 + 1 + 1.5**2)
    assert inside == pytest.approx(2 * (far / 2) / 0.005, abs=48)


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
        (cube(2.0, 40), spot(cone=89.999999), TEXELS[1]),
        (cube(2.0, 40), spot(from_=(0, 1e15, 0)), TEXELS[1]),
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


def test_limits_of_steps():
    assert steps_for(cube(1.0, 2)) == STEPS[0]
    assert steps_for(tfm.Volume(np.ones((1, 1, 2000)))) == STEPS[1]


# --------------------------------------------------------------------------------------- resolving


def test_numbers_are_left_alone():
    scene = make_scene()
    assert scene.resolved() is scene


def test_resolved_has_numbers_only():
    scene = auto(make_scene())
    numbers = scene.resolved()
    assert (numbers.map.res, numbers.map.steps, numbers.march.steps) == (
        map_res_for(scene.volume, scene.lights[0], scene.camera),
        steps_for(scene.volume),
        steps_for(scene.volume),
    )
    assert numbers.resolved() is numbers
    assert (numbers.volume, numbers.camera, numbers.lights) == (scene.volume, scene.camera, scene.lights)
    assert scene.map.res == "auto"


def test_each_is_resolved_by_itself():
    scene = make_scene(
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=33, steps="auto"),
        march=tfm.MarchSettings(steps=7),
    ).resolved()
    assert (scene.map.res, scene.march.steps) == (33, 7)
    assert scene.map.steps == steps_for(scene.volume)


def test_the_most_demanding_light_decides():
    scene = auto(make_scene())
    wide = scene.lights[0].replace(cone=70.0)
    for lights in ([wide, *scene.lights], [*scene.lights, wide]):
        assert scene.replace(lights=tuple(lights)).resolved().map.res == map_res_for(
            scene.volume, wide, scene.camera
        )


def test_maps_of_an_auto_scene_serve_it(renderer):
    scene = auto(make_scene(volume=cube(3.0, 60)))
    scene = scene.replace(camera=scene.camera.replace(res=(8, 6)))
    maps = renderer.build_maps(scene)
    assert maps[0].coefficients.shape[0] == scene.resolved().map.res
    own, given = renderer.render(scene), renderer.render(scene, maps=maps)
    np.testing.assert_array_equal(own.image, given.image)
    np.testing.assert_array_equal(own.image, renderer.render(scene.resolved()).image)
    # For a larger image a map would be made finer; the one there serves all the same.
    other = scene.replace(camera=scene.camera.replace(res=(96, 72)))
    assert other.resolved().map.res != scene.resolved().map.res
    numbers = other.replace(map=scene.resolved().map)
    np.testing.assert_array_equal(renderer.render(other, maps=maps).image, renderer.render(numbers).image)
    with pytest.raises(SceneError, match="map settings"):
        renderer.render(scene.replace(map=scene.map.replace(coeffs=5)), maps=maps)


def test_the_dual_march_takes_auto(renderer):
    scene = auto(make_scene())
    image = renderer.render(scene, method="dual").image
    np.testing.assert_array_equal(image, renderer.render(scene.resolved(), method="dual").image)


def test_the_reference_takes_auto():
    scene = auto(make_scene())
    scene = scene.replace(
        camera=scene.camera.replace(res=(4, 3)), map=scene.map.replace(density_weighting="auto")
    )
    for method in ("tfm", "dual"):
        np.testing.assert_array_equal(
            reference.render(scene, method), reference.render(scene.resolved(), method)
        )
    assert reference.density_weighting(scene) == reference.density_weighting(scene.resolved())
    light, points = scene.lights[0], np.zeros((1, 3))
    np.testing.assert_array_equal(
        reference.light_optical_depth(scene, light, points),
        reference.light_optical_depth(scene.resolved(), light, points),
    )
    assert reference.build_map(scene, light).shape[0] == scene.resolved().map.res


# --------------------------------------------------------------------------------- the error added


@pytest.mark.parametrize("size", [(64, 48), (320, 240)])
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
    numbers = chosen.resolved()
    coarse = numbers.replace(
        map=numbers.map.replace(res=numbers.map.res // 4, steps=numbers.map.steps // 4),
        march=tfm.MarchSettings(steps=numbers.march.steps // 4),
    )
    assert compare(renderer.render(coarse).image, truth).lit.rmse > ADDED_ERROR
