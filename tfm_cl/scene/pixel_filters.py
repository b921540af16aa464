"""Filters that make a pixel of the samples around it: one row each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PixelFilter:
    """A separable filter."""

    radius: float
    """Beyond which it is 0, pixels."""
    summary: str
    value: Callable[[Floats], Floats]
    """At distances within the radius; of any scale."""

    def __call__(self, distance: Any) -> Floats:
        """Return the filter at distances from the pixel's centre, pixels; of any scale."""
        distance = np.abs(np.asarray(distance, np.float64))
        return np.where(distance < self.radius, self.value(np.minimum(distance, self.radius)), 0.0)


SIGMA = 0.5
"""Standard deviation of the Gaussian, pixels; with its radius as in PBRT and Mitsuba."""
BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)
"""Of the four-term window (Harris, "On the Use of Windows for Harmonic Analysis", 1978, table 1)."""


def _gaussian(distance: Floats) -> Floats:
    # Less its value at the radius: it ends without a step.
    return np.asarray(np.exp(-(distance**2) / (2 * SIGMA**2)) - np.exp(-(1.5**2) / (2 * SIGMA**2)))


def _blackman_harris(distance: Floats) -> Floats:
    # From -1.5 to 1.5 pixels there is one period.
    angle = 2 * np.pi * distance / 3
    return np.asarray(sum(share * np.cos(k * angle) for k, share in enumerate(BLACKMAN_HARRIS)))


FILTERS = {
    "box": PixelFilter(0.5, "the mean over the pixel", np.ones_like),
    "gaussian": PixelFilter(
        1.5, "softer: a Gaussian, standard deviation 0.5 pixels, that ends at 1.5", _gaussian
    ),
    "blackman-harris": PixelFilter(
        1.5, "smooth, but sharper than that: the four-term window, 3 pixels wide", _blackman_harris
    ),
}
"""Name -> filter, in the order in which they are listed."""
