"""Writes NanoVDB files: the layout that `tfm_cl.files.volume_io.nvdb` describes, of library version 32.4.

Grids are trees of float or vec3f values with the background 0. They are not packed, so that a reader of the
headers alone needs no library, and nodes know the boxes and statistics of their active voxels. There are no
checksums.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.grid import shown
from tfm_cl.files.volume_io.nvdb_layout import Layout
from tfm_cl.files.volume_io.tree_shape import LOWER_EDGE, ROOT_EDGE, UPPER_EDGE, vector_type
from tfm_cl.files.volume_io.written_grid import WrittenGrid, WrittenLeaves, bits_of, entries_of, nodes_above

_MAGIC = b"NanoVDB0"
_VERSION = 32 << 21 | 4 << 10 | 2
_GRID_SIZE, _TREE_SIZE = 672, 64
_NAME_SIZE = 256
_NO_CHECKSUM = (1 << 64) - 1
_UNKNOWN_CLASS = 0
_FLAGS = 0b111110
"""Nodes have boxes, least and largest values, means and deviations, and lie level by level."""
_HAS_BOX = 2
_LAYOUTS = {
    False: (1, Layout("float32", np.dtype("<f4"))),
    True: (6, Layout("vec3f", vector_type("<f4"))),
}


def write(path: Path, grids: Sequence[WrittenGrid]) -> None:
    """Write a file, a segment for each grid, as NanoVDB's tools do; may leave it incomplete if it raises."""
    for grid in grids:
        if len(grid.name.encode()) >= _NAME_SIZE:
            raise VolumeError(
                f"grid {shown(grid.name)}: a name in a .nvdb has at most {_NAME_SIZE - 1} bytes"
            )
    with path.open("wb") as stream:
        for grid in grids:
            parts = _grid(grid)
            stream.write(_MAGIC + struct.pack("<IHH", _VERSION, 1, 0) + _listed(grid, parts))
            for part in parts:
                stream.write(part)


def _listed(grid: WrittenGrid, parts: list[bytes]) -> bytes:
    """Return a grid's entry in the segment's list, and its name."""
    head, tree, size = parts[0], parts[1], sum(map(len, parts))
    name = grid.name.encode() + b"\0"
    counts = struct.unpack_from("<6I", tree, 32)
    metadata = struct.pack("<4Q2I", size, size, _hash(name[:-1]), grid.active_voxels, _type(grid), 0)
    metadata += head[560:608] + np.ravel(grid.active_box()).astype("<i4").tobytes() + head[608:632]
    return metadata + struct.pack("<I7IHHI", len(name), *counts[:3], 1, *counts[3:], 0, 0, _VERSION) + name


def _hash(name: bytes) -> int:
    """Return the number by which NanoVDB finds names: ``stringHash``."""
    found = 0
    for letter in name:
        found = (found * 67 + letter + (found >> 56)) & _NO_CHECKSUM
    return found


def _type(grid: WrittenGrid) -> int:
    return _LAYOUTS[grid.is_vector][0]


def _grid(grid: WrittenGrid) -> list[bytes]:
    """Return a grid's parts: head, tree, root, upper and lower nodes, leaves."""
    _, layout = _LAYOUTS[grid.is_vector]
    leaves = grid.leaves()
    of_leaves = _leaf_level(leaves, layout)
    lowers = _above(of_leaves, LOWER_EDGE, layout)
    uppers = _above(lowers, UPPER_EDGE, layout)
    root = _root(uppers, layout)
    levels = (of_leaves, lowers, uppers)
    sizes = [len(level.origins) * level.size for level in levels]
    # From the tree: leaves, lower and upper nodes, root.
    begins = [_TREE_SIZE + len(root) + sum(sizes[i + 1 :]) for i in range(len(levels))]
    tree = struct.pack("<4Q", *begins, _TREE_SIZE)
    tree += struct.pack("<6IQ", *(len(level.origins) for level in levels), 0, 0, 0, grid.active_voxels)
    nodes = [
        _nodes(uppers, lowers, layout),
        _nodes(lowers, of_leaves, layout),
        _leaves(leaves, of_leaves, layout),
    ]
    size = _GRID_SIZE + _TREE_SIZE + len(root) + sum(sizes)
    return [_head(grid, size), tree, root, *nodes]


