"""NRRD volumes (``.nrrd``, or ``.nhdr`` with the data in one or several files in the same folder or below).

Encodings: raw, gzip, bzip2, ascii and hex; never more is decompressed than the header declares. The header
is parsed here too, since pynrrd refuses fields that the format allows, such as lists of files.

An axis is not spatial if its ``kinds`` entry says so, its direction is ``none`` or its spacing is NaN. Such
axes are dropped if they have one sample. One with more samples gives

* for three channels of a colour (``RGB-color``, ``3-color``, ``XYZ-color``): the grid ``colour``;
* for a list, time and everything else: volumes ``density[0]``, ``density[1]`` …, of which one must be named.

Otherwise the only grid is ``density``.

Placement, in the file's own world axes (a ``space`` such as left-posterior-superior is not converted):

* ``space directions`` are the edges of a voxel, and ``space origin`` is the *centre* of the first one, as
  the format defines it;
* else ``spacings`` are the edge lengths, and ``axis mins`` the low corner of the first voxel, or its
  centre where ``centers`` says ``node`` (``axis maxs`` likewise the high end, where there are no spacings);
* without a position, the low corner of voxel 0, 0, 0 is at the world's origin.
"""

import bz2
import gzip
import io
import math
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import is_file
from tfm_cl.files.volume_io.decoding import ByteSource, read_voxels
from tfm_cl.files.volume_io.grid import (
    COLOUR,
    DEFAULT_NAME,
    Grid,
    as_colour,
    refuse,
    shown,
    world_from_index_of,
)

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
    "hex": "hex",
    **dict.fromkeys(("gzip", "gz"), "gzip"),
    **dict.fromkeys(("bzip2", "bz2"), "bzip2"),
    **dict.fromkeys(("ascii", "text", "txt"), "ascii"),
}
_ALIASES = {
    "datafile": "data file",
    "lineskip": "line skip",
    "byteskip": "byte skip",
    "axismins": "axis mins",
    "axismaxs": "axis maxs",
    "centerings": "centers",
}
_FIELDS = (
    *("dimension", "type", "encoding", "sizes", "endian", "data file", "line skip", "byte skip", "kinds"),
    *("centers", "spacings", "axis mins", "axis maxs", "space", "space dimension", "space directions"),
    "space origin",
)
"""Fields that describe the voxels; all others are ignored."""
_SPACE_KINDS = ("space", "domain", "none", "???")
_COLOUR_KINDS = ("rgb-color", "xyz-color", "3-color")
_VERSIONS = range(1, 6)
_AXES = 3
_MAX_AXES = 16  # limit of the format
_MAX_VOLUMES = 1024
_MAX_FILES = 1 << 16
_MAX_NAME = 4096  # limit of a path in characters
_MAX_HEADER_BYTES = 1 << 20
_MAX_SKIP_BYTES = 1 << 20  # within compressed data, where a skip must be decompressed
_MAX_DEFLATE_RATIO = 1032  # largest ratio of the deflate format
_MAX_TOKEN = 64  # characters of a number in ascii
_STEP_BYTES = 1 << 20


class _Header(NamedTuple):
    """Fields of a header as written, and what follows them."""

    path: Path
    fields: dict[str, str]
    files: list[str]
    """Lines that follow ``data file: LIST``."""
    size: int
    """Number of bytes before the data."""

    def words(self, field: str) -> list[str]:
        """Split a field at blanks; empty if it is missing."""
        return self.fields.get(field, "").split()

    def damaged(self, why: str) -> VolumeError:
        """Return the error for an invalid header."""
        return VolumeError(f"{self.path}: damaged NRRD header: {why}")

    def number(self, field: str, default: int) -> int:
        """Read a whole number."""
        text = self.fields.get(field)
        if text is None:
            return default
        if not re.fullmatch(r"[+-]?\d{1,18}", text):
            raise self.damaged(f"{field} is a whole number; got {shown(text)}")
        return int(text)

    def numbers(self, field: str) -> NDArray[np.float64] | None:
        """Read a number for each axis, NaN where it is not given; None if the field is missing."""
        words = self.words(field)
        if not words:
            return None
        try:
            values = np.array(words, np.float64)
        except ValueError:
            values = np.empty(0)
        if len(values) != self.number("dimension", 0):
            raise self.damaged(f"{field} is a number for each axis; got {shown(self.fields[field])}")
        return values

    def vectors(self, field: str) -> list[NDArray[np.float64] | None]:
        """Read vectors ``(1,0,0)``, or ``none``; no vectors if the field is missing.

        Some writers say ``(nan,nan,nan)`` for ``none``.
        """
        text = self.fields.get(field, "")
        pattern = re.compile(r"none|\(([^()]*)\)", re.IGNORECASE)
        try:
            numbers = [
                np.array((match[1] or "nan").split(","), np.float64) for match in pattern.finditer(text)
            ]
        except ValueError:
            numbers = []
        found = [None if np.isnan(vector).all() else vector for vector in numbers]
        vectors = [vector for vector in found if vector is not None]
        is_sound = len({len(vector) for vector in vectors}) <= 1 and all(
            np.isfinite(v).all() for v in vectors
        )
        if not is_sound or pattern.sub("", text).strip() or (text and not found):
            raise self.damaged(f"{field} is finite vectors '(x,y,z)' or 'none'; got {shown(text)}")
        return found


