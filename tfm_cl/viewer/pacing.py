"""How large low pictures are, so that they come at a wanted rate."""

from __future__ import annotations

import math

LEAST_WIDTH = 160
"""Pixels; of pictures that are narrower in full, all."""
FIRST_WIDTH = 320
"""As long as nothing is measured."""
WIDTH_STEP = 16
"""Widths are multiples of it."""
ROOM = 0.85
"""Of the time between two pictures, what making one may take: encoding and sending take the rest."""
TOLERATED = (0.7, 1.15)
"""Part of that time within which a picture's size stays: pictures jump when it changes."""
WEIGHT = 0.4
"""Of the last measurement, in the mean of all."""
LARGEST_STEP = 2.0
"""Factor of the number of pixels from one picture to the next, at most, when they become more."""


class Pacer:
    """Chooses the size of the next low picture from the seconds that the last ones took.

    Parameters
    ----------
    rate
        Pictures per second that are wanted.
    """

    def __init__(self, rate: float) -> None:
        self._wanted = ROOM / rate
        self._area = FIRST_WIDTH * FIRST_WIDTH * 9 / 16
        """Pixels that the next picture may have."""
        self._pace: float | None = None
        """Seconds of a pixel, in the mean."""

    def size(self, full: tuple[int, int]) -> tuple[int, int]:
        """Return width and height of the next low picture of a full one, of the same shape."""
        width, height = full
        shape = height / width
        least = min(LEAST_WIDTH, width) ** 2 * shape
        self._area = min(max(self._area, least), width * height)
        wanted = math.sqrt(self._area / shape)
        low = width if wanted > width - 1 else WIDTH_STEP * math.floor(wanted / WIDTH_STEP + 1e-6)
        low = min(max(low, LEAST_WIDTH), width)
        return low, max(round(low * shape), 1)

    def took(self, seconds: float, size: tuple[int, int]) -> None:
        """Note what a low picture took, of the size asked for or another."""
        pace = seconds / (size[0] * size[1])
        self._pace = pace if self._pace is None else self._pace + WEIGHT * (pace - self._pace)
        expected = self._pace * self._area
        low, high = (part * self._wanted for part in TOLERATED)
        if not low <= expected <= high:
            self._area *= min(self._wanted / max(expected, 1e-6), LARGEST_STEP)
