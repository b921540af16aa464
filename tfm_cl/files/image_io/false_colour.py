"""Numbers as colours, for looking at them: colour maps, and the range that they span.

The colours of ``viridis`` and ``magma`` are those of Matplotlib's maps of these names by Nathaniel J. Smith,
Stéfan van der Walt and Eric Firing, which are in the public domain (CC0): each 15th of their 256, between
which they are interpolated, within 5 of 255. Equal steps of a number look equally large, in grey too.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Codes = NDArray[np.uint8]

SEEN = 0.995
"""Part of the numbers, at either end, that a range reaches: a few that stand out leave the others their
colours."""
FAR_OUT = 3.0
"""Tukey's outer fences: what is so many interquartile ranges beyond the quartiles stands out."""
MOST_NUMBERS = 1 << 16
"""From which a range is chosen; of more, evenly spread ones."""
ENTRIES = 1024
"""Of a colour map, once it is interpolated."""


Stops = tuple[tuple[int, int, int], ...]
"""sRGB codes of a colour map at even distances, from the lowest number to the highest."""
Name = Literal["viridis", "magma", "signed"]
COLOURS: dict[Name, Stops] = {
    "viridis": (
        *((68, 1, 84), (72, 23, 105), (71, 42, 122), (67, 61, 132), (61, 78, 138), (53, 94, 141)),
        *((46, 109, 142), (41, 123, 142), (35, 137, 142), (31, 151, 139), (33, 165, 133), (46, 179, 124)),
        *((70, 192, 111), (101, 203, 94), (137, 213, 72), (176, 221, 47), (216, 226, 25), (253, 231, 37)),
    ),
    "magma": (
        *((0, 0, 4), (9, 7, 32), (26, 16, 66), (49, 17, 101), (74, 16, 121), (98, 25, 128)),
        *((121, 34, 130), (145, 43, 129), (170, 51, 125), (194, 59, 117), (217, 70, 107), (236, 88, 96)),
        *((247, 114, 92), (252, 142, 100), (254, 170, 116), (254, 198, 138), (253, 226, 163)),
        (252, 253, 191),
    ),
    "signed": ((150, 215, 255), (40, 120, 220), (0, 0, 0), (215, 95, 20), (255, 225, 150)),
}
"""``signed`` is black in the middle, blue below and orange above it, as errors are."""


def _table(colours: Stops) -> Codes:
    """Return `ENTRIES` colours between the first and the last."""
    at, stops = np.linspace(0, len(colours) - 1, ENTRIES), np.arange(len(colours))
    channels = [np.interp(at, stops, channel) for channel in np.array(colours).T]
    return np.round(np.stack(channels, axis=1)).astype(np.uint8)


_TABLES = {name: _table(colours) for name, colours in COLOURS.items()}


def coloured(numbers: Floats, ends: tuple[float, float], colours: Name) -> Codes:
    """Colour numbers [...], of which those beyond the ends have the last colours: sRGB codes [..., 3]."""
    low, high = ends
    scale = (ENTRIES - 1) / (high - low) if high > low else 0.0
    at = (numbers.astype(np.float64) - low) * scale
    # NaN has no place: it counts as the lowest.
    return _TABLES[colours][np.nan_to_num(np.clip(at, 0, ENTRIES - 1) + 0.5).astype(np.intp)]


def quantiles(numbers: Floats, *parts: float) -> tuple[float, ...]:
    """Return the finite numbers that so many parts of them do not exceed; none where there are none."""
    flat = numbers[np.isfinite(numbers)]
    flat = flat[:: -(-flat.size // MOST_NUMBERS)] if flat.size else flat
    return tuple(map(float, np.quantile(flat, parts))) if flat.size else ()


def range_of(numbers: Floats) -> tuple[float, float]:
    """Choose the ends of a colour map from numbers [...] of which 0 means that there is nothing.

    Returns
    -------
    tuple of two floats
        What all but the lowest and the highest 0.5 % lie between, but no further from the middle half of
        them than `FAR_OUT` times as far as that reaches: a ground's horizon has no end. 0 and 1 where there
        is nothing.
    """
    found = quantiles(numbers[numbers != 0], 1 - SEEN, 0.25, 0.75, SEEN)
    if not found:
        return 0.0, 1.0
    low, quarter, three_quarters, high = found
    reach = FAR_OUT * (three_quarters - quarter)
    return (max(low, quarter - reach), min(high, three_quarters + reach)) if reach > 0 else (low, high)


def range_from_zero(numbers: Floats) -> tuple[float, float]:
    """Choose the ends for numbers ≥ 0 [...] of which 0 is best: 0, and what 99.5 % of the others reach."""
    highest = quantiles(numbers[numbers != 0], SEEN)
    return 0.0, (highest[0] if highest and highest[0] > 0 else 1.0)


def range_around_zero(numbers: Floats) -> tuple[float, float]:
    """Choose the ends for numbers [...] of either sign, as far below 0 as above it."""
    _, high = range_from_zero(np.abs(numbers))
    return -high, high
