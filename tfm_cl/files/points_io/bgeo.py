"""Classic Houdini geometry, ``.bgeo`` version 5: points and their attributes; primitives are left alone.

Big-endian, as a whole compressed by gzip or not (Houdini's ``dsk/docs`` of version 11, and partio's
``BGEO.cpp``)::

    char[5]  "BgeoV"
    int32    version: 5
    int32    points, primitives, point groups, primitive groups
    int32    attributes of points, vertices, primitives, the whole
    of each attribute of points:
        uint16   length of its name, and the name
        uint16   numbers a point
        int32    type: 0 float | 1 integer | 2 string | 4 index of a string | 5 vector
        float32 or int32 for each number: default; of type 4 instead
            int32    strings, and each with a uint16 length
    of each point: float32[4] x, y, z, w; then the numbers of its attributes in that order
"""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.attributes import check_count, points_of
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.volume_io.binary import MAX_PACKING

MAGIC, GZIP, VERSION = b"BgeoV", b"\x1f\x8b", 5
FLOAT, INTEGER, INDEX, VECTOR = 0, 1, 4, 5
POSITION = 4
"""Numbers of a point before its attributes: x, y, z, w."""
STEP = 1 << 20
"""Bytes that are read at a time."""
MOST_ATTRIBUTES, MOST_NUMBERS, MOST_STRINGS = 256, 64, 1 << 16
"""Of a file, of an attribute, of an index: those of real files are far fewer."""


class _Attribute(NamedTuple):
    name: str
    numbers: int
    kind: int


class _Bytes:
    """Big-endian numbers of a stream that may end too soon.

    Parameters
    ----------
    stream, path
        The file, decompressed, and its name for messages.
    largest
        Bytes that the stream can have at most.
    """

    def __init__(self, stream: IO[bytes], path: Path, largest: int) -> None:
        self._stream, self._path, self._largest = stream, path, largest

    def take(self, size: int, what: str) -> bytearray:
        """Read some bytes; memory grows with what is really there.

        Raises
        ------
        VolumeError
            There are fewer, or they do not decompress.
        """
        taken = bytearray()
        while size <= self._largest and len(taken) < size:
            try:
                piece = self._stream.read(min(size - len(taken), STEP))
            except (EOFError, zlib.error, gzip.BadGzipFile) as error:
                raise self.damaged(f"{what} cannot be decompressed ({error})") from error
            if not piece:
                break
            taken += piece
        if len(taken) < size:
            raise self.damaged(f"{what} should take {size:,} bytes; there are fewer")
        return taken

    def numbers(self, layout: str, what: str) -> tuple[Any, ...]:
        """Read numbers as `struct` has them."""
        return struct.unpack(">" + layout, self.take(struct.calcsize(">" + layout), what))

    def text(self, what: str) -> str:
        """Read a string that follows its 16-bit length."""
        (length,) = self.numbers("H", what)
        return self.take(length, what).decode("latin-1")

    def damaged(self, why: str) -> VolumeError:
        """Return the error for bytes that cannot be."""
        return VolumeError(f"{self._path}: damaged or incomplete: {why}; copy or export it again")


def read(path: Path) -> StoredPoints:
    """Read all points of a file.

    Raises
    ------
    VolumeError
        Not such a file, another version, damaged, or too large.
    """
    with path.open("rb") as file:
        packed = file.read(len(GZIP)) == GZIP
        file.seek(0)
        stream: IO[bytes] = gzip.GzipFile(fileobj=file) if packed else file  # type: ignore[assignment]
        largest = path.stat().st_size * (MAX_PACKING if packed else 1)
        return _read(_Bytes(stream, path, largest), path)


def _read(data: _Bytes, path: Path) -> StoredPoints:
    if data.take(len(MAGIC), "the header") != MAGIC:
        raise VolumeError(
            f"{path}: not a classic .bgeo file: it does not begin with {MAGIC.decode()}; save it from "
            "Houdini as .bgeo of version 5 (not .bgeo.sc), or as .ply"
        )
    version, points, _, _, _, attributes, _, _, _ = data.numbers("9i", "the header")
    if version != VERSION:
        raise VolumeError(f"{path}: .bgeo version {version}; expected {VERSION}")
    check_count(path, points)
    if not 0 <= attributes <= MOST_ATTRIBUTES:
        raise data.damaged(f"{attributes} attributes of points")
    found = [_attribute(data, path) for _ in range(attributes)]
    row = POSITION + sum(one.numbers for one in found)
    rows = np.frombuffer(data.take(4 * row * points, f"{points:,} points"), ">f4").reshape(points, row)
    values, at = {}, POSITION
    for one in found:
        numbers: NDArray[Any] = rows[:, at : at + one.numbers]
        values[one.name] = numbers if one.kind in (FLOAT, VECTOR) else numbers.view(">i4")
        at += one.numbers
    return points_of(path, rows[:, :3], values)


def _attribute(data: _Bytes, path: Path) -> _Attribute:
    name = data.text("an attribute's name")
    what = f"attribute {name[:40]!r}"
    count, kind = data.numbers("Hi", what)
    if kind not in (FLOAT, INTEGER, INDEX, VECTOR) or not 0 < count <= MOST_NUMBERS:
        raise VolumeError(
            f"{path}: {what} has {count} numbers of type {kind}; only numbers, up to "
            f"{MOST_NUMBERS} of them, can be read: export the points without it"
        )
    if kind == INDEX:
        (strings,) = data.numbers("i", what)
        if not 0 <= strings <= MOST_STRINGS:
            raise data.damaged(f"{what} has {strings} strings")
        for _ in range(strings):
            data.text(what)
    else:
        data.take(4 * count, what)
    return _Attribute(name, count, kind)
