"""Smooth normals, and where shadow rays of smooth meshes start."""

import numpy as np
import pytest
import trimesh
from tolerances import FLOAT32

from tfm_cl.files.mesh_io.normals import smoothed
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.solids import BoxSolid, MeshSolid, PlaneSolid, SphereSolid

UNIT = 8 * FLOAT32
"""Of a float32 normal: three barycentric products, and its length."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def ball(subdivisions=2, **options):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return MeshSolid.from_arrays(mesh.vertices, mesh.faces, normals=mesh.vertices, **options)


def rays_at(rng, centre, count=4000):
    origins = centre + unit(rng.normal(size=(count, 3))) * 20
    return origins, unit(centre + rng.normal(size=(count, 3)) * 0.4 - origins)


def lit(tracer, hits, origins, directions, towards):
    """Which points a sun lights: as lit pixels find it."""
    points = origins + hits.distance[:, None] * directions
    starts = tracer.lifted(points + hits.raised, hits.flat, hits.distance)
    return (hits.normal @ towards > 0) & ~tracer.occluded(starts, towards, np.inf)


@pytest.mark.parametrize("transform", [np.eye(4), np.diag([-1.0, 2, 0.5, 1])], ids=["plain", "mirrored"])
def test_normals_of_a_coarse_ball_are_those_of_a_sphere(rng, transform):
    mesh, sphere = Tracer([ball(transform=transform)]), Tracer([SphereSolid(transform=transform)])
    origins, directions = rays_at(rng, np.zeros(3))
    one, other = mesh.nearest(origins, directions), sphere.nearest(origins, directions)
    clear = np.isfinite(one.distance) & (-np.einsum("ij,ij->i", other.flat, directions) > 0.5)
    assert clear.sum() > 500
    np.testing.assert_allclose(np.linalg.norm(one.normal[clear], axis=1), 1, atol=UNIT)
    # Flat ones are up to 0.16 off, by half an edge; stretched four times, as far as the two shapes differ.
    stretch = 1 if np.linalg.det(transform) == 1 else 4
    assert np.abs(one.normal - other.normal)[clear].max() < 0.03 * stretch**2
    assert np.abs(one.flat - other.flat)[clear].max() > 0.1
    assert (np.einsum("ij,ij->i", one.flat, directions)[clear] < 0).all()


def test_from_inside_normals_point_inwards(rng):
    directions = unit(rng.normal(size=(500, 3)))
    hits = Tracer([ball()]).nearest([0, 0, 0], directions)
    assert (np.einsum("ij,ij->i", hits.normal, directions) < -0.9).all()
    assert np.abs(hits.raised).max() == 0  # what is hollow needs no room


def test_the_terminator_of_a_coarse_ball_is_that_of_a_sphere(rng):
    """Lit is what faces the light, but for a band where the cosine is small; no facet is seen."""
    tracer, towards = Tracer([ball()]), unit(np.array([1.0, 0.3, 0.2]))
    origins, directions = rays_at(rng, np.zeros(3), 20000)
    hits = tracer.nearest(origins, directions)
    met = np.isfinite(hits.distance)
    hits_flat = hits.flat @ towards
    found = np.zeros(len(met), bool)
    part = type(hits)(**{name: getattr(hits, name)[met] for name in vars(hits)})
    found[met] = lit(tracer, part, origins[met], directions[met], towards)
    cosine = hits.normal @ towards
    clear = met & (cosine > 0.1)
    assert found[clear].all()
    assert (hits_flat[clear] < 0.02).any()  # facets that face away
    # Without room for the smooth surface the triangles would show.
    points = origins + np.where(met, hits.distance, 0)[:, None] * directions
    bare = ~tracer.occluded(
        tracer.lifted(points, hits.flat, np.where(met, hits.distance, 0)), towards, np.inf
    )
    assert not bare[clear].all()
    assert not found[met & (cosine <= 0)].any()


def test_no_light_leaks_through_a_smooth_sheet(rng):
    """A flat sheet whose normals lean: lit from below, nothing above is, whatever they say."""
    vertices = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    leaning = unit(np.array([[1, 0.2, 0]] * 4))
    tracer = Tracer([MeshSolid.from_arrays(vertices, [[0, 2, 1], [0, 3, 2]], normals=leaning)])
    origins = np.column_stack([rng.uniform(-0.9, 0.5, 300), np.full(300, 3.0), rng.uniform(-0.9, 0.9, 300)])
    directions = np.broadcast_to([0.0, -1, 0], origins.shape)
    hits = tracer.nearest(origins, directions)
    below = unit(np.array([1.0, -0.1, 0]))
    assert (hits.normal @ below > 0.5).all()
    assert not lit(tracer, hits, origins, directions, below)[origins[:, 0] < 0.4].any()


def test_normals_that_say_nothing_leave_triangles_flat(rng):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    for normals in (np.zeros_like(mesh.vertices), np.cross(mesh.vertices, [0.3, 0.5, 0.2])):
        solid = MeshSolid.from_arrays(mesh.vertices, mesh.faces, normals=normals)
        origins, directions = rays_at(rng, np.zeros(3), 500)
        hits = Tracer([solid]).nearest(origins, directions)
        met = np.isfinite(hits.distance)
        assert (np.einsum("ij,ij->i", hits.normal, hits.flat)[met] > 0).all()
        if not normals.any():
            np.testing.assert_array_equal(hits.normal, hits.flat)
            assert not hits.raised.any()


def loose(mesh):
    """Every triangle with vertices of its own, as STL has them."""
    return MeshSolid.from_arrays(
        mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    )


def test_computed_normals():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    found = loose(sphere).replace(smooth=True).load()
    at = found.vertices[found.faces]
    assert np.abs(found.normals[found.normal_of] - at).max() < 0.02
    box = trimesh.creation.box()
    for angle in (0, 30, 89):
        flat = loose(box).replace(smooth=angle).load()
        np.testing.assert_allclose(
            flat.normals[flat.normal_of], np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12
        )
    whole = loose(box).replace(smooth=True).load()
    corners = unit(whole.vertices[whole.faces])
    # At each corner three faces weigh the same, however many triangles they are.
    np.testing.assert_allclose(whole.normals[whole.normal_of], corners, atol=1e-12)
    tube = trimesh.creation.cylinder(radius=1, height=2, sections=32)
    shaded = loose(tube).replace(smooth=40).load()
    caps = np.abs(tube.face_normals[:, 2]) > 0.5
    normals = shaded.normals[shaded.normal_of]
    np.testing.assert_allclose(np.abs(normals[caps][..., 2]), 1, atol=1e-12)
    around = unit(shaded.vertices[shaded.faces][~caps] * [1, 1, 0])
    np.testing.assert_allclose(normals[~caps], around, atol=1e-2)


def test_neighbours_of_opposite_winding_do_not_cancel():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    solid = MeshSolid.from_arrays(vertices, [[0, 1, 2], [1, 2, 3]])
    found = smoothed(solid.load(), 180)
    np.testing.assert_allclose(np.abs(found.normals[found.normal_of][..., 2]), 1)


def test_smooth_or_not():
    solid = ball()
    assert solid.load().normals is not None
    assert solid.replace(smooth=True).load().normals is solid.load().normals
    assert solid.replace(smooth=False).load().normals is None
    assert solid.replace(smooth=1.0) != solid.replace(smooth=True)
    assert len(solid.replace(smooth=5).load().normals) == 3 * len(solid.load().faces)  # computed, all flat


# --- what the camera sees otherwise ----------------------------------------------------------------------


def test_what_is_invisible_shades_and_is_not_seen():
    for hidden in (ball(visible=False), SphereSolid(visible=False)):
        tracer = Tracer([hidden, ball(transform=[1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])])
        hits = tracer.nearest([[0, 0, 9], [5.1, 0.1, 9]], [0, 0, -1])
        assert np.isfinite(hits.distance).tolist() == [False, True]
        assert tracer.occluded([[0, 0, 9]], [0, 0, -1], np.inf).all()
        assert tracer.distances([[0.1, 0.1, 9]], [0, 0, -1])[0] < 9
    only = Tracer([ball(visible=False)])
    assert np.isinf(only.nearest([0.1, 0.1, 9], [0, 0, -1]).distance).all()


def test_a_holdout_hides_and_has_no_surface():
    for hole in (ball(holdout=True), SphereSolid(holdout=True)):
        tracer = Tracer([hole, PlaneSolid(point=(0, -2, 0)), BoxSolid(from_=(-1, 2, -1), to=(1, 3, 1))])
        hits = tracer.nearest([[0.1, 0, 9], [3, 0, 9], [0, 2.5, 9]], unit(np.array([0, -0.01, -1])))
        assert hits.holdout.tolist() == [True, False, False]
        assert hits.distance[0] < 9
        assert not hits.normal[0].any()
        assert not hits.albedo[0].any()
        assert hits.albedo[1:].all()
