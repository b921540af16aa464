"""NumPy arrays: one in a ``.npy`` file, several in an ``.npz`` archive.

Arrays are [z, y, x] of any real, integer or bool type, of either byte order, in C or Fortran order. Integers
keep their values. Further axes with one sample are dropped. Pickled objects are never loaded.

The array of a ``.npy`` file is the grid ``density``. In an ``.npz`` every 3-D array is a grid under its
key, and these arrays, where present, place all of them: ``voxel_size`` (one number or x, y, z),
``origin`` (x, y, z, the low corner of voxel 0, 0, 0), or ``world_from_index`` (4×4) instead of both.

A colour is an array [z, y, x, RGB] of the same types: the array of a ``.npy`` file, or one in an ``.npz``.
"""

import itertools
import math
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import check_readable
from tfm_cl.files.volume_io.decoding import read_voxels
from tfm_cl.files.volume_io.grid import COLOUR, DEFAULT_NAME, Grid, shown, shown_names, world_from_index_of

EXTENSIONS = (".npy", ".npz")

_PLACEMENT_KEYS = ("voxel_size", "origin", "world_from_index")
_AXES = 3
_MOST_AXES = 8
_NO_VOLUME = (
    "a colour; give it beside a volume [z, y, x], as --set volume.colour=FILE or the name of this array"
)
_MAX_ITEM_BYTES = 8
_MAX_SIDE = 1 << 48
_MAX_DEFLATE_RATIO = 1032  # of the deflate format itself
_ZIP_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, EOFError, OSError, OverflowError),
    *(NotImplementedError, RuntimeError, ValueError),
)


class ArrayHeader(NamedTuple):
    """The contents of a ``.npy`` header."""

    shape: tuple[int, ...]
    order: Literal["C", "F"]
    dtype: np.dtype[Any]
    header_bytes: int

    @property
    def data_bytes(self) -> int:
        """Size of the array's data in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def not_real(self) -> str:
        """Reason why the values are not real numbers; empty if they are."""
        if self.dtype.hasobject:
            return "pickled Python objects, which are never loaded"
        if self.dtype.kind not in "fiub" or self.dtype.itemsize > _MAX_ITEM_BYTES:
            return f"values of type {self.dtype.name}, not real numbers of at most 64 bits"
        return ""

    @property
    def unsupported(self) -> str:
        """Reason why the array cannot be a density; empty if it can."""
        if self.not_real:
            return self.not_real
        if self.volume_shape is not None:
            return ""
        shape = f"({', '.join(map(str, self.shape[:_MOST_AXES]))}{', …' * (len(self.shape) > _MOST_AXES)})"
        if self.shape[_AXES:] == (3,):
            return f"an array of shape {shape}, {_NO_VOLUME}"
        return f"an array of shape {shape}; a volume is [z, y, x]: save one of its parts"

    @property
    def volume_shape(self) -> tuple[int, int, int] | None:
        """Shape (z, y, x) without further axes of one sample; None if it is unclear which ones those are."""
        extra = len(self.shape) - _AXES
        if not 0 <= extra <= _MOST_AXES - _AXES:
            return None
        singles = [axis for axis, size in enumerate(self.shape) if size == 1]
        found = {
            tuple(size for axis, size in enumerate(self.shape) if axis not in dropped)
            for dropped in itertools.combinations(singles, extra)
        }
        return cast("tuple[int, int, int]", found.pop()) if len(found) == 1 else None


_Decode = Callable[[IO[bytes], ArrayHeader, Path], NDArray[Any]]
"""Reads an array from a stream that is positioned at its data."""


class StoredArray(NamedTuple):
    """An array of a file that has not been read yet."""

    label: str
    """File and array, for messages."""
    header: ArrayHeader
    read: Callable[[], NDArray[Any]]
    """Reads it; call it only if the shape is the expected one."""

    def rows_of_three(self) -> int:
        """Return the number of rows of an array [n, 3]; raises `VolumeError` if it is none."""
        shape = self.header.shape
        if len(shape) != 2 or shape[1] != 3:  # noqa: PLR2004 - rows of x, y, z
            got = "×".join(map(str, shape[:_MOST_AXES])) or "one number"
            raise VolumeError(f"{self.label} is {got}; expected [n, 3]")
        return shape[0]

    def read_up_to(self, most: int) -> NDArray[Any]:
        """Read it if it holds at most so many numbers.

        Raises
        ------
        VolumeError
            It holds more, no real numbers, or cannot be read.
        """
        count = math.prod(self.header.shape)
        if count > most:
            raise VolumeError(f"{self.label} holds {count:,} numbers; at most {most:,} are expected")
        if self.header.not_real:
            raise VolumeError(f"{self.label} holds {self.header.not_real}")
        return self.read()


def read_header(stream: IO[bytes]) -> ArrayHeader:
    """Parse the header of a ``.npy`` stream and stop at the data.

    Raises
    ------
    ValueError
        Not a ``.npy`` header, or of a kind that is not used for arrays of numbers.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers written by Python 2, and of deprecated type names
            version = np.lib.format.read_magic(stream)
            if version == (1, 0):
                shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
            elif version == (2, 0):
                shape, fortran, dtype = np.lib.format.read_array_header_2_0(stream)
            else:
                raise ValueError(f"version {'.'.join(map(str, version))}; {_of_version(version)}")
    except (TypeError, SyntaxError, tokenize.TokenError, RecursionError, MemoryError) as error:
        raise ValueError(f"unreadable header: {error}") from error
    if any(not 0 <= n < _MAX_SIDE for n in shape):
        raise ValueError("impossible shape")
    return ArrayHeader(shape, "F" if fortran else "C", dtype, stream.tell())


