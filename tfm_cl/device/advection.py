"""What grids hold, moved by their velocities, on the device: `kernels/advect.cl`.

The value at x is that at x - v(x) t, of the moment that the file shows. Where neither velocity nor density is
known it is that of the nearest voxels where one is, so that what moves leaves the voxels that it was stored
in. Leaves come and leaves go: memory follows the leaves that what moves may reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import LEAF, Leaves
from tfm_cl.files.volume_io.limits import MAX_BOX_EDGE, MAX_LEAVES, too_large
from tfm_cl.scene.bodies.velocity import STILL

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.scene.bodies.velocity import Velocity

LEAF_VOXELS = LEAF**3
SLAB_LEAVES = 1 << 14
"""Moved at a time, beside those around them: 128 MiB of velocities."""
LAUNCH_LEAVES = 1 << 10
"""Of a launch."""
NUMBERS = 4
"""Of a voxel's velocity: x, y, z, and whether it is known."""
FAR_AWAY = 1 << 26
"""Voxels: beyond every grid."""


@dataclass(frozen=True)
class Moved:
    """What grids hold at another time."""

    channels: tuple[Leaves, ...]
    """Of each grid, the same leaves in all."""
    low: tuple[int, int, int]
    """Index (x, y, z) in the grids of the first voxel of these."""


