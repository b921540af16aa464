"""Mitsuba grid volumes (``.vol``, version 3).

All little-endian: ``VOL``, one byte for the version, then five int32 (encoding, x, y, z, channels), six
float32 (bounding box: low x, y, z, high x, y, z), and the values, channel fastest, then x, y, z.
Encodings: 1 float32; from Mitsuba 0.x also 2 float16 and 3 uint8, where 0…255 stand for 0…1.

The voxels are placed as Mitsuba 3 places them with ``use_grid_bbox``: they fill the bounding box, so the
low corner of voxel 0 is the box's low corner. (Mitsuba 0.x put the outermost voxel centres on its faces.)
Channels have no names: a single channel is the grid ``density``, several are ``channel0``, ``channel1`` …
Three channels are also available as the grid ``colour``.
"""

import math
import struct
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.decoding import read_voxels
from tfm_cl.files.volume_io.grid import COLOUR, DEFAULT_NAME, Grid, as_colour, world_from_index_of

EXTENSIONS = (".vol",)

_HEADER = struct.Struct("<3sB5i6f")
_VERSION = 3
_DTYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f4"), 2: np.dtype("<f2"), 3: np.dtype("u1")}
_QUANTIZED_DIRECTIONS = 4
_MAX_CHANNELS = 64


def open_grids(path: Path) -> list[Grid]:
    """List the channels of a ``.vol`` file, each as a grid.

    Raises
    ------
    VolumeError
        The file is not a version 3 volume, its size does not match its header, or its box has no volume.
    """
    with path.open("rb") as stream:
        header = stream.read(_HEADER.size)
    if len(header) != _HEADER.size or header[:3] != b"VOL":
        raise VolumeError(f"{path}: not a Mitsuba volume; it must start with 'VOL' and a header of 48 bytes")
    _, version, encoding, x, y, z, channels, *box = _HEADER.unpack(header)
    if version != _VERSION:
        remedy = (
            "update tfm_cl, or save it" if version > _VERSION else "save it again with a current Mitsuba,"
        )
        raise VolumeError(
            f"{path}: version {version} of the Mitsuba volume format; {_VERSION} can be read: {remedy} as "
            f"version {_VERSION}"
        )
    if encoding == _QUANTIZED_DIRECTIONS:
        raise VolumeError(f"{path}: holds quantized directions (encoding 4), not densities")
    if encoding not in _DTYPES:
        raise VolumeError(f"{path}: unknown encoding {encoding}; known: 1 float32, 2 float16, 3 uint8")
    if min(x, y, z) < 1 or not 1 <= channels <= _MAX_CHANNELS:
        raise VolumeError(
            f"{path}: {x}×{y}×{z} voxels of {channels} channels; expected at least one voxel and "
            f"1 to {_MAX_CHANNELS} channels"
        )
    dtype = _DTYPES[encoding]
    size, expected = path.stat().st_size, _HEADER.size + x * y * z * channels * dtype.itemsize
    if size != expected:
        raise VolumeError(
            f"{path}: holds {size:,} bytes where {x}×{y}×{z} {dtype.name} voxels of {channels} channels "
            f"take {expected:,}; the file is damaged"
        )
    has_colour = channels == len("rgb")
    world_from_index = _placement(path, (x, y, z), box)
    grids = [
        Grid(
            name=DEFAULT_NAME if channels == 1 else f"channel{channel}",
            is_part=has_colour,
            grid_class="unknown",
            value_type=dtype.name,
            shape=(z, y, x),
            world_from_index=world_from_index,
            has_transform=True,
            read=partial(_read, path, dtype, (z, y, x), channels, channel),
        )
        for channel in range(channels)
    ]
    if has_colour:
        whole = replace(grids[0], name=COLOUR, is_part=False)
        grids.insert(0, as_colour(whole, partial(_read_colour, path, dtype, (z, y, x))))
    return grids


def _placement(path: Path, sizes: tuple[int, int, int], box: list[float]) -> NDArray[np.float64]:
    low, high = box[:3], box[3:]
    if not all(map(math.isfinite, box)) or not all(b > a for a, b in zip(low, high, strict=True)):
        raise VolumeError(f"{path}: its bounding box, {low} to {high}, has no volume; correct it in the file")
    x, y, z = ((b - a) / n for a, b, n in zip(low, high, sizes, strict=True))
    return world_from_index_of((x, y, z), (low[0], low[1], low[2]))


def _read_colour(path: Path, dtype: np.dtype[Any], shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Read three channels: [z, y, x, channel]."""
    z, y, x = shape
    rgb = _read(path, dtype, (z, y, 3 * x), 1, 0)
    rgb.resize((z, y, x, 3), refcheck=False)  # not a view: see `read_voxels`
    return rgb


def _read(
    path: Path, dtype: np.dtype[Any], shape: tuple[int, int, int], channels: int, channel: int
) -> NDArray[np.float32]:
    with path.open("rb") as stream:
        stream.seek(_HEADER.size)
        voxels = read_voxels(stream, dtype, shape, path, channels=channels, channel=channel)
    if dtype.kind == "u":
        voxels /= np.float32(255)
    return voxels
