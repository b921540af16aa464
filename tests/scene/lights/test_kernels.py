"""The lights' kernel headers against their float64 methods, with one lane and with the device's."""

from pathlib import Path

import numpy as np
import pytest
from kernel_calls import Calls
from scenes import make_scene
from tolerances import DEVICE_FUNCTION, FLOAT32, GRAZING

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.structs.light import light_structs
from tfm_cl.maps.probe import light_defines
from tfm_cl.scene.emission_lights import EmissionLight
from tfm_cl.scene.lights import LIGHTS, PointLight, SunLight
from tfm_cl.scene.lights.charts import Hemisphere, Octahedron, Perspective
from tfm_cl.scene.lights.texels import look_up

pytestmark = pytest.mark.lanes

KERNELS = str(Path(__file__).with_name("light_functions.cl"))
COUNT = 5003
"""Not a multiple of any number of lanes."""

PLACE = 10 * FLOAT32
"""World coordinates, relative to the largest: two transforms of three products and a sum each."""
POSITION = 10 * PLACE
"""u, v for scenes whose coordinates are up to ten times the map's width there."""
EDGE = 1e-4
"""Strength near a soft edge, whose slope is up to 1.5 / (blend · cone) ≈ 20, times the angle's rounding."""

SCENE = make_scene()
CENTRE = SCENE.volume.bounds.mean(axis=0)
SIZE = float(np.linalg.norm(np.diff(SCENE.volume.bounds, axis=0)))


def many_lights():
    """Lights of every kind that has a map, at places that do not matter."""
    rng = np.random.default_rng(11)
    lights = {}
    for n in range(3):
        at, to = CENTRE + rng.normal(size=3) * SIZE, CENTRE + rng.uniform(-0.2, 0.2, 3) * SIZE
        falloff = ("none", "inverse-square")[n % 2]
        spot = {"cone": rng.uniform(10, 60), "blend": (0, 0.3, 1)[n], "falloff": falloff}
        lights[f"spot {n}"] = tfm.SpotLight(from_=at, to=to, **spot)
        lights[f"point {n}"] = PointLight(from_=at if n else to, falloff=falloff)
        lights[f"sun {n}"] = SunLight(from_=at, to=to).fitted(SCENE.volume.bounds)
    bounds = SCENE.volume.occupied_bounds
    lights |= {f"{name}, fitted": light.fitted(bounds) for name, light in lights.items()}
    lights["spot all but flat"] = tfm.SpotLight(from_=CENTRE, to=CENTRE + SIZE, cone=89.9, blend=0.1)
    lights["sun straight down"] = SunLight(from_=(0, 1, 0), to=(0, 0, 0)).fitted(SCENE.volume.bounds)
    lights["ball"] = EmissionLight(from_=CENTRE, core_radius=SIZE)
    return lights


LIGHTS_IN_TEST = many_lights()
every_light = pytest.mark.parametrize("light", LIGHTS_IN_TEST.values(), ids=LIGHTS_IN_TEST)
NEAREST = 1e-6 * SIZE


def test_no_kind_is_forgotten():
    assert {light.HEADER for light in LIGHTS_IN_TEST.values()} == {kind.HEADER for kind in LIGHTS.values()}
    charts = {light.headers[0] for light in LIGHTS_IN_TEST.values() if light.type != "sun"}
    assert charts == {chart.HEADER for chart in (Perspective, Hemisphere, Octahedron)}


def device(launcher, light):
    """``light_functions.cl`` for one light."""
    structs = light_structs(SCENE.replace(lights=(light,)), [light])
    return Calls(launcher, KERNELS, light.headers, light_defines(light), {"light": structs})


