"""Bodies of constant density, and how rays are cut at grids: device functions against float64."""

import numpy as np
import pytest
from kernel_calls import Calls
from tolerances import DEVICE_FUNCTION, FAST_MATH, FLOAT32, GRAZING

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.media import media_on_device
from tfm_cl.reference.march import mean_distance

pytestmark = pytest.mark.lanes

COUNT = 4003
"""Not a multiple of any number of lanes."""
WARM, COLD = tfm.Medium(sigma_s=1.0), tfm.Medium(sigma_s=(0.2, 0.5, 1.1))
BOX = tfm.BoxVolume(from_=(-1.2, -0.9, -1.1), to=(1.0, 1.1, 1.3), density=0.5)
FLAT = tfm.BoxVolume(from_=(-2, 0.3, -2), to=(2, 0.301, 2), density=30, medium=COLD)
BALL = tfm.SphereVolume(centre=(0.3, 0.2, 0.1), radius=0.8, density=0.7, medium=COLD)
FOG = tfm.EverywhereVolume(density=0.1)
SCENES = {
    "box": [BOX],
    "ball": [BALL],
    "everywhere": [FOG],
    "box and ball": [BOX, BALL],
    "all kinds, two media": [FLAT, FOG, BALL, BOX],
}
PLACE = 20 * FLOAT32
"""Where a ray meets a body that is some units away and in size, in parts of its distance."""
FAR = 1e6
"""Stands for a ray without an end."""
every_scene = pytest.mark.parametrize("bodies", SCENES.values(), ids=SCENES)


class Bodies(Calls):
    """``body_functions.cl`` for some bodies."""

    def __init__(self, launcher, bodies):
        self.scene = tfm.Scene(bodies, WARM, tfm.Camera(from_=(0, 1, 6), to=(0, 0, 0)), [])
        media = media_on_device(launcher, self.scene, None)
        self.centre = world_from_device(self.scene)[:3, 3]
        super().__init__(
            launcher,
            "body_functions.cl",
            media.headers,
            media.defines | {"TFM_CHANNELS": 3},
            {"bodies": media.arguments["bodies"]},
        )


def rays(rng, centre):
    """World rays, as float32 has them around a centre; some along axes, some from inside, some long."""
    origins = rng.normal(size=(COUNT, 3)) * 2
    directions = 0.4 * rng.normal(size=(COUNT, 3)) - 0.5 * origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:300] = np.eye(3)[rng.integers(0, 3, 300)] * rng.choice([-1, 1], (300, 1))
    origins[300:600] *= 0.2
    directions[600:900] *= rng.uniform(0.01, 50, (300, 1))  # rays of light have no unit direction
    origins, directions = (a.astype(np.float32).astype(np.float64) for a in (origins, directions))
    return origins + centre, directions


def given(bodies, origins, directions, *columns):
    return np.column_stack([origins - bodies.centre, directions, *columns])


def intervals(body, origins, directions, begin, end):
    """Parameters between which rays are in a body, and whether they are at all."""
    length = np.linalg.norm(directions, axis=1)
    low, high = reference.body_interval(
        body, origins, directions / length[:, None], np.full(len(origins), np.inf)
    )
    low, high = np.maximum(low / length, begin), np.minimum(high / length, end)
    return low, high, low < high


@pytest.mark.parametrize("body", [BOX, FLAT, BALL, FOG], ids=["box", "flat box", "sphere", "everywhere"])
def test_body_clip(launcher, rng, body):
    bodies = Bodies(launcher, [body])
    origins, directions = rays(rng, bodies.centre)
    begin = np.where(rng.random(COUNT) < 0.5, 0, rng.uniform(0, 2, COUNT)).astype(np.float32)
    end = np.where(rng.random(COUNT) < 0.5, FAR, begin + rng.uniform(-0.5, 3, COUNT)).astype(np.float32)

    found = bodies("call_body_clip", given(bodies, origins, directions, begin, end), 2)

    low, high, meets = intervals(body, origins, directions, begin, end)
    scale = np.linalg.norm(directions, axis=1)
    # In the world: what grazes a sphere, or passes an edge, may miss by rounding.
    clear = np.abs(high - low) * scale > GRAZING
    assert (meets & clear).sum() > COUNT / 10
    assert ((found[:, 0] < found[:, 1]) == meets)[clear].all()
    error = np.abs(found - np.column_stack([low, high])).max(axis=1) * scale
    # A root of a small discriminant loses digits as the chord gets short.
    short = np.maximum(1, 1 / np.maximum((high - low) * scale, 1e-9))
    assert (error <= PLACE * (4 + np.minimum(high, 10) * scale) * short)[meets & clear].all()