def _head(grid: WrittenGrid, size: int) -> bytes:
    matrix = np.asarray(grid.world_from_index, dtype=np.float64)
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    low, high = grid.active_box()
    # To the far side of the last voxel, as NanoVDB's own tools have it.
    ends = np.array([low, high + 1])
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3) @ linear.T + translation
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    head: bytes = _MAGIC + struct.pack("<Q4IQ", _NO_CHECKSUM, _VERSION, _FLAGS, 0, 1, size)
    head += grid.name.encode().ljust(_NAME_SIZE, b"\0")
    for numbers in ("<f4", "<f8"):
        parts = (linear, np.linalg.inv(linear), translation, np.ones(1))
        head += b"".join(np.ravel(part).astype(numbers).tobytes() for part in parts)
    head += box.astype("<f8").tobytes() + np.linalg.norm(linear, axis=0).astype("<f8").tobytes()
    return (head + struct.pack("<2I", _UNKNOWN_CLASS, _type(grid))).ljust(_GRID_SIZE, b"\0")


# ------------------------------------------------------------------------------------------ the levels


@dataclass(frozen=True, eq=False)
class _Level:
    """The nodes of one level, in the order of the tree, and what is known of their active voxels."""

    edge: int
    """Voxels along an edge of a node."""
    size: int
    """Bytes of a node."""
    origins: NDArray[np.int64]
    low: NDArray[np.int64]
    """[n, 3], first active voxel along each axis."""
    high: NDArray[np.int64]
    least: NDArray[np.float32]
    """[n, numbers of a value]: the least value, of vectors the one of the least length."""
    largest: NDArray[np.float32]
    count: NDArray[np.int64]
    sums: NDArray[np.float64]
    """[n, 2]: of the values, of vectors the squares of their lengths, and of their squares."""

    def statistics(self) -> NDArray[np.uint8]:
        """Return what is known of values as a file has it, [n, bytes]."""
        mean, square = (self.sums / self.count[:, None]).T
        spread = np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0))], axis=-1)
        numbers = np.concatenate([self.least, self.largest, spread], axis=-1)
        return np.ascontiguousarray(numbers, dtype="<f4").view(np.uint8)

    def boxes(self) -> NDArray[np.uint8]:
        """First and last active voxel as a file has them, [n, 24]."""
        return np.concatenate([self.low, self.high], axis=-1).astype("<i4").view(np.uint8)


def _leaf_level(leaves: WrittenLeaves, layout: Layout) -> _Level:
    values = leaves.values.reshape(*leaves.active.shape, -1)
    sizes = _sizes(values)
    rows, sides = np.arange(len(values)), []
    cubes = leaves.active.reshape(-1, LOWER_EDGE, LOWER_EDGE, LOWER_EDGE)
    for axes in ((2, 3), (1, 3), (1, 2)):
        met: NDArray[np.bool_] = np.asarray(cubes.any(axis=axes))
        sides.append((met.argmax(axis=1), LOWER_EDGE - 1 - met[:, ::-1].argmax(axis=1)))
    low, high = (leaves.origins + np.stack(side, axis=-1) for side in zip(*sides, strict=True))
    kept = np.where(leaves.active, sizes, 0)
    return _Level(
        edge=LOWER_EDGE,
        size=layout.least_leaf_size,
        origins=leaves.origins,
        low=low,
        high=high,
        least=values[rows, np.where(leaves.active, sizes, np.inf).argmin(axis=1)],
        largest=values[rows, np.where(leaves.active, sizes, -np.inf).argmax(axis=1)],
        count=leaves.active.sum(axis=1, dtype=np.int64),
        sums=np.stack([kept.sum(axis=1), (kept**2).sum(axis=1)], axis=-1),
    )


