"""Code shared by the two VDB formats: bounded reading of bytes, and codecs.

A file's bytes are never trusted: `Cursor` stops at their end, and no codec writes more than was requested.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import blosc
import numpy as np
from blosc import blosc_extension
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError

MAX_PACKING = 1100
"""Largest ratio by which a block may expand when it is unpacked: zlib reaches at most 1032:1, LZ4 255:1."""


# ------------------------------------------------------------------------------------------------ bytes


def map_file(path: Path) -> memoryview:
    """Map a file into memory, read-only; pages are read from disk when they are accessed."""
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            return memoryview(b"")
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


@cache
def _form(layout: str) -> struct.Struct:
    return struct.Struct("<" + layout)


class Cursor:
    """A reading position in little-endian bytes; every read is checked against their end.

    Parameters
    ----------
    data
        All the bytes.
    source
        Their origin, for messages: the file, or a grid in it.
    at
        Byte at which to begin.
    """

    def __init__(self, data: memoryview, source: str, at: int = 0) -> None:
        self.data = data
        self.source = source
        self.at = at

    def take(self, size: int, what: str) -> memoryview:
        """Read ``size`` bytes; raises `VolumeError` if there are fewer."""
        end = self.at + size
        if size < 0 or self.at < 0 or end > len(self.data):
            raise self.damaged(f"{what} should take {size} bytes, the data end at byte {len(self.data)}")
        taken = self.data[self.at : end]
        self.at = end
        return taken

    def numbers(self, layout: str, what: str) -> tuple[Any, ...]:
        """Read numbers as `struct` describes them in ``layout``, without padding."""
        form = _form(layout)
        return form.unpack(self.take(form.size, what))

    def array(self, dtype: np.dtype[Any], count: int, what: str) -> NDArray[Any]:
        """Read ``count`` items of ``dtype``; a view, not a copy."""
        return np.frombuffer(self.take(dtype.itemsize * count, what), dtype)

    def text(self, what: str) -> str:
        """Read a string that follows its 32-bit length; bytes that are not UTF-8 are replaced."""
        (length,) = self.numbers("I", what)
        return bytes(self.take(length, what)).decode(errors="replace")

    def damaged(self, why: str) -> VolumeError:
        """Return the error for invalid bytes, with the position reached."""
        return VolumeError(
            f"{self.source}: damaged or incomplete at byte {self.at}: {why}; copy or export it again"
        )


# ----------------------------------------------------------------------------------------------- codecs


_ZIP_STEP = 1 << 12
"""Bytes of a zlib stream that are unpacked at a time; they take some MiB at most, besides the output."""


def unzip(packed: memoryview, size: int, source: Cursor) -> bytes | bytearray:
    """Decompress a zlib stream that must hold exactly ``size`` bytes."""
    check_packing(packed, size, source)
    if len(packed) > _ZIP_STEP:
        plain = bytearray(size)
        unzip_into(packed, memoryview(plain), source)
        return plain
    # Of a leaf: a grid has tens of thousands.
    stream = zlib.decompressobj()
    try:
        piece = stream.decompress(packed, size + 1)
    except zlib.error as error:
        raise source.damaged(f"a zlib block does not decompress ({error})") from error
    if len(piece) != size or not stream.eof:
        raise source.damaged(f"a zlib block should hold {size} bytes")
    return piece


def unzip_into(packed: memoryview, plain: memoryview, source: Cursor) -> None:
    """Decompress a zlib stream that must fill ``plain`` exactly."""
    check_packing(packed, len(plain), source)
    stream, at = zlib.decompressobj(), 0
    try:
        for start in range(0, len(packed), _ZIP_STEP):
            # One byte more than there is room for, to detect a longer stream.
            piece = stream.decompress(packed[start : start + _ZIP_STEP], len(plain) - at + 1)
            if at + len(piece) > len(plain):
                break
            plain[at : at + len(piece)] = piece
            at += len(piece)
            if stream.eof:
                break
    except zlib.error as error:
        raise source.damaged(f"a zlib block does not decompress ({error})") from error
    if at != len(plain) or not stream.eof:
        raise source.damaged(f"a zlib block should hold {len(plain)} bytes")


_BLOSC_HEADER = 16
"""Bytes before a Blosc block's data, and the fewest that it has."""


def unblosc(packed: memoryview, size: int, source: Cursor) -> bytearray:
    """Decompress a Blosc block that must hold exactly ``size`` bytes."""
    check_packing(packed, size, source)
    plain = bytearray(size)
    unblosc_into(packed, memoryview(plain), source)
    return plain


def unblosc_into(packed: memoryview, plain: memoryview, source: Cursor) -> None:
    """Decompress a Blosc block that must fill ``plain`` exactly."""
    size = len(plain)
    check_packing(packed, size, source)
    # The header is checked first, since the decoder trusts the sizes in it.
    if len(packed) < _BLOSC_HEADER:
        raise source.damaged(f"a Blosc block of {len(packed)} bytes is shorter than its header")
    plain_size, block_size, packed_size = struct.unpack_from("<3I", packed, 4)
    if plain_size != size or packed_size != len(packed) or not 0 < block_size <= max(size, 1 << 16):
        raise source.damaged(
            f"a Blosc block claims {packed_size} bytes for {plain_size} in blocks of {block_size}; "
            f"it has {len(packed)} for {size}"
        )
    if size == 0:
        return
    try:
        blosc.decompress_ptr(packed, np.frombuffer(plain, np.uint8).ctypes.data)
    except (blosc_extension.error, ValueError) as error:
        raise source.damaged(f"a Blosc block does not decompress ({error})") from error


def check_packing(packed: memoryview, size: int, source: Cursor) -> None:
    """Refuse a size that the compressed bytes cannot expand to, before it is allocated."""
    if size > MAX_PACKING * len(packed):
        raise source.damaged(f"{len(packed)} compressed bytes cannot hold {size}")
