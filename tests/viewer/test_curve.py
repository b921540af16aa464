"""T(z) along the light ray to what a pixel shows, against closed forms; with maps in the slow step."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import InputError
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.settings import ImageSettings
from tfm_cl.viewer.curve import POINTS, curve_at
from tfm_cl.viewer.pictures import seen_depth

MARCHED = 2e-5
"""Of T: the midpoint rule with four steps for each voxel, whose density is cubic along a slanted ray at most;
and kinks between voxels within a step."""
FLOAT32_DEPTH = 1e-6
"""Relative, of a place that is known by a distance in float32."""
OF_MAP = 0.02
"""Of T: 8 coefficients of small maps of small volumes."""


class WithoutMaps:
    """Answers for a renderer whose maps hold nothing; solids are traced."""

    def __init__(self, scene):
        self.scene, self.asked = scene, []

    def maps_of(self, scene, light, part=0):
        assert scene is self.scene
        self.asked.append((light, part))
        return [SimpleNamespace(evaluate=lambda points, _: np.ones_like(points))] * bool(scene.marched)

    def tracer(self, scene):
        return Tracer(scene.solids) if scene.solids else None


def frame_of(scene, **image):
    return SimpleNamespace(scene=scene, file=SimpleNamespace(image=ImageSettings(**image)))


def scene_of(*bodies, lights, res=(40, 30), **settings):
    return tfm.Scene(
        bodies,
        camera=tfm.Camera(from_=(0, 0, 8), to=(0, 0, 0), fov=40, res=res),
        lights=lights,
        medium=tfm.Medium(sigma_s=(1.0, 0.5, 0.25), sigma_a=0.1),
        **settings,
    )


def picked(scene, distance=8.0, place=(0.5, 0.5), light=0):
    """What is told of the pixel in the middle, at a distance; by default that of the scene's middle."""
    width, height = scene.camera.res
    depth = np.full((height, width), distance, np.float32)
    return curve_at(WithoutMaps(scene), frame_of(scene), depth, *place, light)


SUN = tfm.SunLight(from_=(0, 1, 0), to=(0, 0, 0))
BOX = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=0.7)


def test_one_voxel():
    """Along its axis the density is a tent: its integral is a parabola."""
    voxel = tfm.Volume(np.full((1, 1, 1), 2.0, np.float32), voxel_size=0.5, density_scale=3)
    scene = scene_of(voxel, lights=[SUN.replace(from_=(0.02, 1, 0.01))], res=(41, 31))
    middle = voxel.world_from_index[:3, 3]
    scene = scene.replace(camera=scene.camera.replace(from_=np.add(middle, (0, 0, 8)), to=middle))
    found = picked(scene)
    np.testing.assert_allclose(found.point, middle, atol=8 * FLOAT32_DEPTH)
    direction = np.array([-0.02, -1, -0.01]) / np.linalg.norm([0.02, 1, 0.01])
    # The other tents, across it, are never far from 1: their product is integrated with many steps.
    edges = np.linspace(found.z[0], found.z[-1], 200_001)
    at = ((edges[1:] + edges[:-1]) / 2 - found.z_point)[:, None] * direction
    density = 6 * np.prod(np.maximum(1 - np.abs(at) / 0.5, 0), axis=-1)
    depth = np.interp(found.z, edges, np.concatenate([[0], np.cumsum(density * np.diff(edges))]))
    expected = np.exp(-depth[:, None] * scene.medium.sigma_t)
    np.testing.assert_allclose(found.marched, expected, atol=MARCHED)
    total = 6 * 0.5  # of a tent
    assert found.marched[-1, 2] == pytest.approx(np.exp(-total * scene.medium.sigma_t[2]), rel=0.02)
    assert len(found.z) == POINTS
    assert (np.diff(found.z) >= 0).all()


@pytest.mark.parametrize(
    ("light", "z_point"),
    [
        (tfm.PointLight(from_=(0, 4, 0)), 4),
        (tfm.PointLight(from_=(3, 0, 0), intensity=0), 3),
        (tfm.PointLight(from_=(0, -0.5, 0)), 0.5),
        (tfm.SpotLight(from_=(0, 0, -5), to=(0, 0, 0), cone=20), 5),
        (tfm.SpotLight(from_=(0, 6, 0), to=(0, 0, 0), reach=6.2, falloff="inverse-square"), 6),
    ],
)
def test_constant_density(light, z_point):
    scene = scene_of(BOX, lights=[light])
    found = picked(scene.replace(camera=scene.camera.replace(res=(1, 1))))
    assert found.z_point == pytest.approx(z_point, rel=FLOAT32_DEPTH)
    begin = max(z_point - 1, 0)
    way = np.clip(found.z - begin, 0, z_point + 1 - begin)
    expected = np.exp(-0.7 * way[:, None] * scene.medium.sigma_t)
    for curve in (found.marched, found.of_map):  # no map is needed
        np.testing.assert_allclose(curve, expected, atol=2e3 * ROUNDED + FLOAT32_DEPTH)
    assert found.z[0] <= begin + 0.01  # no ray begins in a lamp
    assert found.z[-1] >= min(z_point + 1, 6.2)


