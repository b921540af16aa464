"""Frames of cameras and lights: where their axes lie in the world."""

from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.model_fields import accepts, numbers

Point = tuple[float, float, float]
"""World units."""
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: dict[Axis, Point] = {
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""The world's axes by their names."""


@accepts(numbers(3), {"enum": list(AXES)})
def as_direction(value: Any) -> Any:
    """Return the vector of an axis that is told by its name; what is no text as it is.

    Raises
    ------
    ValueError
        No axis of the world.
    """
    if not isinstance(value, str):
        return value
    name = value.strip().lower().removeprefix("+")
    if name not in AXES:
        raise ValueError(f"should be three numbers [x, y, z], or an axis: {', '.join(AXES)}")
    return AXES[name]


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


def from_y_up(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotation, 3×3, that takes +y to a vector of any length; none for length 0."""
    length = float(np.linalg.norm(up))
    if length == 0:
        return np.eye(3)
    x, y, z = up / length
    one_plus_y = 1 + y if y > 0 else (x * x + z * z) / (1 - y)  # which keeps its digits near -1
    if one_plus_y == 0:
        return np.diag([-1.0, -1.0, 1.0])  # of all half turns across y the one that stays in front
    cross = np.array([[0, x, 0], [-x, 0, -z], [0, z, 0]])  # v ↦ (y × up) × v
    rotation: NDArray[np.float64] = np.eye(3) + cross + cross @ cross / one_plus_y
    return rotation
