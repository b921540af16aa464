"""NanoVDB files (``.nvdb``), library versions 32.3 and later of major version 32.

A file is a row of segments, or (since 32.6) bare grids one behind the other. Little-endian::

    segment     uint64  magic "NanoVDB0" or "NanoVDB2"     uint32  version: major << 21 | minor << 10 | patch
                uint16  number of grids, codec: 0 none, 1 zlib, 2 Blosc
                per grid: its file metadata, then its name (with a final zero)
                per grid: the grid, packed as the codec says
    metadata    0 uint64 size of the grid       8 uint64 size in the file (not trusted: writers differ)
                16 uint64 hash of the name     24 uint64 active voxels    32 uint32 type, class
                40 float64[6] world box        88 int32[6] index box     112 float64[3] voxel size
                136 uint32 size of the name   140 uint32[7] node counts  168 uint16 codec, 0, uint32 version
    packed      none: the bytes; zlib: uint64 size, stream; Blosc: the same for every GiB of the grid

    grid        0 uint64 magic "NanoVDB0" or "NanoVDB1"    16 uint32 version    32 uint64 size of the grid
                40 char[256] name            296 map: at 88 float64[9] matrix, at 232 float64[3] translation
                632 uint32 class, type       672 tree
    tree        0 uint64[4] where the leaf, lower, upper and root nodes begin, from the tree
    root        24 uint32 number of tiles; background; statistics; padding to 32; tiles of 32 bytes
    root tile   0 uint64 key x << 42 | y << 21 | z, each >> 12
                8 int64 offset of the upper node from the root, or 0;  16 uint32 active;  value
    upper node  32 bits[32³] active, bits[32³] has child; statistics; at 8256 the table, 8 bytes an entry:
                the int64 offset of the lower node from this one, or the value of a tile
    lower node  32 bits[16³] active, bits[16³] has child; statistics; at 1088 the table, offsets to leaves
    leaf        0 int32[3] low corner of the active voxels, 12 uint8[3] extent, uint8 flags
                16 bits[512] active; statistics; the 512 values, aligned to 32 bytes
                Fp4, Fp8, Fp16, FpN: 80 float32 minimum, quantum; at 96 codes of 4, 8, 16 or
                1 << (flags >> 5) bits; value = code · quantum + minimum
                bool: 80 bits[512] values; mask: no values, the active voxels are the set ones
                index: 80 uint64 index of the first value; the others', or the other active ones', follow
    statistics  least, largest, mean, deviation; with them nodes of large values grow (see `nvdb_layout`)
    blind data  of index grids: the values (a grid's 640 int64 offset, 648 uint32 count). Each 288 bytes:
                0 int64 offset of its data from here, 8 uint64 count, 16 uint32 bytes of a value,
                20 uint32 semantic, class, type; name

`open_grids` describes the grids. `walk_topology` reads an unpacked grid's tree without its voxels,
`walk_leaves` these in batches, which go into a dense array or stay leaves.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.binary import (
    Cursor,
    check_packing,
    map_file,
    unblosc_into,
    unzip_into,
)
from tfm_cl.files.volume_io.grid import Grid, GridClass, refuse, shown, with_distinct_names
from tfm_cl.files.volume_io.nvdb_layout import Layout, entries_of_node
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

__all__ = ["EXTENSIONS", "Topology", "open_grids", "walk_leaves", "walk_topology"]

EXTENSIONS = (".nvdb",)

_SEGMENT_MAGICS = (b"NanoVDB0", b"NanoVDB2")
_GRID_MAGICS = (b"NanoVDB0", b"NanoVDB1")
_MAJOR, _FIRST_MINOR = 32, 3
_NO_CODEC, _ZLIB, _BLOSC = 0, 1, 2
_BLOSC_CHUNK = 1 << 30
_GRID_SIZE, _METADATA_SIZE = 672, 176
_BLIND_SIZE = 288
_BLIND_NAMES = (1, 3)
"""Classes of blind data that do not hold values but indices and names."""

_GRID_CLASSES: dict[int, GridClass] = {1: "level set", 2: "fog volume", 3: "staggered"}
_UNSUPPORTED_TYPES = {
    0: "unknown",
    12: "rgba8",
    17: "vec4f",
    18: "vec4d",
    21: "index mask",
    22: "on-index mask",
    23: "point index",
    24: "vec3u8",
    25: "vec3u16",
}

_LAYOUTS = {
    1: Layout("float32", np.dtype("<f4")),
    2: Layout("float64", np.dtype("<f8"), 8),
    3: Layout("int16", np.dtype("<i2")),
    4: Layout("int32", np.dtype("<i4")),
    5: Layout("int64", np.dtype("<i8"), 8),
    6: Layout("vec3f", vector_type("<f4")),
    7: Layout("vec3d", vector_type("<f8"), 8),
    8: Layout("mask", np.dtype("u1"), 1, "mask"),
    9: Layout("float16", np.dtype("<f2")),
    10: Layout("uint32", np.dtype("<u4")),
    11: Layout("bool", np.dtype("u1"), 1, "bits"),
    13: Layout("fp4", np.dtype("<f4"), form="codes", code_bits=4),
    14: Layout("fp8", np.dtype("<f4"), form="codes", code_bits=8),
    15: Layout("fp16", np.dtype("<f4"), form="codes", code_bits=16),
    16: Layout("fpn", np.dtype("<f4"), form="codes", code_bits=-1),
    19: Layout("index", np.dtype("<u8"), 8, "index"),
    20: Layout("on-index", np.dtype("<u8"), 8, "on-index"),
    26: Layout("uint8", np.dtype("u1")),
}


@dataclass(frozen=True)
class Topology:
    """A tree without its voxels, and the positions of the voxels."""

    tree: Tree
    leaves_at: NDArray[np.int64]
    """[n], byte of the grid where each leaf begins."""
    background: NDArray[Any]
    """[1], background, of the type of the tree's values."""
    channel: NDArray[Any] | None = None
    """Values that the indices of an index grid refer to."""