class _Axes(NamedTuple):
    """The meaning of the axes of an array, fastest first."""

    sizes: list[int]
    space: list[int]
    """Indices of the three spatial axes, as x, y, z."""
    other: int | None
    """Index of the non-spatial axis with more than one sample, if any."""
    kind: str
    """Kind of that axis."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of a volume, voxels (z, y, x)."""
        x, y, z = (self.sizes[axis] for axis in self.space)
        return z, y, x

    @property
    def volumes(self) -> int:
        """Number of volumes or channels in the array."""
        return 1 if self.other is None else self.sizes[self.other]

    @property
    def inner(self) -> int:
        """Number of consecutive values of a volume before those of the next one."""
        return 1 if self.other is None else math.prod(self.sizes[: self.other])


@dataclass(frozen=True)
class _Data:
    """Location and encoding of the voxels."""

    header: Path
    paths: tuple[Path, ...]
    offsets: tuple[int, ...]
    encoding: str
    skip: int
    """Bytes to skip after decompression, in each file."""
    dtype: np.dtype[Any]
    axes: _Axes

    @property
    def file_bytes(self) -> int:
        """Number of decoded bytes of each file."""
        return math.prod(self.axes.sizes) * self.dtype.itemsize // len(self.paths)


def open_grids(path: Path) -> list[Grid]:
    """Describe the array of a NRRD file, or the volumes that it consists of.

    Raises
    ------
    VolumeError
        The header is damaged, sizes do not match the file, or data lie outside the header's folder.
    """
    header = _read_header(path)
    sizes = _sizes(header)
    type_name = " ".join(header.fields["type"].lower().split())
    encoding = _ENCODINGS.get(header.fields["encoding"].lower(), "")
    axes = _axes(header, sizes)
    unsupported = ""
    if isinstance(axes, str):
        unsupported = axes
    elif type_name not in _DTYPES:
        unsupported = f"values of type {shown(type_name)}"
    elif not encoding:
        known = " ".join(sorted(set(_ENCODINGS.values())))
        unsupported = f"encoding {shown(header.fields['encoding'])}; known: {known}"
    described = Grid(
        name=DEFAULT_NAME,
        grid_class="unknown",
        value_type=np.dtype(_DTYPES[type_name]).name if type_name in _DTYPES else shown(type_name)[1:-1],
        shape=(0, 0, 0),
        world_from_index=world_from_index_of((1, 1, 1), (0, 0, 0)),
        has_transform=False,
        read=partial(refuse, path, DEFAULT_NAME, unsupported),
        unsupported=unsupported,
    )
    if unsupported or isinstance(axes, str):
        return [described]
    data = _locate(header, encoding, _dtype(header, type_name, encoding), axes)
    world_from_index, has_transform = _placement(header, axes)
    described = replace(
        described,
        shape=axes.shape,
        world_from_index=world_from_index,
        has_transform=has_transform,
        read=partial(_read, data, 0),
    )
    return [described] if axes.other is None else _grids_along(described, data)


