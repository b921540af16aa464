"""What a file says of its curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class StoredCurves:
    """Polylines with the values that the file has, one after the other; None for what it does not say.

    All are finite.
    """

    positions: NDArray[np.float32]
    """[n, 3]: x, y, z in the file's units."""
    counts: NDArray[np.int64]
    """[curves]: points of each, 2 or more."""
    widths: NDArray[np.float32] | None = None
    """[n]: the whole width, 0 or more, in the file's units."""
    opacities: NDArray[np.float32] | None = None
    """[n]: from 0 to 1 in a sound file."""
    colours: NDArray[np.float32] | None = None
    """[n, RGB]: from 0 to 1 in a sound file."""
    velocities: NDArray[np.float32] | None = None
    """[n, 3]: in the file's units a second."""
