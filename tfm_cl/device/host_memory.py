"""Memory of pictures that host and device share, kept for the next ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class HostMemory:
    """Memory of arrays that are no longer used: fresh pages cost as much as filling them."""

    MOST_BYTES = 512 << 20
    """Kept at most."""

    def __init__(self) -> None:
        self._free: dict[int, list[NDArray[np.uint8]]] = {}
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Bytes kept."""
        return self._nbytes

    def take(self, nbytes: int) -> NDArray[np.uint8]:
        """Return an array of so many bytes; when it and all its views are gone, its memory is kept."""
        free = self._free.get(nbytes)
        if free:
            self._nbytes -= nbytes
        return np.asarray(_Lease(self, free.pop() if free else np.empty(nbytes, np.uint8)))

    def give_back(self, memory: NDArray[np.uint8]) -> None:
        """Keep memory, as far as there is room."""
        if self._nbytes + memory.nbytes <= self.MOST_BYTES:
            self._nbytes += memory.nbytes
            self._free.setdefault(memory.nbytes, []).append(memory)

    def clear(self) -> None:
        """Keep nothing."""
        self._free.clear()
        self._nbytes = 0


class _Lease:
    """What an array of `HostMemory` stands on."""

    def __init__(self, owner: HostMemory, memory: NDArray[np.uint8]) -> None:
        self._owner, self._memory = owner, memory
        self.__array_interface__ = memory.__array_interface__

    def __del__(self) -> None:
        self._owner.give_back(self._memory)