def _grids_along(described: Grid, data: _Data) -> list[Grid]:
    """Describe the contents of a non-spatial axis, a colour or several volumes, and each of them."""
    axes = data.axes
    has_three = axes.volumes == len("rgb")
    if has_three and axes.kind.lower() in _COLOUR_KINDS:
        whole = as_colour(replace(described, name=COLOUR), partial(_read_colour, data))
    else:
        reason = (
            f"axis {axes.other}, of kind {shown(axes.kind)}, is not space: it holds {axes.volumes} volumes; "
            f"choose one with --grid, '{DEFAULT_NAME}[0]' to '{DEFAULT_NAME}[{axes.volumes - 1}]'"
        )
        if has_three:
            reason += ", or give the file as the colour of another volume, --set volume.colour=FILE"
        whole = replace(
            described,
            value_type=f"{axes.volumes} × {described.value_type}",
            read=partial(refuse, data.header, DEFAULT_NAME, reason),
            read_colour=partial(_read_colour, data) if has_three else None,
            unsupported=reason,
        )
    parts = (
        replace(described, name=f"{whole.name}[{n}]", is_part=True, read=partial(_read, data, n))
        for n in range(axes.volumes)
    )
    return [whole, *parts]


# ---------------------------------------------------------------------------------------------- header


def _read_header(path: Path) -> _Header:
    """Separate the fields, and count the bytes before the data."""
    lines, size = _read_lines(path)
    header = _Header(path, {}, [], size)
    for number, line in enumerate(lines, 2):
        if line.startswith("#"):
            continue
        field, colon, value = line.partition(":")
        if not colon:
            raise header.damaged(f"line {number} is no 'field: value': {shown(line)}")
        field = " ".join(field.lower().split())
        field = _ALIASES.get(field, field)
        if value.startswith("=") or field not in _FIELDS:
            continue
        if field in header.fields:
            raise header.damaged(f"the field '{field}' is there twice")
        header.fields[field] = value.strip()
        if field == "data file" and value.split()[:1] == ["LIST"]:
            header.files.extend(lines[number - 1 :])
            break
    for field in ("dimension", "type", "encoding", "sizes"):
        if not header.fields.get(field):
            raise header.damaged(f"the field '{field}' is missing")
    return header


def _read_lines(path: Path) -> tuple[list[str], int]:
    """Read the lines after the magic up to a blank line or the end, and count the bytes."""
    lines = []
    with path.open("rb") as stream:
        while (line := stream.readline(_MAX_HEADER_BYTES)).strip():
            lines.append(line.decode("utf-8", errors="replace").rstrip())
            if stream.tell() > _MAX_HEADER_BYTES:
                raise VolumeError(f"{path}: not a NRRD file: no blank line ends its header within 1 MiB")
        size = stream.tell()
    magic = lines[0].removeprefix("\ufeff") if lines else ""
    version = magic.removeprefix("NRRD")
    if magic == version or not re.fullmatch("[0-9]{1,4}", version):
        raise VolumeError(f"{path}: not a NRRD file: it must start with 'NRRD' and a version, as 'NRRD0004'")
    if int(version) not in _VERSIONS:
        raise VolumeError(
            f"{path}: NRRD version {int(version)}; versions {_VERSIONS[0]} to {_VERSIONS[-1]} can be read: "
            "it is newer than tfm_cl knows: update tfm_cl, or save it as an older version"
        )
    return lines[1:], size


def _sizes(header: _Header) -> list[int]:
    words, dimension = header.words("sizes"), header.number("dimension", 0)
    sizes = [int(word) if re.fullmatch(r"\d{1,15}", word) else 0 for word in words]
    if len(sizes) != dimension or not 1 <= len(sizes) <= _MAX_AXES or not min(sizes) > 0:
        raise header.damaged(
            f"sizes {shown(header.fields['sizes'])} do not fit dimension {dimension}; there must be one "
            "whole number > 0 for each axis"
        )
    return sizes


