"""Sparse voxels: the 8³ blocks of a grid that hold something, as .vdb files store them and devices take them.

Statistics are those of the whole grid, the zeros between the leaves included; none of them makes a dense
array. Work goes in batches of leaves, so that what is needed beside them stays small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.limits import MAX_LEAVES

LEAF = 8
"""Voxels along an edge of a leaf."""

_BATCH = 1024
"""Leaves worked on at a time (2 MiB)."""
_BLOCK = (LEAF, 64, 1 << 12)
"""Voxels (z, y, x) of a dense array looked at at a time (8 MiB)."""

Index = tuple[int, int, int]


class NotDensities(NamedTuple):
    """Voxels that are negative, infinite or NaN."""

    total: int
    first: Index
    """[z, y, x] of the first in the order of the dense array."""
    value: float
    """What that one holds."""


@dataclass(frozen=True, eq=False)
class Leaves:
    """The leaves of a grid that are not empty.

    The arrays are kept, not copied (``values`` is, when voxels outside the grid have to be set to 0), and
    become read-only here: hand over arrays that nobody else writes. Leaves compare and hash by identity.

    Raises
    ------
    VolumeError
        The arrays do not have these shapes and types, or leaves repeat, are out of order or not in the grid.
    """

    shape: Index
    """Voxels (z, y, x) of the grid."""
    first: Index
    """Where the grid's voxel (0, 0, 0) lies inside leaf (0, 0, 0): (z, y, x), each from 0 to 7."""
    coordinates: NDArray[np.int32]
    """[n, 3], which leaves these are: (z, y, x) ≥ 0, each once, ordered by z, then y, then x."""
    values: NDArray[np.float32]
    """[n, 8, 8, 8], their voxels [leaf, z, y, x]; 0 outside the grid. Voxels in no leaf are 0."""

    def __post_init__(self) -> None:
        if min(self.shape) < 0:
            raise VolumeError(f"leaves: shape is three numbers (z, y, x) ≥ 0; got {self.shape}")
        if not all(0 <= offset < LEAF for offset in self.first):
            raise VolumeError(f"leaves: first is three numbers (z, y, x) from 0 to 7; got {self.first}")
        count = len(self.coordinates)
        for name, array, shape, dtype in (
            ("coordinates", self.coordinates, (count, 3), np.int32),
            ("values", self.values, (count, LEAF, LEAF, LEAF), np.float32),
        ):
            if array.shape != shape or array.dtype != dtype:
                raise VolumeError(
                    f"leaves: {name} is {np.dtype(dtype).name} {list(shape)}; got {array.dtype} "
                    f"{list(array.shape)}"
                )
        self._check_coordinates()
        self._set("values", self._cleared_outside())
        for name in ("coordinates", "values"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            self._set(name, view)

    def _set(self, name: str, value: NDArray[np.generic]) -> None:
        object.__setattr__(self, name, value)

    def _check_coordinates(self) -> None:
        if len(self.coordinates) == 0:
            return
        if self.coordinates.min() < 0 or (self.coordinates.max(axis=0) >= self.dims).any():
            raise VolumeError(
                f"leaves: for {self.shape} voxels, coordinates (z, y, x) are ≥ 0 and below {self.dims}; "
                f"got {self.coordinates.min(axis=0).tolist()} to {self.coordinates.max(axis=0).tolist()}"
            )
        steps = np.diff(self.coordinates, axis=0)
        # The first axis along which a leaf differs from the one before tells their order.
        leading = np.take_along_axis(steps, (steps != 0).argmax(axis=1)[:, None], axis=1)
        if (leading <= 0).any():
            raise VolumeError("leaves: their coordinates repeat or are not ordered by z, then y, then x")

    def _cleared_outside(self) -> NDArray[np.float32]:
        values = self.values
        sides = np.flatnonzero(~self._is_whole())
        for start in range(0, len(sides), _BATCH):
            rows = sides[start : start + _BATCH]
            outside = ~self._inside(rows)
            if values[rows][outside].any():
                if values is self.values:
                    values = values.copy()
                values[rows] = np.where(outside, np.float32(0), values[rows])
        return values

    # ------------------------------------------------------------------------------------ dense arrays

    @classmethod
    def from_dense(cls, array: ArrayLike) -> Leaves:
        """Leaves of a dense array [z, y, x]; empty ones are left out.

        A leaf is empty when all its voxels are +0: so `to_dense` gives the array back bit for bit.

        Raises
        ------
        VolumeError
            The array is not three-dimensional, or has more than `MAX_LEAVES` leaves that are not empty.
        """
        array = np.asarray(array)
        if array.ndim != 3:  # noqa: PLR2004 - axes
            raise VolumeError(f"an array of voxels is [z, y, x]; this one has the shape {array.shape}")
        z, y, x = array.shape
        coordinates = np.argwhere(_occupied(array)).astype(np.int32)
        if len(coordinates) > MAX_LEAVES:
            raise VolumeError(
                f"{x}×{y}×{z} voxels make {len(coordinates):,} leaves of 8³ that are not empty; "
                f"the limit is {MAX_LEAVES:,}"
            )
        values = np.zeros((len(coordinates), LEAF, LEAF, LEAF), np.float32)
        leaves = cls((z, y, x), (0, 0, 0), coordinates, values)
        with np.errstate(over="ignore", invalid="ignore"):
            for row, in_grid, in_leaf in leaves._parts():
                values[row][in_leaf] = array[in_grid]
            lattice, low = leaves._lattice(array)
            for rows in leaves._whole_batches():
                cz, cy, cx = (leaves.coordinates[rows] - low).T
                values[rows] = lattice[cz, :, cy, :, cx, :]
        return leaves

    def to_dense(self) -> NDArray[np.float32]:
        """Return a new array [z, y, x] of all voxels, float32, C order; it has the size of ``shape``."""
        dense = np.zeros(self.shape, np.float32)
        for row, in_grid, in_leaf in self._parts():
            dense[in_grid] = self.values[row][in_leaf]
        lattice, low = self._lattice(dense)
        for rows in self._whole_batches():
            cz, cy, cx = (self.coordinates[rows] - low).T
            lattice[cz, :, cy, :, cx, :] = self.values[rows]
        return dense

    # --------------------------------------------------------------------------------------- the whole

    @property
    def dims(self) -> Index:
        """Number of leaves (z, y, x) that cover the grid."""
        z, y, x = (-(-(o + n) // LEAF) if n else 0 for o, n in zip(self.first, self.shape, strict=True))
        return z, y, x

    @property
    def nbytes(self) -> int:
        """Bytes of both arrays."""
        return self.coordinates.nbytes + self.values.nbytes

    def __repr__(self) -> str:
        return f"Leaves({len(self.coordinates):,} of 8³ in {self.shape} voxels [z, y, x])"

    def not_densities(self) -> NotDensities | None:
        """Find the voxels that are negative, infinite or NaN; None when there are none."""
        count, first, value = 0, (0, 0, 0), 0.0
        for start in range(0, len(self.values), _BATCH):
            batch = self.values[start : start + _BATCH]
            wrong = _wrong(batch)
            if not wrong.any():
                continue
            places = np.argwhere(wrong)
            voxels = (
                LEAF * self.coordinates[start + places[:, 0]].astype(np.int64) + places[:, 1:] - self.first
            )
            least = np.lexsort(voxels.T[::-1])[0]
            z, y, x = voxels[least].tolist()
            if count == 0 or (z, y, x) < first:
                first, value = (z, y, x), float(batch[tuple(places[least])])
            count += len(places)
        return NotDensities(count, first, value) if count else None

    def sanitized(self) -> Leaves:
        """Leaves with 0 for negative, infinite and NaN voxels; leaves that become empty are left out."""
        keep = np.zeros(len(self.values), np.bool_)
        for start in range(0, len(keep), _BATCH):
            batch = self.values[start : start + _BATCH]
            keep[start : start + _BATCH] = ((batch.view(np.uint32) != 0) & ~_wrong(batch)).any(axis=(1, 2, 3))
        values = self.values[keep]
        for start in range(0, len(values), _BATCH):
            batch = values[start : start + _BATCH]
            batch[_wrong(batch)] = 0.0
        return Leaves(self.shape, self.first, self.coordinates[keep], values)

    # -------------------------------------------------------------------------------------- statistics

    def min(self) -> float:
        """Least of the grid's finite voxels; NaN when there is none."""
        return min((float(v.min()) for v in self._finite_batches()), default=math.nan)

    def max(self) -> float:
        """Largest of the grid's finite voxels; NaN when there is none."""
        return max((float(v.max()) for v in self._finite_batches()), default=math.nan)

    def mean(self) -> float:
        """Mean of the grid's finite voxels, summed in float64; NaN when there is none."""
        count = math.prod(self.shape) - self.not_finite()
        total = math.fsum(float(v.sum(dtype=np.float64)) for v in self._finite_batches())
        return total / count if count else math.nan

    def typical(self) -> float:
        """Mean of the grid's finite voxels weighted by themselves; 0 when all are 0."""
        total = squares = 0.0
        for batch in self._finite_batches():
            total += float(batch.sum(dtype=np.float64))
            squares += float(np.square(batch, dtype=np.float64).sum())
        return squares / total if total > 0 else 0.0

    def active(self) -> int:
        """Count the voxels that are not 0."""
        return int(np.count_nonzero(self.values))

    def not_finite(self) -> int:
        """Count the voxels that are infinite or NaN."""
        starts = range(0, len(self.values), _BATCH)
        return sum(int(np.count_nonzero(~np.isfinite(self.values[s : s + _BATCH]))) for s in starts)

    def occupied_box(self) -> tuple[Index, Index] | None:
        """Find the box around the voxels > 0.

        Returns
        -------
        Its first and its last voxel (z, y, x), both inside; None when no voxel is > 0.
        """
        occupied = np.zeros(len(self.values), np.bool_)
        for start in range(0, len(occupied), _BATCH):
            occupied[start : start + _BATCH] = (self.values[start : start + _BATCH] > 0).any(axis=(1, 2, 3))
        if not occupied.any():
            return None
        low, high = [], []
        for axis in range(3):
            layers = self.coordinates[:, axis]
            in_layer = [
                self._occupied_planes(np.flatnonzero(occupied & (layers == layer)), axis)
                for layer in (layers[occupied].min(), layers[occupied].max())
            ]
            low.append(in_layer[0][0])
            high.append(in_layer[1][-1])
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])

    def _occupied_planes(self, rows: NDArray[np.intp], axis: int) -> list[int]:
        """Find the planes across an axis with a voxel > 0, in leaves of one layer: their indices."""
        others = tuple(i for i in range(4) if i != 1 + axis)
        planes = np.zeros(LEAF, np.bool_)
        for start in range(0, len(rows), _BATCH):
            planes |= (self.values[rows[start : start + _BATCH]] > 0).any(axis=others)
        low = LEAF * int(self.coordinates[rows[0], axis]) - self.first[axis]
        return [low + int(plane) for plane in np.flatnonzero(planes)]

    def column_sums(self, axis: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Sum the voxels along an axis, for the columns of leaves that exist.

        Their number, and with it the memory, is bounded by that of the leaves, whatever the grid's size.

        Parameters
        ----------
        axis
            0, 1 or 2: along z, y or x.

        Returns
        -------
        [m, 2], the columns' leaf coordinates along the two other axes, in their order, and [m, 8, 8], the
        sums.
        """
        one, two = (other for other in range(3) if other != axis)
        across = self.dims[two]
        keys = self.coordinates[:, one].astype(np.int64) * across + self.coordinates[:, two]
        columns, column_of = np.unique(keys, return_inverse=True)
        sums = np.zeros((len(columns), LEAF, LEAF))
        for start in range(0, len(keys), _BATCH):
            rows = slice(start, start + _BATCH)
            found, inverse = np.unique(column_of[rows], return_inverse=True)
            order = np.argsort(inverse, kind="stable")
            starts = np.searchsorted(inverse[order], np.arange(len(found)))
            parts = self.values[rows].sum(axis=1 + axis, dtype=np.float64)
            sums[found] += np.add.reduceat(parts[order], starts, axis=0)
        return np.stack(np.divmod(columns, max(across, 1)), axis=-1), sums

    # ------------------------------------------------------------------------------ leaves in the grid

    def _low(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Return where leaves begin in the grid, [n, 3]; less than 0 where they begin outside."""
        return LEAF * self.coordinates[rows].astype(np.int64) - self.first

    def _spans(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First voxel of leaves inside the grid and the one behind the last, both [n, 3], from 0 to 8."""
        low = self._low(rows)
        return np.maximum(-low, 0), np.minimum(np.array(self.shape) - low, LEAF)

    def _is_whole(self) -> NDArray[np.bool_]:
        """Tell which leaves lie inside the grid with all their voxels: [n]."""
        whole = np.ones(len(self.coordinates), np.bool_)
        for axis in range(3):
            layers = self.coordinates[:, axis]
            if self.first[axis]:
                whole &= layers > 0
            whole &= layers < (self.first[axis] + self.shape[axis]) // LEAF
        return whole

    def _inside(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell which voxels of leaves lie inside the grid: [len(rows), 8, 8, 8]."""
        begin, end = self._spans(rows)
        place = np.arange(LEAF)
        z, y, x = ((begin[:, a, None] <= place) & (place < end[:, a, None]) for a in range(3))
        inside: NDArray[np.bool_] = z[:, :, None, None] & y[:, None, :, None] & x[:, None, None, :]
        return inside

    def _finite_batches(self) -> Iterator[NDArray[np.float32]]:
        """Finite voxels in leaves, and a 0 for those in no leaf, if there are any; no batch is empty."""
        whole = self._is_whole()
        begin, end = self._spans(np.flatnonzero(~whole))
        covered = LEAF**3 * int(np.count_nonzero(whole)) + int((end - begin).prod(axis=1).sum())
        if covered < math.prod(self.shape):
            yield np.zeros(1, np.float32)
        for start in range(0, len(whole), _BATCH):
            batch = self.values[start : start + _BATCH]
            chosen = np.isfinite(batch)
            if not whole[start : start + _BATCH].all():
                chosen &= self._inside(np.arange(start, start + len(batch)))
            if chosen.all():
                yield batch
            elif chosen.any():
                yield batch[chosen]

    def _lattice(self, array: NDArray[np.generic]) -> tuple[NDArray[np.generic], NDArray[np.int64]]:
        """View the part of the grid's dense array that whole leaves make up, and the first such leaf.

        The view is [leaf z, z, leaf y, y, leaf x, x].
        """
        part, low = [], []
        for offset, length in zip(self.first, self.shape, strict=True):
            begin = -offset % LEAF
            part.append(slice(begin, max(begin, length - (length - begin) % LEAF)))
            low.append(-(-offset // LEAF))
        whole = array[tuple(part)]
        return whole.reshape([n for length in whole.shape for n in (length // LEAF, LEAF)]), np.array(low)

    def _whole_batches(self) -> Iterator[NDArray[np.intp]]:
        rows = np.flatnonzero(self._is_whole())
        for start in range(0, len(rows), _BATCH):
            yield rows[start : start + _BATCH]

    def _parts(self) -> Iterator[tuple[int, tuple[slice, ...], tuple[slice, ...]]]:
        """Leaves that lie partly in the grid: which, and where that part is, in the grid and in the leaf."""
        rows = np.flatnonzero(~self._is_whole())
        for start in range(0, len(rows), _BATCH):
            batch = rows[start : start + _BATCH]
            lows = self._low(batch).tolist()
            begins, ends = (ends.tolist() for ends in self._spans(batch))
            for row, low, begin, end in zip(batch.tolist(), lows, begins, ends, strict=True):
                in_leaf = tuple(slice(b, e) for b, e in zip(begin, end, strict=True))
                in_grid = tuple(slice(a + s.start, a + s.stop) for a, s in zip(low, in_leaf, strict=True))
                yield row, in_grid, in_leaf


def _wrong(values: NDArray[np.float32]) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        wrong: NDArray[np.bool_] = ~np.isfinite(values) | (values < 0)
    return wrong


def _occupied(array: NDArray[np.generic]) -> NDArray[np.bool_]:
    """Tell which leaves of a dense array hold a voxel with a bit set: [leaf z, leaf y, leaf x]."""
    occupied = np.zeros([-(-length // LEAF) for length in array.shape], np.bool_)
    starts = [range(0, length, step) for length, step in zip(array.shape, _BLOCK, strict=True)]
    for z in starts[0]:
        for y in starts[1]:
            for x in starts[2]:
                block = array[z : z + _BLOCK[0], y : y + _BLOCK[1], x : x + _BLOCK[2]]
                with np.errstate(over="ignore", invalid="ignore"):
                    bits = np.ascontiguousarray(block, np.float32).view(np.uint32)
                for axis in range(3):
                    bits = np.bitwise_or.reduceat(bits, np.arange(0, bits.shape[axis], LEAF), axis=axis)
                low = (z // LEAF, y // LEAF, x // LEAF)
                occupied[tuple(slice(a, a + n) for a, n in zip(low, bits.shape, strict=True))] = bits != 0
    return occupied
