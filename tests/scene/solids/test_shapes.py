"""Planes, spheres and boxes against closed forms and samples."""

import numpy as np
import pytest
from tolerances import FLOAT32, ROUNDED

from tfm_cl.render.tracing.tracer import LIFT, Tracer
from tfm_cl.scene.solids import BoxSolid, PlaneSolid, SphereSolid

ON_SURFACE = 1e-10
"""Of a hit point's equation in object space: transforms here have conditions up to some 100, and the
grazing rays' roots double the relative error of the rest."""

UNIT = 4 * FLOAT32
"""Of a float32 vector's products: three roundings."""


def random_affine(rng, offset=3.0):
    while True:
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        if np.linalg.cond(matrix[:3, :3]) < 30:
            matrix[:3, 3] = rng.normal(size=3) * offset
            return matrix


def rays_towards(rng, middle, count, spread=1.0, far=8.0):
    origins = middle + rng.normal(size=(count, 3)) * far
    targets = middle + rng.normal(size=(count, 3)) * spread
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


SHAPES = {
    "plane": PlaneSolid(point=(0.3, -0.2, 0.1), normal=(1, 2, -0.5)),
    "sphere": SphereSolid(centre=(0.5, 0.2, -0.3), radius=0.9),
    "box": BoxSolid(from_=(-0.5, -1, 0.1), to=(0.7, 0.4, 1.1)),
}


def level(solid, points):
    """Negative inside, 0 on the surface, positive outside; object space."""
    if isinstance(solid, PlaneSolid):
        return (points - solid.point) @ (np.array(solid.normal) / np.linalg.norm(solid.normal))
    if isinstance(solid, SphereSolid):
        return np.linalg.norm(points - solid.centre, axis=-1) - solid.radius
    return np.maximum(solid.from_ - points, points - solid.to).max(axis=-1)


def to_object(solid, points):
    inverse = np.linalg.inv(solid.world_from_object)
    return points @ inverse[:3, :3].T + inverse[:3, 3]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", SHAPES)
def test_hits_are_on_the_surface_and_the_first(name, seed):
    rng = np.random.default_rng(seed)
    solid = SHAPES[name].replace(transform=random_affine(rng))
    middle = solid.world_from_object[:3, 3]
    origins, directions = rays_towards(rng, middle, 400, far=3.0)
    distance = solid.distances(*solid.object_rays(origins, directions))
    hit = np.isfinite(distance)
    assert 20 < hit.sum() < 400 or name == "plane"
    points = origins[hit] + distance[hit, None] * directions[hit]
    assert np.abs(level(solid, to_object(solid, points))).max() < ON_SURFACE
    # Brute force: no change of side on samples before the hit, or anywhere along a miss.
    ends = np.where(hit, distance * (1 - 1e-6), 60.0)
    samples = origins[:, None] + (np.linspace(0, 1, 500)[:, None] * ends[:, None, None]) * directions[:, None]
    sides = np.sign(level(solid, to_object(solid, samples.reshape(-1, 3)))).reshape(400, 500)
    assert (sides == sides[:, :1]).all()


@pytest.mark.parametrize("name", SHAPES)
def test_normals_are_at_right_angles_to_the_surface(name, rng):
    solid = SHAPES[name].replace(transform=random_affine(rng), albedo=(0.1, 0.5, 0.9))
    origins, directions = rays_towards(rng, solid.world_from_object[:3, 3], 500)
    hits = Tracer([solid]).nearest(origins, directions)
    hit = np.isfinite(hits.distance)
    assert hit.sum() > 50
    normals = hits.normal[hit].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=UNIT)
    assert (np.einsum("ij,ij->i", normals, directions[hit]) < 0).all()
    np.testing.assert_array_equal(hits.albedo[hit], np.tile(np.float32([0.1, 0.5, 0.9]), (hit.sum(), 1)))
    assert (hits.normal[~hit] == 0).all()
    assert (hits.albedo[~hit] == 0).all()
    # The level's gradient, by central differences in float64, away from a box's edges.
    exact = solid.distances(*solid.object_rays(origins, directions))[hit]
    points, step = origins[hit] + exact[:, None] * directions[hit], 1e-6
    gradient = np.stack(
        [
            level(solid, to_object(solid, points + step * axis))
            - level(solid, to_object(solid, points - step * axis))
            for axis in np.eye(3)
        ],
        axis=1,
    )
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    cosine = np.abs(np.einsum("ij,ij->i", gradient, normals))
    assert np.quantile(cosine, 0.01) > 1 - 1e-5  # the differences' own error; a box's edges are left out


