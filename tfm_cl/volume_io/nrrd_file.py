"""NRRD volumes (``.nrrd``, or ``.nhdr`` with the data in a file beside it).

pynrrd parses the header; the data are decoded here, so that no more is ever decompressed than the header
declares. Encodings: raw, gzip, bzip2 and ascii. The one grid is named ``density``.

Placement, in the file's own world axes (a ``space`` such as left-posterior-superior is not converted):

* ``space directions`` are the edges of a voxel, and ``space origin`` is the *centre* of the first one, as
  the format defines it;
* else ``spacings`` are the edge lengths, and ``axis mins`` the low corner of the first voxel, or its
  centre where ``centers`` says ``node`` (``axis maxs`` likewise the high end, where there are no spacings);
* a position that is not told puts the low corner of voxel 0, 0, 0 at the world's origin.
"""

import bz2
import gzip
import io
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, cast

import nrrd
import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files import is_file
from tfm_cl.volume_io.grid import Grid, world_from_index_of
from tfm_cl.volume_io.raw import ByteSource, read_voxels

EXTENSIONS = (".nrrd", ".nhdr")

_TYPE_NAMES = {
    "i1": "signed char, int8, int8_t",
    "u1": "uchar, unsigned char, uint8, uint8_t",
    "i2": "short, short int, signed short, signed short int, int16, int16_t",
    "u2": "ushort, unsigned short, unsigned short int, uint16, uint16_t",
    "i4": "int, signed int, int32, int32_t",
    "u4": "uint, unsigned int, uint32, uint32_t",
    "i8": "longlong, long long, long long int, signed long long, signed long long int, int64, int64_t",
    "u8": "ulonglong, unsigned long long, unsigned long long int, uint64, uint64_t",
    "f4": "float",
    "f8": "double",
}
_DTYPES = {name: dtype for dtype, names in _TYPE_NAMES.items() for name in names.split(", ")}
_ENCODINGS = {
    "raw": "raw",
    **dict.fromkeys(("gzip", "gz"), "gzip"),
    **dict.fromkeys(("bzip2", "bz2"), "bzip2"),
    **dict.fromkeys(("ascii", "text", "txt"), "ascii"),
}
_AXES = 3
_MAX_HEADER_BYTES = 1 << 20
_MAX_SKIP_BYTES = 1 << 20  # within compressed data, where a skip must be decompressed
_MAX_DEFLATE_RATIO = 1032  # of the deflate format itself
_MAX_TOKEN = 64  # characters of a number in ascii
_HEADER_ERRORS = (nrrd.NRRDError, ValueError, IndexError, KeyError, TypeError, OverflowError)


@dataclass(frozen=True)
class _Data:
    """Where the voxels are, and how they are written."""

    path: Path
    offset: int
    encoding: str
    skip: int
    """Bytes to leave out after decompression."""
    dtype: np.dtype[Any]
    shape: tuple[int, int, int]


def open_grids(path: Path) -> list[Grid]:
    """Describe the array of a NRRD file.

    Raises
    ------
    VolumeError
        Damaged header, sizes that are not the file's, or data outside the header's folder.
    """
    header, header_bytes = _read_header(path)
    sizes = _sizes(header, path)
    type_name = " ".join(str(header["type"]).lower().split())
    encoding = _ENCODINGS.get(str(header["encoding"]).lower(), "")
    unsupported = ""
    if len(sizes) != _AXES:
        unsupported = f"it has {len(sizes)} axes, not 3"
    elif type_name not in _DTYPES:
        unsupported = f"values of type '{type_name[:40]}'"
    elif not encoding:
        unsupported = f"encoding '{str(header['encoding'])[:40]}'; known: raw gzip bzip2 ascii"
    world_from_index, has_transform = world_from_index_of((1, 1, 1), (0, 0, 0)), False
    shape, read = (0, 0, 0), partial(_refuse, path, unsupported)
    if not unsupported:
        x, y, z = sizes
        shape = (z, y, x)
        dtype = _dtype(header, type_name, encoding, path)
        data = _locate(header, header_bytes, path, encoding=encoding, dtype=dtype, shape=shape)
        read = partial(_read, data)
        world_from_index, has_transform = _placement(header, (x, y, z), path)
    return [
        Grid(
            name="density",
            grid_class="unknown",
            value_type=np.dtype(_DTYPES[type_name]).name if type_name in _DTYPES else type_name,
            shape=shape,
            world_from_index=world_from_index,
            has_transform=has_transform,
            read=read,
            unsupported=unsupported,
        )
    ]


