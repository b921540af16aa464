r"""OpenVDB files (``.vdb``), file versions 220 to 225.

Layout, little-endian; a *string* is a uint32 length and its bytes::

    int64   magic " BDV"                     uint32  file version, library major, library minor
    uint8   has grid offsets                 before 222: uint8 all is zlib       char[36] UUID
    metadata of the file                     int32   number of grids
    per grid:
        string  name, unique by a suffix "\x1e" number
        string  tree type: Tree_<value type>_5_4_3, maybe with "_HalfFloat" (what counts is the grid's
                metadata "is_saved_as_half_float", as in OpenVDB)
        string  instance parent: unique name of the grid whose tree this one shares, else empty
        int64   positions of the grid, of its leaf buffers, of its end (zeros without grid offsets)
        uint32  compression: 1 zlib | 2 active mask | 4 Blosc (not before 222)
        metadata; transform; topology; leaf buffers

    metadata    uint32 count; per item: string name, string type, uint32 size, bytes
    transform   string map type, then float64: ScaleMap and UniformScaleMap 5 vectors (the first is the
                scale), ScaleTranslateMap and UniformScaleTranslateMap 6 (translation, scale), TranslationMap
                1, AffineMap and UnitaryMap a 4×4 matrix for row vectors
    topology    int32 1; value background; uint32 tiles, children of the root;
                per root tile: int32[3] origin, value, uint8 active;
                per root child: int32[3] origin, upper node
    upper node  bits[32³] has child, bits[32³] active, block of 32³ values, then its lower nodes
    lower node  bits[16³] has child, bits[16³] active, block of 16³ values, then per leaf: bits[512] active
    leaf buffers, children of the root by ascending origin: bits[512] active again, block of 512 values
                (bool leaves: bits[512] active, int32[3] origin, bits[512] values; mask leaves: no values, the
                active voxels are the set ones. Before 222 others have int32[3] origin, int8 1 as well.)
    block       int8 kind; 0-2 value(s) for the inactive entries; maybe bits: which of the two; the values:
                of all entries, or with an active mask (and kind < 6) of the active ones only.
                Values are plain, or an int64 size and a compressed block of that size; a size ≤ 0 means
                -size plain bytes. Of half floats none are no bytes, without a size. Before 222 there is no
                kind: all entries are stored, of upper and lower nodes those without a child.

    kind 0  inactive are +background         kind 3  bits choose -background or +background
    kind 1  inactive are -background         kind 4  bits choose the value stored or +background
    kind 2  inactive are the value stored    kind 5  bits choose between the two values stored
                                             kind 6  no inactive entry is left out

`open_grids` describes the grids; `walk_topology` reads a tree without its voxels, `walk_leaves` its voxels
in batches, which go into a dense array or stay leaves.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.binary import Cursor, map_file, unblosc, unzip
from tfm_cl.files.volume_io.grid import Grid, GridClass, refuse, shown, with_distinct_names
from tfm_cl.files.volume_io.tree import (
    VECTORS,
    LeafBatch,
    Tiles,
    Tree,
    as_three,
    batches,
    count_leaves,
    differs,
    fill_dense,
    fill_vectors,
    gather_leaves,
    gather_vectors,
    offset_transform,
    place_origins,
)
from tfm_cl.files.volume_io.tree_shape import LEAF_VOXELS, LOWER_EDGE, ROOT_EDGE, UPPER_EDGE, vector_type

if TYPE_CHECKING:
    from tfm_cl.files.volume_io.leaves import Leaves

__all__ = ["EXTENSIONS", "StoredTree", "Topology", "open_grids", "walk_leaves", "walk_topology"]

EXTENSIONS = (".vdb",)

_MAGIC = 0x56444220
_VERSIONS = range(220, 226)
_FIRST_WITH_KINDS = 222
"""First version whose blocks omit inactive values."""
_ZLIB, _ACTIVE_MASK, _BLOSC = 1, 2, 4
_VALUE_TYPES: dict[str, np.dtype[Any]] = {
    "float": np.dtype("<f4"),
    "double": np.dtype("<f8"),
    "half": np.dtype("<f2"),
    "int32": np.dtype("<i4"),
    "int64": np.dtype("<i8"),
    "bool": np.dtype("u1"),
    "mask": np.dtype("u1"),
    "vec3s": vector_type("<f4"),
    "vec3d": vector_type("<f8"),
    "vec3i": vector_type("<i4"),
}
_HALF_TYPES = {"float": np.dtype("<f2"), "double": np.dtype("<f2")} | dict.fromkeys(
    ("vec3s", "vec3d"), vector_type("<f2")
)
_REMEDIES = {
    "ptdataidx32": "points, not densities; rasterize them first, for instance with OpenVDB's rasterizePoints",
    "ptidx32": "indices of points, not densities; rasterize the points first",
    "string": "text, not densities",
}
_GRID_CLASSES: dict[str, GridClass] = {
    "fog volume": "fog volume",
    "level set": "level set",
    "staggered": "staggered",
}


@dataclass(frozen=True)
class StoredTree:
    """The position of a tree in a file, and how its values are stored."""

    at: int
    """Byte where the topology begins."""
    value: np.dtype[Any]
    """Type of a value; bool is uint8."""
    stored: np.dtype[Any]
    """Type of the values in blocks: ``value``, or half floats."""
    name: str
    """OpenVDB's name of the type."""
    compression: int
    has_kinds: bool = True
    """Whether blocks state which values they omit, as they do since version 222."""

    @property
    def is_bool(self) -> bool:
        """Whether leaves store bits; the bits of a mask are its active voxels."""
        return self.name in ("bool", "mask")

    @property
    def is_vector(self) -> bool:
        """Whether a value is three numbers."""
        return self.value.names is not None

    @property
    def label(self) -> str:
        """Name of the type as shown to users."""
        return self.name if self.is_bool or self.is_vector else self.stored.name


