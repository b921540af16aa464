"""What was started on the device, and may not have ended."""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from tfm_cl.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


class Running:
    """Work that the device does, or will do when what was started before has ended.

    Parameters
    ----------
    end
        Waits, and tells the seconds on the device; it is called once.

    Attributes
    ----------
    has_failed
        Whether it was waited for, or read, in vain: what it was to make may be anything.
    """

    def __init__(self, end: Callable[[], float]) -> None:
        self._end: Callable[[], float] | None = end
        self._seconds = 0.0
        self.has_failed = False

    def wait(self) -> float:
        """Wait for it, and return its seconds on the device.

        Raises
        ------
        DeviceError
            The device failed.
        """
        if self._end is not None:
            end, self._end = self._end, None
            self.has_failed = True
            self._seconds = end()
            self.has_failed = False
        return self._seconds

    def give_up(self) -> None:
        """Wait for it, so that it is known whether it failed."""
        with contextlib.suppress(DeviceError):
            self.wait()


class Finding(Generic[T]):
    """What the device is to find: the host reads it when it is first asked for.

    Parameters
    ----------
    running
        What finds it.
    read
        Reads it; called once.
    nbytes
        Of what is read.
    """

    def __init__(self, running: Running, read: Callable[[], T], nbytes: int) -> None:
        self.running, self.nbytes = running, nbytes
        self._read: Callable[[], T] | None = read

    @property
    def found(self) -> T:
        """Itself.

        Raises
        ------
        DeviceError
            The device failed.
        """
        if self._read is not None:
            self.running.wait()
            failed, self.running.has_failed = self.running.has_failed, True  # until it is read, too
            self._found = self._read()
            self._read, self.running.has_failed = None, failed
        return self._found


class InTurn:
    """Work of which few pieces are under way: during one, the host prepares the next.

    Parameters
    ----------
    most
        Pieces, at most, that are under way; 1: each is waited for at once.
    """

    def __init__(self, most: int = 2) -> None:
        self._most = most
        self._under_way = deque[Running]()
        self._seconds = 0.0

    def add(self, running: Running) -> None:
        """Take note of a piece that was started, and wait for one before it if there are so many."""
        self._under_way.append(running)
        self._wait(self._most - 1)

    def wait(self) -> float:
        """Wait for all, and return their seconds on the device."""
        return self._wait(0)

    def _wait(self, left: int) -> float:
        while len(self._under_way) > left:
            self._seconds += self._under_way.popleft().wait()
        return self._seconds
