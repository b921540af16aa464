"""Lights that are not a point, as the sum of many that are: each with a map of its own.

What a medium point receives is the mean of T over them: the shadow of the whole light, up to the number of
points. Blurring one map instead (`tfm_cl.maps.prefilter`) blurs the density: it takes the geometric mean
of T, which is darker.
"""

import math

import numpy as np
from numpy.typing import NDArray

MOST_SAMPLES = 256
"""Parts of a light: each has a map."""

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
"""Radians between a point and the next: no two come to lie on one ray (Vogel, 1979)."""


def disk_points(count: int) -> NDArray[np.float64]:
    """Spread points over the unit disk: Vogel's spiral, moved so that their mean is the centre.

    Returns
    -------
    points
        [count, 2], each for the same share of the area; always the same.
    """
    number = np.arange(count)
    radius, angle = np.sqrt((number + 0.5) / count), number * GOLDEN_ANGLE
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    centred: NDArray[np.float64] = points - points.mean(axis=0)
    return centred


def sphere_directions(count: int) -> NDArray[np.float64]:
    """Spread unit vectors over the sphere: the same spiral, from +y to -y, its bands of equal area.

    Returns
    -------
    directions
        [count, 3], each for the same solid angle 4π / count; always the same.
    """
    number = np.arange(count)
    y, angle = 1 - (2 * number + 1) / count, number * GOLDEN_ANGLE
    radius = np.sqrt(1 - y * y)
    return np.column_stack([radius * np.cos(angle), y, radius * np.sin(angle)])