@dataclass(frozen=True)
class Topology:
    """A tree without its voxels, and the data needed to read them."""

    tree: Tree
    background: NDArray[Any]
    """[1], background, of the type of the tree's values."""
    leaf_masks: NDArray[np.uint8]
    """[n, 64], bits of the active voxels."""
    leaves_at: int
    """Byte where the leaf buffers begin."""


# ------------------------------------------------------------------------------------------- the file


def open_grids(path: Path) -> list[Grid]:
    """Describe the grids of an OpenVDB file; their topology is walked, their voxels are not read.

    Raises
    ------
    VolumeError
        Not an OpenVDB file, of an unknown version, or damaged.
    """
    file = Cursor(map_file(path), str(path))
    version, has_offsets, is_zipped = _read_header(file)
    archive = _Archive(version, has_offsets, _ZLIB if is_zipped else 0)
    _read_metadata(file)
    (count,) = file.numbers("i", "number of grids")
    trees: dict[str, _Found | str] = {}
    described = {}
    for behind in reversed(range(count)):
        unique_name, grid = _read_grid(file, path, trees, archive, skip_leaves=behind > 0 and not has_offsets)
        if unique_name in described:
            raise file.damaged(f"two grids have the unique name {shown(unique_name)}")
        described[unique_name] = grid
        if isinstance(trees[unique_name], str) and behind and not has_offsets:
            # Without offsets the end of a grid is only found by reading it.
            lost = f"{grid.unsupported}; {behind} grid(s) behind it cannot be reached"
            described[unique_name] = replace(grid, unsupported=lost)
            break
    return with_distinct_names(list(described.values()))


class _Archive(NamedTuple):
    """Properties of all grids of a file."""

    version: int
    has_offsets: bool
    compression: int
    """Compression before version 222, where it is not stored per grid."""


