"""Many weighted points as a few clusters that change as little as the points do: soft k-means.

Where points belong to the nearest of some centres, a small change sends many of them elsewhere: clusters that
are found anew in each frame of a fire jump. So nothing here is chosen, and clusters are a continuous function
of the points and their weights.

1. Points are halved at their mean, again and again, and the number of clusters with them; those near the mean
   go to both sides, in part. All splits of a level have one direction: a diagonal of the body, another one at
   each level, drawn out as the points are by their covariance, of which less is left after each split.
2. Every point belongs to all clusters, but little to those that are further away than the nearest by more
   than a part of their size. The centroids of that are found, and points shared among them once more; further
   iterations would come nearer to the best of clusters, but these jump.

Source: D. MacKay, "Information Theory, Inference, and Learning Algorithms", Cambridge 2003, chapter 20.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

OVERLAP = 0.6
"""Half of the width over which points go to both sides of a split, in standard deviations across it."""
DIAGONALS = np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)]) / math.sqrt(3)
"""Of a body's axes: each axis has a part in all of them, so that no flat or narrow body lies across one."""
SOFT = 0.35
"""Standard deviation of a cluster's border, in that of the clusters themselves."""
FARTHEST = 14.0
"""Exponent from which on a point has no share in a cluster."""
ROUNDED = 1e-12
"""Part of what is largest that may be rounding."""
AT_ONCE = 1024
"""Points whose distances from all centroids are in memory."""


def sums_of_clusters(points: Floats, weights: Floats, values: Floats, count: int, axes: Floats) -> Floats:
    """Return what clusters hold of some values of points, [clusters, values]; their sums are the points'.

    Parameters
    ----------
    points
        [n, 3].
    weights
        [n], > 0.
    values
        [n, values].
    count
        Of clusters, at most: a cluster that gets nothing is left out.
    axes
        3×3: unit vectors of the body's axes are its columns; they and all points may be turned together.
    """
    if len(points) <= count:
        return values
    points = points - np.average(points, axis=0, weights=weights)  # which keeps digits of squares
    weights = weights / weights.sum()
    centres, shares = _split(points, weights, count, axes)
    size = float(weights @ (points**2).sum(axis=1))
    spread = max(size - float(shares @ (centres**2).sum(axis=1)), ROUNDED * size)
    if spread == 0:
        return np.asarray(values.sum(axis=0, keepdims=True))
    stiffness = 0.5 / (SOFT**2 * spread)
    moments = _shared(points, np.column_stack([weights, weights[:, None] * points]), centres, stiffness)
    moments = moments[moments[:, 0] > 0]
    centres = moments[:, 1:] / moments[:, :1]
    sums = _shared(points, np.column_stack([weights, values]), centres, stiffness)
    return np.asarray(sums[sums[:, 0] > 0, 1:])


def _split(points: Floats, weights: Floats, count: int, axes: Floats) -> tuple[Floats, Floats]:
    """Return centroids of parts of the points, around 0, and the parts' weights."""
    directions = _directions((points * weights[:, None]).T @ points, count, axes)
    projected = [points @ direction for direction in directions]
    least = max(ROUNDED * float(np.abs(points).max()), 1e-150)
    centroids, totals, left = [], [], [(np.arange(len(points)), weights, count, 0)]
    while left:
        members, shares, number, level = left.pop()
        total = shares.sum()
        if number == 1:
            centroids.append(shares @ points[members] / total)
            totals.append(total)
            continue
        along = projected[level][members]
        along -= shares @ along / total
        deviation = max(math.sqrt(shares @ along**2 / total), least)
        # Of points that lie evenly, which side gets one more is the larger by as much.
        first = (number + 1) // 2
        border = math.sqrt(3) * (2 * first / number - 1)
        part = np.clip(0.5 + (border - along / deviation) / (2 * OVERLAP), 0, 1)
        for side, of_side in ((part, first), (1 - part, number - first)):
            has = side.nonzero()[0]
            left.append((members[has], shares[has] * side[has], of_side, level + 1))
    return np.array(centroids), np.array(totals)


def _directions(covariance: Floats, count: int, axes: Floats) -> list[Floats]:
    """Return unit vectors across the splits of each level."""
    directions = []
    for level in range((count - 1).bit_length()):
        direction = covariance @ axes @ DIAGONALS[level % len(DIAGONALS)]
        direction /= max(float(np.linalg.norm(direction)), 1e-300)
        directions.append(direction)
        halved = np.eye(3) - np.outer(direction, direction) / 2
        covariance = halved @ covariance @ halved
    return directions


def _shared(points: Floats, values: Floats, centres: Floats, stiffness: float) -> Floats:
    """Return sums of values, [centres, values], where each point is shared among centres."""
    sums = np.zeros((len(centres), values.shape[1]))
    squares = (centres**2).sum(axis=1)
    for start in range(0, len(points), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        further = stiffness * (squares - 2 * points[part] @ centres.T)
        further -= further.min(axis=1, keepdims=True)
        # Which falls to 0 without a step, and knows no numbers so small that they are slow.
        shares = np.exp(-np.minimum(further, FARTHEST)) - math.exp(-FARTHEST)
        shares /= shares.sum(axis=1, keepdims=True)
        sums += shares.T @ values[part]
    return sums