def _of_version(version: tuple[int, int]) -> str:
    if version == (3, 0):
        return "it is for structured arrays, not for numbers"
    return "it is newer than tfm_cl knows: update tfm_cl, or save it with an older NumPy"


def open_grids(path: Path) -> list[Grid]:
    """List the 3-D arrays of a ``.npy`` or ``.npz`` file.

    Raises
    ------
    VolumeError
        The file is damaged, sizes do not match it, or the placement is invalid.
    """
    if path.suffix.lower() == ".npz":
        return _open_npz(path)
    with path.open("rb") as stream:
        header = _checked_header(stream, path.stat().st_size, str(path))
    return [_grid(DEFAULT_NAME, header, partial(_read_npy, path, header, _read))]


def _open_npz(path: Path) -> list[Grid]:
    try:
        with zipfile.ZipFile(path) as archive:
            headers = _headers(archive, path)
            world_from_index = _placement(archive, headers, path)
    except _ZIP_ERRORS as error:
        raise VolumeError(f"{path}: not a readable .npz archive ({_short(error)})") from error
    grids = [
        _grid(name, header, partial(_read_member, path, name, header, _read), world_from_index)
        for name, header in headers.items()
        if name not in _PLACEMENT_KEYS
    ]
    volumes = [grid for grid in grids if min(grid.shape) > 0 or not grid.unsupported]
    return volumes or grids


def _headers(archive: zipfile.ZipFile, path: Path) -> dict[str, ArrayHeader]:
    members = (member for member in dict.fromkeys(archive.namelist()) if member.endswith(".npy"))
    return {member.removesuffix(".npy"): _member_header(archive, member, path) for member in members}


def has_colour(path: Path) -> bool:
    """Tell whether an ``.npz`` archive has an array `COLOUR` that is not a grid, that is, with four axes.

    Raises
    ------
    VolumeError
        Damaged archive.
    """
    header = _archive_headers(path).get(COLOUR)
    return header is not None and len(header.shape) == _AXES + 1