# ------------------------------------------------------------------------------------------- the file


@dataclass(frozen=True)
class _Entry:
    """A grid as listed in the file."""

    name: str
    grid_type: int
    grid_class: GridClass
    size: int
    """Size in bytes when unpacked."""
    at: int
    codec: int


def open_grids(path: Path) -> list[Grid]:
    """Describe the grids of a NanoVDB file.

    A grid's transform and the exact box of its stored voxels are inside the packed grid (the metadata only
    have the box of the active voxels), so grids are unpacked and their topology is walked. Grids of a type
    that cannot be read are only listed.

    Raises
    ------
    VolumeError
        Not a NanoVDB file, of an unknown version, or damaged.
    """
    file = Cursor(map_file(path), str(path))
    return with_distinct_names([_describe(file, path, entry) for entry in _list_entries(file)])


def _list_entries(file: Cursor) -> list[_Entry]:
    """List the grids of all segments, or of a file of bare grids."""
    magic = bytes(file.data[:8])
    if magic not in (*_SEGMENT_MAGICS, *_GRID_MAGICS):
        raise VolumeError(f"{file.source}: not a NanoVDB file: it does not begin with 'NanoVDB'")
    is_bare = magic not in _SEGMENT_MAGICS or (
        # The old magic is used for both; it is followed by the version in a segment, by a checksum in a grid.
        not _is_known(_version_at(file, 8)) and _is_known(_version_at(file, 16))
    )
    entries: list[_Entry] = []
    while not entries or _goes_on(file):
        entries += [_read_bare_grid(file)] if is_bare else _read_segment(file)
        if file.at == len(file.data):
            break
    return entries


def _goes_on(file: Cursor) -> bool:
    """Distinguish a segment or grid from the bytes that some writers leave after the last one."""
    rest = bytes(file.data[file.at : file.at + 8])
    return rest != b"" and any(magic.startswith(rest) for magic in (*_SEGMENT_MAGICS, *_GRID_MAGICS))