def _axes(header: _Header, sizes: list[int]) -> _Axes | str:
    """Distinguish spatial axes from others, or raise an error that says why they do not form a volume."""
    kinds = header.words("kinds") or ["???"] * len(sizes)
    if len(kinds) != len(sizes):
        raise header.damaged(f"kinds is a word for each axis; got {shown(header.fields['kinds'])}")
    directions, spacings = _directions(header), header.numbers("spacings")
    has_spacing = ~np.isnan(spacings) if spacings is not None else np.zeros(len(sizes), np.bool_)
    is_placed = [edge is not None for edge in directions] if directions else has_spacing.tolist()
    is_space = [
        kind.lower() in _SPACE_KINDS and (placed or not any(is_placed))
        for kind, placed in zip(kinds, is_placed, strict=True)
    ]
    space = [axis for axis, known in enumerate(is_space) if known]
    # Some writers declare all axes spatial; those with one sample are dropped first.
    for axis in reversed(space):
        if len(space) > _AXES and sizes[axis] == 1:
            space.remove(axis)
    if len(space) != _AXES:
        remedy = "; name those that are not in 'kinds', as 'list'" if len(space) > _AXES else ""
        return (
            f"it has {len(space)} axes of space, not 3 (its sizes: {shown(header.fields['sizes'])}){remedy}"
        )
    others = [axis for axis, size in enumerate(sizes) if axis not in space and size > 1]
    if not others:
        return _Axes(sizes, space, None, "")
    named = " and ".join(f"axis {axis}, of kind {shown(kinds[axis])}," for axis in others)
    if len(others) > 1:
        return f"{named} are not space; save one volume of them"
    axes = _Axes(sizes, space, others[0], kinds[others[0]])
    if axes.volumes > _MAX_VOLUMES:
        return f"{named} is not space and holds {axes.volumes:,} volumes; the limit is {_MAX_VOLUMES:,}"
    return axes


def _directions(header: _Header) -> list[NDArray[np.float64] | None]:
    """Read a voxel edge for each axis, None for non-spatial ones; empty if no edges are given.

    In a space with time, which comes last, an axis along time is not spatial.
    """
    vectors = header.vectors("space directions")
    if all(vector is None for vector in vectors):
        return []
    if len(vectors) != header.number("dimension", 0):
        text = shown(header.fields["space directions"])
        raise header.damaged(f"space directions is a vector or 'none' for each axis; got {text}")
    return [
        None if vector is None or (len(vector) > _AXES and not vector[:_AXES].any()) else vector
        for vector in vectors
    ]


def _placement(header: _Header, axes: _Axes) -> tuple[NDArray[np.float64], bool]:
    """World-from-index matrix, and whether the header defines it."""
    vectors = _directions(header)
    if vectors:
        edges = np.array([vectors[axis] for axis in axes.space])
        if edges.shape[1] < _AXES or edges[:, _AXES:].any():
            raise VolumeError(f"{header.path}: its space directions are not in three dimensions of space")
        origin = header.vectors("space origin")
        if origin and (len(origin) != 1 or origin[0] is None or len(origin[0]) != edges.shape[1]):
            raise header.damaged(f"space origin is one vector; got {shown(header.fields['space origin'])}")
        matrix = np.eye(4)
        matrix[:3, :3] = edges[:, :_AXES].T
        centre = origin[0] if origin else None
        matrix[:3, 3] = matrix[:3, :3].sum(axis=1) / 2 if centre is None else centre[:_AXES]
        return matrix, True
    spacings, low, high = (_of_space(header, field, axes) for field in ("spacings", "axis mins", "axis maxs"))
    centers = header.words("centers")
    node = np.array([axis < len(centers) and centers[axis].lower() == "node" for axis in axes.space])
    if spacings is not None:
        edges = spacings
    elif low is not None and high is not None:
        edges = (high - low) / np.maximum(np.array(axes.shape[::-1]) - node, 1)
    elif low is None:
        return world_from_index_of((1, 1, 1), (0, 0, 0)), False
    else:
        edges = np.ones(3)
    corner = np.zeros(3) if low is None else low - edges / 2 * node
    (dx, dy, dz), (x, y, z) = edges.tolist(), corner.tolist()
    return world_from_index_of((dx, dy, dz), (x, y, z)), True


def _of_space(header: _Header, field: str, axes: _Axes) -> NDArray[np.float64] | None:
    """Numbers of a field for x, y, z; None if it does not give them."""
    values = header.numbers(field)
    if values is None or np.isnan(values[axes.space]).all():
        return None
    if not np.isfinite(values[axes.space]).all():
        text = shown(header.fields[field])
        raise header.damaged(f"{field} must be finite along all axes of space; got {text}")
    found: NDArray[np.float64] = values[axes.space]
    return found


# ------------------------------------------------------------------------------------------------ data


