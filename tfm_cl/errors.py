"""Every error that tfm_cl raises on purpose.

::

    TfmError
    ├── InputError             wrong use or bad input          (exit code 2)
    │   ├── VolumeError        a volume file or array that cannot be used
    │   ├── SceneError         a scene file, setting or option that cannot be used
    │   └── ImageError         an image file that cannot be read or written
    └── DeviceError            the OpenCL side failed          (exit code 3)
        ├── NoDeviceError      no OpenCL device, or none of that name
        ├── DeviceMemoryError  more memory needed than the device allows
        └── KernelBuildError   a kernel does not compile on the device

A message is one line: which file or value, what was expected, what to do. A scene file with several faults
has a line for each, which are the error's ``args``.
"""

import contextlib
import difflib
from collections.abc import Iterator


class TfmError(Exception):
    """Base class; ``exit_code`` is what the command line returns."""

    exit_code = 1

    def __str__(self) -> str:
        """Return the message, a line for each fault."""
        return "\n".join(map(str, self.args))


class InputError(TfmError):
    """Wrong use or bad input."""

    exit_code = 2


class VolumeError(InputError):
    """A volume file or array that cannot be used."""


class SceneError(InputError):
    """A scene file, a setting or an option that cannot be used; takes a line for each fault."""

    def within(self, where: str) -> "SceneError":
        """Return the same with the place in front of every fault."""
        return SceneError(*(f"{where}: {fault}" for fault in self.args))


class ImageError(InputError):
    """An image file that cannot be read or written."""


class DeviceError(TfmError):
    """The OpenCL side failed."""

    exit_code = 3


class NoDeviceError(DeviceError):
    """No OpenCL device at all, or none with the name asked for."""


class CancelledError(TfmError):
    """Work was ended from another thread, by `Renderer.cancel`."""


class DeviceMemoryError(DeviceError):
    """More memory is needed than the device allows; the message gives both numbers."""


class KernelBuildError(DeviceError):
    """A kernel does not compile on this device; the message holds the compiler's log."""


class Faults:
    """What is wrong in several places, to be told at once."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def add(self, *lines: str) -> None:
        """Add faults."""
        self._lines += lines

    @contextlib.contextmanager
    def collect(self, where: str = "") -> Iterator[None]:
        """Add what a `SceneError` raised inside the block says, with the place in front."""
        try:
            yield
        except SceneError as error:
            self.add(*(error.within(where) if where else error).args)

    def raise_any(self) -> None:
        """Raise a `SceneError` of all faults, if there are any."""
        if self._lines:
            raise SceneError(*dict.fromkeys(self._lines))


def nearest(name: str, known: list[str]) -> str | None:
    """Return the valid name that is meant by one that is not, if any is like it."""
    return next(iter(difflib.get_close_matches(name, known, n=1, cutoff=0.5)), None)


def unknown_key(key: str, known: list[str], section: str = "") -> str:
    """One line about an unknown name: where, what, and the nearest valid name."""
    where = f" in [{section}]" if section else ""
    near = nearest(key, known)
    hint = f"did you mean '{near}'? known" if near else "known"
    return f"unknown key {key!r}{where}; {hint}: {', '.join(known)}"
