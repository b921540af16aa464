"""The volume on the device: records of voxels for the blocks that hold density, and a table of all bricks.

The grid padded with one zero voxel on each side is cut into bricks of 4×4×4 cells (a cell is the cube
between eight voxel centres) and blocks of 2×2×2 bricks. A block with density has a record of every voxel
that its cells touch, so that a trilinear sample reads one record. The table says for a brick with density
which record is its block's, and for one without how far the nearest with density is, so that a march jumps
there. Memory follows the blocks with density; nothing dense is ever made.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.constants import BLOCK_BRICKS, BLOCK_NUMBERS, BRICK_EDGE, MOST_SHARED
from tfm_cl.device.running import Running
from tfm_cl.errors import DeviceMemoryError
from tfm_cl.files.volume_io.leaves import LEAF, Leaves

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfm_cl.device.launch import Launcher

VoxelType = Literal["f32", "f16", "u8"]

VOXEL_BITS: dict[VoxelType, int] = {"f32": 32, "f16": 16, "u8": 8}
MOST_POOLS = 8
MAX_INDEX = (1 << 31) - 1
"""Largest voxel index within a pool, and largest number of bricks: the kernels' ints."""
FARTHEST = 32
"""Largest distance, in bricks, that the table tells."""
SLAB_BYTES = 64 << 20
"""Leaves uploaded at a time."""
TABLE_ENTRY = 4
"""Bytes of a brick in the table."""
Channels = tuple["Leaves", ...]
"""A grid's voxels: of one density, or of three, red, green and blue, in boxes of one size."""
ONE_FIELD: dict[str, int | str] = {
    "TFM_MEDIA": 1,
    "TFM_AMOUNTS": 1,
    "TFM_BODIES": 0,
    "TFM_MEDIUM_OF_GRID(i)": 0,
}
"""Macros of kernels that know of one field of density only: light passes."""
ANY_GRID: dict[str, int | str] = {**ONE_FIELD, "TFM_POOLS": 1, "TFM_GRIDS": 1, "TFM_VOXEL_CHANNELS": 1}
"""Macros of kernels that make records and read none."""
MOST_EXPONENT = 126
"""Of two, by whose power voxels are scaled."""
LEAF_BRICKS = 4
"""Bricks along an axis whose cells may touch voxels of one leaf."""
BATCH = 1024
"""Leaves looked at at a time on the host."""


@dataclass(frozen=True)
class BrickGrid:
    """The bricks of one or several grids on a device."""

    blocks: cl.Buffer
    """int [records, `BLOCK_NUMBERS`]: of its (first channel's) record, where each block is: see `_places`."""
    table: cl.Buffer
    """int [z, y, x] of the bricks, a grid after the other: number of the (first channel's) record, from 1, or
    minus the distance to the nearest."""
    pools: tuple[cl.Buffer, ...]
    """Records, ``pool_size`` each; record 0 is all zero."""
    brick_counts: tuple[tuple[int, int, int], ...]
    """Of each grid, bricks along x, y, z."""
    occupied: int
    """Bricks with density."""
    records: int
    """Of all blocks with density in all channels, and the zero record."""
    pool_size: int
    voxels: VoxelType
    exponents: tuple[tuple[int, ...], ...]
    """Of each grid and channel: a stored voxel times two to this power is its volume's."""
    filling: Running = field(default_factory=lambda: Running(lambda: 0.0), compare=False)
    """What fills the records, which may not have ended: kernels on another queue have to wait for it."""

    @property
    def channels(self) -> int:
        """1, or 3 where a grid has a colour."""
        return max(map(len, self.exponents))

    @property
    def defines(self) -> dict[str, int | str]:
        """Macros of every kernel that reads the grids."""
        return {
            "TFM_VOXEL_BITS": VOXEL_BITS[self.voxels],
            "TFM_POOLS": 1 if len(self.pools) == 1 else MOST_POOLS,
            "TFM_GRIDS": len(self.brick_counts),
            "TFM_VOXEL_CHANNELS": self.channels,
        }

    @property
    def arguments(self) -> dict[str, cl.Buffer]:
        """Kernel arguments by name: the table, and one or `MOST_POOLS` pools."""
        pools = self.pools
        if len(pools) > 1:
            pools += pools[:1] * (MOST_POOLS - len(pools))
        return {"bricks": self.table} | {f"pool{i}": pool for i, pool in enumerate(pools)}

    @property
    def nbytes(self) -> int:
        """Size on the device."""
        return sum(int(buffer.size) for buffer in (self.blocks, self.table, *self.pools))


