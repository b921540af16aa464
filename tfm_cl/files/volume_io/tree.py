"""The sparse tree that both VDB formats store, and its conversion to a dense array or to leaves.

It is a tree of cubes. The root holds any number of *upper* nodes of 4096³ voxels. An upper node has 32³
entries, each a *lower* node of 128³ voxels or a tile (one value for the whole cube). A lower node has 16³
entries, each a *leaf* of 8³ voxels or a tile. Entries and voxels are ordered with z fastest: entry ``(x * n +
y) * n + z``. Index coordinates are integers at voxel *centres*.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import LEAF, Leaves
from tfm_cl.files.volume_io.limits import MAX_LEAVES, too_large, too_many_leaves
from tfm_cl.files.volume_io.tree_shape import COMPONENTS, LEAF_VOXELS, LOWER_EDGE, UPPER_EDGE

if TYPE_CHECKING:
    from tfm_cl.files.volume_io.binary import Cursor

LEAVES_PER_BATCH = 256
VECTORS = "vectors are no densities; as the colour of another grid: --set volume.colour=NAME"
"""Reason why a tree of vectors is refused as a density."""


@dataclass(frozen=True)
class Tiles:
    """Cubes of equal size, each with a single value."""

    edge: int
    """Voxels along an edge: `ROOT_EDGE`, `UPPER_EDGE` or `LOWER_EDGE`."""
    origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each cube's low voxel."""
    values: NDArray[Any]
    """[n], the value of each cube."""


@dataclass(frozen=True)
class LeafBatch:
    """A batch of leaf nodes with their voxels."""

    origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each leaf's low voxel."""
    values: NDArray[Any]
    """[n, 8, 8, 8], ordered [leaf, x, y, z]; active and inactive voxels alike."""


@dataclass(frozen=True)
class Tree:
    """A tree without the voxels in its leaves."""

    background: float
    """Value of all space that no leaf or tile covers; for vectors, its first component."""
    tiles: list[Tiles]
    """Tiles that differ from the background, active or not."""
    leaf_origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each leaf's low voxel, in the file's order."""
    active_voxels: int
    """Number of active voxels, including those of active tiles."""

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


def as_three(value: NDArray[Any]) -> tuple[float, float, float]:
    """Components of the only vector in an array; for a number, itself three times."""
    numbers = [value[name] for name in COMPONENTS] if value.dtype.names else [value] * 3
    x, y, z = (float(number[0]) for number in numbers)
    return x, y, z


def place_origins(origin: NDArray[np.int64], places: NDArray[np.int64], edge: int) -> NDArray[np.int64]:
    """Index coordinates of a node's entries (given by index), each ``edge`` voxels wide."""
    dim = 32 if edge == UPPER_EDGE else 16
    return origin + edge * np.stack(np.unravel_index(places, (dim, dim, dim)), axis=-1)


def batches(items: NDArray[Any]) -> list[NDArray[Any]]:
    """Split leaves into batches of `LEAVES_PER_BATCH`, to bound the memory for voxels."""
    return [items[start : start + LEAVES_PER_BATCH] for start in range(0, len(items), LEAVES_PER_BATCH)]


def differs(values: NDArray[Any], background: NDArray[Any]) -> NDArray[np.bool_]:
    """Where values are not the background; NaN differs from everything."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is treated like any other value
        different: NDArray[np.bool_] = values != background
    return different


def offset_transform(
    world_from_index: NDArray[np.float64], low: NDArray[np.int64], source: Cursor
) -> NDArray[np.float64]:
    """World-from-index matrix of an array whose first voxel is the tree's voxel ``low``."""
    if not (np.isfinite(world_from_index).all() and np.abs(world_from_index).max() < 1e150):  # noqa: PLR2004 - products stay finite
        raise source.damaged(f"its transform is not finite: {world_from_index.tolist()}")
    matrix = world_from_index.copy()
    matrix[:3, 3] += matrix[:3, :3] @ low
    return matrix


