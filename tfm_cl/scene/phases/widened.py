"""Phase functions as light from a part of the sky, instead of one direction, shows them."""

from collections.abc import Hashable
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legval, legvander

from tfm_cl.scene.phases.base import ANGLES, PHASES, Phase

LEAST = 1e-6
"""Moments that are less than this part of their own are left out."""
OVERLAP = 0.6
"""Variance of the spread, over the square of the disk's radius: equal parts of the sky add up to an even sky
within a tenth (half the width leaves ripples of half of it)."""
ALIKE = 0.01
"""Relative difference up to which a phase function is wide enough by itself."""
COSINES = 1024
"""Of the table."""


def widened(phase: Phase, spread: float) -> Phase:
    """Return the mean of a phase function over directions around the light's.

    These are spread like a Gaussian, so that neighbouring parts of the sky overlap. What depends on how
    strands lie is wide anyway.

    Parameters
    ----------
    spread
        Radius of the disk, radians.
    """
    return phase if spread == 0 or phase.KNOWS_TANGENTS else _widened(phase, phase.content, spread)


@lru_cache(maxsize=64)
def _widened(phase: Phase, _content: Hashable, spread: float) -> Phase:
    variance = OVERLAP * spread**2  # along each axis
    count = int(np.sqrt(-2 * np.log(LEAST) / variance)) + 2
    order = np.arange(count)
    # Midpoints in the cube root of the angle, as `Phase.mean_cosine` has them: p may have a peak forwards.
    root = (np.arange(ANGLES) + 0.5) / ANGLES
    angle = np.pi * root**3
    weights = 2 * np.pi * phase.evaluate(np.cos(angle)) * np.sin(angle) * 3 * np.pi * root**2 / ANGLES
    moments = weights @ legvander(np.cos(angle), count - 1)
    # A Gaussian on the sphere multiplies each moment.
    moments *= np.exp(-order * (order + 1) * variance / 2) / moments[0]
    cosines = np.cos(np.linspace(np.pi, 0, COSINES))
    values = np.maximum(legval(cosines, (2 * order + 1) / (4 * np.pi) * moments), 0)
    if np.allclose(values, phase.evaluate(cosines), rtol=ALIKE, atol=0):
        return phase
    return PHASES["table"].from_table({"cosines": cosines, "values": values})