def open_colour(path: Path, name: str | None = None) -> StoredArray:
    """Find an array [z, y, x, 3] in a ``.npy`` or ``.npz`` file.

    Parameters
    ----------
    path
        The file.
    name
        Key of the array in an archive; by default `COLOUR`, else the only array with four axes.

    Raises
    ------
    VolumeError
        The file is missing or damaged, or the array does not exist or does not hold real numbers.
    """
    check_readable(path, VolumeError)
    if path.suffix.lower() != ".npz":
        try:
            with path.open("rb") as stream:
                header = _checked_header(stream, path.stat().st_size, str(path))
        except OSError as error:
            raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error
        label, read = f"{path}: the colour", partial(_read_npy, path, header, _read_channels)
    else:
        headers = _archive_headers(path)
        if name is None:
            of_four = [key for key, header in headers.items() if len(header.shape) == _AXES + 1]
            name = of_four[0] if len(of_four) == 1 else COLOUR
        if name not in headers:
            names = shown_names(list(headers)) or "none"
            raise VolumeError(f"{path}: no array {shown(name)} [z, y, x, 3]; its arrays: {names}")
        header, label = headers[name], f"{path}: array {shown(name)}"
        read = partial(_read_member, path, name, header, _read_channels)
    if header.not_real:
        raise VolumeError(f"{label} holds {header.not_real}")
    return StoredArray(label, header, read)


def open_arrays(path: Path) -> dict[str, StoredArray]:
    """Describe the arrays of an ``.npz`` archive by their keys; they are read as they are stored.

    Raises
    ------
    VolumeError
        Damaged archive.
    """
    return {
        name: StoredArray(
            f"{path}: array {shown(name)}", header, partial(_read_member, path, name, header, _read_plain)
        )
        for name, header in _archive_headers(path).items()
    }


def _archive_headers(path: Path) -> dict[str, ArrayHeader]:
    try:
        with zipfile.ZipFile(path) as archive:
            return _headers(archive, path)
    except _ZIP_ERRORS as error:
        raise VolumeError(f"{path}: not a readable .npz archive ({_short(error)})") from error


def _grid(name: str, header: ArrayHeader, read: Any, world_from_index: Any = None) -> Grid:
    is_colour = name == COLOUR and len(header.shape) == _AXES + 1
    z, y, x = (None if is_colour else header.volume_shape) or (0, 0, 0)
    return Grid(
        name=name,
        grid_class="unknown",
        value_type=header.dtype.name,
        shape=(z, y, x),
        world_from_index=world_from_index_of((1, 1, 1), (0, 0, 0))
        if world_from_index is None
        else world_from_index,
        has_transform=world_from_index is not None,
        read=read,
        unsupported=header.unsupported or (_NO_VOLUME if is_colour else ""),
    )


def _checked_header(stream: IO[bytes], size: int, label: str) -> ArrayHeader:
    """Read the header of a stream of ``size`` bytes, which must hold the whole array."""
    try:
        header = read_header(stream)
    except ValueError as error:
        raise VolumeError(f"{label}: not a readable NumPy array ({_short(error)})") from error
    if header.dtype.hasobject:
        return header  # a pickle: its size cannot be told, and it is never read
    if header.header_bytes + header.data_bytes > size:
        raise VolumeError(
            f"{label}: declares shape {header.shape} of {header.dtype.name}, {header.data_bytes:,} bytes, "
            f"but holds {size - header.header_bytes:,}; the file is damaged"
        )
    return header


def _member_header(archive: zipfile.ZipFile, member: str, path: Path) -> ArrayHeader:
    info, label = archive.getinfo(member), f"{path}: array {shown(member.removesuffix('.npy'))}"
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise VolumeError(f"{label}: compressed in a way NumPy does not write; save it with numpy.savez")
    packed = min(info.compress_size, path.stat().st_size)
    if info.file_size > packed * (_MAX_DEFLATE_RATIO if info.compress_type else 1):
        raise VolumeError(f"{label}: {packed:,} bytes cannot hold {info.file_size:,}; the archive is damaged")
    with archive.open(info) as stream:
        return _checked_header(stream, info.file_size, label)


