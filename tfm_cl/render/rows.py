"""Pictures a few rows at a time: these fit a core's cache, and what is cancelled ends between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from collections.abc import Iterator

TOGETHER = 1 << 14
"""Pixels, at least a row."""


def rows_at_once(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield all rows of a picture [height, width, …].

    Raises
    ------
    CancelledError
        Between them: what the thread does was cancelled.
    """
    height, width = shape[:2]
    rows = max(1, TOGETHER // width)
    for top in range(0, height, rows):
        check_cancelled()
        yield slice(top, min(top + rows, height))
