"""Area lights: a disk of light as many spot lights, the mean of whose transmittance is its soft shadow.

Each point of the disk has a map of its own, and what a medium point receives is the mean of T over them: the
shadow of the area light itself, up to the number of points. Blurring one map instead
(`tfm_cl.passes.prefilter`) blurs the density: it takes the geometric mean of T, which is darker.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tfm_cl.lights.base import Light
from tfm_cl.lights.spot import SpotLight

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


def spread(light: Light) -> tuple[Light, ...]:
    """Return the point-like lights whose sum a light is.

    Parameters
    ----------
    light
        Of any type. A spot light with a ``radius`` gives ``samples`` spot lights on its disk, which faces
        the axis, each with its part of the intensity and the same cone, turned to look at the same ``to``;
        any other light gives itself.
    """
    if not isinstance(light, SpotLight) or light.radius == 0:
        return (light,)
    right, up = light.frame().world_from_light[:3, :2].T
    offsets = light.radius * disk_points(light.samples) @ np.stack([right, up])
    part = {"intensity": np.divide(light.intensity, light.samples), "radius": 0.0}
    return tuple(light.replace(from_=light.from_ + offset, **part) for offset in offsets)