def points_for(light, rng):
    """Points around the volume and, as float32 holds them, in the device's frame."""
    local = (rng.normal(size=(COUNT, 3)) * SIZE).astype(np.float32).astype(np.float64)
    if light.type == "spot":  # most of them inside
        origins, directions = light.rays(rng.uniform(0.15, 0.85, (COUNT, 2)))
        points = origins + rng.uniform(0.1, 3, (COUNT, 1)) * SIZE * directions
        local[: COUNT // 2] = (points - CENTRE).astype(np.float32)[: COUNT // 2]
    return local + CENTRE, local


@every_light
def test_texel_rays(launcher, rng, light):
    positions = rng.uniform(0, 1, (COUNT, 2)).astype(np.float32).astype(np.float64)
    positions[:4] = (0, 0), (0, 1), (1, 0), (1, 1)
    positions[4:8] = (0, 0.3), (1, 0.3), (0.6, 0), (0.5, 0.5)

    found = device(launcher, light)("call_texel_ray", positions, 6)

    origins, directions = light.rays(positions)
    assert np.abs(found[:, :3] - (origins - CENTRE)).max() < PLACE * 4 * SIZE
    assert np.abs(found[:, 3:] - directions).max() < DEVICE_FUNCTION
    assert np.allclose(np.linalg.norm(found[:, 3:], axis=1), 1, atol=DEVICE_FUNCTION)


@every_light
def test_arrival(launcher, rng, light):
    points, local = points_for(light, rng)

    found = device(launcher, light)("call_light", local, 15)

    arrival, reached = light.arrival(points, NEAREST), light.reaches(points)
    assert np.count_nonzero(reached) > COUNT // 4
    assert np.abs(found[:, :3] - arrival.direction)[reached].max() < 3 * DEVICE_FUNCTION
    assert np.abs(found[:, 3] - arrival.distance)[reached].max() < PLACE * 8 * SIZE
    in_map = ((arrival.position > -0.5) & (arrival.position < 1.5)).all(axis=1)
    assert np.count_nonzero(in_map & reached) > COUNT // 8
    assert np.abs(found[:, 4:6] - arrival.position)[reached & in_map].max() < POSITION
    beyond = ((found[:, 4:6] < 0) | (found[:, 4:6] > 1)).any(axis=1)
    assert beyond[reached & ~in_map].all()
    error = np.abs(found[:, 6] - arrival.strength) / np.maximum(arrival.strength, 1e-30)
    soft = getattr(light, "blend", 0) > 0
    falls = arrival.strength / light.falloff_at(arrival.distance, NEAREST)
    assert (error * (falls if soft else 1))[reached].max() < (EDGE if soft else 3 * DEVICE_FUNCTION)


@every_light
def test_reach_and_depth(launcher, rng, light):
    points, local = points_for(light, rng)

    found = device(launcher, light)("call_light", local, 15)

    depth = light.projective_depth(points)
    assert np.abs(found[:, 8] - depth).max() < PLACE * 8 * SIZE
    # Where two points on either side of one are both reached, or neither, rounding does not decide.
    moved = [light.reaches(points + GRAZING * SIZE * offset) for offset in (*np.eye(3), *-np.eye(3))]
    clear = np.all(moved, axis=0) | ~np.any(moved, axis=0)
    assert clear.mean() > 0.9
    assert ((found[:, 7] == 1) == light.reaches(points))[clear].all()


@every_light
def test_ray_to_a_point(launcher, rng, light):
    points, local = points_for(light, rng)

    found = device(launcher, light)("call_light", local, 15)

    origin, direction = found[:, 9:12], found[:, 12:]
    assert np.abs(origin - (light.begins(points) - CENTRE)).max() < PLACE * 8 * SIZE
    assert np.abs(origin + direction - local).max() < PLACE * 8 * SIZE  # parameter 1 is the point
    distance = light.arrival(points).distance
    along = np.where(distance > 0, distance, np.nan)[:, None] * light.arrival(points).direction
    assert np.nanmax(np.abs(direction - along)) < PLACE * 8 * SIZE


@every_light
def test_clip(launcher, rng, light):
    points, local = points_for(light, rng)
    directions = rng.normal(size=(COUNT, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    interval = np.tile([0.25 * SIZE, 2 * SIZE], (COUNT, 1))
    interval[:9] = 3.0  # nothing to begin with
    rays = np.column_stack([local, directions, interval])

    found = device(launcher, light)("call_clip", rays, 3)

    begin, end = light.interval(points, directions.astype(np.float32).astype(np.float64))
    begin, end = np.maximum(begin, interval[:, 0]), np.minimum(end, interval[:, 1])
    clear = np.abs(end - begin) > 10 * GRAZING * SIZE
    clear[:9] = True
    assert ((found[:, 2] == 1) == (begin < end))[clear].all()
    both = (found[:, 2] == 1) & (begin < end)
    assert np.count_nonzero(both) > COUNT // 20
    error = np.abs(found[:, :2] - np.column_stack([begin, end]))[both].max(axis=1)
    assert np.quantile(error, 0.98) < GRAZING * SIZE  # the others graze the side
    if light.type != "spot":
        assert (found[9:, :2] == interval[9:].astype(np.float32)).all()


@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
def test_at_the_light_itself_all_is_finite(launcher, falloff):
    for light in (
        tfm.SpotLight(from_=CENTRE, to=CENTRE + 1, falloff=falloff),
        PointLight(from_=CENTRE, falloff=falloff),
    ):
        found = device(launcher, light)("call_light", np.zeros((3, 3)), 15)
        assert np.isfinite(found).all()
        assert found[0, 6] == pytest.approx(1 if falloff == "none" else 1 / NEAREST**2)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (5, 12), (64, 33)], ids=str)
def test_texture(launcher, rng, shape):
    height, width = shape
    image = rng.uniform(0, 4, (height, width, 3)).astype(np.float32)
    positions = rng.uniform(-0.2, 1.2, (COUNT, 2))
    positions[:5] = (0, 0), (1, 1), (0, 1), (-1e30, 1e30), (np.nan, 0.5)
    uploaded = np.dstack([image, np.ones(shape, np.float32)])

    calls = device(launcher, LIGHTS_IN_TEST["sun 0"])
    found = calls("call_texture", positions, 3, texture=uploaded, width=width, height=height)

    expected = look_up(image, np.nan_to_num(positions.astype(np.float32).astype(np.float64), nan=0))
    # A place is rounded to some half ulps of the width; neighbours differ by up to 4.
    assert np.abs(found - expected).max() < 4 * 4 * FLOAT32 * max(shape) + DEVICE_FUNCTION * 4
    assert np.isfinite(found).all()


def test_texture_is_upright(launcher):
    image = np.zeros((2, 2, 3), np.float32)
    image[0, 0], image[0, 1], image[1, 0] = (
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
    )  # top left, top right, bottom left
    texture = np.dstack([image, np.ones((2, 2))]).astype(np.float32)
    calls = device(launcher, LIGHTS_IN_TEST["sun 0"])

    positions = np.array([[0, 1], [1, 1], [0, 0], [0.5, 0.5]])
    found = calls("call_texture", positions, 3, texture=texture, width=2, height=2)

    assert found.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.25, 0.25, 0.25]]


