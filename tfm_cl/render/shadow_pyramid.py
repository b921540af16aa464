"""Bounds of shadow maps, by which kernels tell stretches of rays that are all lit or all dark.

A level k has an entry for every 2^k texels along both axes: the least and the largest distance among the
next 4 · 2^k, so that any square of up to 3 · 2^k + 1 texels lies within one entry's. See
``kernels/light/stretch.h``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import SHADOW_FIRST_LEVEL
from tfm_cl.interrupts import check_cancelled

Pick = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
"""The lesser or the larger of two numbers."""
WINDOW = 4
"""Cells along a side of what an entry bounds."""


def bounds_res(res: NDArray[np.int64] | int) -> NDArray[np.int64]:
    """Entries along a side of the finest level, of maps of some sizes: a power of two."""
    cells = -(-np.asarray(res) >> SHADOW_FIRST_LEVEL)
    return np.asarray(2 ** np.ceil(np.log2(np.maximum(cells, WINDOW))).astype(np.int64))


def bounds_size(res: NDArray[np.int64] | int) -> NDArray[np.int64]:
    """Numbers of all levels of maps of some sizes: two an entry."""
    return np.asarray(2 * (4 * bounds_res(res) ** 2 - 1) // 3)


def shadow_bounds(maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the bounds of maps of one size.

    Parameters
    ----------
    maps
        Distances [n, res, res].

    Returns
    -------
    float32 [n, bounds_size(res)]: least and largest distance of each entry, level by level, row by row.

    Raises
    ------
    CancelledError
        What this thread does was cancelled.
    """
    count, res, _ = maps.shape
    whole = int(bounds_res(res)) << SHADOW_FIRST_LEVEL
    found = np.empty((count, int(bounds_size(res)) // 2, 2), np.float32)
    for which, (pick, padding) in enumerate(((np.minimum, np.inf), (np.maximum, -np.inf))):
        cells = _padded(maps, whole - res, padding)
        for _ in range(SHADOW_FIRST_LEVEL):
            check_cancelled()
            cells = _halved(cells, pick)
        first = 0
        while size := cells.shape[1]:
            found[:, first : first + size**2, which] = _windows(cells, pick, padding).reshape(count, -1)
            first += size**2
            cells = _halved(cells, pick)
    return found.reshape(count, -1)


def _padded(cells: NDArray[np.float32], width: int, padding: float) -> NDArray[np.float32]:
    """Append rows and columns that bound nothing."""
    return np.pad(cells, ((0, 0), (0, width), (0, width)), constant_values=padding) if width else cells


def _halved(cells: NDArray[np.float32], pick: Pick) -> NDArray[np.float32]:
    """Pick among two cells along both axes; nothing is left of a single one."""
    half = cells.shape[1] // 2
    rows = pick(cells[:, 0 : 2 * half : 2], cells[:, 1::2])
    return pick(rows[..., 0 : 2 * half : 2], rows[..., 1::2])


def _windows(cells: NDArray[np.float32], pick: Pick, padding: float) -> NDArray[np.float32]:
    """Pick among each cell and the next three along both axes."""
    size = cells.shape[1]
    padded = _padded(cells, WINDOW, padding)
    pairs = pick(padded[:, :-1], padded[:, 1:])
    rows = pick(pairs[:, :size], pairs[:, 2 : size + 2])
    pairs = pick(rows[..., :-1], rows[..., 1:])
    return pick(pairs[..., :size], pairs[..., 2 : size + 2])