def _version_at(file: Cursor, at: int) -> tuple[int, int]:
    """Major and minor library version stored at a byte of the file."""
    if len(file.data) < at + 4:
        raise file.damaged("the header is cut short")
    (version,) = struct.unpack_from("<I", file.data, at)
    return version >> 21, version >> 10 & 0x7FF


def _is_known(version: tuple[int, int]) -> bool:
    return version[0] == _MAJOR and version[1] >= _FIRST_MINOR


def _check_version(file: Cursor, at: int) -> None:
    version = _version_at(file, at)
    if not _is_known(version):
        remedy = (
            "it is newer than tfm_cl knows: update tfm_cl, or convert with an older nanovdb_convert"
            if version[0] > _MAJOR
            else "convert the original again with a current nanovdb_convert"
        )
        raise VolumeError(
            f"{file.source}: NanoVDB version {version[0]}.{version[1]}; {_MAJOR}.{_FIRST_MINOR} and later "
            f"{_MAJOR}.x can be read: {remedy}"
        )


def _read_segment(file: Cursor) -> list[_Entry]:
    """Read a segment's list of grids and skip their bytes."""
    if bytes(file.take(8, "magic of a segment")) not in _SEGMENT_MAGICS:
        raise file.damaged("no segment begins 8 bytes before")
    _check_version(file, file.at)
    _, count, codec = file.numbers("IHH", "header of a segment")
    if codec not in (_NO_CODEC, _ZLIB, _BLOSC):
        raise file.damaged(f"unknown codec {codec}")
    listed = []
    for _ in range(count):
        metadata = file.take(_METADATA_SIZE, "metadata of a grid")
        (size,) = struct.unpack_from("<Q", metadata)
        grid_type, grid_class = struct.unpack_from("<2I", metadata, 32)
        (name_size,) = struct.unpack_from("<I", metadata, 136)
        name = _text(file.take(name_size, "name of a grid"))
        listed.append((name, grid_type, _GRID_CLASSES.get(grid_class, "unknown"), size))
    entries = []
    for name, grid_type, grid_class, size in listed:
        entries.append(_Entry(name, grid_type, grid_class, size, file.at, codec))
        for _ in _chunks(file, size, codec):
            pass
    return entries


def _read_bare_grid(file: Cursor) -> _Entry:
    """Read a grid's own header and skip the grid."""
    at = file.at
    head = file.take(_GRID_SIZE, "header of a grid")
    if bytes(head[:8]) not in _GRID_MAGICS:
        raise file.damaged("no grid begins here")
    _check_version(file, at + 16)
    (size,) = struct.unpack_from("<Q", head, 32)
    grid_class, grid_type = struct.unpack_from("<2I", head, 632)
    file.at = at
    file.take(max(size, _GRID_SIZE), "grid")
    name = _text(head[40:296])
    return _Entry(name, grid_type, _GRID_CLASSES.get(grid_class, "unknown"), size, at, _NO_CODEC)


def _text(name: memoryview) -> str:
    return bytes(name).partition(b"\0")[0].decode(errors="replace")


def _chunks(file: Cursor, size: int, codec: int) -> Iterator[tuple[memoryview, int]]:
    """Packed pieces of a grid of ``size`` bytes and their unpacked sizes; skips the grid."""
    step = _BLOSC_CHUNK if codec == _BLOSC else size
    for start in range(0, size, max(step, 1)):
        plain_size = min(step, size - start)
        packed_size = file.numbers("Q", "size of a packed grid")[0] if codec else plain_size
        yield file.take(packed_size, "grid"), plain_size