def _dtype(header: _Header, type_name: str, encoding: str) -> np.dtype[Any]:
    dtype = np.dtype(_DTYPES[type_name])
    if encoding == "ascii":
        return np.dtype(np.float64)  # what `_Numbers` parses them to
    if dtype.itemsize == 1:
        return dtype
    endian = header.fields.get("endian", "").lower()
    if endian not in {"little", "big"}:
        raise header.damaged(f"endian is little or big; got {shown(endian)}")
    return dtype.newbyteorder("<" if endian == "little" else ">")


def _locate(header: _Header, encoding: str, dtype: np.dtype[Any], axes: _Axes) -> _Data:
    """Find the data, and check that the files are large enough to hold them."""
    names = _data_files(header, axes)
    paths = tuple(_beside(header, name) for name in names) or (header.path,)
    start = 0 if names else header.size
    lines, skip = header.number("line skip", 0), header.number("byte skip", 0)
    if lines < 0:
        raise header.damaged(f"line skip is ≥ 0; got {lines}")
    compressed = encoding in {"gzip", "bzip2"}
    if skip < -1 or (skip == -1 and encoding != "raw"):
        raise VolumeError(f"{header.path}: byte skip must be ≥ 0 here, or -1 for raw data; got {skip}")
    if compressed and skip > _MAX_SKIP_BYTES:
        raise VolumeError(f"{header.path}: byte skip is {skip:,}; the limit is {_MAX_SKIP_BYTES:,} here")
    voxels = math.prod(axes.sizes) // len(paths)
    offsets = []
    for path in paths:
        file_bytes = path.stat().st_size
        with path.open("rb") as stream:
            stream.seek(start)
            offset = _skip_lines(stream, lines, path)
        if skip == -1:
            offset = max(offset, file_bytes - voxels * dtype.itemsize)
        elif not compressed:
            offset += skip
        if file_bytes - offset < _least_bytes(encoding, voxels, dtype.itemsize):
            raise VolumeError(
                f"{path}: holds {max(file_bytes - offset, 0):,} bytes of data, too few for "
                f"{'×'.join(map(str, axes.sizes))} voxels of type {header.fields['type'][:40]}"
                f"{f' in {len(paths)} files' if len(paths) > 1 else ''}; the file is cut short or its header "
                "is wrong"
            )
        offsets.append(offset)
    return _Data(header.path, paths, tuple(offsets), encoding, skip if compressed else 0, dtype, axes)