# ------------------------------------------------------------------------------------------- the cone


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def spot_rays(light, rng, count):
    """Rays of every kind: inside, outside, through the apex, along the side, along the axis."""
    matrix = light.frame().world_from_light
    apex, axis = matrix[:3, 3], matrix[:3, 2]
    origins = apex + rng.normal(size=(count, 3)) * 3
    directions = unit(rng.normal(size=(count, 3)))
    part = count // 8
    angle = rng.uniform(0, 2 * np.pi, part)
    tangent = np.tan(np.radians(light.cone))
    side = unit(
        np.cos(angle)[:, None] * tangent * matrix[:3, 0]
        + np.sin(angle)[:, None] * tangent * matrix[:3, 1]
        + axis
    )
    directions[:part] = unit(apex - origins[:part])
    directions[part : 2 * part] = side * rng.choice([-1, 1], part)[:, None]
    directions[2 * part : 3 * part] = axis * rng.choice([-1, 1], part)[:, None]
    origins[3 * part : 4 * part] = apex + axis * rng.uniform(0.1, 3, part)[:, None]
    origins[4 * part : 5 * part] = apex + side * rng.uniform(0.1, 3, part)[:, None]
    directions[5 * part : 6 * part] = unit(
        apex + axis * 2 + rng.normal(size=(part, 3)) - origins[5 * part : 6 * part] * 1.0
    )
    return origins, directions


