"""One cache of what a session has made: known by content, bounded in bytes."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")

BUDGET = 2 << 30
"""Bytes, on host and device together, that are kept for the next frames, unless a caller asks otherwise."""


class Cache:
    """Keeps what was made, the most recently used first, as long as it fits.

    Keys hold all that a value depends on, so that a hit is what would be made again. The latest value stays
    whatever its size: it is in use.

    Parameters
    ----------
    budget
        Bytes.
    """

    def __init__(self, budget: int = BUDGET) -> None:
        self.budget = budget
        self.made: Counter[str] = Counter()
        """Kind -> how often a value of it was made so far."""
        self._kept: OrderedDict[tuple[str, Hashable], tuple[Any, int]] = OrderedDict()
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Bytes kept."""
        return self._nbytes

    def get(self, kind: str, key: Hashable, make: Callable[[], T], nbytes: Callable[[T], int]) -> T:
        """Return the value of a key, made now if it is not kept.

        Parameters
        ----------
        kind
            What it is, for `made`: ``"bricks"``, ``"map"``.
        nbytes
            Size of a value.
        """
        place = kind, key
        if place in self._kept:
            self._kept.move_to_end(place)
        else:
            value = make()
            size = nbytes(value)
            self.made[kind] += 1
            self._kept[place] = value, size
            self._nbytes += size
            self._shrink()
        found: T = self._kept[place][0]
        return found

    def _shrink(self) -> None:
        while len(self._kept) > 1 and self._nbytes > self.budget:
            _, (_, size) = self._kept.popitem(last=False)
            self._nbytes -= size

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
        self._nbytes = 0