def _least_bytes(encoding: str, voxels: int, item_bytes: int) -> int:
    if encoding == "gzip":
        return -(-voxels * item_bytes // _MAX_DEFLATE_RATIO)
    if encoding == "bzip2":
        return 1  # no useful bound; reading stops where the data end
    if encoding == "ascii":
        return 2 * voxels - 1  # one digit per number, and a separator
    return voxels * item_bytes * (2 if encoding == "hex" else 1)


class _Files(NamedTuple):
    """What ``data file`` says."""

    names: list[str]
    """In order, at most `_MAX_FILES` of them."""
    total: int
    """Of all."""
    within: str | None = None
    """Number of axes in each, where it is given."""
    is_single: bool = False


def _named(header: _Header) -> _Files:
    """Read which files hold the data; none if they are in the header's own."""
    text = header.fields.get("data file")
    if text is None:
        return _Files([], 0, is_single=True)
    if len(text) > _MAX_NAME:
        raise header.damaged(f"data file is a name; got {len(text):,} characters: {shown(text)}")
    pattern = re.fullmatch(
        r"(.*?%0?\d{0,2}[diu].*?)\s+(-?\d{1,9})\s+(-?\d{1,9})\s+([+-]?\d{1,9})(?:\s+(\d{1,2}))?", text
    )
    if pattern is not None and pattern[1].count("%") == 1:
        first, last, step = (int(pattern[n]) for n in (2, 3, 4))
        if step == 0 or (last - first) * step < 0:
            raise header.damaged(f"data file never gets from {first} to {last} in steps of {step}")
        numbers = range(first, last + (1 if step > 0 else -1), step)
        return _Files([pattern[1] % number for number in numbers[:_MAX_FILES]], len(numbers), pattern[5])
    if header.words("data file")[:1] == ["LIST"]:
        listed = re.fullmatch(r"LIST(?:\s+(\d{1,2}))?", text)
        if listed is None or not header.files:
            raise header.damaged(f"data file is LIST and maybe a number, then names; got {shown(text)}")
        return _Files(header.files, len(header.files), listed[1])
    return _Files([text], 1, is_single=True)


def named_files(path: Path) -> list[str]:
    """Return the names of the files that hold the data of a header, at most `_MAX_FILES`.

    Raises
    ------
    VolumeError
        Not the header of a NRRD file.
    OSError
        It cannot be read.
    """
    return [name.strip() for name in _named(_read_header(path)).names[:_MAX_FILES]]


def _data_files(header: _Header, axes: _Axes) -> list[str]:
    """Names of the data files in order; empty if the data are in the header's own file."""
    names, count, within, is_single = _named(header)
    if is_single:
        return names
    sizes = axes.sizes
    dimension = len(sizes) - 1 if within is None else int(within)
    if not 1 <= dimension <= len(sizes):
        raise header.damaged(f"data file says that files have {dimension} axes; the array has {len(sizes)}")
    expected = math.prod(sizes[dimension:])
    fits = sizes[-1] % count == 0 if dimension == len(sizes) else count == expected
    if not fits or count > _MAX_FILES:
        wanted = f"a divisor of {sizes[-1]}" if dimension == len(sizes) else f"{expected:,}"
        raise VolumeError(
            f"{header.path}: its data are in {count:,} files; for sizes {sizes} with {dimension} axes in "
            f"each, that is {wanted} (at most {_MAX_FILES:,})"
        )
    return names


def _beside(header: _Header, name: str) -> Path:
    """Path of a data file, which must be in the folder of its header or below."""
    plain = name.strip()
    parts = plain.split("/")
    # An untrusted header must not cause other folders to be read.
    if plain == "" or plain[-1] == "/" or plain[0] == "/" or ".." in parts or set(plain) & set("\\:\0"):
        raise VolumeError(
            f"{header.path}: its data file {shown(plain)} must lie beside the header or in a folder below, "
            "named with '/'; move it there and correct the header"
        )
    path = header.path.parent.joinpath(*parts)
    if not is_file(path):
        raise VolumeError(f"{header.path}: its data file {shown(plain)} does not exist beside it")
    return path


def _skip_lines(stream: IO[bytes], lines: int, path: Path) -> int:
    """Skip lines, and return the position of the next one."""
    while lines > 0:
        part = stream.readline(1 << 16)
        if not part:
            raise VolumeError(f"{path}: ends within the lines to skip; its NRRD header is wrong")
        lines -= part.endswith(b"\n")
    return stream.tell()


def _read(data: _Data, number: int) -> NDArray[np.float32]:
    """Read one of the volumes that an array holds."""
    axes = data.axes
    with _Source(data) as source:
        if axes.inner == 1 or axes.other is None:
            voxels = read_voxels(
                source, data.dtype, axes.shape, data.header, channels=axes.volumes, channel=number
            )
        else:
            run = axes.inner * data.dtype.itemsize
            runs = _Runs(source, run, axes.volumes, number)
            voxels = read_voxels(runs, data.dtype, axes.shape, data.header)
        source.finish()
    return voxels


def _read_colour(data: _Data) -> NDArray[np.float32]:
    """Read all channels: [z, y, x, channel]."""
    axes = data.axes
    outer = math.prod(axes.sizes) // (axes.inner * axes.volumes)
    with _Source(data) as source:
        values = read_voxels(source, data.dtype, (outer, axes.volumes, axes.inner), data.header)
        source.finish()
    rgb = np.moveaxis(values, 1, -1).reshape(*axes.shape, axes.volumes)
    return np.ascontiguousarray(rgb)


class _Source:
    """The decoded bytes of all files, concatenated."""

    def __init__(self, data: _Data) -> None:
        self._data = data
        self._next = 0
        self._left = 0
        self._stream: IO[bytes] | None = None
        self._decoded: ByteSource = io.BytesIO()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self._stream.close()

    def read(self, size: int, /) -> bytes:
        """Return ``size`` bytes, fewer only at the end; raises `VolumeError` if a file ends early."""
        taken = bytearray()
        while len(taken) < size and (self._left or self._open_next()):
            part = self._checked(min(size - len(taken), self._left))
            if not part:
                path = self._data.paths[self._next - 1]
                raise VolumeError(f"{path}: its data end early; the file is cut short or its header is wrong")
            taken += part
            self._left -= len(part)
        return bytes(taken)

    def finish(self) -> None:
        """Read to the end of all files, which also verifies the checksums of the encoding."""
        while self.read(_STEP_BYTES):
            pass
        self._check_end()

    def _open_next(self) -> bool:
        data = self._data
        self._check_end()
        if self._next == len(data.paths):
            return False
        if self._stream is not None:
            self._stream.close()
        self._stream = data.paths[self._next].open("rb")
        self._stream.seek(data.offsets[self._next])
        self._next += 1
        self._left = data.file_bytes
        self._decoded = _decoder(self._stream, data.encoding)
        self._checked(data.skip)
        return True

    def _check_end(self) -> None:
        """Detect a file that holds more than it should; raw data may."""
        if self._next and self._left == 0 and self._data.encoding != "raw" and self._checked(1):
            raise VolumeError(
                f"{self._data.paths[self._next - 1]}: holds more voxels than its header declares; the header "
                "is wrong"
            )

    def _checked(self, size: int) -> bytes:
        try:
            return self._decoded.read(size)
        except (zlib.error, EOFError, OSError, ValueError) as error:
            path = self._data.paths[self._next - 1]
            raise VolumeError(f"{path}: damaged {self._data.encoding} data ({error})") from error


class _Runs:
    """One of ``count`` volumes whose bytes are interleaved in runs."""

    def __init__(self, source: ByteSource, run: int, count: int, number: int) -> None:
        self._source = source
        self._run = run
        self._gap = run * (count - 1)
        self._skip = run * number
        self._left = run

    def read(self, size: int, /) -> bytes:
        """Return ``size`` bytes, fewer only at the end."""
        taken = bytearray()
        while len(taken) < size:
            while self._skip:
                self._skip -= len(self._source.read(min(self._skip, _STEP_BYTES))) or self._skip
            part = self._source.read(min(size - len(taken), self._left))
            if not part:
                break
            taken += part
            self._left -= len(part)
            if self._left == 0:
                self._left, self._skip = self._run, self._gap
        return bytes(taken)


def _decoder(stream: IO[bytes], encoding: str) -> ByteSource:
    if encoding == "gzip":
        return gzip.GzipFile(fileobj=stream)
    if encoding == "bzip2":
        return bz2.BZ2File(stream)
    if encoding == "ascii":
        return _Text(stream, _parse_numbers)
    if encoding == "hex":
        return _Text(stream, _parse_hex)
    return stream


class _Text(io.RawIOBase):
    """The data of a text encoding, as bytes."""

    def __init__(self, stream: IO[bytes], parse: Callable[[bytes, bool], tuple[bytes, bytes]]) -> None:
        self._stream = stream
        self._parse = parse
        self._parsed = bytearray()
        self._partial = b""

    def read(self, size: int = -1, /) -> bytes:
        while len(self._parsed) < size:
            text = self._stream.read(1 << 16)
            parsed, self._partial = self._parse(self._partial + text, not text)
            self._parsed += parsed
            if not text:
                break
        taken = bytes(self._parsed[:size])
        del self._parsed[:size]
        return taken


def _parse_numbers(text: bytes, is_end: bool) -> tuple[bytes, bytes]:  # noqa: FBT001 - of a callback
    """Numbers of a text as bytes of float64, and a number that the end of the text may have cut."""
    tokens, partial = text.split(), b""
    if tokens and not is_end and not text[-1:].isspace():
        partial = tokens.pop()
    if max(map(len, [partial, *tokens])) > _MAX_TOKEN:
        raise ValueError(f"a number of more than {_MAX_TOKEN} characters")
    return np.array(tokens, dtype="S").astype(np.float64).tobytes(), partial


def _parse_hex(text: bytes, is_end: bool) -> tuple[bytes, bytes]:  # noqa: FBT001 - of a callback
    """Bytes for the pairs of digits of a text, and a last digit without its pair."""
    digits = b"".join(text.split())
    whole = len(digits) - (0 if is_end else len(digits) % 2)
    return bytes.fromhex(digits[:whole].decode("ascii")), digits[whole:]