def _read_header(file: Cursor) -> tuple[int, bool, bool]:
    """Read up to the file's metadata: version, whether grids have offsets, whether everything is zlib."""
    if len(file.data) < 8 or file.numbers("q", "magic") != (_MAGIC,):  # noqa: PLR2004 - bytes of the magic
        raise VolumeError(f"{file.source}: not an OpenVDB file: it does not begin with ' BDV'")
    version, _, _, has_offsets = file.numbers("IIIB", "header")
    if version not in _VERSIONS:
        remedy = (
            "it is newer than tfm_cl knows: update tfm_cl, or save it with an older OpenVDB"
            if version > _VERSIONS[-1]
            else "save it again with a current OpenVDB"
        )
        raise VolumeError(
            f"{file.source}: OpenVDB file version {version}; versions {_VERSIONS[0]} to {_VERSIONS[-1]} "
            f"can be read: {remedy}"
        )
    is_zipped = version < _FIRST_WITH_KINDS and file.numbers("B", "compression") != (0,)
    file.take(36, "UUID")
    return version, bool(has_offsets), is_zipped


def _read_metadata(file: Cursor) -> dict[str, bytes]:
    """Read a metadata map; values stay bytes, and the last value of a name wins."""
    (count,) = file.numbers("I", "number of metadata items")
    items = {}
    for _ in range(count):
        name = file.text("metadata name")
        file.text("metadata type")
        (size,) = file.numbers("I", "metadata size")
        items[name] = bytes(file.take(size, f"metadata {shown(name)}"))
    return items


# -------------------------------------------------------------------------------------------- a grid


@dataclass(frozen=True)
class _Found:
    """A tree found in the file, and the contents of its topology."""

    stored: StoredTree
    low: NDArray[np.int64]
    """Index coordinates (x, y, z) of the low voxel of its box."""
    shape: tuple[int, int, int]
    background: tuple[float, float, float]
    """Background; for scalar values, three times the same."""
    active_voxels: int
    leaf_count: int


def _read_grid(
    file: Cursor,
    path: Path,
    trees: dict[str, _Found | str],
    archive: _Archive,
    *,
    skip_leaves: bool,
) -> tuple[str, Grid]:
    """Read a grid's unique name and description; leaves the file where the grid ends.

    ``trees`` holds the trees found so far by unique name (or the reason why one is not supported), for
    instances. Without offsets, the end is only known after the leaf buffers, which ``skip_leaves`` skips.
    """
    unique_name = file.text("grid name")
    tree_type = file.text("tree type")
    parent = file.text("instance parent")
    grid_at, _, end = file.numbers("3q", "grid positions")
    if archive.has_offsets:
        if not file.at <= grid_at <= end <= len(file.data):
            raise file.damaged(f"grid {shown(unique_name)} claims to lie at bytes {grid_at} to {end}")
        file.at = grid_at
    has_kinds = archive.version >= _FIRST_WITH_KINDS
    (compression,) = file.numbers("I", "compression") if has_kinds else (archive.compression,)
    if compression & ~(_ZLIB | _ACTIVE_MASK | _BLOSC):
        raise file.damaged(f"unknown compression {compression:#x}")
    metadata = _read_metadata(file)
    world_from_tree = _read_transform(file)

    if parent and parent not in trees:
        raise file.damaged(
            f"grid {shown(unique_name)} shares the tree of {shown(parent)}, which is missing before it"
        )
    found: _Found | str
    if parent:
        found = trees[parent]
    elif isinstance(world_from_tree, str):
        found = world_from_tree
    else:
        is_half = any(metadata.get("is_saved_as_half_float", b""))
        stored = _stored_tree(tree_type, compression, file.at, is_half=is_half, has_kinds=has_kinds)
        found = stored if isinstance(stored, str) else _find_tree(file, stored, skip_leaves=skip_leaves)
    trees[unique_name] = found
    if archive.has_offsets:
        file.at = end

    name = unique_name.partition("\x1e")[0]
    if isinstance(world_from_tree, str) or isinstance(found, str):
        reason = found if isinstance(found, str) else str(world_from_tree)
        value_type = shown(tree_type.removeprefix("Tree_").partition("_")[0])[1:-1]
        return unique_name, _unsupported(path, name, value_type, reason, metadata)
    grid = Grid(
        name=name,
        grid_class=_grid_class(metadata),
        value_type=found.stored.label,
        shape=found.shape,
        world_from_index=offset_transform(world_from_tree, found.low, file),
        has_transform=True,
        is_box_of_stored=True,
        read=partial(_read_dense, path, found.stored, found.shape),
        active_voxels=found.active_voxels,
    )
    if found.stored.is_vector:
        return unique_name, replace(
            grid,
            read=partial(refuse, path, name, VECTORS),
            read_colour=partial(_read_vectors, path, found.stored, found.shape),
            read_vector_leaves=partial(_read_vector_leaves, path, found.stored, found.shape),
            colour_background=found.background,
            unsupported=VECTORS,
        )
    return unique_name, replace(
        grid,
        read_leaves=partial(_read_leaves, path, found.stored, found.shape),
        leaf_count=found.leaf_count,
        background=found.background[0],
    )


