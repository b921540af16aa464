"""Between two places: matrices taken apart into a shift, a turn and a stretch, and put together again."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STILL = 1e-9
"""Angle in radians below which nothing turns."""


class Decomposed(NamedTuple):
    """A 4×4 matrix in parts that can be interpolated: shift · turn · stretch.

    Turn and stretch are its polar decomposition (Shoemake & Duff, "Matrix animation and polar
    decomposition", 1992).
    """

    shift: Floats
    """[3]."""
    turn: Floats
    """Unit quaternion [4]: x, y, z, w."""
    stretch: Floats
    """3×3, symmetric; negative where the matrix mirrors."""

    @classmethod
    def of(cls, matrix: Floats) -> Decomposed:
        """Take an affine matrix apart."""
        left, factors, right = np.linalg.svd(matrix[:3, :3])
        sign = 1.0 if np.linalg.det(left @ right) > 0 else -1.0
        return cls(matrix[:3, 3], _quaternion(sign * left @ right), sign * (right.T * factors) @ right)

    def matrix(self) -> Floats:
        """Put it together, 4×4."""
        x, y, z, w = self.turn
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = turn @ self.stretch, self.shift
        return found


def angle_between(one: Decomposed, other: Decomposed) -> float:
    """Return the angle between two turns as quaternions, at most a quarter turn: half of that in space."""
    return float(np.arccos(min(abs(float(one.turn @ other.turn)), 1.0)))


def turned_between(one: Decomposed, other: Decomposed, along: float) -> Floats:
    """Return the turn at a part of the shorter way from one to another (slerp), a quaternion [4]."""
    angle = angle_between(one, other)
    if angle < STILL:
        return one.turn
    sign = 1.0 if one.turn @ other.turn >= 0 else -1.0
    found: Floats = (
        np.sin((1 - along) * angle) * one.turn + sign * np.sin(along * angle) * other.turn
    ) / np.sin(angle)
    return found


def affine_of(value: Any) -> Floats | None:
    """Return the matrix, 4×4, that 16 numbers or four rows say; None where they say no affine one."""
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if found.shape not in {(16,), (4, 4)}:
        return None
    found = found.reshape(4, 4)
    return found if found[3].tolist() == [0, 0, 0, 1] else None


def _quaternion(turn: Floats) -> Floats:
    """Return the quaternion of a rotation, 3×3.

    It is the eigenvector of the largest eigenvalue of a symmetric matrix (Bar-Itzhack, "New method for
    extracting the quaternion from a rotation matrix", 2000), which has no special cases.
    """
    (a, b, c), (d, e, f), (g, h, i) = turn
    symmetric = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    found: Floats = np.linalg.eigh(symmetric)[1][:, -1]
    return found
