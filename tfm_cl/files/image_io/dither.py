"""Ordered dithering: codes that are right on average, so that slow gradients do not band."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

EXACT = 1 / 512
"""Steps from a code within which a value is that code in every pixel: flat fields of a code stay flat."""


def thresholds(x: NDArray[np.int64], y: NDArray[np.int64]) -> Floats:
    """Return what to add to a value, in steps, before it is rounded down.

    Interleaved gradient noise (Jimenez, "Next Generation Post Processing in Call of Duty: Advanced Warfare",
    SIGGRAPH 2014): over any 3 by 3 pixels the thresholds are spread almost evenly, and the same pixel always
    has the same.

    Parameters
    ----------
    x, y
        Pixels of the full frame, to be broadcast.

    Returns
    -------
    NDArray
        Between `EXACT` and 1 - `EXACT`; the mean over a patch is 1/2.
    """
    noise = (52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1)) % 1
    return EXACT + (1 - 2 * EXACT) * noise