def _unpack(file: Cursor, entry: _Entry) -> Cursor:
    """Return a cursor over the bytes of a grid, positioned at its tree."""
    chunks = list(_chunks(Cursor(file.data, file.source, entry.at), entry.size, entry.codec))
    source = f"{file.source}: grid {shown(entry.name)}"
    packed = Cursor(file.data, source, entry.at)
    unpack = {_ZLIB: unzip_into, _BLOSC: unblosc_into}.get(entry.codec)
    if unpack is None:
        plain = Cursor(file.data, source, entry.at).take(entry.size, "grid")
    else:
        for data, size in chunks:
            check_packing(data, size, packed)
        # One buffer for all pieces: joining them would take twice the size of the grid.
        plain, at = memoryview(bytearray(entry.size)), 0
        for data, size in chunks:
            unpack(data, plain[at : at + size], packed)
            at += size
    grid = Cursor(plain, source)
    head = grid.take(_GRID_SIZE, "header of a grid")
    _check_version(grid, 16)
    (grid_type,) = struct.unpack_from("<I", head, 636)
    if bytes(head[:8]) not in _GRID_MAGICS or grid_type != entry.grid_type:
        raise packed.damaged(f"the grid begins wrongly, or is of type {grid_type}, not {entry.grid_type}")
    return grid


# -------------------------------------------------------------------------------------------- a grid


def _describe(file: Cursor, path: Path, entry: _Entry) -> Grid:
    layout = _LAYOUTS.get(entry.grid_type)
    if layout is None:
        return _unsupported(path, entry)
    grid = _unpack(file, entry)
    if layout.form in ("index", "on-index") and _find_channel(grid) is None:
        return _unsupported(path, entry)
    topology = walk_topology(grid, layout)
    low, shape = topology.tree.box()
    world_from_tree = np.eye(4)
    world_from_tree[:3, :3] = np.frombuffer(grid.data, "<f8", 9, 296 + 88).reshape(3, 3)
    world_from_tree[:3, 3] = np.frombuffer(grid.data, "<f8", 3, 296 + 232)
    described = Grid(
        name=entry.name,
        grid_class=entry.grid_class,
        value_type=layout.name,
        shape=shape,
        world_from_index=offset_transform(world_from_tree, low, grid),
        has_transform=True,
        is_box_of_stored=True,
        read=partial(_read_dense, path, entry, layout, shape),
        active_voxels=topology.tree.active_voxels,
    )
    if layout.is_vector:
        return replace(
            described,
            read=partial(refuse, path, entry.name, VECTORS),
            read_colour=partial(_read_vectors, path, entry, layout, shape),
            read_vector_leaves=partial(_read_vector_leaves, path, entry, layout, shape),
            colour_background=as_three(topology.background),
            unsupported=VECTORS,
        )
    return replace(
        described,
        read_leaves=partial(_read_leaves, path, entry, layout, shape),
        leaf_count=count_leaves(topology.tree),
        background=topology.tree.background,
    )


def _unsupported(path: Path, entry: _Entry) -> Grid:
    """Describe a grid that can only be listed, not read."""
    layout = _LAYOUTS.get(entry.grid_type)
    value_type = layout.name if layout else _UNSUPPORTED_TYPES.get(entry.grid_type, f"type {entry.grid_type}")
    reason = (
        f"{value_type} values without the numbers they are indices of; write these as blind data"
        if layout
        else f"{value_type} values; convert them to a grid of numbers first"
    )
    return Grid(
        name=entry.name,
        grid_class=entry.grid_class,
        value_type=value_type,
        shape=(0, 0, 0),
        world_from_index=np.eye(4),
        has_transform=False,
        read=partial(refuse, path, entry.name, reason),
        unsupported=reason,
    )


def _read_dense(
    path: Path, entry: _Entry, layout: Layout, shape: tuple[int, int, int]
) -> NDArray[np.float32]:
    """Read a grid's voxels for `Grid.read`."""
    grid = _unpack(Cursor(map_file(path), str(path)), entry)
    topology = walk_topology(grid, layout)
    return fill_dense(topology.tree, walk_leaves(grid, layout, topology), shape, grid)


