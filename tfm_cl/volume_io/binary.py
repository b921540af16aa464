"""What the two VDB formats share: bounded reading, their codecs, and a sparse tree's way to a dense array.

Both formats store the same tree of cubes. The root holds any number of nodes of 4096³ voxels; such an
*upper* node has 32³ places, each a *lower* node of 128³ voxels or a tile (one value for the whole place);
a lower node has 16³ places, each a *leaf* of 8³ voxels or a tile. Places and voxels are ordered with z
fastest: entry ``(x * n + y) * n + z``. Index coordinates are integers at voxel *centres*.

A file's bytes are never trusted: `Cursor` stops at their end, and no codec writes more than was asked for.
"""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import blosc
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.volume_io import MAX_VOXELS

ROOT_EDGE, UPPER_EDGE, LOWER_EDGE = 4096, 128, 8
"""Voxels along a tile of the root, of an upper and of a lower node."""
LEAF_VOXELS = LOWER_EDGE**3
LEAVES_PER_BATCH = 1024

MAX_PACKING = 1100
"""No block is believed to unpack to more than this many times its size: zlib ends at 1032:1, LZ4 at 255:1."""


# ------------------------------------------------------------------------------------------------ bytes


def map_file(path: Path) -> memoryview:
    """Map a file into memory, read-only; pages are read from disk when touched."""
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            return memoryview(b"")
        return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


class Cursor:
    """A reading position in little-endian bytes; every step is checked against their end.

    Parameters
    ----------
    data
        All the bytes.
    source
        What they are, for messages: the file, or a grid of it.
    at
        Byte to begin at.
    """

    def __init__(self, data: memoryview, source: str, at: int = 0) -> None:
        self.data = data
        self.source = source
        self.at = at

    def take(self, size: int, what: str) -> memoryview:
        """Step over ``size`` bytes and return them; raises `VolumeError` when there are fewer."""
        end = self.at + size
        if size < 0 or self.at < 0 or end > len(self.data):
            raise self.damaged(f"{what} should take {size} bytes, the data end at byte {len(self.data)}")
        taken = self.data[self.at : end]
        self.at = end
        return taken

    def numbers(self, layout: str, what: str) -> tuple[Any, ...]:
        """Read numbers as `struct` describes them in ``layout``, without padding."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout), what))

    def array(self, dtype: np.dtype[Any], count: int, what: str) -> NDArray[Any]:
        """Read ``count`` items of ``dtype``; a view, not a copy."""
        return np.frombuffer(self.take(dtype.itemsize * count, what), dtype)

    def text(self, what: str) -> str:
        """Read a string behind its 32-bit length; bytes that are not UTF-8 are replaced."""
        (length,) = self.numbers("I", what)
        return bytes(self.take(length, what)).decode(errors="replace")

    def damaged(self, why: str) -> VolumeError:
        """Return the error for bytes that cannot be right, with the position reached."""
        return VolumeError(
            f"{self.source}: damaged or incomplete at byte {self.at}: {why}; copy or export it again"
        )


def distinct_names(names: list[str]) -> list[str]:
    """Give names that repeat the numbers OpenVDB shows: ``density[0]``, ``density[1]``."""
    counts, seen = Counter(names), Counter[str]()
    distinct = []
    for name in names:
        distinct.append(f"{name}[{seen[name]}]" if counts[name] > 1 else name)
        seen[name] += 1
    return distinct


# ----------------------------------------------------------------------------------------------- codecs


def unzip(packed: memoryview, size: int, source: Cursor) -> bytes:
    """Decompress a zlib stream that must hold exactly ``size`` bytes."""
    _check_packing(packed, size, source)
    stream = zlib.decompressobj()
    try:
        plain = stream.decompress(packed, size + 1)  # one more, to notice a longer stream
    except zlib.error as error:
        raise source.damaged(f"a zlib block does not decompress ({error})") from error
    if len(plain) != size or not stream.eof:
        raise source.damaged(f"a zlib block should hold {size} bytes")
    return plain


def unblosc(packed: memoryview, size: int, source: Cursor) -> bytes:
    """Decompress a Blosc block that must hold exactly ``size`` bytes.

    The header is checked first: the decoder takes the sizes in it at their word.
    """
    _check_packing(packed, size, source)
    if len(packed) < blosc.MAX_OVERHEAD:
        raise source.damaged(f"a Blosc block of {len(packed)} bytes is shorter than its header")
    plain_size, block_size, packed_size = struct.unpack_from("<3I", packed, 4)
    if plain_size != size or packed_size != len(packed) or not 0 < block_size <= max(size, 1 << 16):
        raise source.damaged(
            f"a Blosc block claims {packed_size} bytes for {plain_size} in blocks of {block_size}; "
            f"it has {len(packed)} for {size}"
        )
    try:
        plain: bytes = blosc.decompress(packed)
    except (RuntimeError, ValueError) as error:
        raise source.damaged(f"a Blosc block does not decompress ({error})") from error
    return plain


def _check_packing(packed: memoryview, size: int, source: Cursor) -> None:
    if size > MAX_PACKING * len(packed):
        raise source.damaged(f"{len(packed)} compressed bytes cannot hold {size}")


# ------------------------------------------------------------------------------------------------ trees


@dataclass(frozen=True)
class Tiles:
    """Cubes of one value each, all of one size."""

    edge: int
    """Voxels along an edge: `ROOT_EDGE`, `UPPER_EDGE` or `LOWER_EDGE`."""
    origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each cube's low voxel."""
    values: NDArray[Any]
    """[n]."""