def count_leaves(tree: Tree) -> int:
    """Count the leaves that `gather_leaves` allocates: stored ones, and those that tiles expand to."""
    if tree.background != 0.0:
        return math.prod(tree.box()[1]) // LEAF_VOXELS
    return len(tree.leaf_origins) + sum(len(t.origins) * (t.edge // LEAF) ** 3 for t in tree.tiles)


def fill_dense(
    tree: Tree, leaves: Iterable[LeafBatch], shape: tuple[int, int, int], source: Cursor
) -> NDArray[np.float32]:
    """Write a tree into a dense array.

    Parameters
    ----------
    tree, leaves
        The tree, and the voxels of all its leaves.
    shape
        The shape (z, y, x) announced to the caller; it must be that of the tree.

    Returns
    -------
    The voxels of `Tree.box`, float32 [z, y, x]; other types are rounded to float32.

    Raises
    ------
    VolumeError
        The tree has another shape, or is too large to be read densely.
    """
    low = _checked_low(tree, shape, source, sparse=False)
    dense = np.zeros(shape, np.float32)
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # NaN stays NaN; a double that is too large becomes infinite
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


def fill_vectors(
    tree: Tree,
    background: NDArray[Any],
    walk: Callable[[], Iterable[LeafBatch]],
    shape: tuple[int, int, int],
    source: Cursor,
) -> NDArray[np.float32]:
    """Write a tree of vectors, whose values are of a `vector_type`, into a dense array.

    Parameters
    ----------
    tree, shape
        As for `fill_dense`.
    background
        [1], the vector of all space that no leaf or tile covers.
    walk
        Yields the voxels of all leaves; called for each component, so that no second array is needed.

    Returns
    -------
    The vectors of `Tree.box`, float32 [z, y, x, 3].

    Raises
    ------
    VolumeError
        As `fill_dense`.
    """
    vectors = np.empty((*shape, len(COMPONENTS)), np.float32)
    for axis, name in enumerate(COMPONENTS):
        tiles = [Tiles(tiles.edge, tiles.origins, tiles.values[name]) for tiles in tree.tiles]
        numbers = replace(tree, background=float(background[name][0]), tiles=tiles)
        leaves = (LeafBatch(batch.origins, batch.values[name]) for batch in walk())
        vectors[..., axis] = fill_dense(numbers, leaves, shape, source)
    return vectors


def gather_vectors(
    tree: Tree, walk: Callable[[], Iterable[LeafBatch]], shape: tuple[int, int, int], source: Cursor
) -> tuple[Leaves, ...]:
    """Gather a tree of vectors, whose values are of a `vector_type`, as the leaves of its components.

    Parameters
    ----------
    tree, walk, shape
        As for `fill_vectors`. What no leaf or tile covers is 0, whatever the background.

    Returns
    -------
    Three `Leaves`, each without those that are all 0.

    Raises
    ------
    VolumeError
        As `gather_leaves`.
    """
    components = []
    for name in COMPONENTS:
        tiles = [Tiles(tiles.edge, tiles.origins, tiles.values[name]) for tiles in tree.tiles]
        numbers = replace(tree, background=0.0, tiles=tiles)
        leaves = (LeafBatch(batch.origins, batch.values[name]) for batch in walk())
        components.append(gather_leaves(numbers, leaves, shape, source))
    return tuple(components)


def gather_leaves(
    tree: Tree, leaves: Iterable[LeafBatch], shape: tuple[int, int, int], source: Cursor
) -> Leaves:
    """Gather the leaves of a tree, including those that its tiles expand to, without a dense array.

    Parameters
    ----------
    tree, leaves
        The tree, and the voxels of all its leaves.
    shape
        The shape (z, y, x) announced to the caller; it must be that of the tree.

    Returns
    -------
    The voxels of `Tree.box` as from `fill_dense`. Leaves that are all 0 are omitted.

    Raises
    ------
    VolumeError
        The tree has another shape, its box is too large, or it needs more than `MAX_LEAVES` leaves.
    """
    low = _checked_low(tree, shape, source, sparse=True)
    count = count_leaves(tree)
    if count > MAX_LEAVES:
        raise VolumeError(f"{source.source}: {too_many_leaves(count)}")
    dims = tuple(length // LEAF for length in shape)
    # A leaf's key is its index in the box, z-major, so the order of the leaves is that of their keys.
    strides = np.array([1, dims[2], dims[1] * dims[2]], np.int64)
    tile_keys = [((tiles.origins - low) // LEAF) @ strides for tiles in tree.tiles]
    within = [_keys_within(tiles.edge, strides) for tiles in tree.tiles]
    if tree.background != 0.0:
        keys = np.arange(count)
    else:
        keys = np.empty(count, np.int64)
        keys[: len(tree.leaf_origins)] = ((tree.leaf_origins - low) // LEAF) @ strides
        end = len(tree.leaf_origins)
        for own, inside in zip(tile_keys, within, strict=True):
            begin, end = end, end + len(own) * len(inside)
            np.add(own[:, None], inside, out=keys[begin:end].reshape(len(own), len(inside)))
        keys.sort()

    values = np.zeros((count, LEAF, LEAF, LEAF), np.float32)
    used = np.zeros(count, np.bool_)
    with np.errstate(invalid="ignore", over="ignore"):  # as in `fill_dense`
        if tree.background != 0.0:
            values.fill(tree.background)
            used[:] = True
        for tiles, own, inside in zip(tree.tiles, tile_keys, within, strict=True):
            constants = tiles.values.astype(np.float32)
            step = max(1, LEAVES_PER_BATCH // len(inside))
            for start in range(0, len(own), step):
                slots = np.searchsorted(keys, own[start : start + step, None] + inside)
                constant = constants[start : start + step, None]
                values[slots] = constant[..., None, None, None]
                used[slots] = constant.view(np.uint32) != 0
        for batch in leaves:
            slots = np.searchsorted(keys, ((batch.origins - low) // LEAF) @ strides)
            voxels = np.ascontiguousarray(batch.values.transpose(0, 3, 2, 1), np.float32)
            has_bits = voxels.view(np.uint32).any(axis=(1, 2, 3))  # -0 is kept: a dense array would have it
            values[slots], used[slots] = voxels, has_bits
    coordinates = np.stack(np.unravel_index(keys[used], dims), axis=-1).astype(np.int32)
    return Leaves(shape, (0, 0, 0), coordinates, _compacted(values, used))


def _checked_low(
    tree: Tree, shape: tuple[int, int, int], source: Cursor, *, sparse: bool
) -> NDArray[np.int64]:
    """Low voxel of the tree's box, which must have the announced shape and not be too large."""
    low, own_shape = tree.box()
    if own_shape != shape:
        raise VolumeError(
            f"{source.source}: has changed since it was opened: the grid spans {own_shape} voxels [z, y, x], "
            f"it was {shape}; open it again"
        )
    reason = too_large(shape, sparse=sparse)
    if reason:
        raise VolumeError(f"{source.source}: {reason}")
    return low


def _keys_within(edge: int, strides: NDArray[np.int64]) -> NDArray[np.int64]:
    """Keys of the leaves in a cube, relative to that of its first leaf."""
    x, y, z = (np.arange(edge // LEAF) * stride for stride in strides)
    keys: NDArray[np.int64] = (z[:, None, None] + y[:, None] + x).ravel()
    return keys


def _compacted(values: NDArray[np.float32], used: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Move the used rows to the front and release the memory of the rest, without a second array."""
    rows = np.flatnonzero(used)
    if len(rows) < len(values):
        for start in range(0, len(rows), LEAVES_PER_BATCH):
            batch = rows[start : start + LEAVES_PER_BATCH]
            values[start : start + len(batch)] = values[batch]
        values.resize((len(rows), *values.shape[1:]), refcheck=False)
    return values
