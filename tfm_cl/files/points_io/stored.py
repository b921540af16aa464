"""What a file says of its points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MAX_POINTS = 1 << 26
"""Largest number of points of a file: with radius and colour 2 GiB in memory."""


@dataclass(frozen=True)
class StoredPoints:
    """Points as a file has them, with nothing left out."""

    positions: NDArray[np.float32]
    """[n, 3]: x, y, z in the file's units."""
    attributes: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """By name, [n] or [n, numbers], what is said of each point."""
