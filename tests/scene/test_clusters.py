"""Points in clusters: near each other, and such as change no faster than the points."""

import itertools

import numpy as np
import pytest
from scenes import turned
from tolerances import ROUNDED

from tfm_cl.scene.clusters import sums_of_clusters

UPRIGHT = np.eye(3)
MOVES = 0.6
"""Of a cluster's radius, by which its centroid may move where points are stretched by 2.5 %: half of that by
1.25 %. A jump, as where splits have the axis that is widest, is 2 and more."""


def clusters_of(points, weights, count, axes=UPRIGHT):
    """Weights, centroids and mean squares of distances from these."""
    moments = weights[:, None] * np.column_stack([points, (points**2).sum(axis=1)])
    sums = sums_of_clusters(points, weights, np.column_stack([weights, moments]), count, axes)
    total, centroids = sums[:, 0], sums[:, 1:4] / sums[:, :1]
    return total, centroids, sums[:, 4] / total - (centroids**2).sum(axis=1)


def spread(points, weights, count):
    """Weighted sum of squared distances to the centroids."""
    total, _, squares = clusters_of(points, weights, count)
    return float(total @ squares)


def test_heaps_of_points_are_found(rng):
    middles = 10 * rng.permutation(np.stack(np.meshgrid(*[range(2)] * 3), axis=-1).reshape(-1, 3))
    heap, weights = rng.integers(0, 8, 2000), rng.uniform(0.1, 1, 2000)
    points = middles[heap] + rng.normal(size=(2000, 3))
    total, centroids, _ = clusters_of(points, weights, 8)
    nearest = np.linalg.norm(middles[:, None] - centroids, axis=-1).argmin(axis=1)
    assert sorted(nearest) == list(range(8))
    assert np.abs(total[nearest] / np.bincount(heap, weights) - 1).max() < 0.01
    assert spread(points, weights, 8) < 1.01 * 3 * weights.sum()


def test_more_clusters_are_closer_and_hold_all(rng):
    points, weights, values = rng.uniform(size=(3000, 3)), rng.uniform(size=3000), rng.normal(size=(3000, 2))
    for count in (1, 5, 48, 2999):
        sums = sums_of_clusters(points, weights, values, count, UPRIGHT)
        assert len(sums) <= count
        assert np.abs(sums.sum(axis=0) - values.sum(axis=0)).max() < 3000 * ROUNDED
    spreads = [spread(points, weights, count) for count in (1, 8, 64, 512)]
    # In a cube, an eighth as large is half as wide; weighted points in clumps do better.
    assert all(fine < 0.35 * coarse for coarse, fine in itertools.pairwise(spreads))
    one, other = (clusters_of(given, weights, 64) for given in (points, points.copy()))
    assert all(np.array_equal(*pair) for pair in zip(one, other, strict=True))


@pytest.mark.parametrize("count", [6, 16, 48])
def test_as_points_are_stretched_no_cluster_jumps(rng, count):
    """Through a round cloud, from one that is twice as long along one axis to one that is along another."""
    cloud, weights, before = rng.normal(size=(2000, 3)), rng.uniform(size=2000), None
    for stretch in np.linspace(-0.7, 0.7, 57):
        points = cloud * np.exp(stretch * np.array([1, 0.3, -0.8]))
        _, centroids, squares = clusters_of(points, weights, count)
        if before is not None:
            assert (np.linalg.norm(centroids - before, axis=1) < MOVES * np.sqrt(squares)).all()
        before = centroids


def test_a_point_that_fades_in_changes_nothing_at_once(rng):
    points, weights = rng.normal(size=(500, 3)), rng.uniform(size=500)
    _, without, _ = clusters_of(points, weights, 16)
    more = np.concatenate([points, [[9, 0, 0]]])
    for weight in (1e-3, 1e-6, 1e-9):
        _, centroids, _ = clusters_of(more, np.append(weights, weight), 16)
        assert np.abs(centroids - without).max() < 10 * weight + ROUNDED


def test_what_is_turned_with_its_axes_stays_the_same(rng):
    points, weights = rng.normal(size=(500, 3)) * [1, 2, 0.5], rng.uniform(size=500)
    turn = turned(40, (1, -2, 0.7), (1, 1, 1), (0, 0, 0))[:3, :3]
    total, centroids, _ = clusters_of(points, weights, 24)
    total_turned, centroids_turned, _ = clusters_of(points @ turn.T + 3, weights, 24, turn)
    assert np.abs(total_turned - total).max() < 500 * ROUNDED
    assert np.abs(centroids_turned - centroids @ turn.T - 3).max() < 500 * ROUNDED


@pytest.mark.parametrize(
    ("stretch", "worst"), [((1, 1, 0), 1 / 8), ((1, 0, 0), 1 / 50), ((0.01, 3, 1e-9), 1 / 50)]
)
def test_what_is_flat_or_narrow_is_cut_along_itself(rng, stretch, worst):
    points, weights = rng.uniform(size=(3000, 3)) * stretch, np.ones(3000)
    assert spread(points, weights, 16) < worst * spread(points, weights, 1)


@pytest.mark.parametrize("count", [1, 5])
def test_points_that_are_one_stay_together(count):
    points, weights = np.full((9, 3), 0.3), np.ones(9)
    total, centroids, _ = clusters_of(points, weights, count)
    assert abs(total.sum() - 9) < 9 * ROUNDED
    assert np.abs(centroids - 0.3).max() < ROUNDED


def test_two_places_of_many_points_are_not_mixed():
    points = np.repeat([[0.0, 0, 0], [1, 0, 0]], 9, axis=0)
    for count in (2, 3, 5, 17):
        total, centroids, _ = clusters_of(points, np.ones(18), count)
        assert np.abs(centroids[:, 0] * (1 - centroids[:, 0])).max() < 1e-9
        assert abs(total @ centroids[:, 0] - 9) < 18 * ROUNDED


def test_few_points_are_a_cluster_each():
    assert np.array_equal(clusters_of(np.eye(3), np.ones(3), 3)[1], np.eye(3))