def _find_tree(file: Cursor, stored: StoredTree, *, skip_leaves: bool) -> _Found:
    """Walk the tree that begins here; leaves the file after its topology, or after its leaf buffers."""
    topology = walk_topology(file, stored)
    if skip_leaves:
        _skip_leaves(file, stored, topology)
    tree = topology.tree
    low, shape = tree.box()
    background = as_three(topology.background)
    return _Found(stored, low, shape, background, tree.active_voxels, count_leaves(tree))


def _stored_tree(
    tree_type: str, compression: int, at: int, *, is_half: bool, has_kinds: bool
) -> StoredTree | str:
    """How the tree's values are stored, or the reason why the tree is not supported."""
    match = re.fullmatch(r"Tree_(\w+?)_5_4_3(?:_HalfFloat)?", tree_type)
    if match is None:
        return f"trees of type {shown(tree_type)}; save the grid with OpenVDB's default tree, 5_4_3"
    name = match[1]
    value = _VALUE_TYPES.get(name)
    if value is None:
        remedy = _REMEDIES.get(name, f"known: {' '.join(_VALUE_TYPES)}")
        return f"{shown(name)[1:-1]} values: {remedy}"
    stored = _HALF_TYPES.get(name, value) if is_half else value
    return StoredTree(at, value, stored, name, compression, has_kinds)


def _unsupported(path: Path, name: str, value_type: str, reason: str, metadata: dict[str, bytes]) -> Grid:
    """Describe a grid that can only be listed, not read."""
    return Grid(
        name=name,
        grid_class=_grid_class(metadata),
        value_type=value_type,
        shape=(0, 0, 0),
        world_from_index=np.eye(4),
        has_transform=False,
        read=partial(refuse, path, name, reason),
        unsupported=reason,
    )


def _grid_class(metadata: dict[str, bytes]) -> GridClass:
    return _GRID_CLASSES.get(metadata.get("class", b"").decode(errors="replace"), "unknown")


def _read_transform(file: Cursor) -> NDArray[np.float64] | str:
    """World-from-index matrix of the tree's coordinates, or the reason why it is not supported."""
    map_type = file.text("transform type")
    vectors = {
        "ScaleMap": 5,
        "UniformScaleMap": 5,
        "ScaleTranslateMap": 6,
        "UniformScaleTranslateMap": 6,
        "TranslationMap": 1,
    }
    matrix = np.eye(4)
    if map_type in ("AffineMap", "UnitaryMap"):
        return file.array(np.dtype("<f8"), 16, map_type).reshape(4, 4).T.astype(np.float64)
    if map_type not in vectors:
        if map_type == "NonlinearFrustumMap":
            return "a frustum transform; resample the grid to a linear one first"
        return f"a transform of type {shown(map_type)}"
    numbers = file.array(np.dtype("<f8"), 3 * vectors[map_type], map_type)
    if map_type.endswith(("TranslateMap", "TranslationMap")):
        matrix[:3, 3] = numbers[:3]
        numbers = numbers[3:]
    if len(numbers):
        matrix[range(3), range(3)] = numbers[:3]
    return matrix


