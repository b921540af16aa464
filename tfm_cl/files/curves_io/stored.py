"""What a file says of its curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_CURVE_POINTS = 1 << 26
"""Largest number of points of all curves of a file: with width and colour 2 GiB in memory."""


@dataclass(frozen=True)
class StoredCurves:
    """Polylines as a file has them, one after the other."""

    positions: NDArray[np.float32]
    """[n, 3]: x, y, z in the file's units."""
    counts: NDArray[np.int64]
    """[curves]: points of each, 2 or more."""
    widths: NDArray[np.float32] | None
    """[n]: the whole width, in the file's units."""
    opacities: NDArray[np.float32] | None
    """[n]: from 0 to 1."""
    colours: NDArray[np.float32] | None
    """[n, RGB], from 0 to 1."""
