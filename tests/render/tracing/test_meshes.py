"""Meshes in Embree against brute force and the analytic sphere."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from tolerances import FLOAT32

from tfm_cl.errors import SceneError
from tfm_cl.render.tracing import threads
from tfm_cl.render.tracing.tracer import LIFT, Tracer
from tfm_cl.scene.solids import MeshSolid, PlaneSolid, SphereSolid

EXACT = 2 * FLOAT32
"""Distances of the float64 plane, rounded once to float32."""

RIM = 1e-5
"""Barycentric distance from an edge at which float32 and float64 may disagree about a hit."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def brute_force(triangles, origins, directions):
    """Möller-Trumbore in float64, all pairs: distance, triangle, near an edge [N]; weights [N, F, 3]."""
    first, one, other = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    cross = np.cross(directions[:, None], other)
    determinant = np.einsum("fj,nfj->nf", one, cross)
    offset = origins[:, None] - first
    u = np.einsum("nfj,nfj->nf", offset, cross) / determinant
    turned = np.cross(offset, one)
    v = np.einsum("nj,nfj->nf", directions, turned) / determinant
    t = np.einsum("fj,nfj->nf", other, turned) / determinant
    rim = np.minimum(np.minimum(u, v), 1 - u - v)
    distance = np.where((rim >= 0) & (t > 0), t, np.inf)
    unclear = ((np.abs(rim) < RIM) & (t > -RIM)).any(axis=1)
    return distance.min(axis=1), distance.argmin(axis=1), unclear, np.stack([1 - u - v, u, v], axis=-1)


@pytest.mark.parametrize(
    ("offset", "scale"),
    [(0.0, 1.0), (1e6, 1.0), (0.0, 1e-9), (0.0, 1e9)],
    ids=["near", "far", "tiny", "huge"],
)
def test_embree_against_all_pairs(rng, offset, scale):
    triangles = (rng.normal(size=(300, 1, 3)) * 2 + rng.normal(size=(300, 3, 3)) * 0.5) * scale + offset
    albedo = rng.uniform(size=(900, 3)).astype(np.float32)
    solid = MeshSolid.from_arrays(triangles.reshape(-1, 3), np.arange(900).reshape(-1, 3), albedo)
    origins = rng.normal(size=(2000, 3)) * 5 * scale + offset
    directions = unit(rng.normal(size=(2000, 3)) * 2 * scale + offset - origins)
    distance, which, unclear, weights = brute_force(triangles, origins, directions)
    clear = ~unclear
    hit = np.isfinite(distance) & clear
    assert hit.sum() > 500
    assert unclear.sum() < 60
    tracer = Tracer([solid])
    hits = tracer.nearest(origins, directions)
    np.testing.assert_array_equal(np.isfinite(hits.distance)[clear], np.isfinite(distance)[clear])
    # Coordinates of 1e6 themselves hold float64's 1e-10.
    np.testing.assert_allclose(hits.distance[hit], distance[hit], rtol=EXACT, atol=1e-9 * scale)
    chosen = triangles[which[hit]]
    normals = unit(np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0]))
    normals *= -np.sign(np.einsum("ij,ij->i", normals, directions[hit]))[:, None]
    np.testing.assert_allclose(hits.normal[hit], normals, atol=1e-6)
    corner_weights = weights[hit, which[hit]]
    expected = np.einsum("ij,ijk->ik", corner_weights, albedo.reshape(300, 3, 3)[which[hit]])
    np.testing.assert_allclose(hits.albedo[hit], expected, atol=2e-3)  # float32 weights of slivers
    assert np.abs(hits.albedo[hit] - expected).mean() < 1e-5
    # Distances alone are Embree's.
    coarse = tracer.distances(origins, directions)
    np.testing.assert_array_equal(np.isfinite(coarse), np.isfinite(hits.distance))
    cosine = np.abs(np.einsum("ij,ij->i", normals, directions[hit]))
    error = np.abs(coarse[hit] - distance[hit]) * cosine
    assert (error < LIFT * 20 * scale + FLOAT32 * distance[hit]).all()
    # Shadows up to and past the hit.
    assert not tracer.occluded(origins[hit], directions[hit], distance[hit]).any()
    margin = 3 * LIFT * 20 * scale
    assert tracer.occluded(origins[hit], directions[hit], distance[hit] / (1 - 2 * LIFT) + margin).all()


def icosphere(subdivisions=6, **options):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return MeshSolid.from_arrays(mesh.vertices, mesh.faces, **options)


