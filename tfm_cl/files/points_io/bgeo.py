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

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.stored import MAX_POINTS, StoredPoints
from tfm_cl.files.volume_io.binary import MAX_PACKING

MAGIC, GZIP, VERSION = b"BgeoV", b"\x1f\x8b", 5
FLOAT, INTEGER, INDEX, VECTOR = 0, 1, 4, 5
MOST_ATTRIBUTES, MOST_NUMBERS, MOST_STRINGS = 256, 64, 1 << 16
"""Of a file, of an attribute, of an index: those of real files are far fewer."""


class _Attribute(NamedTuple):
    name: str
    numbers: int
    kind: int


class _Bytes:
    """Big-endian numbers of a stream that may end too soon."""

    def __init__(self, stream: IO[bytes], path: Path) -> None:
        self._stream, self._path = stream, path

    def take(self, size: int, what: str) -> bytes:
        """Read some bytes.

        Raises
        ------
        VolumeError
            There are fewer, or they do not decompress.
        """
        # Room for more than there can be is not even asked for.
        size_of_all = MAX_PACKING * self._path.stat().st_size
        try:
            taken = self._stream.read(min(size, size_of_all))
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise self.damaged(f"{what} cannot be decompressed ({error})") from error
        if len(taken) < size:
            raise self.damaged(f"{what} should take {size:,} bytes; {len(taken):,} are left")
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
        return _read(_Bytes(stream, path), path)


def _read(data: _Bytes, path: Path) -> StoredPoints:
    if data.take(len(MAGIC), "the header") != MAGIC:
        raise VolumeError(
            f"{path}: not a classic .bgeo file: it does not begin with {MAGIC.decode()}; save it from "
            "Houdini as .bgeo of version 5 (not .bgeo.sc), or as .ply"
        )
    version, points, _, _, _, attributes, _, _, _ = data.numbers("9i", "the header")
    if version != VERSION:
        raise VolumeError(f"{path}: .bgeo version {version}; expected {VERSION}")
    if not 0 <= points <= MAX_POINTS:
        raise VolumeError(f"{path}: {points:,} points; from 0 to {MAX_POINTS:,} can be read")
    if not 0 <= attributes <= MOST_ATTRIBUTES:
        raise data.damaged(f"{attributes} attributes of points")
    found = [_attribute(data, path) for _ in range(attributes)]
    row = 4 + sum(one.numbers for one in found)
    rows = np.frombuffer(data.take(4 * row * points, f"{points:,} points"), ">f4").reshape(points, row)
    values, at = {}, 4
    for one in found:
        numbers = rows[:, at : at + one.numbers]
        if one.kind not in (FLOAT, VECTOR):
            numbers = np.ascontiguousarray(numbers).view(">i4")
        values[one.name] = (numbers[:, 0] if one.numbers == 1 else numbers).astype(np.float32)
        at += one.numbers
    return StoredPoints(rows[:, :3].astype(np.float32), values)


def _attribute(data: _Bytes, path: Path) -> _Attribute:
    name = data.text("an attribute's name")
    count, kind = data.numbers("Hi", f"attribute {name!r}")
    if kind not in (FLOAT, INTEGER, INDEX, VECTOR) or not 0 < count <= MOST_NUMBERS:
        raise VolumeError(
            f"{path}: attribute {name!r} has {count} numbers of type {kind}; only numbers, up to "
            f"{MOST_NUMBERS} of them, can be read: export the points without it"
        )
    if kind == INDEX:
        (strings,) = data.numbers("i", f"attribute {name!r}")
        if not 0 <= strings <= MOST_STRINGS:
            raise data.damaged(f"attribute {name!r} has {strings} strings")
        for _ in range(strings):
            data.text(f"attribute {name!r}")
    else:
        data.take(4 * count, f"attribute {name!r}")
    return _Attribute(name, count, kind)