def _refuse(path: Path, reason: str) -> NDArray[np.float32]:
    raise VolumeError(f"{path}: cannot be read: {reason}")


def _read_header(path: Path) -> tuple[Mapping[str, Any], int]:
    """Parse the fields, and count the bytes up to the data."""
    lines = []
    with path.open("rb") as stream:
        while (line := stream.readline(_MAX_HEADER_BYTES)).strip():
            lines.append(line)
            if stream.tell() > _MAX_HEADER_BYTES:
                raise VolumeError(f"{path}: not a NRRD file: no blank line ends its header within 1 MiB")
        header_bytes = stream.tell()
    if not lines or not lines[0].startswith(b"NRRD"):
        raise VolumeError(f"{path}: not a NRRD file: it must start with 'NRRD'")
    try:
        with np.errstate(all="ignore"):  # sizes such as 1e99 are refused below
            header = nrrd.read_header(lines)
    except _HEADER_ERRORS as error:
        raise VolumeError(f"{path}: damaged NRRD header ({' '.join(str(error).split())[:120]})") from error
    for field in ("dimension", "type", "encoding", "sizes"):
        if field not in header:
            raise VolumeError(f"{path}: damaged NRRD header: the field '{field}' is missing")
    return cast("Mapping[str, Any]", header), header_bytes


def _sizes(header: Mapping[str, Any], path: Path) -> list[int]:
    sizes = [int(n) for n in header["sizes"]]
    if len(sizes) != header["dimension"] or not sizes or min(sizes) < 1:
        raise VolumeError(
            f"{path}: damaged NRRD header: sizes {sizes} do not fit dimension {header['dimension']}; "
            "there must be one number > 0 for each axis"
        )
    return sizes


def _dtype(header: Mapping[str, Any], type_name: str, encoding: str, path: Path) -> np.dtype[Any]:
    dtype = np.dtype(_DTYPES[type_name])
    if encoding == "ascii":
        return np.dtype(np.float64)  # what `_Numbers` parses them to
    if dtype.itemsize == 1:
        return dtype
    endian = str(header.get("endian", "")).lower()
    if endian not in {"little", "big"}:
        raise VolumeError(f"{path}: damaged NRRD header: endian is little or big; got '{endian[:40]}'")
    return dtype.newbyteorder("<" if endian == "little" else ">")


