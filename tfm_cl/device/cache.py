"""One cache of what a session has made: known by content, bounded in bytes."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

T = TypeVar("T")

BUDGET = 2 << 30
"""Bytes, on host and device together, that are kept for the next frames, unless a caller asks otherwise."""


class Same:
    """What is known by being itself, as part of a key; it lives as long as that."""

    def __init__(self, value: object) -> None:
        self._value = value

    def __eq__(self, other: object) -> bool:
        """Tell whether both are one."""
        return isinstance(other, Same) and self._value is other._value

    def __hash__(self) -> int:
        """Of the object's identity."""
        return id(self._value)


class Cache:
    """Keeps what was made, the most recently used first, as long as it fits.

    Keys hold all that a value depends on, so that a hit is what would be made again. The latest value stays
    whatever its size, and the latest of each kind that is held: they are in use.

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
        self._held: dict[str, tuple[str, Hashable]] = {}
        """Kind -> where the value of that kind is that may not be pushed out."""
        self._used: list[set[tuple[str, Hashable]]] = [set(), set()]
        """Where the values are that were asked for since the last `forget_unused`, and before that."""
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Bytes kept."""
        return self._nbytes

    def get(
        self,
        kind: str,
        key: Hashable,
        make: Callable[[], T],
        nbytes: Callable[[T], int],
        *,
        held: bool = False,
        serves: Callable[[T], bool] | None = None,
    ) -> T:
        """Return the value of a key, made now if it is not kept.

        Parameters
        ----------
        kind
            What it is, for `made`: ``"bricks"``, ``"map"``.
        nbytes
            Size of a value.
        held
            Whether the caller goes on using it while other values are made: to push it out would free
            nothing, and the next frame would make it again.
        serves
            Whether a value that is kept is what it was to be; otherwise it is made again.
        """
        place = kind, key
        if held:
            self._held[kind] = place
        kept = self._kept.get(place)
        if kept is not None and serves is not None and not serves(kept[0]):
            self._forget(place)
            kept = None
        if kept is not None:
            self._kept.move_to_end(place)
            self._used[0].add(place)
            found: T = kept[0]
            return found
        return self._put(kind, key, make(), nbytes)

    def get_many(
        self,
        kind: str,
        keys: Sequence[Hashable],
        make: Callable[[list[int]], Sequence[T]],
        nbytes: Callable[[T], int],
    ) -> list[T]:
        """Return the values of many keys, in their order; those that are not kept are made together.

        Parameters
        ----------
        make
            Given places in ``keys``, makes their values.
        """
        first: dict[Hashable, int] = {}
        for place, key in enumerate(keys):
            first.setdefault(key, place)
        found: dict[Hashable, T] = {}
        for key in first:
            if (kept := self._kept.get((kind, key))) is not None:
                self._kept.move_to_end((kind, key))
                self._used[0].add((kind, key))
                found[key] = kept[0]
        missing = [key for key in first if key not in found]
        # What is made may push out what was found.
        for key, value in zip(missing, make([first[key] for key in missing]) if missing else (), strict=True):
            found[key] = self._put(kind, key, value, nbytes)
        return [found[key] for key in keys]

    def _put(self, kind: str, key: Hashable, value: T, nbytes: Callable[[T], int]) -> T:
        size = nbytes(value)
        self.made[kind] += 1
        self._kept[kind, key] = value, size
        self._used[0].add((kind, key))
        self._nbytes += size
        self._shrink()
        return value

    def _shrink(self) -> None:
        in_use = {next(reversed(self._kept)), *self._held.values()}
        while self._nbytes > self.budget:
            oldest = next((place for place in self._kept if place not in in_use), None)
            if oldest is None:
                break
            self._forget(oldest)

    def _forget(self, place: tuple[str, Hashable]) -> None:
        _, size = self._kept.pop(place)
        self._nbytes -= size

    def forget_unused(self) -> None:
        """Forget what was not asked for since this was called the last time but one."""
        in_use = {*self._used[0], *self._used[1], *self._held.values()}
        for place in [place for place in self._kept if place not in in_use]:
            self._forget(place)
        self._used = [set(), self._used[0]]

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
        self._held.clear()
        self._used = [set(), set()]
        self._nbytes = 0