@dataclass(frozen=True)
class Leaves:
    """A batch of leaf nodes with their voxels."""

    origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each leaf's low voxel."""
    values: NDArray[Any]
    """[n, 8, 8, 8], ordered [leaf, x, y, z]; active and inactive voxels alike."""


@dataclass(frozen=True)
class Tree:
    """A tree without the voxels of its leaves."""

    background: float
    """Value of all space that no leaf or tile covers."""
    tiles: list[Tiles]
    """The tiles that differ from the background, active or not."""
    leaf_origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each leaf's low voxel, in the file's order."""
    active_voxels: int
    """Voxels marked active, those of active tiles included."""

    def box(self) -> tuple[NDArray[np.int64], tuple[int, int, int]]:
        """Return the low voxel (x, y, z) and the shape (z, y, x) of the box around leaves and tiles."""
        cubes = [(self.leaf_origins, LOWER_EDGE), *((tiles.origins, tiles.edge) for tiles in self.tiles)]
        cubes = [(origins, edge) for origins, edge in cubes if len(origins)]
        if not cubes:
            return np.zeros(3, np.int64), (0, 0, 0)
        low = np.min([origins.min(axis=0) for origins, _ in cubes], axis=0)
        high = np.max([origins.max(axis=0) + edge for origins, edge in cubes], axis=0)
        x, y, z = (high - low).tolist()
        return low, (z, y, x)


def place_origins(origin: NDArray[np.int64], places: NDArray[np.int64], edge: int) -> NDArray[np.int64]:
    """Index coordinates of a node's entries (given by number), each ``edge`` voxels wide."""
    dim = 32 if edge == UPPER_EDGE else 16
    return origin + edge * np.stack(np.unravel_index(places, (dim, dim, dim)), axis=-1)


def batches(items: NDArray[Any]) -> list[NDArray[Any]]:
    """Split what leaves have in common into pieces of `LEAVES_PER_BATCH`, to bound the memory for voxels."""
    return [items[start : start + LEAVES_PER_BATCH] for start in range(0, len(items), LEAVES_PER_BATCH)]


def differs(values: NDArray[Any], background: NDArray[Any]) -> NDArray[np.bool_]:
    """Where values are not the background; NaN differs from all."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is a value like others here
        different: NDArray[np.bool_] = values != background
    return different


def offset_transform(
    world_from_index: NDArray[np.float64], low: NDArray[np.int64], source: Cursor
) -> NDArray[np.float64]:
    """World-from-index of an array whose first voxel is the tree's voxel ``low``."""
    if not (np.isfinite(world_from_index).all() and np.abs(world_from_index).max() < 1e150):  # noqa: PLR2004 - products stay finite
        raise source.damaged(f"its transform is not finite: {world_from_index.tolist()}")
    matrix = world_from_index.copy()
    matrix[:3, 3] += matrix[:3, :3] @ low
    return matrix


def fill_dense(
    tree: Tree, leaves: Iterable[Leaves], shape: tuple[int, int, int], source: Cursor
) -> NDArray[np.float32]:
    """Write a tree into a dense array.

    Parameters
    ----------
    tree, leaves
        The tree, and the voxels of all its leaves.
    shape
        The shape (z, y, x) promised to the caller; must be the tree's.

    Returns
    -------
    The voxels of `Tree.box`, float32 [z, y, x]; other types are rounded to it.

    Raises
    ------
    VolumeError
        The tree is of another shape, or larger than `MAX_VOXELS`.
    """
    low, own_shape = tree.box()
    if own_shape != shape:
        raise VolumeError(
            f"{source.source}: has changed since it was opened: the grid spans {own_shape} voxels [z, y, x], "
            f"it was {shape}; open it again"
        )
    if math.prod(shape) > MAX_VOXELS:
        raise VolumeError(
            f"{source.source}: spans {shape} voxels [z, y, x]; the limit is {MAX_VOXELS:,} in all"
        )
    dense = np.zeros(shape, np.float32)
    with np.errstate(invalid="ignore", over="ignore"):  # NaN stays NaN; too large a double is infinite
        if tree.background != 0.0:
            dense.fill(tree.background)
        # [block z, z, block y, y, block x, x]: leaves and small tiles fill whole blocks.
        blocks = dense.reshape([n for length in shape for n in (length // LOWER_EDGE, LOWER_EDGE)])
        for tiles in tree.tiles:
            if tiles.edge == LOWER_EDGE:
                x, y, z = ((tiles.origins - low) // LOWER_EDGE).T
                blocks[z, :, y, :, x, :] = tiles.values[:, None, None, None]
            else:
                for (x, y, z), value in zip((tiles.origins - low).tolist(), tiles.values, strict=True):
                    dense[z : z + tiles.edge, y : y + tiles.edge, x : x + tiles.edge] = value
        for batch in leaves:
            x, y, z = ((batch.origins - low) // LOWER_EDGE).T
            blocks[z, :, y, :, x, :] = batch.values.transpose(0, 3, 2, 1)
    return dense