def test_a_sphere_far_away_keeps_its_digits():
    """Closed form: along the axis, a ray that passes at height h ends at D - sqrt(r² - h²)."""
    away, height = 1e8, np.array([0.0, 0.5, 0.9, 0.999])
    origins = np.stack([np.full(4, -away), height, np.zeros(4)], axis=1)
    distance = SphereSolid().distances(origins, np.tile([1.0, 0, 0], (4, 1)))
    # The subtraction of 1e8 is all that rounds; the textbook formula would be wrong by 1e-8 * 1e8.
    np.testing.assert_allclose(distance, away - np.sqrt(1 - height**2), rtol=2e-16, atol=3e-8)


def test_from_inside_and_from_the_surface():
    for solid in (SphereSolid(), BoxSolid()):
        origins = np.array([[0, 0, 0], [0.25, 0, 0], [1, 0, 0], [1, 0, 0], [-3, 0, 0], [3, 0, 0]], float)
        directions = np.array([[1, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0], [1, 0, 0]], float)
        np.testing.assert_allclose(
            solid.distances(origins, directions), [1, 1.25, np.inf, 2, 2, np.inf], rtol=ROUNDED
        )


def test_rays_along_the_faces_of_a_box_are_numbers():
    values = [-1.0, -0.5, 0.0, 1.0, 2.0]
    origins = np.array([(x, y, -3.0) for x in values for y in values])
    distance = BoxSolid().distances(origins, np.tile([0.0, 0.0, 1.0], (25, 1)))
    assert not np.isnan(distance).any()
    inside = (np.abs(origins[:, :2]) < 1).all(axis=1)
    assert (distance[inside] == 2).all()
    assert np.isinf(distance[np.abs(origins[:, :2]).max(axis=1) > 1]).all()


def test_bounds_hold_the_surface(rng):
    for name in ("sphere", "box"):
        solid = SHAPES[name].replace(transform=random_affine(rng))
        low, high = solid.bounds()
        origins, directions = rays_towards(rng, (low + high) / 2, 20000, spread=0.5)
        distance = solid.distances(*solid.object_rays(origins, directions))
        hit = np.isfinite(distance)
        points = origins[hit] + distance[hit, None] * directions[hit]
        size = (high - low).max()
        assert (points >= low - ROUNDED * size).all()
        assert (points <= high + ROUNDED * size).all()
        # Tight for a sphere: thousands of points come near every side.
        if name == "sphere":
            assert np.abs(points.min(axis=0) - low).max() < 0.05 * size
            assert np.abs(points.max(axis=0) - high).max() < 0.05 * size


def test_the_nearest_of_several_wins(rng):
    solids = [
        PlaneSolid(point=(0, -1, 0), albedo=0.1),
        SphereSolid(albedo=0.2),
        BoxSolid(from_=(2, -1, -1), to=(3, 1, 1), albedo=0.3),
    ]
    tracer = Tracer(solids)
    np.testing.assert_array_equal(tracer.bounds, [[-1, -1, -1], [3, 1, 1]])
    origins, directions = rays_towards(rng, np.zeros(3), 2000, spread=2.0)
    each = np.stack([solid.distances(*solid.object_rays(origins, directions)) for solid in solids])
    hits = tracer.nearest(origins, directions)
    np.testing.assert_array_equal(hits.distance, each.min(axis=0).astype(np.float32))
    np.testing.assert_array_equal(tracer.distances(origins, directions), hits.distance)
    hit = np.isfinite(hits.distance)
    expected = np.array([0.1, 0.2, 0.3], np.float32)[each.argmin(axis=0)]
    np.testing.assert_array_equal(hits.albedo[hit, 0], expected[hit])
    assert len(np.unique(hits.albedo[hit, 0])) == 3
    # Shadows: blocked exactly up to the first surface.
    assert not tracer.occluded(origins[hit], directions[hit], hits.distance[hit]).any()
    assert tracer.occluded(origins[hit], directions[hit], hits.distance[hit] * 1.001).all()
    assert not tracer.occluded(origins[~hit], directions[~hit], np.inf).any()