@every_scene
def test_what_a_stretch_of_a_ray_meets(launcher, rng, bodies):
    calls = Bodies(launcher, bodies)
    scene = calls.scene
    origins, directions = rays(rng, calls.centre)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    end = rng.uniform(0.1, 9, COUNT).astype(np.float32)
    begin_step, length = rng.uniform(-1, 5, COUNT), rng.uniform(0, 3, COUNT)
    length[:50] = 0
    steps = np.column_stack([begin_step, begin_step + length]).astype(np.float32)

    media = list(dict.fromkeys(scene.medium_of(body) for body in scene.bodies))
    found = calls("call_add_bodies", given(calls, origins, directions, 0 * end, end, steps), 2 + len(media))

    expected = np.ones((COUNT, len(media)))
    hull = np.full(COUNT, np.inf), np.full(COUNT, -np.inf)
    for body in scene.bodies:
        low, high, meets = intervals(body, origins, directions, 0, end)
        hull = tuple(
            np.where(meets, choose(edge, own), edge)
            for choose, edge, own in zip((np.minimum, np.maximum), hull, (low, high), strict=True)
        )
        way = np.clip(np.minimum(high, steps[:, 1]) - np.maximum(low, steps[:, 0]), 0, None)
        expected[:, media.index(scene.medium_of(body))] += body.density * np.where(meets, way, 0)
    meets = hull[0] < hull[1]
    # A chord that grazes is as long as its ends are exact.
    assert np.quantile(np.abs(found[:, 2:] - expected), 0.995) < 30 * PLACE
    assert np.abs(found[:, 2:] - expected).max() < GRAZING * max(body.density for body in bodies)
    assert (expected.max(axis=1) > 1.1).sum() > COUNT / 10
    assert (found[:50, 2:] == 1).all()
    clear = np.abs(hull[1] - hull[0]) > GRAZING
    assert ((found[:, 0] < found[:, 1]) == meets)[clear].all()
    assert np.abs(found[:, :2] - np.column_stack(hull))[meets & clear].max() < GRAZING


@every_scene
@pytest.mark.parametrize("inside", [0, -1], ids=["from outside", "both ends inside"])
def test_how_far_light_travels_through_bodies(launcher, rng, bodies, inside):
    calls = Bodies(launcher, bodies)
    origins, directions = rays(rng, calls.centre)
    distance = np.linalg.norm(directions, axis=1).astype(np.float32)

    found = calls(
        "call_ways_to_light",
        given(calls, origins, directions, distance),
        len(bodies),
        from_inside=inside,
        to_inside=inside,
    )

    largest = 0.0
    for i, body in enumerate(calls.scene.homogeneous):
        low, high, meets = intervals(body, origins, directions, 0, 1)
        expected = distance * (1 if inside else np.where(meets, high - low, 0))
        error = np.abs(found[:, i] - expected)
        assert np.quantile(error, 0.99) < 30 * PLACE * max(expected.max(), 1)
        assert error.max() < GRAZING * max(expected.max(), 1)
        largest = max(largest, expected.max())
    assert largest > 1


@pytest.mark.parametrize("body", [BOX, BALL, FOG], ids=["box", "sphere", "everywhere"])
def test_how_far_light_travels_to_a_point_that_is_known_to_be_inside(launcher, rng, body):
    calls = Bodies(launcher, [body])
    origins, directions = rays(rng, calls.centre)
    chosen = body.contains(origins + directions)
    origins, directions = origins[chosen], directions[chosen]
    distance = np.linalg.norm(directions, axis=1).astype(np.float32)

    found = calls(
        "call_ways_to_light",
        given(calls, origins, directions, distance),
        1,
        from_inside=0,
        to_inside=1,
    )[:, 0]

    low, _, _ = intervals(body, origins, directions, 0, 1)
    assert chosen.sum() > 100
    error = np.abs(found - distance * (1 - np.clip(low, 0, 1)))
    assert np.quantile(error, 0.99) < 30 * PLACE
    assert error.max() < GRAZING


