"""Extended lights as the sum of many point-like parts, each with a map of its own.

A point in the medium receives the mean of T over the parts. With enough parts that is the soft shadow of
the whole light. Blurring a single map instead (`tfm_cl.maps.prefilter`) blurs the density: it takes the
geometric mean of T, which is darker.
"""

import math

import numpy as np
from numpy.typing import NDArray

MOST_SAMPLES = 256
"""Largest number of parts of a light; each part has a map of its own."""

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
"""Golden angle: the angle in radians between consecutive points of the spiral, with which no two points lie
on one ray from the centre (Vogel, 1979)."""


def disk_points(count: int) -> NDArray[np.float64]:
    """Spread points over the unit disk on Vogel's spiral, shifted so that their mean is the centre.

    Returns
    -------
    points
        [count, 2], each representing the same share of the area; deterministic.
    """
    number = np.arange(count)
    radius, angle = np.sqrt((number + 0.5) / count), number * GOLDEN_ANGLE
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    centred: NDArray[np.float64] = points - points.mean(axis=0)
    return centred


def sphere_directions(count: int) -> NDArray[np.float64]:
    """Spread unit vectors over the sphere on the same spiral, from +y to -y in bands of equal area.

    Returns
    -------
    directions
        [count, 3], each representing the same solid angle 4π / count; deterministic.
    """
    number = np.arange(count)
    y, angle = 1 - (2 * number + 1) / count, number * GOLDEN_ANGLE
    radius = np.sqrt(1 - y * y)
    return np.column_stack([radius * np.cos(angle), y, radius * np.sin(angle)])