def _above(below: _Level, edge: int, layout: Layout) -> _Level:
    """Return the nodes whose entries are ``edge`` voxels wide, above those of a level."""
    of_node = edge * (32 if edge == UPPER_EDGE else 16)
    origins, parents = nodes_above(below.origins, of_node)
    starts = np.searchsorted(parents, np.arange(len(origins)))
    parts = [slice(*ends) for ends in zip(starts, [*starts[1:], len(parents)], strict=True)]
    return _Level(
        edge=of_node,
        size=layout.node_size(edge),
        origins=origins,
        low=np.minimum.reduceat(below.low, starts),
        high=np.maximum.reduceat(below.high, starts),
        least=np.stack([below.least[part][_sizes(below.least[part]).argmin()] for part in parts]),
        largest=np.stack([below.largest[part][_sizes(below.largest[part]).argmax()] for part in parts]),
        count=np.add.reduceat(below.count, starts),
        sums=np.add.reduceat(below.sums, starts),
    )


def _sizes(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return what values [..., numbers] are compared by: themselves, or the squares of vectors' lengths."""
    numbers = values.astype(np.float64)
    found: NDArray[np.float64] = numbers[..., 0] if values.shape[-1] == 1 else (numbers**2).sum(axis=-1)
    return found


def _root(uppers: _Level, layout: Layout) -> bytes:
    nodes, tile = len(uppers.origins), layout.root_tile
    root = np.zeros(layout.root_size + nodes * tile.itemsize, np.uint8)
    # What is active in all of them is known as of a node above.
    whole = replace(
        uppers,
        low=uppers.low.min(axis=0, keepdims=True),
        high=uppers.high.max(axis=0, keepdims=True),
        least=uppers.least[[_sizes(uppers.least).argmin()]],
        largest=uppers.largest[[_sizes(uppers.largest).argmax()]],
        count=uppers.count.sum(keepdims=True),
        sums=uppers.sums.sum(axis=0, keepdims=True),
    )
    statistics = whole.statistics()[0]
    at = layout.background_at + layout.value.itemsize
    root[:24] = whole.boxes()[0]
    root[24:28] = np.frombuffer(struct.pack("<I", nodes), np.uint8)
    root[at : at + len(statistics)] = statistics
    tiles = np.zeros(nodes, tile)
    x, y, z = ((uppers.origins // ROOT_EDGE) & 0xFFFFF).astype(np.uint64).T
    tiles["key"] = x << np.uint64(42) | y << np.uint64(21) | z
    tiles["child"] = len(root) + uppers.size * np.arange(nodes)
    root[layout.root_size :] = np.frombuffer(tiles.tobytes(), np.uint8)
    return root.tobytes()


def _nodes(level: _Level, below: _Level, layout: Layout) -> bytes:
    """Return upper or lower nodes, behind all of which those below lie."""
    dim = level.edge // below.edge
    _, parents = nodes_above(below.origins, level.edge)
    entries = entries_of(below.origins, level.origins[parents], below.edge, dim)
    nodes = np.zeros((len(level.origins), level.size), np.uint8)
    nodes[:, :24], nodes[:, 24] = level.boxes(), _HAS_BOX
    has_child = np.zeros((len(nodes), dim**3), dtype=bool)
    has_child[parents, entries] = True
    masks, statistics = bits_of(has_child), level.statistics()
    at = 32 + masks.shape[1]
    nodes[:, at : at + masks.shape[1]] = masks
    nodes[:, at + masks.shape[1] : at + masks.shape[1] + statistics.shape[1]] = statistics
    table = nodes[:, layout.table_at(below.edge) :].reshape(len(nodes), dim**3, layout.entry.itemsize)
    begins = (len(nodes) - parents) * level.size + np.arange(len(parents)) * below.size
    table[parents, entries, :8] = begins.astype("<i8").view(np.uint8).reshape(-1, 8)
    return nodes.tobytes()


def _leaves(leaves: WrittenLeaves, level: _Level, layout: Layout) -> bytes:
    nodes = np.zeros((len(level.origins), level.size), np.uint8)
    masks, statistics = bits_of(leaves.active), level.statistics()
    nodes[:, :12] = level.low.astype("<i4").view(np.uint8)
    nodes[:, 12:15], nodes[:, 15] = level.high - level.low, _HAS_BOX
    nodes[:, 16 : 16 + masks.shape[1]] = masks
    nodes[:, 80 : 80 + statistics.shape[1]] = statistics
    values = leaves.values.reshape(len(nodes), -1).astype("<f4").view(np.uint8)
    nodes[:, layout.leaf_values_at :] = values
    return nodes.tobytes()
