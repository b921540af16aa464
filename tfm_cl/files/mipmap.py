"""Images of albedo in memory: each with its averages over 2×2 texels, over 4×4, and so on (a mip pyramid)."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

EXTENSIONS = (".jpeg", ".jpg", ".png")
"""Images that an albedo may be: what they hold is from 0 to 1."""

KEPT_RES = 4096
"""Largest number of texels along each side that is kept; larger images are averaged (130 MiB at most)."""

Wrap = Literal["repeat", "clamp", "mirror"]
"""What lies beyond the image."""


@dataclass(frozen=True, eq=False, repr=False)
class Mipmap:
    """An image, linear and from 0 to 1, and its averages."""

    levels: tuple[NDArray[np.float16], ...]
    """[RGB, height, width] each, the top row first; half as large as the one before, down to one texel."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """Along u and v."""

    @classmethod
    def of(cls, image: NDArray[np.floating[Any]], wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")) -> "Mipmap":
        """Make the averages of linear values [height, width, RGB] from 0 to 1."""
        level = np.asarray(image, np.float32)
        while max(level.shape[:2]) > KEPT_RES:
            level = _halved(level)
        levels = [_stored(level)]
        while max(level.shape[:2]) > 1:
            level = _halved(level)
            levels.append(_stored(level))
        return cls(tuple(levels), wrap)

    def wrapped(self, wrap: tuple[Wrap, Wrap]) -> "Mipmap":
        """Return the same image with something else beyond it."""
        return self if wrap == self.wrap else Mipmap(self.levels, wrap)


def _stored(level: NDArray[np.float32]) -> NDArray[np.float16]:
    return np.ascontiguousarray(np.moveaxis(level, 2, 0), np.float16)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average an image to half its sides, rounded down; the mean stays."""
    for axis in (0, 1):
        image = np.moveaxis(_halved_rows(np.moveaxis(image, axis, 0)), 0, axis)
    return image


def _halved_rows(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    count = len(rows)
    if count == 1:
        return rows
    if count % 2 == 0:
        return np.float32(0.5) * (rows[::2] + rows[1::2])
    # Of an odd number each new one covers a little more than two: parts of three.
    half = count // 2
    size, first = count / half, 2 * np.arange(half)
    begin = (np.arange(half) * size - first).astype(np.float32)
    weights = np.stack([1 - begin, np.ones(half, np.float32), np.float32(size - 2) + begin])
    weights = (weights / size).astype(np.float32).reshape(3, half, *(1,) * (rows.ndim - 1))
    parts = (weights[i] * rows[first + i] for i in range(3))
    return np.asarray(sum(parts), np.float32)