def _read_npy(path: Path, header: ArrayHeader, decode: _Decode) -> NDArray[Any]:
    with path.open("rb") as stream:
        stream.seek(header.header_bytes)
        return decode(stream, header, path)


def _read_member(path: Path, name: str, header: ArrayHeader, decode: _Decode) -> NDArray[Any]:
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as stream:
            stream.read(header.header_bytes)
            return decode(stream, header, path)
    except (KeyError, *_ZIP_ERRORS) as error:
        raise VolumeError(f"{path}: array {shown(name)} cannot be read ({_short(error)})") from error


def _read(stream: IO[bytes], header: ArrayHeader, path: Path) -> NDArray[np.float32]:
    if header.unsupported:
        raise VolumeError(f"{path}: holds {header.unsupported}")
    shape = cast("tuple[int, int, int]", header.volume_shape)
    return read_voxels(stream, header.dtype, shape, path, order=header.order)


def _read_channels(stream: IO[bytes], header: ArrayHeader, path: Path) -> NDArray[np.float32]:
    """Read an array [z, y, x, channels] as one with three axes, joining the last two."""
    z, y, x, channels = header.shape
    values = read_voxels(stream, header.dtype, (z, y, x * channels), path, order=header.order)
    if header.order == "F":
        return np.ascontiguousarray(np.moveaxis(values.reshape(z, y, channels, x), 2, 3))
    values.resize(header.shape, refcheck=False)  # not a view: see `read_voxels`
    return values


def _read_plain(stream: IO[bytes], header: ArrayHeader, path: Path) -> NDArray[Any]:
    data = stream.read(header.data_bytes)
    if len(data) < header.data_bytes:
        raise VolumeError(f"{path}: an array of {header.data_bytes:,} bytes ends after {len(data):,}")
    values = np.frombuffer(data, header.dtype)
    return values.reshape(header.shape, order=header.order)


def _placement(
    archive: zipfile.ZipFile, headers: dict[str, ArrayHeader], path: Path
) -> NDArray[np.float64] | None:
    """World-from-index matrix for all the grids of an archive, or None if it has none."""
    found = {}
    for key in _PLACEMENT_KEYS:
        if key in headers:
            found[key] = _small_array(archive, key, headers[key], path)
    matrix = found.pop("world_from_index", None)
    if matrix is not None:
        if found:
            raise VolumeError(
                f"{path}: has both world_from_index and {' and '.join(found)}; keep one of them"
            )
        return matrix
    if not found:
        return None
    sizes = np.broadcast_to(found.get("voxel_size", np.ones(1)).ravel(), 3)
    if sizes.min() <= 0:
        raise VolumeError(f"{path}: voxel_size is > 0; got {sizes.tolist()}")
    (dx, dy, dz), (x, y, z) = sizes.tolist(), found.get("origin", np.zeros(3)).tolist()
    return world_from_index_of((dx, dy, dz), (x, y, z))


def _small_array(archive: zipfile.ZipFile, key: str, header: ArrayHeader, path: Path) -> NDArray[np.float64]:
    shapes = {"voxel_size": ((), (1,), (3,)), "origin": ((3,),), "world_from_index": ((4, 4),)}[key]
    if header.shape not in shapes or header.dtype.kind not in "fiu":
        wanted = " or ".join(map(str, shapes))
        raise VolumeError(
            f"{path}: {key} is an array of numbers of shape {wanted}; got {header.shape} {header.dtype}"
        )
    with archive.open(f"{key}.npy") as stream:
        stream.read(header.header_bytes)
        values = np.frombuffer(stream.read(header.data_bytes), header.dtype).astype(np.float64)
    if not np.isfinite(values).all():
        raise VolumeError(f"{path}: {key} holds numbers that are not finite")
    return values.reshape(header.shape, order=header.order)


def _short(error: Exception) -> str:
    """Shorten an error of NumPy or zipfile to one line: they quote what they could not read."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:120] + "…"  # noqa: PLR2004 - a line of a terminal
