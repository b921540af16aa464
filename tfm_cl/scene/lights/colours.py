"""Whether lights have one colour, so that what they scatter needs but one number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SAME_COLOUR = 1e-6
"""Difference, in parts of the strongest component, of colours that count as one."""
TINY = 1e-100
"""Keeps lights without intensity from a division by 0."""


def common_colour(intensities: Sequence[Sequence[float]]) -> NDArray[np.float64] | None:
    """Return the colour, at most 1, that those of some lights are multiples of; None where they differ."""
    colours = np.array(intensities, np.float64)
    most = colours.max(axis=1)
    strongest: NDArray[np.float64] = colours[most.argmax()] / max(float(most.max()), TINY)
    difference = np.abs(colours - np.outer(most, strongest)).max(axis=1)
    return strongest if (difference <= SAME_COLOUR * most).all() else None