def test_what_the_camera_does_not_see_hides_nothing_from_it():
    tracer = Tracer([SphereSolid(visible=False), SphereSolid(centre=(9, 0, 0))])
    starts = np.array([[0, 0, 3], [9, 0, 3]])
    assert tracer.occluded(starts, (0, 0, -1), 9.0).tolist() == [True, True]
    assert tracer.occluded(starts, (0, 0, -1), 9.0, by_seen=True).tolist() == [False, True]


def test_one_origin_serves_for_all_rays(rng):
    directions = rays_towards(rng, np.zeros(3), 50)[1]
    tracer = Tracer([SphereSolid()])
    np.testing.assert_array_equal(
        tracer.distances([0.1, 0.2, 0.3], directions),
        tracer.distances(np.tile([0.1, 0.2, 0.3], (50, 1)), directions),
    )
    assert tracer.distances([0, 0, 3], [0, 0, -1]).tolist() == [2.0]


def test_nothing_at_all():
    tracer = Tracer([])
    assert tracer.bounds is None
    assert np.isinf(tracer.distances(np.zeros((3, 3)), np.eye(3))).all()
    assert np.isinf(tracer.nearest(np.zeros((3, 3)), np.eye(3)).distance).all()
    assert not tracer.occluded(np.zeros((3, 3)), np.eye(3), np.inf).any()
    assert tracer.distances(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def grazing(rng, normals):
    """Directions at angles down to 1e-7 above the surfaces."""
    across = np.cross(normals, rng.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    sine = 10 ** rng.uniform(-7, 0, size=(len(normals), 1))
    return sine * normals + np.sqrt(np.maximum(1 - sine**2, 0)) * across


def test_no_acne_at_grazing_angles(rng):
    solid = SphereSolid(centre=(5, 6, 7), radius=2.0)
    tracer = Tracer([solid])
    origins, directions = rays_towards(rng, np.array(solid.centre), 20000, spread=1.0, far=30.0)
    hits = tracer.nearest(origins, directions)
    outside = np.linalg.norm(origins - solid.centre, axis=1) > solid.radius
    hit = np.isfinite(hits.distance) & outside
    distance, normals = hits.distance[hit], hits.normal[hit].astype(np.float64)
    points = origins[hit] + distance[:, None] * directions[hit]
    towards = grazing(rng, normals)
    starts = tracer.lifted(points, normals, distance)
    assert not tracer.occluded(starts, towards, np.inf).any()
    assert tracer.occluded(points, towards, np.inf).any()  # it is the lift that does it
    assert tracer.occluded(starts, -normals, np.inf).all()


def test_no_leak_through_a_thin_box(rng):
    thick = 1e-3
    tracer = Tracer([BoxSolid(from_=(-50, 0, -50), to=(50, thick, 50))])
    origins = np.column_stack([rng.uniform(-5, 5, 5000), np.full(5000, 5.0), rng.uniform(-5, 5, 5000)])
    hits = tracer.nearest(origins, [0, -1, 0])
    points = origins + hits.distance[:, None] * np.array([0.0, -1.0, 0.0])
    starts = tracer.lifted(points, hits.normal, hits.distance)
    assert (starts[:, 1] > thick).all()
    assert (starts[:, 1] < thick + 20 * LIFT).all()
    towards = grazing(rng, np.tile([0.0, 1.0, 0.0], (5000, 1)))
    assert not tracer.occluded(starts, towards, np.inf).any()
    # Flatter ones leave beyond the box's edge.
    assert tracer.occluded(starts, -towards, np.inf)[towards[:, 1] > 1e-6].all()
    below = starts * [1, -1, 1]
    assert tracer.occluded(below, towards, np.inf)[towards[:, 1] > 1e-3].all()
