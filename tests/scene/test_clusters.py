"""Points in clusters: near each other, and the same each time."""

import itertools

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl.scene.clusters import centroids_of, clusters_of


def spread(points, weights, labels):
    """Weighted sum of squared distances to the centroids."""
    return float(weights @ ((points - centroids_of(points, weights, labels)[labels]) ** 2).sum(axis=1))


def test_heaps_of_points_are_found(rng):
    middles = 10 * rng.permutation(np.stack(np.meshgrid(*[range(2)] * 3), axis=-1).reshape(-1, 3))
    heap = rng.integers(0, 8, 2000)
    points = middles[heap] + rng.normal(size=(2000, 3))
    labels = clusters_of(points, rng.uniform(0.1, 1, 2000), 8)
    assert sorted(set(labels)) == list(range(8))
    assert len(set(zip(heap.tolist(), labels.tolist(), strict=True))) == 8


def test_more_clusters_are_closer(rng):
    points, weights = rng.uniform(size=(3000, 3)), rng.uniform(size=3000)
    spreads = [spread(points, weights, clusters_of(points, weights, count)) for count in (1, 8, 64, 512)]
    # In a cube, an eighth as large is half as wide; weighted points in clumps do better.
    assert all(fine < 0.35 * coarse for coarse, fine in itertools.pairwise(spreads))
    assert np.array_equal(clusters_of(points, weights, 64), clusters_of(points.copy(), weights, 64))


@pytest.mark.parametrize("count", [1, 5])
def test_points_that_are_one_stay_together(count):
    points, weights = np.full((9, 3), 0.3), np.ones(9)
    labels = clusters_of(points, weights, count)
    assert set(labels) == {0}
    assert np.abs(centroids_of(points, weights, labels) - 0.3).max() < ROUNDED


def test_few_points_are_a_cluster_each():
    assert clusters_of(np.eye(3), np.ones(3), 3).tolist() == [0, 1, 2]
