"""Pixels that stand for all of a film."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_PIXELS = 1 << 22
"""Of all frames together."""


def spread(pixels: NDArray[Any], frames: int) -> NDArray[Any]:
    """Return pixels from all over a frame [H, W, channels], of one of so many: [n, channels]."""
    flat = pixels.reshape(-1, pixels.shape[-1])
    most = max(MOST_PIXELS // frames, 1)
    if len(flat) <= most:
        return flat
    # Steps of the golden ratio fall into step with no row.
    places = (np.arange(most) * 0.6180339887498949 % 1 * len(flat)).astype(np.int64)
    return flat[places]
