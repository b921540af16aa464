"""How large low pictures are, so that they come at a wanted rate."""

from __future__ import annotations

import math

LEAST_WIDTH = 160
"""Pixels; of pictures that are narrower in full, all."""
FIRST_WIDTH = 320
"""As long as nothing is measured; wider pictures are as `SOON` allows, narrower ones as `ROOM` does."""
WIDTH_STEP = 16
"""Widths are multiples of it."""
FIRST_AREA = FIRST_WIDTH * FIRST_WIDTH * 9 / 16
SOON = 0.45
"""Of the time between two pictures, what making one should take: an input waits for the one in the making."""
ROOM = 0.85
"""The same, at most: encoding and sending take the rest."""
TOLERATED = (0.7, 1.15)
"""Part of the right number of pixels within which a size stays: pictures jump when it changes."""
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
        self._soon, self._most = SOON / rate, ROOM / rate
        self._area = FIRST_AREA
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
        per_pixel = max(self._pace, 1e-12)
        right = max(self._soon / per_pixel, min(FIRST_AREA, self._most / per_pixel))
        least, most = (part * right for part in TOLERATED)
        if not least <= self._area <= most:
            self._area = min(right, self._area * LARGEST_STEP)