def clipped(launcher, light, origins, directions):
    """Where the rays are in the light; 0, 0 where they miss it."""
    rays = np.column_stack(
        [origins - CENTRE, directions, np.zeros(len(origins)), np.full(len(origins), np.inf)]
    )
    found = device(launcher, light)("call_clip", rays, 3)
    return np.where(found[:, 2:] == 1, found[:, :2], 0)


@pytest.mark.parametrize("cone", [1.0, 24.0, 60.0, 89.0])
def test_clip_against_points_on_100_000_rays(launcher, rng, cone):
    light = tfm.SpotLight(from_=(0.4, 0.5, -0.3), to=(0, -0.2, 0.1), cone=cone)
    count = 100_000
    origins, directions = spot_rays(light, rng, count)

    intervals = clipped(launcher, light, origins, directions)

    # Brute force: points along every ray are inside the cone exactly when they are inside the interval.
    matrix = light.frame().world_from_light
    tangent = np.tan(np.radians(cone))
    wrong = 0
    for t in rng.uniform(0, 8, (64, count)):
        local = (origins + t[:, None] * directions - matrix[:3, 3]) @ matrix[:3, :3]
        radius, height = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
        # Angular distance to the side: rounding may decide there.
        clear = np.abs(np.arctan2(radius, height) - np.radians(cone)) > GRAZING
        clear &= np.linalg.norm(local, axis=1) > GRAZING
        inside = (height > 0) & (radius <= tangent * height)
        claimed = (t >= intervals[:, 0]) & (t <= intervals[:, 1])
        wrong += np.count_nonzero(clear & (inside != claimed))
    assert wrong == 0


def test_clip_agrees_with_the_reference(launcher, rng):
    light = tfm.SpotLight(from_=(0.4, 0.5, -0.3), to=(0, -0.2, 0.1), cone=24)
    origins, directions = spot_rays(light, rng, 20_000)

    intervals = clipped(launcher, light, origins, directions)

    begin, end = reference.cone_interval(light, origins, directions)
    bounded = np.minimum(end, 100), np.minimum(intervals[:, 1], 100)
    close = (np.abs(begin - intervals[:, 0]) < GRAZING * 5) & (
        np.abs(bounded[0] - bounded[1]) < GRAZING * 100
    )
    # Rays parallel to the side have an end that any rounding moves to infinity or back.
    assert np.count_nonzero(close) > 0.85 * 20_000


@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
@pytest.mark.parametrize("blend", [0.0, 0.3, 1.0])
def test_strength_of_a_spot_is_the_reference_s(launcher, rng, falloff, blend):
    light = tfm.SpotLight(
        from_=(2, 3, 1), to=(0, 0, 0), cone=24, falloff=falloff, blend=blend, intensity=(3, 2, 1)
    )
    matrix, tangent = light.frame().world_from_light, np.tan(np.radians(24))
    uv = rng.uniform(0.16, 0.84, (500, 2))  # inside the cone's circle
    z = rng.uniform(0.5, 5, (500, 1))
    points = np.column_stack([(2 * uv - 1) * tangent * z, z]) @ matrix[:3, :3].T + matrix[:3, 3]

    found = device(launcher, light)("call_light", points - CENTRE, 15)

    assert np.abs(found[:, 4:6] - uv).max() < 1e-5
    assert np.allclose(found[:, 3], np.linalg.norm(points - matrix[:3, 3], axis=1), rtol=1e-6)
    expected = reference.unshadowed(SCENE.grids[0], light, points)
    radiance = found[:, 6:7] * light_structs(SCENE, [light])["intensity"]
    assert np.allclose(radiance, expected, rtol=1e-4, atol=1e-5)


def test_texel_rays_point_where_light_at_looks_them_up(launcher, rng):
    light = SCENE.lights[0]
    calls, uv = device(launcher, light), rng.uniform(0, 1, (300, 2))

    directions = calls("call_texel_ray", uv, 6)[:, 3:]
    points = np.asarray(light.from_) + directions * 2.5

    assert np.abs(calls("call_light", points - CENTRE, 15)[:, 4:6] - uv).max() < 1e-5
