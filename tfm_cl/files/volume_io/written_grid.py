"""What is written to a volume file: grids of numbers or of vectors, and the leaves that they make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.grid import shown
from tfm_cl.files.volume_io.limits import MAX_VOXELS
from tfm_cl.files.volume_io.tree_shape import LEAF_VOXELS, LOWER_EDGE, ROOT_EDGE, UPPER_EDGE

MOST_VOXELS = 1 << 20
"""Along an axis: well within what the keys of a tree's root can say."""


@dataclass(frozen=True, eq=False)
class WrittenGrid:
    """One grid of a file that is to be written.

    Raises
    ------
    VolumeError
        The arrays do not have these shapes and types, or there is no name.
    """

    name: str
    values: NDArray[np.float32]
    """[z, y, x], or vectors and colours [z, y, x, 3]."""
    active: NDArray[np.bool_]
    """[z, y, x]: which voxels have a value; the others are the background, 0."""
    world_from_index: NDArray[np.float64]
    """4×4, column vectors: world position of the *centre* of voxel (x, y, z)."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """What else the file says of it, where the format can (.vdb, .npy)."""

    def __post_init__(self) -> None:
        shape = self.active.shape
        right = self.values.dtype == np.float32 and self.values.shape in (shape, (*shape, 3))
        if len(shape) != 3 or not right or self.active.dtype != np.bool_:  # noqa: PLR2004 - z, y, x
            raise VolumeError(
                f"grid {shown(self.name)}: values are float32 [z, y, x] or [z, y, x, 3], and active is bool "
                f"[z, y, x]; got {self.values.dtype} {self.values.shape} and {self.active.dtype} {shape}"
            )
        if self.active.size > MAX_VOXELS or max(shape, default=0) > MOST_VOXELS:
            z, y, x = shape
            raise VolumeError(
                f"grid {shown(self.name)}: {x}×{y}×{z} voxels; the limit is {MAX_VOXELS:,}, and "
                f"{MOST_VOXELS:,} along an axis"
            )
        if not self.name or "\0" in self.name or "\x1e" in self.name:
            raise VolumeError(f"a grid's name is text without control characters; got {self.name!r}")

    @property
    def is_vector(self) -> bool:
        """Whether a value is three numbers."""
        return self.values.ndim > self.active.ndim

    @property
    def active_voxels(self) -> int:
        """How many voxels are active."""
        return int(np.count_nonzero(self.active))

    @property
    def dense(self) -> NDArray[np.float32]:
        """The values, with 0 where a voxel is not active."""
        active = self.active[..., None] if self.is_vector else self.active
        return np.where(active, self.values, np.float32(0))

    def active_box(self) -> NDArray[np.int64]:
        """First and last active voxel, [2, (x, y, z)]; of a grid without any the last is before the first."""
        ends = []
        for axes in ((0, 1), (0, 2), (1, 2)):
            found = np.flatnonzero(self.active.any(axis=axes))
            ends.append((found[0], found[-1]) if found.size else (0, -1))
        return np.array(ends, np.int64).T

    def leaves(self) -> WrittenLeaves:
        """Return the blocks of 8³ voxels that hold an active one."""
        padding = [(0, -length % LOWER_EDGE) for length in self.active.shape]
        active = np.pad(self.active, padding)
        values = np.pad(self.values, [*padding, *[(0, 0)] * self.is_vector])
        split = [n for length in active.shape for n in (length // LOWER_EDGE, LOWER_EDGE)]
        blocks = active.reshape(split)
        z, y, x = np.nonzero(blocks.any(axis=(1, 3, 5)))
        origins = LOWER_EDGE * np.stack([x, y, z], axis=-1)
        order = np.lexsort(np.hstack([origins, origins // UPPER_EDGE, origins // ROOT_EDGE])[:, _KEYS].T)
        origins, z, y, x = origins[order], z[order], y[order], x[order]
        is_active = blocks[z, :, y, :, x, :].transpose(0, 3, 2, 1)
        of_leaves = values.reshape(*split, *values.shape[3:])[z, :, y, :, x, :]
        of_leaves = of_leaves.transpose(0, 3, 2, 1, *range(4, of_leaves.ndim))
        chosen = is_active[..., None] if self.is_vector else is_active
        of_leaves = np.where(chosen, of_leaves, np.float32(0))
        return WrittenLeaves(
            origins, is_active.reshape(-1, LEAF_VOXELS), of_leaves.reshape(-1, LEAF_VOXELS, *values.shape[3:])
        )


_KEYS = [2, 1, 0, 5, 4, 3, 8, 7, 6]
"""What leaves are ordered by, the least first: the root's child, in it the lower node, in it the leaf."""


class WrittenLeaves(NamedTuple):
    """Leaves in the order of a tree: those of a node follow each other, with z fastest."""

    origins: NDArray[np.int64]
    """[n, 3], index coordinates (x, y, z) of each leaf's low voxel."""
    active: NDArray[np.bool_]
    """[n, 512], in the order of a leaf: z fastest."""
    values: NDArray[np.float32]
    """[n, 512], or [n, 512, 3]; 0 where not active."""


def nodes_above(origins: NDArray[np.int64], edge: int) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Return the nodes that nodes of a tree, which lie in its order, belong to.

    Parameters
    ----------
    origins
        [n, 3], of leaves or nodes.
    edge
        Voxels along an edge of those above.

    Returns
    -------
    origins, parents
        [m, 3], and the number [n] of the one that each belongs to.
    """
    above = origins // edge * edge
    is_first = np.ones(len(above), dtype=bool)
    is_first[1:] = (np.diff(above, axis=0) != 0).any(axis=1)
    return above[is_first], np.cumsum(is_first) - 1


def entries_of(
    children: NDArray[np.int64], parents: NDArray[np.int64], edge: int, dim: int
) -> NDArray[np.int64]:
    """Return which entry of its parent each child is, [n]; ``edge``: voxels along an edge of a child."""
    x, y, z = ((children - parents) // edge).T
    entries: NDArray[np.int64] = (x * dim + y) * dim + z
    return entries


def bits_of(flags: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Pack flags [..., n] to bits, lowest first."""
    return np.packbits(flags, axis=-1, bitorder="little")