def test_an_icosphere_is_nearly_a_sphere(rng):
    transform = np.eye(4)
    transform[:3] = [[1, 0.5, 0, 4], [0, 2, 0.1, 5], [0, 0, 0.7, 6]]
    mesh, sphere = icosphere(transform=transform), SphereSolid(transform=transform)
    bounds = np.array(sphere.bounds())
    np.testing.assert_allclose(Tracer([mesh]).bounds, bounds, atol=2e-3)
    origins = rng.normal(size=(5000, 3)) * 10 + transform[:3, 3]
    directions = unit(transform[:3, 3] + rng.normal(size=(5000, 3)) * 0.5 - origins)
    one, other = Tracer([mesh]).nearest(origins, directions), Tracer([sphere]).nearest(origins, directions)
    cosine = -np.einsum("ij,ij->i", other.normal, directions)
    clear = cosine > 0.3
    assert clear.sum() > 1000
    # Edges of 1/60 lie (1/60)² / 8 = 4e-5 inside, stretched twice and by 1 / 0.3.
    np.testing.assert_allclose(one.distance[clear], other.distance[clear], atol=3e-4)
    # Flat normals turn by half an edge, stretched by the conditions of the transform (3).
    np.testing.assert_allclose(one.normal[clear], other.normal[clear], atol=0.05)
    np.testing.assert_array_equal(one.albedo[clear], np.float32(0.8) * np.ones((clear.sum(), 3), np.float32))


@pytest.mark.parametrize("subdivisions", [1, 5])
def test_no_acne_on_a_tessellated_sphere(rng, subdivisions):
    offset = np.array([100.0, -50.0, 20.0])
    transform = np.eye(4)
    transform[:3, 3] = offset
    tracer = Tracer([icosphere(subdivisions, transform=transform)])
    origins = offset + unit(rng.normal(size=(50000, 3))) * 12
    directions = unit(offset + rng.normal(size=(50000, 3)) * 0.4 - origins)
    hits = tracer.nearest(origins, directions)
    hit = np.isfinite(hits.distance)
    assert hit.sum() > 20000
    points = origins[hit] + hits.distance[hit, None] * directions[hit]
    normals = hits.normal[hit].astype(np.float64)
    across = unit(np.cross(normals, rng.normal(size=normals.shape)))
    sine = 10 ** rng.uniform(-6, 0, size=(len(normals), 1))
    towards = unit(sine * normals + np.sqrt(1 - sine**2) * across)
    starts = tracer.lifted(points, normals, hits.distance[hit])
    assert not tracer.occluded(starts, towards, np.inf).any()
    assert tracer.occluded(points, towards, np.inf).any()  # it is the lift that does it
    assert tracer.occluded(starts, -normals, np.inf).all()
    # Nothing gets through from inside either, not even at edges.
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    middles = mesh.vertices[mesh.edges_unique].mean(axis=1)
    assert tracer.occluded(offset, unit(middles), np.inf).all()
    assert tracer.occluded(offset, unit(rng.normal(size=(20000, 3))), np.inf).all()
    assert tracer.occluded(offset, unit(mesh.vertices), np.inf).mean() > 0.99  # Embree: edges, not vertices


def test_no_leak_through_a_thin_box_of_triangles(rng):
    thick = 1e-3
    box = trimesh.creation.box(bounds=[[-5, 0, -5], [5, thick, 5]])
    tracer = Tracer([MeshSolid.from_arrays(box.vertices, box.faces)])
    origins = np.column_stack([rng.uniform(-4, 4, 5000), np.full(5000, 5.0), rng.uniform(-4, 4, 5000)])
    hits = tracer.nearest(origins, [0, -1, 0])
    np.testing.assert_allclose(hits.distance, 5 - thick, rtol=EXACT)
    starts = tracer.lifted(origins - [0, 5 - thick, 0], hits.normal, hits.distance)
    below = starts * [1, -1, 1]
    towards = unit(rng.normal(size=(5000, 3)) * [1, 0.3, 1])
    steep = np.abs(towards[:, 1]) > 0.01
    up = towards[:, 1] > 0
    np.testing.assert_array_equal(tracer.occluded(starts, towards, np.inf)[steep], ~up[steep])
    np.testing.assert_array_equal(tracer.occluded(below, towards, np.inf)[steep], up[steep])


def test_a_camera_far_away_costs_no_digits():
    mesh = icosphere(3)
    origins = np.array([[0.2, 0.1, -3.0], [0.2, 0.1, -3.0e7]])
    hits = Tracer([mesh]).nearest(origins, [0, 0, 1])
    np.testing.assert_array_equal(hits.normal[0], hits.normal[1])
    assert hits.distance[1] == np.float32(3.0e7 - 3.0 + float(hits.distance[0]))


def test_meshes_and_shapes_together(rng):
    transform = np.eye(4)
    transform[0, 3] = 3
    solids = [
        icosphere(3, albedo=0.1),
        PlaneSolid(point=(0, -1.5, 0), albedo=0.2),
        icosphere(2, albedo=0.3, transform=transform),
    ]
    tracer = Tracer(solids)
    np.testing.assert_allclose(tracer.bounds, [[-1, -1, -1], [4, 1, 1]], atol=1e-2)
    origins = rng.normal(size=(3000, 3)) * 6
    directions = unit(rng.normal(size=(3000, 3)) * 2 - origins)
    hits = tracer.nearest(origins, directions)
    each = np.stack([Tracer([solid]).nearest(origins, directions).distance for solid in solids])
    np.testing.assert_allclose(hits.distance, each.min(axis=0), rtol=EXACT)
    hit = np.isfinite(hits.distance)
    np.testing.assert_allclose(
        hits.albedo[hit, 0], np.array([0.1, 0.2, 0.3])[each.argmin(axis=0)][hit], rtol=EXACT
    )
    assert len(np.unique(each.argmin(axis=0)[hit])) == 3


