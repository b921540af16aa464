"""What grids hold, moved by their velocities, in float64: on the whole box of voxels that it may reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.velocity import Velocity
    from tfm_cl.scene.bodies.volume import Volume

Floats = NDArray[np.float64]


def moved_voxels(volume: Volume, frames: float) -> tuple[Floats, tuple[int, int, int]]:
    """Return what a volume that has a velocity holds so many frames later: D(x - v(x) t).

    Returns
    -------
    Its channels [c, z, y, x], one or three; and the index (x, y, z) in the volume of their first voxel.
    """
    velocity = volume.velocity
    if velocity is None:
        raise ValueError("the volume has no velocity")
    margin = [int(np.ceil(reach)) + 1 for reach in velocity.reach(frames)[::-1]]
    z, y, x = (np.arange(-m, n + m) for m, n in zip(margin, volume.shape, strict=True))
    places = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1).astype(np.float64)
    moves = np.pad(volume.data, [(m, m) for m in margin]) > 0
    displacement = (
        _velocity_at(places, moves, velocity, max(margin).bit_length()) @ (frames * velocity.per_frame).T
    )
    channels = [
        _around(channel.data.astype(np.float64), places - displacement)[0]
        for channel in (volume.channels if volume.colour is not None else (volume,))
    ]
    low_z, low_y, low_x = (-m for m in margin)
    return np.stack(channels), (low_x, low_y, low_z)


def _velocity_at(places: Floats, moves: NDArray[np.bool_], velocity: Velocity, passes: int) -> Floats:
    """Return the velocity at indices (x, y, z) [z, y, x, 3]; where none is known, that of neighbours.

    Each of the passes reaches twice as far as the one before: 1, 3, 7, … voxels.
    """
    found, known = np.zeros(places.shape), moves.copy()
    grids = zip(velocity.components, velocity.own_from_index, velocity.most, strict=True)
    for axis, (leaves, matrix, most) in enumerate(grids):
        value, weight = _around(
            leaves.to_dense().astype(np.float64), places @ matrix[:3, :3].T + matrix[:3, 3]
        )
        at_rim = ~moves & (weight > 0)
        value[at_rim] /= weight[at_rim]
        found[..., axis] = np.clip(value, -most, most)
        known |= weight > 0
    for number in range(passes):
        step = 1 << number
        sums = _neighbours(found * known[..., None], step)
        count = _neighbours(known[..., None].astype(np.float64), step)
        new = ~known & (count[..., 0] > 0)
        found[new] = sums[new] / count[new]
        known |= new
    return found


def _neighbours(values: Floats, step: int) -> Floats:
    """Sum over each voxel and the 26 around it, so many steps away along each axis, [z, y, x, numbers]."""
    for axis in range(3):
        padded = np.pad(values, [(step, step) if axis == other else (0, 0) for other in range(4)])
        places = np.arange(values.shape[axis])
        values = np.sum([np.take(padded, places + shift * step, axis=axis) for shift in range(3)], axis=0)
    return values


def _around(data: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Interpolate data [z, y, x] at indices (x, y, z) […, 3], 0 beyond it.

    Returns the values, and the sums of the weights of what is not 0.
    """
    low = np.floor(at)
    after = at - low
    values, weights = np.zeros(at.shape[:-1]), np.zeros(at.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        index = (low + corner)[..., ::-1].astype(np.int64)
        inside = ((index >= 0) & (index < data.shape)).all(axis=-1)
        weight = np.where(corner, after, 1 - after).prod(axis=-1)
        held = np.zeros(inside.shape)
        held[inside] = data[tuple(index[inside].T)]
        values += weight * held
        weights += np.where(held != 0, weight, 0)
    return values, weights
