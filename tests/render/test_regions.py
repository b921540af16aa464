"""Where lights light anything: what touches these regions is found, and little else."""

import numpy as np
import pytest

from tfm_cl.render.regions import FADED, LitRegions
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight
from tfm_cl.scene.solids import BoxSolid, MeshSolid, PlaneSolid, SphereSolid

COUNT = 300
SAMPLES = 4000
SUN = SunLight(from_=(0, 1, 0), to=(0, 0, 0)).fitted(np.array([[-1.0] * 3, [1.0] * 3]))


def random_lights(rng):
    lights = []
    for _ in range(COUNT):
        at, towards = rng.normal(size=3) * 2, rng.normal(size=3)
        reach = None if rng.random() < 0.2 else rng.uniform(0.2, 3)
        if rng.random() < 0.3:
            lights.append(PointLight(from_=at, reach=reach))
        else:
            lights.append(SpotLight(from_=at, to=at + towards, cone=rng.choice([2, 20, 60, 89]), reach=reach))
    return lights


def lit(light, points):
    """Which points the light reaches before it has faded."""
    reach = np.inf if light.reach is None else (1 - FADED) * light.reach
    return light.reaches(points) & (np.linalg.norm(points - light.from_, axis=1) < reach)


def test_no_box_that_is_lit_is_missed(rng):
    lights = random_lights(rng)
    low = rng.normal(size=(COUNT, 3)) * 2
    boxes = np.stack([low, low + rng.uniform(0, 1, (COUNT, 3))], axis=1)
    touching = LitRegions.of(lights).touch_boxes(boxes)
    within = rng.uniform(size=(COUNT, SAMPLES, 3)) * (boxes[:, 1] - low)[:, None] + low[:, None]
    found = np.array([lit(light, points).any() for light, points in zip(lights, within, strict=True)])
    assert found.sum() > COUNT / 20
    assert touching[found].all()
    # "All" would pass the test above.
    assert touching.sum() < 1.5 * found.sum()


def test_boxes_for_all_are_boxes_in_each_row(rng):
    regions = LitRegions.of(random_lights(rng))
    low = rng.normal(size=(5, 3)) * 2
    boxes = np.stack([low, low + rng.uniform(0, 1, (5, 3))], axis=1)
    rows = [regions.touch_boxes(np.broadcast_to(box, (COUNT, 2, 3))) for box in boxes]
    assert 0 < np.mean(rows) < 1
    assert (regions.touch_boxes(boxes[:, None]) == rows).all()


def test_extents_are_those_of_all_points_that_are_lit(rng):
    lights = [light for light in random_lights(rng) if light.reach is not None]
    regions = LitRegions.of(lights)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    extent = regions.extent(direction)
    for light, end in zip(lights, extent, strict=True):
        offsets = rng.normal(size=(SAMPLES, 3))
        offsets *= (light.reach * rng.uniform(size=(SAMPLES, 1)) ** 0.2) / np.linalg.norm(
            offsets, axis=1, keepdims=True
        )
        points = light.from_ + offsets
        heights = points[lit(light, points)] @ direction
        assert heights.max(initial=-np.inf) <= end
        if light.type == "point":
            assert heights.max() > end - 0.3 * light.reach


def test_a_spot_that_ends_at_a_plane_does_not_touch_it():
    above = SpotLight(from_=(0, 1, 0), to=(0, 0, 0), cone=30, reach=1)
    lights = [above, above.replace(reach=1.01), above.replace(to=(0, 2, 0), reach=None), SUN]
    floor = np.zeros(3), np.array([0.0, 1.0, 0.0])
    assert LitRegions.of(lights).touch_plane(*floor).tolist() == [False, True, False, True]
    wider = LitRegions.of([above.replace(to=(1, 1, 0), reach=2)])
    assert not wider.touch_plane(*floor).any()
    assert wider.widened(np.array([0.1])).touch_plane(*floor).any()


@pytest.mark.parametrize(
    ("solid", "at"),
    [
        (SphereSolid(radius=0.3), (1, 0, 0)),
        (BoxSolid(from_=(-0.2, -0.2, -0.2), to=(0.2, 0.2, 0.2)), (1, 0, 0)),
        (MeshSolid.from_arrays([[1, -1, -1], [1, 1, -1], [1, 0, 1]], [[0, 1, 2]]), (0, 0, 0)),
        (PlaneSolid(normal=(1, 0, 0)), (1, 0, 0)),
    ],
    ids=["sphere", "box", "mesh", "plane"],
)
def test_a_solid_may_shade_what_reaches_it(solid, at):
    moved = np.eye(4)
    moved[:3, 3] = at
    tracer = Tracer([solid.replace(transform=moved)])
    towards = SpotLight(from_=(-1, 0, 0), to=(0, 0, 0), cone=10)
    lights = [towards, towards.replace(reach=0.5), towards.replace(to=(-2, 0, 0)), SUN]
    assert tracer.may_shade(LitRegions.of(lights), np.array([5.0, 0, 0])).tolist() == [
        True,
        False,
        False,
        True,
    ]


def test_a_plane_hides_what_it_shades_from_an_eye_beside_the_light():
    tracer = Tracer([PlaneSolid(point=(0, 0, 1), transform=np.diag([1.0, 1, 2, 1]), normal=(0, 0, 1))])
    spot = SpotLight(from_=(0, 0, 3), to=(0, 0, 0))
    sun = SunLight(from_=(0, 0, 1), to=(0, 0, 0)).fitted(np.array([[-1.0] * 3, [1.0] * 3]))
    regions = LitRegions.of([spot, sun])
    for height, seen in ((2.5, False), (1.5, True), (2.0, True)):
        assert tracer.may_shade(regions, np.array([9.0, 4.0, height])).tolist() == [seen, seen]


def test_a_plane_that_is_not_seen_hides_nothing():
    tracer = Tracer([PlaneSolid(point=(0, 0, 1), normal=(0, 0, 1), visible=False)])
    regions = LitRegions.of([SpotLight(from_=(0, 0, 3), to=(0, 0, 0))])
    assert tracer.may_shade(regions, np.array([9.0, 4.0, 2.5])).all()


def test_triangles_that_lie_together_have_a_box_of_their_own(rng):
    # A large ring: the box around all of it is mostly empty.
    angles = np.linspace(0, 2 * np.pi, 257)[:-1]
    inner = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(256)])
    vertices = np.concatenate([inner, 1.1 * inner])
    numbers = np.arange(256)
    faces = np.column_stack([numbers, (numbers + 1) % 256, numbers + 256])
    tracer = Tracer([MeshSolid.from_arrays(vertices, faces)])
    points = np.concatenate([rng.uniform(-0.4, 0.4, (50, 3)), 1.05 * inner[::8]])
    lights = [PointLight(from_=at, reach=0.2) for at in points]
    met = tracer.may_shade(LitRegions.of(lights), np.array([0.0, 0, 5]))
    assert not met[:50].any()
    assert met[50:].all()


def test_a_plane_shades_nothing_in_a_box_on_the_light_s_side():
    tracer = Tracer([PlaneSolid(point=(0, -1, 0))])
    regions = LitRegions.of([PointLight(from_=(0, 2, 0)), PointLight(from_=(0, -3, 0))])
    for low, high, shaded in ((-1, 1, [False, True]), (-2, 1, [True, True]), (-9, -1, [True, False])):
        box = np.array([[-4.0, low, -4.0], [4.0, high, 4.0]])
        assert tracer.may_shade(regions, within=box).tolist() == shaded
    assert tracer.may_shade(regions, within=np.array([[-np.inf] * 3, [np.inf] * 3])).all()