def test_an_origin_refines_what_is_near_it(rng):
    """A detail of 1e-4 next to a ground of 1e4: Embree's zero at the detail keeps its shadows."""
    detail = trimesh.creation.icosphere(subdivisions=3, radius=1e-4)
    ground = np.array([[-1e4, -1, -1e4], [1e4, -1, -1e4], [0, -1, 1e4]])
    spot = np.array([7000.1, 0.0, -8000.3])
    solids = [
        MeshSolid.from_arrays(detail.vertices + spot, detail.faces),
        MeshSolid.from_arrays(ground, [[0, 1, 2]]),
    ]
    towards = unit(rng.normal(size=(2000, 3)) * [1, 0, 1])
    starts = spot - 1e-3 * towards
    assert np.isfinite(Tracer(solids, origin=spot).nearest(starts, towards).distance).mean() == 1
    assert np.isfinite(Tracer(solids).nearest(starts, towards).distance).mean() < 1


def test_chunks_make_no_difference(rng, monkeypatch):
    tracer = Tracer([icosphere(3), PlaneSolid(point=(0, -1, 0))])
    origins = rng.normal(size=(1000, 3)) * 4
    directions = unit(-origins + rng.normal(size=(1000, 3)))
    whole = tracer.nearest(origins, directions), tracer.distances(origins, directions)
    blocked = tracer.occluded(origins, directions, 4.0)
    monkeypatch.setattr(threads, "CHUNK", 37)
    monkeypatch.setattr(threads, "_cores", lambda: 3)
    parts = tracer.nearest(origins, directions), tracer.distances(origins, directions)
    for name in ("distance", "normal", "albedo"):
        np.testing.assert_array_equal(getattr(parts[0], name), getattr(whole[0], name))
    np.testing.assert_array_equal(parts[1], whole[1])
    np.testing.assert_array_equal(tracer.occluded(origins, directions, 4.0), blocked)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: tracer.distances(origins, directions), range(8)):
            np.testing.assert_array_equal(found, whole[1])


def test_an_interrupt_leaves_no_threads(monkeypatch):
    done = []

    def trace(part):
        done.append(part)
        if len(done) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(threads, "_cores", lambda: 2)
    monkeypatch.setattr(threads, "CHUNK", 100)
    with pytest.raises(KeyboardInterrupt):
        threads.in_chunks(100_000, trace)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("tfm-solids")]


def test_degenerate_triangles_are_dropped():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]
    solid = MeshSolid.from_arrays(vertices, [[0, 0, 1], [0, 1, 2], [0, 1, 3], [2, 2, 2]])
    assert solid.load().faces.tolist() == [[0, 1, 2]]
    assert Tracer([solid]).distances([0.2, 0.2, 3], [0, 0, -1]).tolist() == [3.0]


@pytest.mark.parametrize(
    ("vertices", "faces", "albedo", "message"),
    [
        (np.eye(3), np.zeros((0, 3), int), None, "holds no triangles"),
        (np.eye(3), [[0, 1, 3]], None, "a triangle names vertex 3; there are 3"),
        (np.eye(3), [[0, 1, -1]], None, "a triangle names vertex -1"),
        (np.eye(3), [[0, 1, 1 << 62]], None, "names vertex"),
        (np.eye(3), [[0.0, 1, 2]], None, "faces should be whole numbers"),
        (np.eye(3) * np.nan, [[0, 1, 2]], None, "is not finite"),
        (np.eye(3) * 1e16, [[0, 1, 2]], None, "or beyond 1e+15"),
        (np.eye(3)[:, :2], [[0, 1, 2]], None, "vertices should be numbers"),
        ([["a", "b", "c"]], [[0, 0, 0]], None, "vertices should be numbers"),
        ([[1], [1, 2]], [[0, 0, 0]], None, "rows differ in length"),
        (np.ones((3, 3)), [[0, 1, 2]], None, "no triangle has an area"),
        (np.eye(3), [[0, 1, 2]], np.full((3, 3), 2.0), "albedo should be numbers from 0 to 1"),
        (np.eye(3), [[0, 1, 2]], np.ones((2, 3)), "albedo should be numbers from 0 to 1"),
        (np.eye(3), [[0, 1, 2]], 2.0, "solid.albedo = 2.0: should be from 0 to 1"),
    ],
    ids=range(14),
)
def test_arrays_that_cannot_be(vertices, faces, albedo, message):
    with pytest.raises(SceneError) as caught:
        MeshSolid.from_arrays(vertices, faces, albedo)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