def _read_leaves(path: Path, entry: _Entry, layout: Layout, shape: tuple[int, int, int]) -> Leaves:
    """Read a grid's voxels for `Grid.read_leaves`."""
    grid = _unpack(Cursor(map_file(path), str(path)), entry)
    topology = walk_topology(grid, layout)
    return gather_leaves(topology.tree, walk_leaves(grid, layout, topology), shape, grid)


def _read_vectors(
    path: Path, entry: _Entry, layout: Layout, shape: tuple[int, int, int]
) -> NDArray[np.float32]:
    """Read a grid's vectors for `Grid.read_colour`."""
    grid = _unpack(Cursor(map_file(path), str(path)), entry)
    topology = walk_topology(grid, layout)
    walk = partial(walk_leaves, grid, layout, topology)
    return fill_vectors(topology.tree, topology.background, walk, shape, grid)


def _read_vector_leaves(
    path: Path, entry: _Entry, layout: Layout, shape: tuple[int, int, int]
) -> tuple[Leaves, ...]:
    """Read a grid's vectors for `Grid.read_vector_leaves`."""
    grid = _unpack(Cursor(map_file(path), str(path)), entry)
    topology = walk_topology(grid, layout)
    return gather_vectors(topology.tree, partial(walk_leaves, grid, layout, topology), shape, grid)


def _find_channel(grid: Cursor) -> NDArray[Any] | None:
    """Find the first blind data of a grid that can be the values of its indices, that is, numbers."""
    metadata_at, count = struct.unpack_from("<qI", grid.data, 640)
    for number in range(count):
        grid.at = at = metadata_at + _BLIND_SIZE * number
        offset, length, size, _, data_class, number_type = grid.numbers("qQ4I", "metadata of blind data")
        layout = _LAYOUTS.get(number_type)
        if layout is None or layout.is_vector or layout.form != "values" or data_class in _BLIND_NAMES:
            continue
        if size == layout.value.itemsize:
            grid.at = at + offset
            return grid.array(layout.value, length, "blind data")
    return None


# ------------------------------------------------------------------------------------------- the tree


def walk_topology(grid: Cursor, layout: Layout) -> Topology:
    """Read a tree without the voxels of its leaves.

    Parameters
    ----------
    grid
        All bytes of the unpacked grid.
    layout
        The layout for its value type.

    Raises
    ------
    VolumeError
        The bytes cannot be a tree.
    """
    grid.at = _GRID_SIZE
    *_, root_offset = grid.numbers("4Q", "header of the tree")
    root_at = _GRID_SIZE + root_offset
    grid.at = root_at
    root = grid.take(layout.root_size, "root")
    background = np.frombuffer(root, layout.value, 1, layout.background_at)
    (tile_count,) = struct.unpack_from("<I", root, 24)
    entries = grid.array(layout.root_tile, tile_count, "root tiles")
    origins = _origins_of_keys(entries["key"])
    if len(np.unique(origins, axis=0)) != tile_count:
        raise grid.damaged("keys of the root repeat")
    has_child = entries["child"] != 0

    channel = _find_channel(grid) if layout.form in ("index", "on-index") else None
    background = _looked_up(background, channel, grid)
    walk = _Walk(grid, layout, background, channel)
    at_root = np.zeros(3, np.int64)
    walk.add_tiles(ROOT_EDGE, at_root, origins, entries["value"], entries["active"], ~has_child)
    walk.active_voxels += int(np.count_nonzero(entries["active"][~has_child])) * ROOT_EDGE**3
    upper_at = root_at + entries["child"][has_child]
    lower_at, lower_origins = walk.below(upper_at, origins[has_child], UPPER_EDGE)
    leaves_at, leaf_origins = walk.below(lower_at, lower_origins, LOWER_EDGE)
    walk.check_nodes(leaves_at, layout.least_leaf_size)
    walk.count_active(leaves_at)
    tiles = [tiles for tiles in walk.tiles if len(tiles.origins)]
    tree = Tree(as_three(background)[0], tiles, leaf_origins, walk.active_voxels)
    return Topology(tree, leaves_at, background, channel)