def test_of_a_medium_everywhere_there_is_an_end():
    fog = tfm.EverywhereVolume(density=0.1)
    lamp = tfm.PointLight(from_=(0, 3, 0))
    scene = scene_of(fog, lights=[lamp], res=(1, 1))
    found = picked(scene)
    assert 0 < found.z[0] < 0.01
    assert 6 <= found.z[-1] < 7
    expected = np.exp(-0.1 * found.z[:, None] * scene.medium.sigma_t)
    np.testing.assert_allclose(found.marched, expected, atol=FLOAT32_DEPTH)


def test_a_sun_s_distances_begin_before_everything():
    scene = scene_of(BOX, tfm.Volume(blobs(), voxel_size=0.05), lights=[SUN], res=(1, 1))
    found = picked(scene)
    top = found.z_point - 1
    assert 0 < top < 0.1
    before = found.z < top
    assert before.any()
    assert (found.marched[before] == 1).all()


def test_grey_media_have_one_curve():
    scene = scene_of(BOX, lights=[SUN], res=(1, 1))
    coloured, grey = (
        picked(of).to_dict() for of in (scene, scene.replace(medium=tfm.Medium(sigma_s=0.5, sigma_a=0.1)))
    )
    assert (len(coloured["map"]), len(coloured["marched"])) == (3, 3)
    assert (len(grey["map"]), len(grey["marched"])) == (1, 1)
    assert json.loads(json.dumps(grey, allow_nan=False)) == grey
    assert grey["type"] == "curve"
    assert len(grey["z"]) == len(grey["marched"][0]) == POINTS


def test_of_several_parts_the_one_that_brings_most():
    wide = tfm.SpotLight(from_=(0, 5, 0), to=(0, 0, 0), radius=2, samples=5, falloff="inverse-square")
    scene = scene_of(BOX, lights=[SUN, wide], res=(1, 1))
    renderer = WithoutMaps(scene)
    found = curve_at(renderer, frame_of(scene), np.full((1, 1), 8, np.float32), 0.5, 0.5, 1)
    away = [np.linalg.norm(part.from_) for part in wide.parts()]
    assert renderer.asked == [(1, int(np.argmin(away)))]
    assert found.z_point == pytest.approx(min(away), rel=FLOAT32_DEPTH)
    assert found.lines[0].startswith(f"light 2 (spot), part {np.argmin(away) + 1} of 5")


def test_solids_end_both_curves():
    plate = tfm.BoxSolid(from_=(-1, 1.5, -1), to=(1, 1.6, 1))
    floor = tfm.PlaneSolid(point=(0, -2, 0), normal=(0, 1, 0))
    lamp = tfm.PointLight(from_=(0, 4, 0))
    scene = scene_of(BOX, lights=[lamp], solids=[plate], res=(1, 1))
    found = picked(scene)
    ends = found.z[found.marched.any(axis=-1)]
    assert ends[-1] == pytest.approx(2.4, abs=0.02)
    np.testing.assert_array_equal(found.of_map > 0, found.marched > 0)
    assert "a solid ends the light at z = 2.4" in found.lines
    # The surface that a pixel shows is lit, and is in the curve.
    scene = scene.replace(solids=[floor], camera=tfm.Camera(from_=(0, 0, 8), to=(0, -2, 0), res=(1, 1)))
    found = picked(scene, np.hypot(8, 2))
    there = int(np.flatnonzero(found.z == found.z_point)[0])
    np.testing.assert_allclose(found.point, (0, -2, 0), atol=1e-5)
    np.testing.assert_allclose(found.marched[there], np.exp(-1.4 * scene.medium.sigma_t), rtol=1e-4)
    assert not found.marched[-1].any()
    # One stands where a sun comes from.
    scene = scene.replace(lights=[SUN], solids=[plate.replace(from_=(-9, 50, -9), to=(9, 51, 9))])
    found = picked(scene, np.hypot(8, 2))
    assert not found.marched.any()
    assert found.lines[-1] == "a solid keeps all light off"
    # Or is what the pixel shows, before all media.
    scene = scene.replace(camera=tfm.Camera(from_=(0, 60, 8), to=(0, 51, 0), res=(1, 1)))
    found = picked(scene, np.hypot(9, 8))
    there = int(np.flatnonzero(found.z == found.z_point)[0])
    assert found.marched[there].tolist() == [1, 1, 1]
    assert not found.marched[-1].any()