def _read_dense(path: Path, stored: StoredTree, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Read a grid's voxels for `Grid.read`."""
    file = Cursor(map_file(path), str(path), stored.at)
    topology = walk_topology(file, stored)
    return fill_dense(topology.tree, walk_leaves(file, stored, topology), shape, file)


def _read_leaves(path: Path, stored: StoredTree, shape: tuple[int, int, int]) -> Leaves:
    """Read a grid's voxels for `Grid.read_leaves`."""
    file = Cursor(map_file(path), str(path), stored.at)
    topology = walk_topology(file, stored)
    return gather_leaves(topology.tree, walk_leaves(file, stored, topology), shape, file)


def _read_vectors(path: Path, stored: StoredTree, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Read a grid's vectors for `Grid.read_colour`."""
    file = Cursor(map_file(path), str(path), stored.at)
    topology = walk_topology(file, stored)
    walk = partial(walk_leaves, file, stored, topology)
    return fill_vectors(topology.tree, topology.background, walk, shape, file)


def _read_vector_leaves(path: Path, stored: StoredTree, shape: tuple[int, int, int]) -> tuple[Leaves, ...]:
    """Read a grid's vectors for `Grid.read_vector_leaves`."""
    file = Cursor(map_file(path), str(path), stored.at)
    topology = walk_topology(file, stored)
    return gather_vectors(topology.tree, partial(walk_leaves, file, stored, topology), shape, file)


# ------------------------------------------------------------------------------------------- the tree


def walk_topology(file: Cursor, stored: StoredTree) -> Topology:
    """Read a tree without the voxels of its leaves.

    Parameters
    ----------
    file
        Positioned at ``stored.at``; left after the topology.
    stored
        The tree's position and types.

    Raises
    ------
    VolumeError
        The bytes cannot be a tree.
    """
    (buffers,) = file.numbers("i", "number of buffers")
    if buffers != 1:
        raise file.damaged(f"the tree should have 1 buffer, it claims {buffers}")
    background = file.array(stored.value, 1, "background")
    tile_count, child_count = file.numbers("2I", "number of root entries")
    tile_type = np.dtype([("origin", "<i4", 3), ("value", stored.value), ("active", "u1")])
    root = file.array(tile_type, tile_count, "root tiles")
    active_voxels = int(np.count_nonzero(root["active"])) * ROOT_EDGE**3
    values: NDArray[Any] = root["value"]
    if stored.name == "mask":
        values, background = root["active"], np.zeros(1, np.uint8)
    kept = differs(values, background)
    tiles = [Tiles(ROOT_EDGE, root["origin"][kept].astype(np.int64), values[kept])]

    children: dict[tuple[int, ...], _Branch] = {}
    for _ in range(child_count):
        origin = file.array(np.dtype("<i4"), 3, "origin of a root child").astype(np.int64)
        children[tuple(origin.tolist())] = _walk_upper(file, stored, background, origin)
    root_origins = {*children, *map(tuple, root["origin"].tolist())}
    if len(root) + child_count != len(root_origins) or any(
        n % ROOT_EDGE for one in root_origins for n in one
    ):
        raise file.damaged("origins at the root repeat or are no multiples of 4096")

    # Their leaf buffers follow in this order, regardless of the order of the children.
    branches = [children[origin] for origin in sorted(children)]
    for edge in (UPPER_EDGE, LOWER_EDGE):
        at_edge = [tiles for branch in branches for tiles in branch.tiles if tiles.edge == edge]
        if at_edge:
            origins, constants = ([getattr(t, name) for t in at_edge] for name in ("origins", "values"))
            tiles.append(Tiles(edge, np.concatenate(origins), np.concatenate(constants)))
    leaf_origins = [origins for branch in branches for origins in branch.leaf_origins]
    leaf_masks = [masks for branch in branches for masks in branch.leaf_masks]
    tree = Tree(
        background=as_three(background)[0],
        tiles=[t for t in tiles if len(t.origins)],
        leaf_origins=np.concatenate([np.empty((0, 3), np.int64), *leaf_origins]),
        active_voxels=active_voxels + sum(branch.active_voxels for branch in branches),
    )
    all_masks = np.concatenate([np.empty((0, 64), np.uint8), *leaf_masks])
    return Topology(tree, background, all_masks, file.at)


@dataclass
class _Branch:
    """The contents found below one child of the root."""

    tiles: list[Tiles]
    leaf_origins: list[NDArray[np.int64]]
    leaf_masks: list[NDArray[np.uint8]]
    active_voxels: int = 0


def _walk_upper(
    file: Cursor, stored: StoredTree, background: NDArray[Any], origin: NDArray[np.int64]
) -> _Branch:
    """Read an upper node and everything below it, down to the masks of the leaves."""
    branch = _Branch([], [], [])
    for lower_origin in _read_internal(file, stored, background, origin, UPPER_EDGE, branch):
        leaves = _read_internal(file, stored, background, lower_origin, LOWER_EDGE, branch)
        masks = file.array(np.dtype(np.uint8), 64 * len(leaves), "leaf masks").reshape(-1, 64)
        branch.leaf_origins.append(leaves)
        branch.leaf_masks.append(masks)
        branch.active_voxels += int(np.unpackbits(masks).sum())
    return branch


def _read_internal(
    file: Cursor,
    stored: StoredTree,
    background: NDArray[Any],
    origin: NDArray[np.int64],
    edge: int,
    branch: _Branch,
) -> NDArray[np.int64]:
    """Read an upper or lower node without its children; returns their origins [n, 3]."""
    size = 32**3 if edge == UPPER_EDGE else 16**3
    child_mask, active_mask = (file.take(size // 8, "node mask") for _ in range(2))
    has_child, count = _bits(child_mask), int.from_bytes(active_mask, "little").bit_count()
    entries = np.arange(size) if stored.has_kinds else np.flatnonzero(~has_child)
    block = _read_block(file, stored, background, count, len(entries))
    if stored.has_kinds and count == 0 and block.is_all(background):
        return place_origins(origin, np.flatnonzero(has_child), edge)
    active, values = _bits(active_mask), np.zeros(size, stored.value)
    values[entries] = _unpack_blocks([block], active[None, entries], stored, file)[0]
    if stored.name == "mask":
        values = active.astype(np.uint8)
    active_tiles = int(np.count_nonzero(active & ~has_child))
    branch.active_voxels += active_tiles * edge**3
    kept = np.flatnonzero(~has_child & differs(values, background))
    if len(kept):
        branch.tiles.append(Tiles(edge, place_origins(origin, kept, edge), values[kept]))
    return place_origins(origin, np.flatnonzero(has_child), edge)


def walk_leaves(file: Cursor, stored: StoredTree, topology: Topology) -> Iterator[LeafBatch]:
    """Read the voxels of a tree in batches of leaves.

    Parameters
    ----------
    file
        The tree's file, at any position.
    stored, topology
        The tree, and its topology from `walk_topology`.

    Raises
    ------
    VolumeError
        The bytes are not that tree's leaves.
    """
    file.at = topology.leaves_at
    all_origins = batches(topology.tree.leaf_origins)
    for masks, origins in zip(batches(topology.leaf_masks), all_origins, strict=True):
        if stored.is_bool:
            values = _read_bool_leaves(file, masks, stored)
        else:
            blocks = list(_read_leaf_blocks(file, stored, topology.background, masks))
            values = _unpack_blocks(blocks, _bits(masks), stored, file)
        yield LeafBatch(origins, values.reshape(-1, 8, 8, 8))


def _skip_leaves(file: Cursor, stored: StoredTree, topology: Topology) -> None:
    """Skip the leaf buffers, which begin here, without decompressing them."""
    for masks in batches(topology.leaf_masks):
        if stored.is_bool:
            _read_bool_leaves(file, masks, stored)
        else:
            for _ in _read_leaf_blocks(file, stored, topology.background, masks):
                pass


def _read_bool_leaves(file: Cursor, masks: NDArray[np.uint8], stored: StoredTree) -> NDArray[np.uint8]:
    """Read leaves of a bool or mask tree: [n, 512] of 0 and 1."""
    fields = [("active", "u1", 64), ("origin", "<i4", 3), ("values", "u1", 64)]
    leaf = np.dtype(fields if stored.name == "bool" else fields[:2])
    leaves = file.array(leaf, len(masks), "bool leaves")
    if not np.array_equal(leaves["active"], masks):
        raise file.damaged("active voxels of a leaf are not those of the topology")
    return _bits(leaves["values"] if stored.name == "bool" else masks).view(np.uint8)


# ---------------------------------------------------------------------------------- blocks of values


_LEAF_HEAD = struct.Struct("<64sBq")
"""Mask, kind and bytes of a leaf whose block is compressed and has no values for inactive voxels."""


class _Block(NamedTuple):
    """The values of a node as stored."""

    is_complete: bool
    """Whether all entries are stored, not only the active ones."""
    inactive: bytes
    """Two values for entries that are not stored; the second where ``choice`` is set."""
    choice: memoryview | None
    """Bits per entry; if missing, none is set."""
    codec: int
    """0, or the codec of ``packed``."""
    size: int
    """Size in bytes when unpacked."""
    packed: memoryview

    def is_all(self, value: NDArray[Any]) -> bool:
        """Tell whether no entry is stored, and all are this value."""
        if self.size or self.choice is not None:
            return False
        return not differs(np.frombuffer(self.inactive, value.dtype, 1), value).any()


def _read_leaf_blocks(
    file: Cursor, stored: StoredTree, background: NDArray[Any], masks: NDArray[np.uint8]
) -> Iterator[_Block]:
    """Read the blocks of leaves, of which there are tens of thousands: usual ones in one step each."""
    counts = _bits(masks).sum(axis=1).tolist()
    codec = stored.compression & (_BLOSC | _ZLIB) if stored.has_kinds else 0
    plus = background.tobytes()
    usual = {6: plus + plus, 0: plus + plus, 1: _negated(background, stored).tobytes() + plus}
    saves = stored.compression & _ACTIVE_MASK
    item, data, end = stored.stored.itemsize, file.data, len(file.data) - _LEAF_HEAD.size
    for mask, count in zip(masks.view("V64").ravel().tolist(), counts, strict=True):
        if codec and count and file.at <= end:
            stored_mask, kind, packed_size = _LEAF_HEAD.unpack_from(data, file.at)
            begin = file.at + _LEAF_HEAD.size
            if stored_mask == mask and kind in usual and 0 < packed_size <= len(data) - begin:
                file.at = begin + packed_size
                is_complete = kind == 6 or not saves  # noqa: PLR2004 - as in `_read_block`
                size = (LEAF_VOXELS if is_complete else count) * item
                yield _Block(is_complete, usual[kind], None, codec, size, data[begin : file.at])
                continue
        if file.take(64, "leaf mask") != mask:
            raise file.damaged("active voxels of a leaf are not those of the topology")
        if not stored.has_kinds and file.numbers("3ib", "origin and buffers of a leaf")[-1] != 1:
            raise file.damaged("a leaf should have 1 buffer")
        yield _read_block(file, stored, background, count, LEAF_VOXELS)


def _read_block(file: Cursor, stored: StoredTree, background: NDArray[Any], active: int, size: int) -> _Block:
    """Read the values of a node with ``size`` entries, ``active`` of them active, without unpacking."""
    kind = file.take(1, "kind of a block")[0] if stored.has_kinds else 6
    if kind > 6:  # noqa: PLR2004 - the module's docstring lists them
        raise file.damaged(f"a block of values is of the unknown kind {kind}")
    value_size = stored.value.itemsize
    plus = background.tobytes()
    if kind in (2, 4):
        inactive = bytes(file.take(value_size, "inactive value")) + plus
    elif kind == 5:  # noqa: PLR2004
        inactive = bytes(file.take(2 * value_size, "inactive values"))
    else:
        inactive = plus + plus if kind == 0 else _negated(background, stored).tobytes() + plus
    choice = file.take(size // 8, "choice of inactive values") if kind in (3, 4, 5) else None
    is_complete = kind == 6 or not stored.compression & _ACTIVE_MASK  # noqa: PLR2004
    plain_size = (size if is_complete else active) * stored.stored.itemsize
    codec = stored.compression & (_BLOSC | _ZLIB)
    if plain_size == 0 and stored.stored != stored.value:
        codec = 0  # no half floats are stored as nothing at all, not as an empty compressed block
    packed_size = plain_size
    if codec:
        (packed_size,) = file.numbers("q", "size of a compressed block")
        if packed_size <= 0:
            codec, packed_size = 0, -packed_size
            if packed_size != plain_size:
                raise file.damaged(f"a plain block should have {plain_size} bytes, it claims {packed_size}")
    return _Block(is_complete, inactive, choice, codec, plain_size, file.take(packed_size, "values"))


def _negated(background: NDArray[Any], stored: StoredTree) -> NDArray[Any]:
    """Return what OpenVDB calls minus the background."""
    if stored.is_bool:
        opposite: NDArray[Any] = np.logical_not(background).astype(stored.value)
        return opposite
    numbers = background.view(stored.value["x"]) if stored.is_vector else background
    negated: NDArray[Any] = np.negative(numbers).view(stored.value)
    return negated


def _unpack_blocks(
    blocks: list[_Block], active: NDArray[np.bool_], stored: StoredTree, file: Cursor
) -> NDArray[Any]:
    """Values of nodes of one size, [node, entry], from their blocks and active entries [node, entry]."""
    values = np.empty(active.shape, stored.value)
    inactive = np.frombuffer(b"".join(block.inactive for block in blocks), stored.value).reshape(-1, 2)
    values[:] = inactive[:, :1]
    for row, block in enumerate(blocks):
        if block.choice is not None:
            values[row, _bits(block.choice)] = inactive[row, 1]
    is_stored = active | np.array([block.is_complete for block in blocks])[:, None]
    plain = b"".join([_unpack(block, file) for block in blocks])
    with np.errstate(invalid="ignore"):  # a signalling half stays a NaN
        values.reshape(-1)[np.flatnonzero(is_stored)] = np.frombuffer(plain, stored.stored)
    return values


def _unpack(block: _Block, file: Cursor) -> bytes | bytearray | memoryview:
    if block.size == 0:
        return b""  # Blosc wraps even empty data
    if block.codec & _BLOSC:
        return unblosc(block.packed, block.size, file)
    return unzip(block.packed, block.size, file) if block.codec else block.packed


def _bits(masks: NDArray[np.uint8] | memoryview) -> NDArray[np.bool_]:
    """Bits of masks [..., bytes] as booleans [..., bits], lowest first."""
    unpacked = np.unpackbits(np.asarray(masks, np.uint8), axis=-1, bitorder="little")
    return unpacked.view(np.bool_)
