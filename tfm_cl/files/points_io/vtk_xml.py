"""VTK's XML files, ``.vtu`` and ``.vtp``: the points and what is said of them; cells are left alone.

("VTK File Formats", https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html)::

    <VTKFile type="UnstructuredGrid | PolyData" byte_order=... header_type="UInt32 | UInt64" compressor=...>
      <UnstructuredGrid> <Piece NumberOfPoints=...>
        <Points> <DataArray type="Float32" NumberOfComponents="3" format=.../> </Points>
        <PointData> <DataArray Name=... type=... NumberOfComponents=... format=.../> ... </PointData>
      </Piece> ... </UnstructuredGrid>
      <AppendedData encoding="raw | base64"> _ bytes </AppendedData>
    </VTKFile>

An array's numbers are text (``ascii``), base64 (``binary``), or at an offset into the appended data. Bytes
follow their number, a header; compressed ones follow the number of blocks, a block's size, that of the last
one if it is another, and each block's compressed size. In base64, the header of compressed bytes is encoded
alone.

meshio, which reads such files too, decompresses without a limit.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.attributes import check_count, is_known, points_of
from tfm_cl.files.points_io.lines import numbers_of_text, typed
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.volume_io.binary import Cursor, map_file, unzip

KINDS = ("UnstructuredGrid", "PolyData")
ByteOrder = Literal["<", ">"]
ORDERS: dict[str, ByteOrder] = {"LittleEndian": "<", "BigEndian": ">"}
HEADERS: dict[str, Literal["u4", "u8"]] = {"UInt32": "u4", "UInt64": "u8"}
TYPES = {
    **{f"Int{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)},
    "Float32": "f4",
    "Float64": "f8",
}
ZLIB = "vtkZLibDataCompressor"
MOST_XML = 1 << 28
"""Bytes of the text, without appended data; as a tree it takes a few times as many."""
MOST_TAGS = 1_000_000
MOST_NUMBERS = 16
"""Of a point, in an attribute that is read at all."""

T = TypeVar("T")


def read(path: Path) -> StoredPoints:
    """Read all points of a file; pieces are joined.

    Raises
    ------
    VolumeError
        Not such a file, damaged, too large, or compressed by something else than zlib.
    """
    file = _File(path)
    pieces = list(file.pieces())
    if not pieces:
        raise VolumeError(f"{path}: holds no piece with points")
    names = pieces[0][1].keys()
    if any(attributes.keys() != names for _, attributes in pieces):
        raise VolumeError(f"{path}: its pieces do not have the same attributes")
    try:
        positions = np.concatenate([positions for positions, _ in pieces])
        attributes = {name: np.concatenate([of_piece[name] for _, of_piece in pieces]) for name in names}
    except ValueError as error:
        raise VolumeError(f"{path}: its pieces do not fit together ({error})") from error
    return points_of(path, positions, attributes)


@dataclass(frozen=True)
class _Packing:
    """How a file stores bytes."""

    header: np.dtype[Any]
    order: ByteOrder
    compressed: bool


class _File:
    def __init__(self, path: Path) -> None:
        self.path, data = path, map_file(path)
        start = re.search(rb"<AppendedData[^<>]*>\s*_", data)
        size = start.start() if start else len(data)
        if size > MOST_XML:
            raise VolumeError(f"{path}: {size:,} bytes of XML; up to {MOST_XML:,} can be read")
        text = bytes(data[:size])
        if text.count(b"<") > MOST_TAGS:
            raise VolumeError(f"{path}: {text.count(b'<'):,} tags of XML; up to {MOST_TAGS:,} can be read")
        if b"<!DOCTYPE" in text:  # entities may expand without end
            raise VolumeError(f"{path}: has a DOCTYPE, which VTK's files have not")
        self.appended = data[start.end() :] if start else memoryview(b"")
        self.appended_is_raw = start is not None and re.search(rb"encoding *= *.raw", start[0]) is not None
        try:
            self.root = ET.fromstring(text + b"</VTKFile>" if start else text)  # noqa: S314 - no DOCTYPE
        except (ET.ParseError, ValueError, LookupError) as error:
            raise VolumeError(f"{path}: not readable as XML ({error})") from error
        if self.root.tag != "VTKFile" or self.root.get("type") not in KINDS:
            raise VolumeError(f"{path}: not a VTK file of {' or '.join(KINDS)}")
        if self.root.get("compressor") not in {None, "", ZLIB}:
            compressor = self.root.get("compressor", "")[:40]
            raise VolumeError(f"{path}: compressed by {compressor!r}; save it with zlib or uncompressed")
        self.packing = _Packing(
            header=np.dtype(self._one_of("header_type", "UInt32", HEADERS)),
            order=self._one_of("byte_order", "LittleEndian", ORDERS),
            compressed=bool(self.root.get("compressor")),
        )

    def _one_of(self, key: str, default: str, known: Mapping[str, T]) -> T:
        value = self.root.get(key, default)
        if value not in known:
            raise VolumeError(f"{self.path}: {key} is {value[:40]!r}; known: {', '.join(known)}")
        return known[value]

    def pieces(self) -> Iterator[tuple[NDArray[Any], dict[str, NDArray[Any]]]]:
        """Yield positions [n, 3] and attributes [n, numbers] of the pieces that have points."""
        total = 0
        for piece in self.root.iterfind("*/Piece"):
            count = self._count(piece, "NumberOfPoints", None)
            total += count
            check_count(self.path, total)
            places = piece.findall("Points/DataArray")
            if count and len(places) != 1:
                raise VolumeError(f"{self.path}: a piece has {len(places)} arrays of points; expected 1")
            if count:
                yield self._array(places[0], count), self._attributes(piece, count)

    def _attributes(self, piece: ET.Element, count: int) -> dict[str, NDArray[Any]]:
        """Read what is used of a piece's attributes."""
        found: dict[str, NDArray[Any]] = {}
        for array in piece.iterfind("PointData/DataArray"):
            name = array.get("Name", "")
            if name in found:  # many might lead to the same bytes
                raise self._damaged(f"a piece has two arrays {name!r}")
            if is_known(name):
                found[name] = self._array(array, count)
        return found

    def _count(self, element: ET.Element, key: str, default: str | None) -> int:
        text = element.get(key) or default
        if text is None or not re.fullmatch(r"\s*[0-9]{1,18}\s*", text, re.ASCII):
            raise self._damaged(f"{key} should be a whole number, not {str(text)[:20]!r}")
        return int(text)

    def _array(self, element: ET.Element, count: int) -> NDArray[Any]:
        """Read an array [count, numbers]."""
        name, kind = element.get("Name", "Points")[:40], element.get("type", "")
        if kind not in TYPES:
            raise VolumeError(f"{self.path}: {name!r} is of type {kind[:20]!r}; known: {', '.join(TYPES)}")
        dtype, each = np.dtype(TYPES[kind]), self._count(element, "NumberOfComponents", "1")
        if each > MOST_NUMBERS:
            raise self._damaged(f"{name!r} has {each:,} numbers a point")
        text, form = element.text or "", element.get("format", "ascii")
        if form == "ascii":
            values = self._of_text(text, count * each, dtype, name)
        else:
            source, raw = self._source(element, text, form, f"{self.path}: {name!r}")
            plain = self._unpacked(source, count * each * dtype.itemsize, raw=raw)
            values = np.frombuffer(plain, dtype.newbyteorder(self.packing.order))
        return values.reshape(count, each)

    def _of_text(self, text: str, count: int, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
        try:
            return typed(numbers_of_text(memoryview(text.encode()), 0, count)[0], dtype)
        except ValueError as error:
            raise self._damaged(f"{name!r} should be {count:,} numbers: {error}") from error

    def _source(self, element: ET.Element, text: str, form: str, label: str) -> tuple[Cursor, bool]:
        """Find an array's bytes, and whether they are raw or base64."""
        if form == "binary":
            return Cursor(memoryview("".join(text.split()).encode()), label), False
        if form == "appended":
            return Cursor(self.appended, label, self._count(element, "offset", None)), self.appended_is_raw
        raise self._damaged(f"an array has the format {form[:20]!r}")

    def _unpacked(self, source: Cursor, size: int, *, raw: bool) -> bytes | memoryview:
        """Return an array's ``size`` bytes from where its header begins."""
        one = self.packing.header.itemsize
        start = source.at
        first = self._taken(source, one, raw=raw)
        if not self.packing.compressed:
            if self._header(first) != [size]:
                raise source.damaged(f"should be {size:,} bytes; its header says {self._header(first)[0]:,}")
            if raw or bytes(source.data[source.at - 1 : source.at]) == b"=":
                return self._taken(source, size, raw=raw)  # the header is encoded alone
            source.at = start
            return self._taken(source, one + size, raw=raw)[one:]
        (blocks,) = self._header(first)
        source.at = start
        header = self._header(self._taken(source, one * (3 + blocks), raw=raw))
        _, block, last, *packed = header
        sizes = [block] * (blocks - bool(last)) + [last] * bool(last)
        if len(sizes) != blocks or sum(sizes) != size:
            raise source.damaged(f"should be {size:,} bytes; its blocks have {sum(sizes):,}")
        data = Cursor(memoryview(self._taken(source, sum(packed), raw=raw)), source.source)
        return b"".join(
            unzip(data.take(packed_bytes, "a block"), plain_bytes, source)
            for packed_bytes, plain_bytes in zip(packed, sizes, strict=True)
        )

    def _taken(self, source: Cursor, size: int, *, raw: bool) -> bytes | memoryview:
        """Take bytes, decoded."""
        if raw:
            return source.take(size, "the array")
        try:
            return binascii.a2b_base64(source.take(-(-size // 3) * 4, "the array"), strict_mode=True)[:size]
        except binascii.Error as error:
            raise source.damaged(f"not base64 ({error})") from error

    def _header(self, data: bytes | memoryview) -> list[int]:
        found: list[int] = np.frombuffer(data, self.packing.header.newbyteorder(self.packing.order)).tolist()
        return found

    def _damaged(self, why: str) -> VolumeError:
        return VolumeError(f"{self.path}: damaged or incomplete: {why}; copy or export it again")