def record_voxels(lanes: int) -> int:
    """Voxels of a record, rounded up to 4."""
    edge = BLOCK_BRICKS * BRICK_EDGE + MOST_SHARED[lanes]
    return -(-(edge**3) // 4) * 4


def record_bytes(lanes: int, voxels: VoxelType) -> int:
    """Size of a record; 8 bits come with the float that 255 stands for."""
    return record_voxels(lanes) * VOXEL_BITS[voxels] // 8 + (4 if voxels == "u8" else 0)


def brick_count_of(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Bricks along x, y, z, of whole blocks, that cover the padded grid of ``shape`` (z, y, x) voxels."""
    z, y, x = (((n + 1) // (BLOCK_BRICKS * BRICK_EDGE) + 1) * BLOCK_BRICKS for n in shape)
    return x, y, z


def device_bytes(channels: Channels, lanes: int, voxels: VoxelType) -> int:
    """Size that `build_bricks` will give a grid, without a device: `BrickGrid.nbytes`."""
    # The first record is zero.
    records = 1 + len(channels) * len(np.unique(np.concatenate([_blocks(one, lanes) for one in channels])))
    of_record = record_bytes(lanes, voxels) + 4 * BLOCK_NUMBERS
    return records * of_record + TABLE_ENTRY * math.prod(brick_count_of(channels[0].shape))


def _blocks(leaves: Leaves, lanes: int) -> NDArray[np.int64]:
    """Return the numbers of the blocks whose records have a voxel > 0."""
    edge = BLOCK_BRICKS * BRICK_EDGE
    size = tuple(n // BLOCK_BRICKS for n in brick_count_of(leaves.shape)[::-1])
    found = np.zeros(0, np.int64)  # numbers of blocks: a table of all would be as large as the box
    # Padded by one voxel, a leaf begins at the same place within a block wherever it lies.
    shift = np.array([1 - first for first in leaves.first])
    candidates = np.arange(-1, 1 + LEAF // edge)
    low = edge * candidates[:, None] - shift[:, None, None] % edge
    reads = (low <= np.arange(LEAF)) & (np.arange(LEAF) < low + edge + MOST_SHARED[lanes])
    for start in range(0, len(leaves.values), BATCH):
        occupied = (leaves.values[start : start + BATCH] > 0).astype(np.float32)
        z, y, x = reads.astype(np.float32)
        touched = np.einsum("nzyx,kz,jy,ix->nkji", occupied, z, y, x, optimize=True) > 0
        leaf, *place = np.nonzero(touched)
        base = (LEAF * leaves.coordinates[start : start + BATCH].astype(np.int64) + shift) // edge
        block = base[leaf] + candidates[np.stack(place, axis=-1)]
        inside = ((block >= 0) & (block < size)).all(axis=1)
        found = np.union1d(found, np.ravel_multi_index(tuple(block[inside].T), size))
    return found


def build_bricks(launcher: Launcher, grids: Sequence[Channels], what: str, voxels: VoxelType) -> BrickGrid:
    """Put the leaves of grids on the device as bricks.

    Parameters
    ----------
    grids
        Each grid's voxels.
    what
        Names them in messages.
    voxels
        Type that records are stored in. ``f16``: relative error 2⁻¹¹ (absolute 3e-8 of the largest
        density); ``u8``: absolute error 1/510 of the largest density of the block.

    Raises
    ------
    DeviceMemoryError
        When the records exceed the device's memory, or `MOST_POOLS` of its largest buffers.
    """
    counts = tuple(brick_count_of(channels[0].shape) for channels in grids)
    launcher.check_fits(f"the brick table of {what}", TABLE_ENTRY * check_count(grids, what))
    slabs = [
        [list(_slabs(launcher, leaves, count[2])) for leaves in channels]
        for channels, count in zip(grids, counts, strict=True)
    ]
    flags = [_occupied(of_grid, count, launcher.lanes) for of_grid, count in zip(slabs, counts, strict=True)]
    blocks = [_any_of_blocks(of_grid) for of_grid in flags]
    counted = [
        len(channels) * int(np.count_nonzero(of_grid))
        for channels, of_grid in zip(grids, blocks, strict=True)
    ]
    *firsts, records = itertools.accumulate(counted, initial=1)
    # No command but the launches: a CPU's driver would do it when what other queues have begun has ended.
    tables = [
        brick_table(flagged, in_blocks, first, len(channels)).ravel()
        for flagged, in_blocks, first, channels in zip(flags, blocks, firsts, grids, strict=True)
    ]
    table = launcher.upload(f"the brick table of {what}", np.concatenate(tables))
    pools, pool_size = _allocate(launcher, what, records, voxels)
    exponents = tuple(
        tuple(_exponent(leaves.max()) if voxels == "f16" else 0 for leaves in channels) for channels in grids
    )
    occupied = sum(int(np.count_nonzero(of_grid)) for of_grid in flags)
    places = _places(blocks, [len(channels) for channels in grids], records)
    block_buffer = launcher.upload(f"the blocks of {what}", places)
    bricks = BrickGrid(block_buffer, table, pools, counts, occupied, records, pool_size, voxels, exponents)
    filling = launcher.in_turn()
    for i, of_channels in enumerate(slabs):
        for channel, one in enumerate(of_channels):
            done = 0
            for slab in one:
                begin, end = slab.first_layer // BLOCK_BRICKS, slab.end_layer // BLOCK_BRICKS
                corners = np.argwhere(blocks[i][begin:end])[:, ::-1] + (0, 0, begin)
                places_of = np.arange(done, done + len(corners), dtype=np.int64)
                numbers = firsts[i] + channel + len(of_channels) * places_of
                for launch in _fill(launcher, slab, bricks, exponents[i][channel], corners, numbers):
                    filling.add(launch)
                done += len(corners)
    return replace(bricks, filling=Running(filling.wait))


def _places(blocks: list[NDArray[np.bool_]], channels: list[int], records: int) -> NDArray[np.int32]:
    """Tell of each record where its block is.

    Returns
    -------
    int32 [records, `BLOCK_NUMBERS`]: the block's x, y, z, in blocks; the number of its grid, or -1 for the
    zero record and those of further channels; the records of the blocks one further along x, y and z, by
    these three as bits of an index from 1 to 7, or 0.
    """
    places = np.zeros((records, BLOCK_NUMBERS), np.int32)
    places[:, 3] = -1
    first = 1
    for grid, (has_density, step) in enumerate(zip(blocks, channels, strict=True)):
        corners = np.argwhere(has_density)
        mine = first + step * np.arange(len(corners))
        numbers = np.zeros(tuple(n + 1 for n in has_density.shape), np.int32)
        numbers[tuple(corners.T)] = mine
        places[mine, :3], places[mine, 3] = corners[:, ::-1], grid
        for after in range(1, 8):
            offset = (after >> 2 & 1, after >> 1 & 1, after & 1)
            places[mine, 4 + after] = numbers[tuple((corners + offset).T)]
        first += step * len(corners)
    return places


def check_count(grids: Sequence[Channels], what: str) -> int:
    """Count the bricks of grids, also empty ones.

    Raises
    ------
    DeviceMemoryError
        More than kernels can index on any device.
    """
    bricks = sum(math.prod(brick_count_of(channels[0].shape)) for channels in grids)
    if bricks > MAX_INDEX:
        raise DeviceMemoryError(f"{what} has {bricks:,} bricks; kernels index {MAX_INDEX:,}")
    return bricks


def _any_of_blocks(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which blocks have a brick that is flagged."""
    for axis in range(3):
        ahead = (slice(None),) * axis
        flags = np.logical_or.reduce(
            [flags[(*ahead, slice(i, None, BLOCK_BRICKS))] for i in range(BLOCK_BRICKS)]
        )
    return flags


def brick_table(
    flags: NDArray[np.bool_], blocks: NDArray[np.bool_], first_record: int = 1, records: int = 1
) -> NDArray[np.int32]:
    """Give bricks with density their block's first record, others minus their chessboard distance.

    Each block has so many ``records``, numbered from ``first_record``, z-major. Distances stop at
    `FARTHEST`: a jump may be shorter than it could.
    """
    table = -_distances(flags).astype(np.int32)
    numbers = np.zeros(blocks.shape, np.int32)
    count = int(np.count_nonzero(blocks))
    numbers[blocks] = first_record + records * np.arange(count, dtype=np.int32)
    for axis in range(3):
        numbers = numbers.repeat(BLOCK_BRICKS, axis=axis)
    np.copyto(table, numbers, where=flags)
    return table


def _distances(flags: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Chessboard distance of every brick from the next that is flagged, at most `FARTHEST`."""
    if not flags.any():
        return np.full(flags.shape, FARTHEST, np.uint8)
    found = np.zeros(flags.shape, np.uint8)
    # With an empty layer on every side, neighbours along each axis are a fixed number of bricks away.
    reached = np.pad(flags, 1)
    inside = reached[1:-1, 1:-1, 1:-1]
    margin = [(slice(None),) * axis + (end,) for axis in range(3) for end in (0, -1)]
    row = reached.reshape(-1)
    before = np.empty_like(row)
    for _ in range(FARTHEST):
        missing = ~inside
        if not missing.any():
            break
        found += missing
        for stride in reached.strides:
            before[:] = row
            row[stride:] |= before[:-stride]
            row[:-stride] |= before[stride:]
        for layer in margin:
            reached[layer] = False
    return found


@dataclass(frozen=True)
class _Slab:
    """Brick layers, and the leaves that they touch."""

    first_layer: int
    end_layer: int
    table: NDArray[np.int32]
    """[z, y, x] of leaves: their numbers in ``values``, or -1."""
    values: NDArray[np.float32]
    first: tuple[int, int, int]
    """Where voxel (0, 0, 0) (x, y, z) of the padded grid lies, from the slab's first leaf voxel."""


def _slabs(launcher: Launcher, leaves: Leaves, layers: int) -> Iterator[_Slab]:
    """Cut the volume into slabs of block layers whose leaves take about `SLAB_BYTES`."""
    beyond = MOST_SHARED[launcher.lanes]
    most = min(SLAB_BYTES, launcher.largest_buffer)
    leaf_layers, rows, columns = leaves.dims
    starts = np.searchsorted(leaves.coordinates[:, 0], np.arange(leaf_layers + 1))
    layer = 0
    while layer < layers:
        end = layer + BLOCK_BRICKS
        low, high = _leaf_range(leaves, layer, end, leaf_layers, beyond)
        while end < layers:
            wider = _leaf_range(leaves, layer, end + BLOCK_BRICKS, leaf_layers, beyond)
            if (starts[wider[1]] - starts[wider[0]]) * 4 * LEAF**3 > most:
                break
            low, high = wider
            end += BLOCK_BRICKS
        chosen = slice(int(starts[low]), int(starts[high]))
        table = np.full((max(high - low, 1), rows, columns), -1, np.int32)
        z, y, x = leaves.coordinates[chosen].T
        table[z - low, y, x] = np.arange(len(z), dtype=np.int32)
        first = (leaves.first[2] - 1, leaves.first[1] - 1, leaves.first[0] - 1 - low * LEAF)
        yield _Slab(layer, end, table, leaves.values[chosen], first)
        layer = end


def _leaf_range(leaves: Leaves, layer: int, end: int, leaf_layers: int, beyond: int) -> tuple[int, int]:
    """Leaf layers that the records of brick layers ``layer`` to ``end`` (excluded) read."""
    low = (layer * BRICK_EDGE - 1 + leaves.first[0]) // LEAF
    high = (end * BRICK_EDGE - 2 + beyond + leaves.first[0]) // LEAF + 1
    return min(max(low, 0), leaf_layers), min(max(high, 0), leaf_layers)


def _occupied(
    channels: Sequence[Sequence[_Slab]], count: tuple[int, int, int], lanes: int
) -> NDArray[np.bool_]:
    """Which bricks [z, y, x] of a grid hold density in any channel."""
    shape = np.array(count[::-1])
    # A leaf at the grid's sides may touch bricks that there are not.
    flags = np.zeros(shape + 2 * LEAF_BRICKS, np.bool_)
    strides = np.array(flags.strides)
    touched = np.indices((LEAF_BRICKS,) * 3).reshape(3, -1).T @ strides
    for slab in itertools.chain.from_iterable(channels):
        leaves = np.argwhere(slab.table >= 0)
        first, offset = np.divmod(-np.array(slab.first[::-1]), BRICK_EDGE)
        starts = (LEAF // BRICK_EDGE * leaves + first + LEAF_BRICKS - 1) @ strides
        for start in range(0, len(leaves), BATCH):
            batch = slice(start, start + BATCH)
            found = _touched(slab.values[batch], offset.tolist(), lanes)
            leaf, brick = np.divmod(np.flatnonzero(found), len(touched))
            flags.reshape(-1)[starts[batch][leaf] + touched[brick]] = True
    inside = tuple(slice(LEAF_BRICKS, LEAF_BRICKS + n) for n in shape)
    return np.ascontiguousarray(flags[inside])


def _touched(values: NDArray[np.float32], offset: Sequence[int], lanes: int) -> NDArray[np.bool_]:
    """Which `LEAF_BRICKS` along z, y, x have a voxel > 0 of leaves [n, z, y, x] in what they answer for.

    ``offset``: along z, y, x, a leaf's first voxel from the first of brick 1, 0 to `BRICK_EDGE` - 1.
    """
    answers = [[_answered(brick, along, lanes) for brick in range(LEAF_BRICKS)] for along in offset]
    # A voxel is a bit, a layer of a leaf a word.
    layers = np.packbits(values > 0, bitorder="little").view("<u8").reshape(-1, LEAF)
    of_bricks = np.stack([np.bitwise_or.reduce(layers[:, one], axis=1) for one in answers[0]], axis=1)
    place = np.arange(LEAF)
    y, x = ([(one.start <= place) & (place < one.stop) for one in along] for along in answers[1:])
    masks = np.array([[np.packbits(np.outer(j, i), bitorder="little").view("<u8")[0] for i in x] for j in y])
    found: NDArray[np.bool_] = (of_bricks[..., None, None] & masks) != 0
    return found


def _answered(brick: int, offset: int, lanes: int) -> slice:
    """Which voxels of a leaf's edge the cells of a brick touch, and those that lanes share with them."""
    begin = (brick - 1) * BRICK_EDGE - offset
    end = min(begin + BRICK_EDGE + MOST_SHARED[lanes], LEAF)
    return slice(max(begin, 0), max(end, 0, begin))


def _allocate(
    launcher: Launcher, what: str, records: int, voxels: VoxelType
) -> tuple[tuple[cl.Buffer, ...], int]:
    """Make the pools for so many records; the first record is zero."""
    size = record_bytes(launcher.lanes, voxels)
    pool_size = min(launcher.largest_buffer // size, MAX_INDEX // (record_voxels(launcher.lanes) + 4))
    if records > MOST_POOLS * pool_size:
        hint = "" if voxels == "u8" else "; smaller voxels may fit: --voxels f16 or u8"
        raise DeviceMemoryError(
            f"{what} needs {records * size / 2**20:,.1f} MiB; {launcher.device.name.strip()} allows "
            f"{MOST_POOLS * launcher.largest_buffer / 2**20:,.1f} MiB in {MOST_POOLS} buffers{hint}"
        )
    counts = [min(pool_size, records - start) for start in range(0, records, pool_size)]
    pools = tuple(launcher.empty(what, size * count) for count in counts)
    launcher.clear(pools[0], size)
    return pools, pool_size


def _exponent(largest: float) -> int:
    """Find the power of two that brings voxels into [0, 2): exact for values that are halves already.

    It and its reciprocal are normal numbers of float32.
    """
    return min(max(math.frexp(largest)[1] - 1, -MOST_EXPONENT), MOST_EXPONENT) if largest > 0 else 0


def _fill(
    launcher: Launcher,
    slab: _Slab,
    bricks: BrickGrid,
    exponent: int,
    places: NDArray[np.int64],
    numbers: NDArray[np.int64],
) -> Iterator[Running]:
    """Begin to write the records ``numbers`` [N], rising, of the blocks at ``places`` [N, 3] (x, y, z)."""
    if not len(numbers):
        return
    kernel = launcher.kernels.kernel("fill_records", "bricks.cl", (), bricks.defines | ANY_GRID)
    z, y, x = slab.table.shape
    leaf_arguments = {
        "table": launcher.upload("the leaf table", slab.table),
        "leaves": launcher.upload("the leaves", slab.values),
        "leaf_count": (x, y, z, 0),
        "first": (*slab.first, 0),
    }
    in_pools, within = np.divmod(numbers, bricks.pool_size)
    for pool in np.flatnonzero(np.bincount(in_pools)).tolist():
        here = in_pools == pool
        blocks = np.zeros((int(np.count_nonzero(here)), 4), np.int32)
        blocks[:, :3], blocks[:, 3] = places[here], within[here]
        yield launcher.start(
            kernel,
            (len(blocks),),
            {
                **leaf_arguments,
                "blocks": launcher.upload("the blocks' places", blocks),
                "count": len(blocks),
                "scale": 2.0**-exponent,
                "pool": bricks.pools[pool],
            },
        )
