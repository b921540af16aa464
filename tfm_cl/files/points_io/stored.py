"""What a file says of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_POINTS = 1 << 26
"""Largest number of points of a file, of all its curves too: with radius and colour 2 GiB in memory."""


@dataclass(frozen=True)
class StoredPoints:
    """Points with the values that the file has; None for what it does not say. All are finite."""

    positions: NDArray[np.float32]
    """[n, 3]: x, y, z in the file's units."""
    radii: NDArray[np.float32] | None = None
    """[n]: 0 or more, in the file's units."""
    densities: NDArray[np.float32] | None = None
    """[n]"""
    opacities: NDArray[np.float32] | None = None
    """[n]: from 0 to 1 in a sound file."""
    colours: NDArray[np.float32] | None = None
    """[n, RGB]: from 0 to 1 in a sound file."""
    velocities: NDArray[np.float32] | None = None
    """[n, 3]: in the file's units a second."""
