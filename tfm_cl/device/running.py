"""What was started on the device, and may not have ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


class Running:
    """Work that the device does, or will do when what was started before has ended.

    Parameters
    ----------
    end
        Waits, and tells the seconds on the device; it is called once.

    Attributes
    ----------
    has_failed
        Whether it was waited for in vain: what it was to make may be anything.
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


class InTurn:
    """Work of which two pieces, at most, are under way: during one, the host prepares the next.

    Parameters
    ----------
    waits
        Whether each is waited for at once instead.
    """

    def __init__(self, *, waits: bool = False) -> None:
        self._waits = waits
        self._last: Running | None = None
        self._seconds = 0.0

    def add(self, running: Running) -> None:
        """Wait for the piece before one that was started."""
        self.wait()
        self._last = running
        if self._waits:
            self.wait()

    def wait(self) -> float:
        """Wait for all, and return their seconds on the device."""
        if self._last is not None:
            last, self._last = self._last, None
            self._seconds += last.wait()
        return self._seconds