def _locate(
    header: Mapping[str, Any],
    header_bytes: int,
    path: Path,
    *,
    encoding: str,
    dtype: np.dtype[Any],
    shape: tuple[int, int, int],
) -> _Data:
    """Find the data, and check that the file is large enough to hold them."""
    data_path, start = _data_file(header, header_bytes, path)
    file_bytes = data_path.stat().st_size
    with data_path.open("rb") as stream:
        stream.seek(start)
        offset = _skip_lines(stream, header.get("line skip", header.get("lineskip", 0)), data_path)
    skip = header.get("byte skip", header.get("byteskip", 0))
    voxels = math.prod(shape)
    least = voxels * dtype.itemsize
    compressed = encoding in {"gzip", "bzip2"}
    most = _MAX_SKIP_BYTES if compressed else file_bytes
    if not (0 <= skip <= most or (skip == -1 and encoding == "raw")):
        raise VolumeError(
            f"{path}: damaged NRRD header: byte skip must be 0 to {most:,} here, or -1 for raw data"
        )
    if skip == -1:
        offset, skip = max(offset, file_bytes - least), 0
    elif not compressed:
        offset, skip = offset + skip, 0
    if encoding == "gzip":
        least = -(-least // _MAX_DEFLATE_RATIO)
    elif encoding == "bzip2":
        least = 1  # has no useful bound; reading stops where the data do
    elif encoding == "ascii":
        least = 2 * voxels - 1  # a digit each, and what separates them
    if file_bytes - offset < least:
        z, y, x = shape
        raise VolumeError(
            f"{data_path}: holds {max(file_bytes - offset, 0):,} bytes of data, too few for {x}×{y}×{z} "
            f"voxels of type {header['type']}; the file is cut short or its header is wrong"
        )
    return _Data(data_path, offset, encoding, skip, dtype, shape)


def _data_file(header: Mapping[str, Any], header_bytes: int, path: Path) -> tuple[Path, int]:
    """Find the file of the data, and where they start in it."""
    name = header.get("data file", header.get("datafile"))
    if name is None:
        return path, header_bytes
    plain = str(name).removeprefix("./")
    if plain.startswith("LIST") or "%" in plain:
        raise VolumeError(f"{path}: its data are split over several files; join them into one")
    # A header from elsewhere must not be able to have other folders read.
    if plain in {"", ".", ".."} or any(character in plain for character in "/\\:\0"):
        raise VolumeError(f"{path}: its data file {name[:80]!r} must be a plain name, beside the header")
    data_path = path.with_name(plain)
    if not is_file(data_path):
        raise VolumeError(f"{path}: its data file {plain[:80]!r} is not beside it")
    return data_path, 0


def _skip_lines(stream: IO[bytes], lines: int, path: Path) -> int:
    """Leave out lines, and tell where the next one starts."""
    while lines > 0:
        part = stream.readline(1 << 16)
        if not part:
            raise VolumeError(f"{path}: ends within the lines to skip; its NRRD header is wrong")
        lines -= part.endswith(b"\n")
    return stream.tell()


def _placement(
    header: Mapping[str, Any], sizes: tuple[int, int, int], path: Path
) -> tuple[NDArray[np.float64], bool]:
    """World-from-index, and whether the header tells it."""
    if "space directions" in header:
        edges = _numbers(header, ("space directions",), (3, 3), path)
        matrix = np.eye(4)
        matrix[:3, :3] = edges.T
        centre = _numbers(header, ("space origin",), (3,), path) if "space origin" in header else None
        matrix[:3, 3] = edges.sum(axis=0) / 2 if centre is None else centre
        return matrix, True
    low, high = (
        _numbers(header, (f"axis {end}", f"axis{end}"), (3,), path)
        if f"axis {end}" in header or f"axis{end}" in header
        else None
        for end in ("mins", "maxs")
    )
    node = "node" in str(header.get("centers", header.get("centerings", "")))
    if "spacings" in header:
        edges = _numbers(header, ("spacings",), (3,), path)
    elif low is not None and high is not None:
        edges = (high - low) / np.maximum(np.array(sizes) - node, 1)
    elif low is None:
        return world_from_index_of((1, 1, 1), (0, 0, 0)), False
    else:
        edges = np.ones(3)
    corner = np.zeros(3) if low is None else low - edges / 2 * node
    (dx, dy, dz), (x, y, z) = edges.tolist(), corner.tolist()
    return world_from_index_of((dx, dy, dz), (x, y, z)), True


def _numbers(
    header: Mapping[str, Any], fields: tuple[str, ...], shape: tuple[int, ...], path: Path
) -> NDArray[np.float64]:
    field = next(field for field in fields if field in header)
    try:
        values = np.asarray(header[field], dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != shape or not np.isfinite(values).all():
        raise VolumeError(f"{path}: damaged NRRD header: {field} must be {math.prod(shape)} finite numbers")
    return values


def _read(data: _Data) -> NDArray[np.float32]:
    with data.path.open("rb") as stream:
        stream.seek(data.offset)
        try:
            source = _decoder(stream, data.encoding)
            source.read(data.skip)
            voxels = read_voxels(source, data.dtype, data.shape, data.path)
            # Reading on to the end also checks what checksum the encoding has.
            longer = data.encoding != "raw" and bool(source.read(1))
        except (zlib.error, EOFError, OSError, ValueError) as error:
            raise VolumeError(f"{data.path}: damaged {data.encoding} data ({error})") from error
    if longer:
        raise VolumeError(f"{data.path}: holds more voxels than its header declares; the header is wrong")
    return voxels


def _decoder(stream: IO[bytes], encoding: str) -> ByteSource:
    if encoding == "gzip":
        return gzip.GzipFile(fileobj=stream)
    if encoding == "bzip2":
        return bz2.BZ2File(stream)
    if encoding == "ascii":
        return _Numbers(stream)
    return stream


class _Numbers(io.RawIOBase):
    """Numbers written in ascii, as the bytes of float64."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._parsed = bytearray()
        self._partial = b""

    def read(self, size: int = -1, /) -> bytes:
        while len(self._parsed) < size:
            text = self._stream.read(1 << 16)
            tokens = (self._partial + text).split()
            self._partial = b""
            if text and tokens and not text[-1:].isspace():
                self._partial = tokens.pop()
            if max(map(len, [self._partial, *tokens])) > _MAX_TOKEN:
                raise ValueError(f"a number of more than {_MAX_TOKEN} characters")
            self._parsed += np.array(tokens, dtype="S").astype(np.float64).tobytes()
            if not text:
                break
        taken = bytes(self._parsed[:size])
        del self._parsed[:size]
        return taken
