"""Numbers of files that are lines of text with arrays between them, as text or as bytes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.binary import map_file

LONGEST_LINE = 4096
"""Bytes of a line of words."""
_WORD = re.compile(rb"\S+")
_SPACE = re.compile(rb"\s*")


def numbers_of_text(data: memoryview, at: int, count: int) -> tuple[NDArray[np.float64], int]:
    """Read numbers with white space between, from byte ``at`` on; also returns where they end.

    Raises
    ------
    ValueError
        There are fewer, or something that is not a number.
    """
    # A number takes two bytes at least, with its space.
    if not 0 <= count <= (len(data) - at + 1) // 2:
        raise ValueError("there are fewer")
    end = at

    def values() -> Iterator[float]:
        nonlocal end
        for word in itertools.islice(_WORD.finditer(data, at), count):
            end = word.end()
            yield float(word[0])

    return np.fromiter(values(), np.float64, count), end


def typed(values: NDArray[np.float64], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Give numbers of text their type, which tells levels of a colour from fractions.

    Raises
    ------
    ValueError
        A whole number is beyond its type.
    """
    if dtype.kind == "f" or dtype.itemsize == 8:  # noqa: PLR2004 - float64 has not all of these
        return values
    limits = np.iinfo(dtype)
    if not ((values >= limits.min) & (values <= limits.max)).all():
        raise ValueError("it has values beyond its type")
    return values.astype(dtype)


class Lines:
    """A reading position in a file; every read is checked against its end.

    Parameters
    ----------
    path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, map_file(path), 0

    def line(self) -> str:
        """Read a line, without its end; an empty string at the end of the file.

        Raises
        ------
        VolumeError
            No line ends nearby: these are other bytes.
        """
        bytes_ahead = bytes(self.data[self.at : self.at + LONGEST_LINE])
        end = bytes_ahead.find(b"\n")
        if end < 0 and len(bytes_ahead) == LONGEST_LINE:
            raise self.damaged("a line of words should be here")
        self.at += len(bytes_ahead) if end < 0 else end + 1
        return bytes_ahead[: None if end < 0 else end].decode("latin-1").strip()

    def words(self) -> list[str]:
        """Read the next line that is not empty, as words; none at the end of the file."""
        self.skip_space()
        return self.line().split()

    def skip_space(self) -> None:
        """Go to the next byte that is not white space."""
        if space := _SPACE.match(self.data, self.at):
            self.at = space.end()

    def numbers(self, count: int, dtype: np.dtype[Any], what: str) -> NDArray[Any]:
        """Read numbers of bytes; a view, not a copy.

        Raises
        ------
        VolumeError
            There are fewer.
        """
        size = count * dtype.itemsize
        if not 0 <= size <= len(self.data) - self.at:
            raise self.damaged(f"{what} should take {size:,} bytes; {len(self.data) - self.at:,} are left")
        self.at += size
        return np.frombuffer(self.data[self.at - size : self.at], dtype)

    def text_numbers(self, count: int, what: str) -> NDArray[np.float64]:
        """Read numbers of text, with white space between.

        Raises
        ------
        VolumeError
            There are fewer, or something that is not a number.
        """
        try:
            values, self.at = numbers_of_text(self.data, self.at, count)
        except ValueError as error:
            raise self.damaged(f"{what} should be {count:,} numbers: {error}") from error
        return values

    def typed(self, values: NDArray[np.float64], dtype: np.dtype[Any], what: str) -> NDArray[Any]:
        """Give numbers of text their type; raises `VolumeError` if one is beyond it."""
        try:
            return typed(values, dtype)
        except ValueError as error:
            raise self.damaged(f"{what}: {error}") from error

    def count(self, word: str, what: str, *, least: int = 0) -> int:
        """Read a whole number from a word.

        Raises
        ------
        VolumeError
            It is none, or less than ``least``.
        """
        # Of ASCII digits only, and few enough for any file's size.
        if not re.fullmatch(r"-?[0-9]{1,18}", word) or int(word) < least:
            raise self.damaged(f"{what} should be a whole number of {least} or more, not {word[:20]!r}")
        return int(word)

    def damaged(self, why: str) -> VolumeError:
        """Return the error for bytes that cannot be, with the position reached."""
        printable = "".join(letter if letter.isprintable() else "?" for letter in why)
        return VolumeError(
            f"{self.path}: damaged or incomplete at byte {self.at}: {printable}; copy or export it again"
        )