def moved(
    launcher: Launcher, channels: Sequence[Leaves], density: Leaves, velocity: Velocity, frames: float
) -> Moved | None:
    """Move what several grids of the same voxels hold.

    Parameters
    ----------
    channels
        What moves: grids of one shape.
    density
        Tells, beside the velocity itself, where a velocity of 0 is meant: where it is > 0.
    velocity
        Of these voxels.
    frames
        How long, from the moment that the grids show; may be negative.

    Returns
    -------
    None where nothing moves.

    Raises
    ------
    VolumeError
        Something moves farther than `FARTHEST` voxels, or the moved grid would be too large.
    DeviceError
        Memory or compilation.
    """
    reach = velocity.reach(frames)
    if reach.max() < STILL:
        return None
    margin = np.ceil(reach[::-1]).astype(np.int64) + 1
    shape = tuple(int(n) for n in density.shape + 2 * margin)
    if (reason := too_large(shape, sparse=True)) or max(shape) > MAX_BOX_EDGE:  # type: ignore[arg-type]
        raise VolumeError(f"{velocity.label}: what it moves {reason}")
    work = _Advection(launcher, density, velocity, frames, margin)
    targets = _reached([density, *channels], -(-margin // LEAF), velocity.label)
    values = work.run(channels, targets)
    bits = np.zeros(len(targets), np.bool_)
    for one in values:
        bits |= one.any(axis=(1, 2, 3))
    corner = np.array(density.first) - margin  # of the moved grid, in voxels of the leaves' lattice
    coordinates = (targets[bits] - corner // LEAF).astype(np.int32)
    inside = ((coordinates >= 0) & (LEAF * coordinates < corner % LEAF + shape)).all(axis=1)
    z, y, x = (int(n) for n in -margin)
    first: Any = tuple(int(n) for n in corner % LEAF)
    found = tuple(Leaves(shape, first, coordinates[inside], one[bits][inside]) for one in values)  # type: ignore[arg-type]
    return Moved(found, (x, y, z))


def _reached(grids: Sequence[Leaves], layers: NDArray[np.int64], label: str) -> NDArray[np.int64]:
    """Return the leaves [n, 3] (z, y, x) up to so many of them from those of grids along each axis."""
    found = np.unique(np.concatenate([grid.coordinates for grid in grids]).astype(np.int64), axis=0)
    low = found.min(axis=0, initial=0) - layers
    size = found.max(axis=0, initial=0) + layers + 1 - low
    keys = np.ravel_multi_index(tuple((found - low).T), tuple(size))
    for axis, stride in enumerate((size[1] * size[2], size[2], 1)):
        steps = np.arange(-layers[axis], layers[axis] + 1) * stride
        keys = np.unique((keys[:, None] + steps).ravel())
        if len(keys) > MAX_LEAVES:
            raise VolumeError(
                f"{label}: what it moves may reach more than {MAX_LEAVES:,} leaves of 8³ voxels; lower "
                "volume.velocity_scale or shorten image.shutter"
            )
    leaves: NDArray[np.int64] = np.stack(np.unravel_index(keys, tuple(size)), axis=-1) + low
    return leaves


class _Advection:
    """The work on one grid's velocity: slabs of leaf layers, one after the other."""

    def __init__(
        self,
        launcher: Launcher,
        density: Leaves,
        velocity: Velocity,
        frames: float,
        margin: NDArray[np.int64],
    ) -> None:
        self._launcher, self._density, self._velocity = launcher, density, velocity
        self._by = velocity.per_frame * frames
        self._passes = int(margin.max()).bit_length()
        self._halo = -(-(1 << self._passes) // LEAF)

    def run(self, channels: Sequence[Leaves], targets: NDArray[np.int64]) -> list[NDArray[np.float32]]:
        """Return what each channel holds in the leaves ``targets`` [n, 3] at the other time: [n, 8, 8, 8]."""
        values = [np.empty((len(targets), LEAF, LEAF, LEAF), np.float32) for _ in channels]
        for around, made in self._slabs(targets):
            leaves = targets[around]
            known = self._extended(self._velocities(leaves), leaves)
            first, count = made.start - around.start, made.stop - made.start
            for channel, out in zip(channels, values, strict=True):
                out[made] = self._advected(channel, leaves, first, count, known)
        return values

    def _slabs(self, targets: NDArray[np.int64]) -> Iterator[tuple[slice, slice]]:
        """Cut the leaves into layers; yields those that are looked at, and among them those that are made."""
        layers = np.arange(targets[0, 0], targets[-1, 0] + 2) if len(targets) else np.zeros(0, np.int64)
        starts = np.searchsorted(targets[:, 0], layers)
        most = min(SLAB_LEAVES, self._launcher.largest_buffer // (4 * NUMBERS * LEAF_VOXELS) // 2)
        low, last = 0, len(layers) - 1
        while low < last:
            high = low + 1
            while high < last and starts[high + 1] - starts[low] <= most:
                high += 1
            around = max(low - self._halo, 0), min(high + self._halo, last)
            yield slice(*starts[[*around]].tolist()), slice(*starts[[low, high]].tolist())
            low = high

    def _velocities(self, leaves: NDArray[np.int64]) -> cl.Buffer:
        """Return the velocity at the voxels of leaves, as far as it is known there: float4 each."""
        found = self._empty(len(leaves))
        self._launcher.clear(found, int(found.size))
        corners = self._corners(leaves)
        density = _slab(self._launcher, self._density, (leaves[0, 0], leaves[-1, 0] + 1))
        grids = zip(self._velocity.components, self._velocity.own_from_index, strict=True)
        for number, (grid, matrix) in enumerate(grids):
            places = corners @ matrix[:3, :3].T + matrix[:3, 3]
            voxels = np.floor(places)
            high = (LEAF - 1) * np.abs(matrix[2, :3]).sum() + 1
            ends = np.array([places[:, 2].min() - high, places[:, 2].max() + high]) + grid.first[0]
            slab = _slab(self._launcher, grid, np.clip(ends // LEAF + (0, 1), 0, grid.dims[0]))
            self._run(
                "sample_velocity",
                0,
                len(leaves),
                {
                    **slab,
                    "moving_table": density["table"],
                    "moving": density["leaves"],
                    "moving_count": density["leaf_count"],
                    "moving_first": density["first"],
                    "voxels": self._upload(np.clip(voxels, -FAR_AWAY, FAR_AWAY).astype(np.int32)),
                    "after": self._upload((places - voxels).astype(np.float32)),
                    "corners": self._upload(corners),
                    **_vectors(("x_along", "y_along", "z_along"), matrix[:3, :3].T),
                    "most": float(self._velocity.most[number]),
                    "component": number,
                    "velocity": found,
                },
            )
        return found

    def _extended(self, known: cl.Buffer, leaves: NDArray[np.int64]) -> cl.Buffer:
        """Return the same, with the velocity of the nearest voxels where none is known."""
        where = _table(self._launcher, leaves, self._density.first)
        corners, other = self._upload(self._corners(leaves)), self._empty(len(leaves))
        for number in range(self._passes):  # after each, 1, 3, 7, … voxels farther
            arguments = {**where, "corners": corners, "velocity": known, "extended": other}
            self._run("extend_velocity", 0, len(leaves), arguments | {"apart": 1 << number})
            known, other = other, known
        return known

    def _advected(
        self, grid: Leaves, leaves: NDArray[np.int64], first: int, count: int, velocities: cl.Buffer
    ) -> NDArray[np.float32]:
        """Return what a grid holds in ``count`` of the leaves, from number ``first`` on."""
        near = (leaves[0, 0] - self._halo, leaves[-1, 0] + 1 + self._halo)
        slab, corners = _slab(self._launcher, grid, near), self._upload(self._corners(leaves))
        values = np.empty((count, LEAF, LEAF, LEAF), np.float32)
        for start in range(0, count, LAUNCH_LEAVES):
            part = values[start : start + LAUNCH_LEAVES]
            out = self._launcher.empty("the moved voxels", part.nbytes)
            self._run(
                "advect",
                first + start,
                len(part),
                {
                    **slab,
                    "corners": corners,
                    "velocity": velocities,
                    **_vectors(("x_by", "y_by", "z_by"), self._by),
                    "moved": out,
                },
            )
            part[:] = self._launcher.download(out, part.shape, np.float32)
        return values

    def _run(self, name: str, first: int, count: int, arguments: dict[str, Any]) -> None:
        """Run a kernel over the voxels of leaves, in launches of bounded time."""
        kernel = self._launcher.kernels.kernel(name, "advect.cl")
        for start in range(first, first + count, LAUNCH_LEAVES):
            some = min(LAUNCH_LEAVES, first + count - start)
            self._launcher.run(
                kernel, (LEAF_VOXELS * some,), {**arguments, "first_leaf": start, "count": some}
            )

    def _corners(self, leaves: NDArray[np.int64]) -> NDArray[np.int32]:
        """Return the indices (x, y, z) in the grid of the low voxels of leaves (z, y, x)."""
        corners: NDArray[np.int32] = (LEAF * leaves - self._density.first)[:, ::-1].astype(np.int32)
        return corners

    def _upload(self, rows: NDArray[Any]) -> cl.Buffer:
        """Upload rows of three as vectors."""
        return self._launcher.upload("the leaves' places", np.pad(rows, [(0, 0), (0, 1)]))

    def _empty(self, leaves: int) -> cl.Buffer:
        nbytes = 4 * NUMBERS * LEAF_VOXELS * leaves
        return self._launcher.empty("the velocities", nbytes, reuse=True)


def _slab(launcher: Launcher, grid: Leaves, layers: Sequence[Any] | NDArray[Any]) -> dict[str, Any]:
    """Upload the leaves of some layers: arguments of what reads a `LeafSlab`."""
    low, high = (int(end) for end in np.clip(layers, 0, grid.dims[0]))
    chosen = slice(*np.searchsorted(grid.coordinates[:, 0], (low, max(low, high))).tolist())
    values = grid.values[chosen]
    return {
        **_table(launcher, grid.coordinates[chosen].astype(np.int64), grid.first),
        "leaves": launcher.upload("the leaves", values if len(values) else np.zeros(1, np.float32)),
    }


def _table(launcher: Launcher, leaves: NDArray[np.int64], first: tuple[int, int, int]) -> dict[str, Any]:
    """Upload which leaf is where: leaves [n, 3] (z, y, x), ``first`` as of `Leaves`."""
    low = leaves.min(axis=0, initial=1 << 40) if len(leaves) else np.zeros(3, np.int64)
    size = leaves.max(axis=0) + 1 - low if len(leaves) else np.ones(3, np.int64)
    table = np.full(size, -1, np.int32)
    table[tuple((leaves - low).T)] = np.arange(len(leaves), dtype=np.int32)
    z, y, x = (int(n) for n in np.array(first) - LEAF * low)
    layers, rows, columns = table.shape
    return {
        "table": launcher.upload("the leaf table", table),
        "leaf_count": (columns, rows, layers, 0),
        "first": (x, y, z, 0),
    }


def _vectors(names: tuple[str, ...], rows: NDArray[np.float64]) -> dict[str, tuple[float, ...]]:
    """Name rows of three numbers."""
    return {name: (*row, 0.0) for name, row in zip(names, rows.tolist(), strict=True)}