@pytest.mark.parametrize("ratio", [1.2, 1.7])
def test_light_enters_a_box_smoothly_by_one_face(launcher, rng, ratio):
    calls = Bodies(launcher, [BOX])
    low, high = BOX.bounds
    origins = rng.normal(size=(COUNT, 3)) * 2
    ends = rng.uniform(low, high, (2, COUNT, 3))
    ends[1] = ends[0] + 0.3 * (ends[1] - ends[0])
    first, last = (ends - origins).astype(np.float32).astype(np.float64)
    origins = origins.astype(np.float32).astype(np.float64)

    found = calls(
        "call_is_smooth",
        np.column_stack([origins - calls.centre, first, origins - calls.centre, last]),
        1,
        ratio=ratio,
    )[:, 0]

    # Where rays to points in between cross the planes of the faces that the light is before.
    along = np.linspace(0, 1, 33)[:, None, None]
    ways = np.abs(first + along * (last - first))
    faces = (np.abs(origins - (low + high) / 2) - (high - low) / 2) / ways
    outside = faces.max(axis=2) > 0
    enters = np.where(outside, faces.argmax(axis=2), -1)
    smooth = found != 0
    assert smooth.mean() > 0.3
    assert (~smooth).mean() > 0.05
    assert (enters == enters[:1])[:, smooth].all()
    by = np.take_along_axis(ways, np.maximum(enters, 0)[..., None], axis=2)[..., 0]
    changes = by.max(axis=0) / by.min(axis=0)
    assert (changes[smooth & outside.all(axis=0)] < ratio * (1 + 10 * PLACE)).all()
    assert smooth[~outside.any(axis=0)].all()


def test_mean_distance_of_the_opacity(launcher):
    depths = np.concatenate([[0], np.logspace(-30, 30, 4000), np.linspace(0.5, 1.5, 999)]).astype(np.float32)
    lengths = np.resize([1.0, 0.25, 300.0], len(depths)).astype(np.float32)

    found = Bodies(launcher, [BOX])("call_mean_distance", np.column_stack([depths, lengths]))

    depths = depths.astype(np.float64)
    expected = mean_distance((depths / lengths)[:, None], lengths[:, None].astype(np.float64))[:, 0]
    # From 1 on 1/x and 1/(e^x - 1), of which 0.42 is left at first, round: some ten half-ulps.
    assert (np.abs(found - expected) <= 3 * FAST_MATH * expected + 1e-30).all()
    assert (found[:2] == lengths[:2] / 2).all()


def test_rays_are_cut_at_the_grids(launcher, rng):
    begin = rng.uniform(0, 5, COUNT)
    whole = np.column_stack([begin, begin + rng.uniform(0.01, 5, COUNT)])
    grids = np.sort(rng.uniform(-2, 12, (COUNT, 2)), axis=1)
    grids[:100] = whole[:100]  # nothing beside them
    grids[100:200] = whole[100:200] + np.array([-1, 1])
    meets = rng.random(COUNT) < 0.8
    values = np.column_stack([whole, grids, meets]).astype(np.float32)
    values[200:300, 2:4] = 1e30, -1e30  # an empty hull
    steps = 37

    found = Bodies(launcher, [BOX])("call_split_at_grids", values, 3, 3, steps=steps)

    values = values.astype(np.float64)
    low, high = values[:, 0], values[:, 1]
    first, last = np.clip(values[:, 2], low, high), np.clip(values[:, 3], low, high)
    cut = (values[:, 4] > 0) & (first < last)
    first, last = np.where(cut, first, high), np.where(cut, last, high)
    edges = np.stack([low, first, last, high], axis=1)
    assert 500 < cut.sum() < COUNT - 500
    assert (found[:, :, 0] == edges[:, :-1]).all()
    assert (found[:, :, 1] == edges[:, 1:]).all()
    # In proportion to the length, rounded up, at least one; where rounding decides either number serves.
    share = steps * (edges[:, 1:] - edges[:, :-1]) / (high - low)[:, None]
    count = found[:, :, 2]
    lengths = edges[:, 1:] > edges[:, :-1]
    assert (count[~lengths] == 0).all()
    assert (count >= np.ceil(share * (1 - DEVICE_FUNCTION)))[lengths].all()
    assert (count <= np.maximum(np.ceil(share * (1 + DEVICE_FUNCTION)), 1))[lengths].all()
    assert (count[200:300, 0] == steps).all()
