"""Many weighted points as a few clusters: a recursive split, then Lloyd's iterations of weighted k-means.

The cluster with the largest weighted sum of squared distances is split at its weighted median, along the axis
on which it is widest, until there are enough; each iteration then gives every point to the nearest centroid.
Nothing is left to chance, and time is bounded by the number of points.

Source: S. Lloyd, "Least Squares Quantization in PCM", IEEE Transactions on Information Theory 28(2), 1982.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ITERATIONS = 4
"""Of Lloyd's: more move centroids by little."""
AT_ONCE = 1024
"""Points whose distances from all centroids are in memory."""


def clusters_of(points: Floats, weights: Floats, count: int) -> NDArray[np.intp]:
    """Return the cluster of each point, [n], numbers from 0 on without gaps; at most ``count`` clusters.

    Parameters
    ----------
    points
        [n, 3].
    weights
        [n], > 0.
    """
    if len(points) <= count:
        return np.arange(len(points))
    points = points - points.mean(axis=0)  # which keeps digits of squares
    labels = _split(points, weights, count)
    for _ in range(ITERATIONS):
        nearest = _nearest(points, centroids_of(points, weights, labels))
        labels = np.unique(nearest, return_inverse=True)[1]
    return labels


def centroids_of(points: Floats, weights: Floats, labels: NDArray[np.intp]) -> Floats:
    """Weighted means of clusters, [clusters, 3]."""
    total = np.bincount(labels, weights)
    moments = [np.bincount(labels, weights * along) for along in points.T]
    centroids: Floats = np.stack(moments, axis=1) / total[:, None]
    return centroids


def _nearest(points: Floats, centroids: Floats) -> NDArray[np.intp]:
    """Which centroid is nearest to each point."""
    found = np.empty(len(points), np.intp)
    squares = (centroids**2).sum(axis=1)
    for start in range(0, len(points), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        found[part] = (squares - 2 * points[part] @ centroids.T).argmin(axis=1)
    return found


def _split(points: Floats, weights: Floats, count: int) -> NDArray[np.intp]:
    heap = [(*_spread(points, weights), 0, np.arange(len(points)))]
    while len(heap) < count and heap[0][0] < 0:
        _, axis, _, members = heapq.heappop(heap)
        members = members[np.argsort(points[members, axis], kind="stable")]
        before = weights[members].cumsum()
        middle = int(np.clip(np.searchsorted(before, before[-1] / 2), 1, len(members) - 1))
        for part in (members[:middle], members[middle:]):
            # The first member of each is its own: no two entries compare beyond it.
            heapq.heappush(heap, (*_spread(points[part], weights[part]), int(part[0]), part))
    labels = np.empty(len(points), np.intp)
    for number, (*_, members) in enumerate(heap):
        labels[members] = number
    return labels


def _spread(points: Floats, weights: Floats) -> tuple[float, int]:
    """Minus the weighted sum of squared distances to the centroid, and the axis with most of it."""
    offsets = points - np.average(points, axis=0, weights=weights)
    squares = weights @ offsets**2
    return -float(squares.sum()), int(squares.argmax())
