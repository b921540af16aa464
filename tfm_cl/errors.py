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
has a line for each, which are the error's ``args``; of very many the message is the first few.
"""

import contextlib
import difflib
import re
from collections.abc import Iterator, Mapping
from typing import Self

OUT_OF_MEMORY = "out of memory: the volume, map or image is too large for this machine"
"""What is told of a `MemoryError`."""
MOST_TOLD = 20
"""Faults of a scene file that are told one by one; all are the error's ``args``."""

Key = tuple[str | int, ...]
"""Where something is in a scene file: keys, and numbers of tables of an array from 0, outermost first."""


class Fault(str):
    """One line about what is wrong, with the `Key` of what it is wrong with: empty where that is open."""

    __slots__ = ("key",)
    key: Key

    def __new__(cls, line: str, key: Key = ()) -> Self:
        """Make one; the key of a line that is a fault already stays."""
        fault = super().__new__(cls, line)
        fault.key = key or getattr(line, "key", ())
        return fault

    def __reduce__(self) -> tuple[type[Self], tuple[str, Key]]:
        """Tell pickle what it is made of."""
        return type(self), (str(self), self.key)

    def within(self, where: str) -> Self:
        """Return the same with the place in front."""
        return type(self)(f"{where}: {self}", self.key)

    def below(self, *key: str | int) -> Self:
        """Return the same of a table that has this key itself."""
        return type(self)(str(self), (*key, *self.key))


class TfmError(Exception):
    """Base class; ``exit_code`` is what the command line returns."""

    exit_code = 1

    @property
    def lines(self) -> list[str]:
        """What is told: a line for each fault; of very many the first `MOST_TOLD`, and how many there are."""
        lines = [str(line) for line in self.args]
        more = len(lines) - MOST_TOLD
        return [*lines[:MOST_TOLD], f"and {more:,} more"] if more > 1 else lines

    def __str__(self) -> str:
        """Return the message, its `lines`."""
        return "\n".join(self.lines)


class TfmWarning(UserWarning):
    """What a user should know of a picture, which was made all the same; a line each."""


class InputError(TfmError):
    """Wrong use or bad input."""

    exit_code = 2


class VolumeError(InputError):
    """A volume file or array that cannot be used."""


class SceneError(InputError):
    """A scene file, a setting or an option that cannot be used; takes a line for each fault."""

    @property
    def faults(self) -> list[Fault]:
        """Its lines."""
        return [Fault(line) for line in self.args]

    def within(self, where: str) -> "SceneError":
        """Return the same with the place in front of every fault."""
        return SceneError(*(fault.within(where) for fault in self.faults))


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
    def collect(self, where: str = "", *key: str | int) -> Iterator[None]:
        """Add what a `SceneError` raised inside the block says of the table with the key.

        The place comes in front of each line.
        """
        try:
            yield
        except SceneError as error:
            found = error.within(where) if where else error
            self.add(*(fault.below(*key) for fault in found.faults))

    def raise_any(self) -> None:
        """Raise a `SceneError` of all faults, if there are any."""
        if self._lines:
            raise SceneError(*dict.fromkeys(self._lines))


def nearest(name: str, known: list[str]) -> str | None:
    """Return the valid name that is meant by one that is not, if any is like it."""
    return next(iter(difflib.get_close_matches(name, known, n=1, cutoff=0.5)), None)


def words(said: Mapping[str, str]) -> dict[str, str]:
    """Turn what to write instead -> names with spaces between into what `meant_by` takes."""
    return {name: instead for instead, names in said.items() for name in names.split()}


def meant_by(key: str, words: Mapping[str, str]) -> str | None:
    """Return what ``words`` say of a name that other programs have; they are its small letters and digits."""
    return words.get(re.sub(r"[^a-z0-9]", "", key.lower()))


def unknown_key(key: str, known: list[str], section: str = "", words: Mapping[str, str] | None = None) -> str:
    """One line about an unknown name: where, what, and what to write instead.

    Parameters
    ----------
    known
        All valid names, of which the nearest is told.
    words
        Names that other programs have, as `meant_by` reads them -> the valid name, or what to do.
    """
    where = f" in [{section}]" if section else ""
    said = meant_by(key, words or {}) or ""
    if said in known or " " in said:  # what is one word is a key, which this section may lack
        return f"unknown key {key!r}{where}; " + (f"write '{said}'" if said in known else said)
    near = nearest(key, known)
    hint = f"did you mean '{near}'? known" if near else "known"
    return f"unknown key {key!r}{where}; {hint}: {', '.join(known)}"