def _looked_up(indices: NDArray[Any], channel: NDArray[Any] | None, grid: Cursor) -> NDArray[Any]:
    """Look up the values of an index grid; those of other grids are returned as they are."""
    if channel is None:
        return indices
    if indices.size and int(indices.max()) >= len(channel):
        raise grid.damaged(f"an index of {int(indices.max())} for {len(channel)} values")
    values: NDArray[Any] = channel[indices]
    return values


def _origins_of_keys(keys: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Index coordinates [n, 3] encoded in the root's keys: 20 bits per axis, in units of 4096."""
    shifts = np.array([42, 21, 0], np.uint64)
    units = (keys[:, None] >> shifts & np.uint64(0xFFFFF)).astype(np.int64)
    return ((units ^ 0x80000) - 0x80000) * ROOT_EDGE


class _Walk:
    """Descends a tree level by level and gathers its contents."""

    def __init__(
        self, grid: Cursor, layout: Layout, background: NDArray[Any], channel: NDArray[Any] | None
    ) -> None:
        self.grid = grid
        self.layout = layout
        self.background = background
        self.channel = channel
        self.tiles: list[Tiles] = []
        self.active_voxels = 0

    def check_nodes(self, at: NDArray[np.int64], size: int) -> None:
        """Refuse nodes outside the grid, and more nodes than the grid has room for."""
        room = len(self.grid.data)
        if len(at) * size > room or ((at < _GRID_SIZE) | (at > room - size)).any():
            raise self.grid.damaged(f"{len(at)} nodes of {size} bytes do not lie in the grid's {room}")

    def add_tiles(
        self,
        edge: int,
        origin: NDArray[np.int64],
        of_entries: NDArray[np.int64],
        values: NDArray[Any],
        active: NDArray[Any],
        is_tile: NDArray[np.bool_],
    ) -> None:
        """Keep the tiles that differ from the background; entries that are not tiles hold no values.

        The position of a tile is the ``origin`` of its node plus its offset there, one of ``of_entries``.
        """
        chosen = np.flatnonzero(is_tile)
        values = active[chosen].astype(np.uint8) if self.layout.form == "mask" else values[chosen]
        values = _looked_up(values, self.channel, self.grid)
        kept = differs(values, self.background)
        self.tiles.append(Tiles(edge, origin + of_entries[chosen[kept]], values[kept]))

    def below(
        self, nodes_at: NDArray[np.int64], origins: NDArray[np.int64], edge: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Read upper or lower nodes; returns the positions of their children and the children's origins."""
        table_at, entries = self.layout.table_at(edge), entries_of_node(edge)
        self.check_nodes(nodes_at, self.layout.node_size(edge))
        of_entries = place_origins(np.zeros(3, np.int64), np.arange(entries), edge)
        children_at = [np.empty(0, np.int64)]
        children_origins = [np.empty((0, 3), np.int64)]
        for at, origin in zip(nodes_at.tolist(), origins, strict=True):
            table = np.frombuffer(self.grid.data, self.layout.entry, entries, at + table_at)
            active, has_child = np.unpackbits(
                np.frombuffer(self.grid.data, np.uint8, entries // 4, at + 32), bitorder="little"
            ).reshape(2, -1)
            places = np.flatnonzero(has_child)
            children_at.append(at + table["child"][places])
            children_origins.append(origin + of_entries[places])
            is_tile = has_child == 0
            self.active_voxels += int(np.count_nonzero(active[is_tile])) * edge**3
            self.add_tiles(edge, origin, of_entries, table["value"], active, is_tile)
        return np.concatenate(children_at), np.concatenate(children_origins)

    def count_active(self, leaves_at: NDArray[np.int64]) -> None:
        """Count the active voxels of the leaves."""
        for batch in batches(leaves_at):
            self.active_voxels += int(np.unpackbits(_rows(self.grid, batch + 16, 64)).sum())


def walk_leaves(grid: Cursor, layout: Layout, topology: Topology) -> Iterator[LeafBatch]:
    """Read the voxels of a tree in batches of leaves.

    Parameters
    ----------
    grid, layout
        As for `walk_topology`.
    topology
        Their topology from `walk_topology`.

    Raises
    ------
    VolumeError
        A leaf does not lie in the grid.
    """
    origins = batches(topology.tree.leaf_origins)
    for at, batch_origins in zip(batches(topology.leaves_at), origins, strict=True):
        values: NDArray[Any]
        if layout.form == "values":
            rows = _rows(grid, at + layout.leaf_values_at, LEAF_VOXELS * layout.value.itemsize)
            values = rows.view(layout.value)
        elif layout.form == "codes":
            values = _decode_leaves(grid, at, layout)
        elif layout.form in ("bits", "mask"):
            values = _bits(grid, at + layout.leaf_values_at)
        else:
            values = _looked_up(_leaf_indices(grid, at, layout), topology.channel, grid)
        yield LeafBatch(batch_origins, values.reshape(-1, 8, 8, 8))


def _bits(grid: Cursor, at: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Bits [n, 512] that begin at these bytes, as 0 and 1."""
    return np.unpackbits(_rows(grid, at, LEAF_VOXELS // 8), axis=-1, bitorder="little")


def _leaf_indices(grid: Cursor, at: NDArray[np.int64], layout: Layout) -> NDArray[np.uint64]:
    """Return the indices [n, 512] of voxels; 0, for the background, if inactive in an on-index grid."""
    first = _rows(grid, at + layout.leaf_values_at, 8).view("<u8")
    if layout.form == "index":
        return first + np.arange(LEAF_VOXELS, dtype=np.uint64)
    active = _bits(grid, at + 16)
    before = np.cumsum(active, axis=-1, dtype=np.uint64) - active
    return np.where(active, first + before, np.uint64(0))


def _decode_leaves(grid: Cursor, at: NDArray[np.int64], layout: Layout) -> NDArray[np.float32]:
    """Voxels [n, 512] of quantised leaves."""
    values = np.empty((len(at), LEAF_VOXELS), np.float32)
    flags = _rows(grid, at + 15, 1)[:, 0]
    own_bits = 1 << (flags >> 5).astype(np.int64)
    bits_of_leaf = own_bits if layout.code_bits < 0 else np.full(len(at), layout.code_bits)
    if bits_of_leaf.max(initial=0) > 16:  # noqa: PLR2004 - the widest code
        raise grid.damaged("a leaf claims codes of more than 16 bits")
    minimum, quantum = _rows(grid, at + 80, 8).view("<f4").T[:, :, None]
    for bits in np.unique(bits_of_leaf).tolist():
        chosen = bits_of_leaf == bits
        packed = _rows(grid, at[chosen] + layout.leaf_values_at, LEAF_VOXELS // 8 * bits)
        codes = _unpack_codes(packed, bits)
        with np.errstate(invalid="ignore", over="ignore"):  # statistics of a damaged file
            values[chosen] = codes.astype(np.float32) * quantum[chosen] + minimum[chosen]
    return values


def _unpack_codes(packed: NDArray[np.uint8], bits: int) -> NDArray[Any]:
    """Codes [n, 512] of ``bits`` bits each, lowest bits of a byte first."""
    if bits == 16:  # noqa: PLR2004
        return packed.view("<u2")
    shifts = np.arange(0, 8, bits, dtype=np.uint8)
    codes: NDArray[np.uint8] = packed[:, :, None] >> shifts & np.uint8((1 << bits) - 1)
    return codes.reshape(len(packed), -1)


def _rows(grid: Cursor, at: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Copy ``size`` bytes from each position: [n, size]."""
    if len(at) and not 0 <= at.min() <= at.max() <= len(grid.data) - size:
        raise grid.damaged("a leaf does not lie in the grid")
    windows = sliding_window_view(np.frombuffer(grid.data, np.uint8), size)
    rows: NDArray[np.uint8] = windows[at]
    return rows
