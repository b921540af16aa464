"""Which pixels a light may change: every one that it does, and few more."""

import math

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.render.culling import block_lists, bounds_of_lights, pixel_bounds
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight

BOX = np.array([[-1.5, -1.0, -2.0], [1.0, 2.0, 1.5]])
EVERYWHERE = np.array([[-np.inf] * 3, [np.inf] * 3])
RES = (40, 28)


def random_light(rng):
    at, towards = rng.normal(size=3) * 2.5, rng.normal(size=3)
    reach = None if rng.random() < 0.5 else rng.uniform(0.2, 4)
    if rng.random() < 0.3:
        return PointLight(from_=at, reach=reach)
    return SpotLight(from_=at, to=at + towards, cone=rng.choice([1, 8, 30, 70, 89]), reach=reach)


def random_camera(rng):
    at = rng.normal(size=3) * rng.choice([0.3, 3.0, 8.0])
    return tfm.Camera(from_=at, to=at + rng.normal(size=3), fov=rng.choice([20, 60, 120]), res=RES)


def box_interval(rays, bounds):
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = ((face - rays.origins) / rays.directions for face in bounds)
    return np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)


def touched(light, camera, bounds):
    """[height, width]: pixels whose ray meets, in the bounds, what the light reaches."""
    rays = reference.camera_rays(camera)
    begin, end = light.interval(*rays)
    if np.isfinite(bounds).all():
        first, last = box_interval(rays, bounds)
        begin, end = np.maximum(begin, first), np.minimum(end, last)
    return (end > np.maximum(begin, 0)).reshape(camera.res[::-1])


@pytest.mark.parametrize("bounds", [BOX, EVERYWHERE, BOX + 1e4], ids=["box", "everywhere", "far away"])
def test_every_pixel_that_a_light_changes_is_inside(rng, bounds):
    shown = whole = 0
    offset = 1e4 if bounds[0, 0] > 1e3 else 0.0
    for _ in range(400):
        light, camera = random_light(rng), random_camera(rng)
        if offset:
            light = light.replace(
                from_=np.add(light.from_, offset),
                **({"to": np.add(light.to, offset)} if light.type == "spot" else {}),
            )
            camera = camera.replace(from_=np.add(camera.from_, offset), to=np.add(camera.to, offset))
        x0, y0, x1, y1 = pixel_bounds(light, camera, bounds)
        outside = touched(light, camera, bounds)
        shown += outside.any()
        whole += (x1 - x0) * (y1 - y0) == RES[0] * RES[1]
        outside[y0:y1, x0:x1] = False
        assert not outside.any(), (light, camera)
    assert shown > 60
    # "Everything" would pass the test above.
    assert whole < 300


def test_a_small_light_before_the_camera_touches_what_it_covers():
    camera = tfm.Camera(from_=(0, 0, 10), to=(0, 0, 0), fov=40, res=(400, 200))
    light = SpotLight(from_=(0, 1, 0), to=(0, 0, 0), cone=15, reach=0.5)

    x0, y0, x1, y1 = pixel_bounds(light, camera, EVERYWHERE)

    pixel = 2 * 10 * math.tan(math.radians(20)) / 200
    high, wide = 0.5 / pixel, 2 * 0.5 * math.tan(math.radians(15)) / pixel
    # The pyramid is 8 % wider than the cone and nearer to the camera; a pixel and a part on each side.
    assert high <= y1 - y0 <= 1.1 * high + 4
    assert wide <= x1 - x0 <= 1.15 * wide + 4


