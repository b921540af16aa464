"""Frames of cameras and lights: where their axes lie in the world."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]
"""World units."""


def look_at(origin: Point, target: Point, up: Point) -> NDArray[np.float64]:
    """World-from-local frame with z towards ``target``, y as near to ``up`` as can be, x = y-right."""
    forward = np.subtract(target, origin)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([right, np.cross(right, forward), forward, origin])
    return matrix


def facing(origin: Point, target: Point) -> NDArray[np.float64]:
    """4×4 world-from-light at ``origin`` with z towards ``target``; the map's rows are horizontal."""
    return _facing(origin, target).copy()


@lru_cache(maxsize=1 << 14)
def _facing(origin: Point, target: Point) -> NDArray[np.float64]:
    """`facing`, cached, since it is called often and for many lights."""
    axis = np.subtract(target, origin)
    # Any up will do that is not along the axis.
    up = (0.0, 1.0, 0.0) if abs(axis[1]) < 0.99 * np.linalg.norm(axis) else (0.0, 0.0, 1.0)
    return look_at(origin, target, up)