def test_the_point_is_what_the_pixel_shows():
    scene = scene_of(BOX, lights=[SUN], res=(40, 30))
    width, height = 20, 10
    depth = np.zeros((height, width), np.float32)
    depth[2, 15] = 7.5
    found = curve_at(WithoutMaps(scene), frame_of(scene), depth, 15.9 / width, 2.1 / height, 0)
    (origin,), (direction,) = scene.camera.rays_through(np.array([31.0]), np.array([7.5]))
    np.testing.assert_allclose(found.point, origin + 7.5 * direction, rtol=FLOAT32_DEPTH)
    # Of a crop they are the frame's pixels.
    cropped = frame_of(scene, crop=(5, 10, 25, 20))
    found = curve_at(WithoutMaps(scene), cropped, depth, 15.9 / width, 2.1 / height, 0)
    (origin,), (direction,) = scene.camera.rays_through(np.array([20.5]), np.array([12.5]))
    np.testing.assert_allclose(found.point, origin + 7.5 * direction, rtol=FLOAT32_DEPTH)


def test_where_there_is_no_curve_a_line_says_why():
    lamp = tfm.SpotLight(from_=(0, 6, 0), to=(0, 9, 0))
    scene = scene_of(BOX, lights=[lamp, SUN], res=(1, 1))
    for distance in (0, np.inf):
        nothing = picked(scene, distance).to_dict()
        assert nothing["point"] is nothing["z_point"] is None
        assert nothing["lines"] == ["nothing is seen there: the camera's ray meets no medium and no solid"]
    unlit = picked(scene).to_dict()
    assert unlit["point"] == pytest.approx((0, 0, 0), abs=1e-5)
    assert unlit["z"] == unlit["map"] == unlit["marched"] == []
    assert unlit["lines"] == ["light 1 (spot) does not reach this point: it is outside its cone or reach"]
    with pytest.raises(InputError, match="light 2: the scene has 2"):
        picked(scene, light=2)
    for place in ((1.5, 0.5), (0.5, -0.1), (np.nan, 0.5)):
        with pytest.raises(InputError, match="a place in the picture is from 0 to 1"):
            picked(scene, place=place)


LIGHTS = {
    "spot with a radius": tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, radius=0.4, samples=3),
    "sun": tfm.SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0)),
    "point within": tfm.PointLight(from_=(0.2, 0.3, 0.2)),
    "environment": tfm.EnvironmentLight(samples=4),
}


@pytest.mark.slow
def test_the_picture_s_map_follows_the_march(renderer, small_scene):
    result = renderer.render(small_scene)
    made = renderer._cache.made.copy()
    found = curve_at(renderer, frame_of(small_scene), seen_depth(result.aovs), 0.5, 0.5, 0)
    assert renderer._cache.made == made
    assert np.abs(found.of_map - found.marched).max() < OF_MAP
    assert found.marched.min() < 0.1
    (light_map,) = renderer.build_maps(small_scene)
    expected = light_map.evaluate(found.point, small_scene.medium.sigma_t)
    np.testing.assert_allclose(found.of_map[found.z == found.z_point], [expected], atol=FLOAT32_DEPTH)


@pytest.mark.slow
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_maps_of_all_kinds_of_lights(renderer, light):
    scene = make_scene(lights=[light], map=tfm.MapSettings(res=48, steps=48), solids=[tfm.GroundSolid()])
    found = curve_at(renderer, frame_of(scene), np.full((1, 1), 4.2, np.float32), 0.5, 0.5, 0)
    assert np.abs(found.of_map - found.marched).max() < OF_MAP
    assert found.marched.min() < 0.5
    assert np.ptp(found.marched, axis=-1).max() > 0.05


@pytest.mark.slow
def test_maps_of_several_fields(renderer, small_scene):
    red = tfm.Medium(sigma_s=(0.3, 1.0, 1.0))
    bodies = [small_scene.volume, small_scene.volume.with_medium(red)]
    scene = small_scene.replace(volume=bodies, map=tfm.MapSettings(res=48, steps=48))
    found = curve_at(renderer, frame_of(scene), np.full((1, 1), 4.2, np.float32), 0.5, 0.5, 0)
    assert np.abs(found.of_map - found.marched).max() < OF_MAP
    assert found.marched.min() < 0.1


@pytest.mark.slow
def test_maps_are_those_of_the_light_s_parts(renderer, small_scene):
    spot = small_scene.lights[0]
    scene = small_scene.replace(lights=[spot, spot.replace(radius=0.4, samples=3)])
    maps = renderer.build_maps(scene)
    for number, light, part in ((0, 0, 0), (1, 1, 0), (3, 1, 2)):
        (found,) = renderer.maps_of(scene, light, part)
        assert found.light.map_key() == maps[number].light.map_key()
        np.testing.assert_array_equal(found.coefficients, maps[number].coefficients)
    with pytest.raises(tfm.InputError, match=r"light 1, part 3: the scene's lights have \[1, 3\] parts"):
        renderer.maps_of(scene, 1, 3)
