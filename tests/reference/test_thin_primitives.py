"""Strands and polygons in the float64 reference: where rays cross them, and what they scatter."""

import numpy as np
import pytest
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.reference.geometry import Rays
from tfm_cl.reference.primitives import amounts, meet

ONE = np.ones((1, 1, 1))
"""Weights of one body, of one channel."""
FAR = 100.0


def strands(rng, **changes):
    points = np.cumsum(rng.normal(0, 0.3, (9, 4, 3)), axis=1).reshape(-1, 3)
    return tfm.Curves(points, [4] * 9, rng.uniform(0.1, 0.5, 36), opacity=rng.uniform(0, 1, 36), **changes)


def triangles(rng, **changes):
    return tfm.Polygons(rng.normal(0, 0.8, (60, 3)), np.arange(60).reshape(20, 3), 0.4, **changes)


def random_rays(rng, count=400):
    origins = rng.uniform(-1.5, 1.5, (count, 3))
    directions = rng.uniform(-1, 1, (count, 3)) - origins
    return Rays(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


every_kind = pytest.mark.parametrize("make", [strands, triangles])


@every_kind
def test_rays_cross_what_the_bodies_themselves_say(rng, make):
    body, rays = make(rng, colour=rng.uniform(0, 1, 3)), random_rays(rng)
    cuts = np.broadcast_to(np.linspace(0.1, 4, 9), (400, 9))
    weights = np.eye(3)[None]
    found = amounts([body], weights, rays, cuts)
    expected = [body.depths_along(*ray, cuts[0]) for ray in zip(*rays, strict=True)]
    assert (found > 0).any(axis=(1, 2)).sum() > 100
    np.testing.assert_allclose(found, expected, atol=ROUNDED)


@every_kind
def test_the_distance_is_that_of_the_place_crossed(rng, make):
    """A strand's axis is nearest to the ray there, in its width; a triangle's place is a mean of corners."""
    body, rays = make(rng), random_rays(rng)
    met = meet(body, rays)
    assert len(met.ray) > 100
    places = rays.part(met.ray).at(met.distance)
    apart = np.full(len(places), np.inf)
    for i, place in enumerate(places):
        first, *others = np.moveaxis(body.corners, 1, 0)
        edges = np.stack([other - first for other in others], axis=2)
        at = np.linalg.pinv(edges) @ (place - first)[..., None]
        inside = (at[..., 0] > -ROUNDED).all(axis=1) & (at[..., 0].sum(axis=1) < 1 + ROUNDED)
        distances = np.linalg.norm((edges @ at)[..., 0] + first - place, axis=1)
        # Of those that the place is beside, the one that is nearest.
        apart[i] = distances[inside].min()
    assert apart.max() < (0.25 if isinstance(body, tfm.Curves) else ROUNDED)


@every_kind
def test_tangents_are_weighted_by_what_is_left(rng, make):
    body, rays = make(rng), random_rays(rng)
    ends = np.zeros(400), np.full(400, FAR)
    met = meet(body, rays)
    tangents = met.tangents(*ends)
    trace = np.trace(tangents, axis1=1, axis2=2)
    expected = met.between(*ends)[:, 0] if isinstance(body, tfm.Curves) else np.zeros(400)
    np.testing.assert_allclose(trace, expected, atol=ROUNDED)
    assert (np.linalg.eigvalsh(tangents) > -ROUNDED).all()


def test_a_strand_that_a_ray_runs_along_is_not_crossed():
    strand = tfm.Curves([[0, 0, -1], [0, 0, 1]], [2], 0.5)
    axis = Rays(np.array([[0.1, 0, -5.0]]), np.array([[0, 0, 1.0]]))
    np.testing.assert_array_equal(meet(strand, axis).between(np.zeros(1), np.full(1, FAR)), [[0]])


def test_bodies_of_many_are_looked_at_in_parts(rng, monkeypatch):
    body, rays = triangles(rng), random_rays(rng, 40)
    ends = np.broadcast_to([0.0, FAR], (40, 2))
    whole = amounts([body], ONE, rays, ends)
    monkeypatch.setattr("tfm_cl.reference.primitives.PAIRS", 300)
    np.testing.assert_allclose(amounts([body], ONE, rays, ends), whole, rtol=ROUNDED)