def test_what_lies_behind_the_camera_touches_nothing_and_around_it_everything():
    camera = tfm.Camera(from_=(0, 0, 10), to=(0, 0, 0), res=RES)
    nothing, everything = (0, 0, 0, 0), (0, 0, *RES)
    for at, to, reach, expected in (
        ((0, 0, 11), (0, 0, 12), None, nothing),
        ((0, 0, 13), (0, 0, 12), 1.0, nothing),
        ((0, 0, 12), (0, 0, 10), None, everything),
        ((0, 0, 10), (0, 0, 9), None, everything),
    ):
        light = SpotLight(from_=at, to=to, cone=40, reach=reach)
        assert pixel_bounds(light, camera, EVERYWHERE) == expected
    assert pixel_bounds(PointLight(from_=(0, 0, 12)), camera, EVERYWHERE) == everything
    sun = SunLight(from_=(0, 1, 0), to=(0, 0, 0))
    assert pixel_bounds(sun, camera, np.add(BOX, (0, 0, 20))) == nothing
    x0, _, x1, _ = pixel_bounds(sun, camera.replace(from_=(0, 0, 30)), BOX)
    assert 0 < x0 < x1 < RES[0]


def test_a_light_that_leaves_the_medium_alone_touches_nothing():
    camera = tfm.Camera(from_=(0, 0, 30), to=(0, 0, 0), res=RES)
    away = SpotLight(from_=(0, 3, 0), to=(0, 4, 0), cone=20)
    assert pixel_bounds(away, camera, BOX) == (0, 0, 0, 0)
    assert pixel_bounds(away, camera, EVERYWHERE) != (0, 0, 0, 0)


def test_many_lights_are_as_one_by_one(rng):
    camera = random_camera(rng)
    lights = [random_light(rng) for _ in range(50)] + [SunLight(from_=(0, 1, 0), to=(0, 0, 0))]
    together = bounds_of_lights(lights, camera, BOX)
    assert together.tolist() == [list(pixel_bounds(light, camera, BOX)) for light in lights]


@pytest.mark.parametrize("crop", [(0, 0, 100, 70), (17, 5, 83, 64), (33, 33, 34, 34)])
def test_blocks_list_the_lights_that_touch_them(rng, crop):
    low = rng.integers(-10, 90, (60, 2))
    rectangles = np.concatenate([low, low + rng.integers(0, 60, (60, 2))], axis=1)
    rectangles = np.clip(rectangles, 0, [100, 70, 100, 70])
    lists = block_lists(rectangles, crop, 16)

    column, row = lists.first
    assert (column, row) == (crop[0] // 16, crop[1] // 16)
    x0, y0, x1, y1 = crop
    for block in range(len(lists.starts) - 1):
        x, y = (column + block % lists.columns) * 16, (row + block // lists.columns) * 16
        cut = [max(x, x0), max(y, y0), min(x + 16, x1), min(y + 16, y1)]
        expected = [
            n
            for n, (a, b, c, d) in enumerate(rectangles)
            if max(a, cut[0]) < min(c, cut[2]) and max(b, cut[1]) < min(d, cut[3])
        ]
        assert lists.lights[lists.starts[block] : lists.starts[block + 1]].tolist() == expected
    assert len(lists.starts) - 1 == lists.columns * (-(-y1 // 16) - row)


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_reach_in_float64(rng, kind):
    cone = {"to": (1, 2, 3), "cone": 35} if kind == "spot" else {}
    light = {"spot": SpotLight, "point": PointLight}[kind](from_=(0.2, -0.1, 0.4), reach=1.7, **cone)
    endless = light.replace(reach=None)
    points = light.from_ + rng.normal(size=(5000, 3)) * 1.2
    distance = np.linalg.norm(points - light.from_, axis=1)

    assert (light.reaches(points) == (endless.reaches(points) & (distance < 1.7))).all()
    window = np.maximum(1 - (distance / 1.7) ** 4, 0) ** 2
    assert np.allclose(light.arrival(points).strength, window * endless.arrival(points).strength, rtol=1e-12)

    origins, directions = rng.normal(size=(2, 500, 3)) * 2
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    begin, end = light.interval(origins, directions)
    t = np.linspace(0, 12, 2001)
    for ray in range(len(origins)):
        inside = light.reaches(origins[ray] + t[:, None] * directions[ray])
        # Within half a step of the ends either may be.
        assert (inside == ((t >= begin[ray]) & (t <= end[ray])))[
            (np.abs(t - begin[ray]) > 1e-9) & (np.abs(t - end[ray]) > 1e-9)
        ].all()
