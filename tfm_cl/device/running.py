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
    """

    def __init__(self, end: Callable[[], float]) -> None:
        self._end: Callable[[], float] | None = end
        self._seconds = 0.0

    def wait(self) -> float:
        """Wait for it, and return its seconds on the device.

        Raises
        ------
        DeviceError
            The device failed.
        """
        if self._end is not None:
            end, self._end = self._end, None
            self._seconds = end()
        return self._seconds
