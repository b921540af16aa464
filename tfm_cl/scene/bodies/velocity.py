"""How fast what a volume holds moves: for motion blur."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.limits import FRAMES_A_SECOND

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tfm_cl.files.volume_io.stored_velocity import Component, StoredVelocity, VelocitySource

OUTLIERS = 1e-3
"""Of the voxels with a velocity, as Arnold's ``velocity_outlier_threshold``."""
LOOKED_AT = 1 << 22
"""Voxels, at most, that tell which are outliers."""
FARTHEST = 512
"""Voxels that anything may move from the frame to either end of the shutter."""
STILL = 1e-6
"""Voxels: what moves by less stays where it is."""

ALIGNED = 1e-6
"""Voxels: grids whose voxels are nearer to each other than that share them."""

_NUMBERS = itertools.count()


@dataclass(frozen=True, eq=False)
class VelocityAsked:
    """What is said of how fast a volume's contents move; see `Volume.with_velocity`."""

    source: VelocitySource | NDArray[np.float32] = None
    scale: float = 1.0
    fps: float = FRAMES_A_SECOND
    outlier_threshold: float = OUTLIERS

    def keys(self) -> dict[str, float]:
        """Return the numbers as keys of a scene file."""
        return {
            "velocity_scale": self.scale,
            "velocity_fps": self.fps,
            "velocity_outlier_threshold": self.outlier_threshold,
        }


@dataclass(frozen=True, eq=False)
class Velocity:
    """How fast what is at a volume's voxels moves."""

    label: str
    components: tuple[Leaves, ...]
    """Along the x, y and z axis of the world that they were stored in, units per second."""
    own_from_index: tuple[NDArray[np.float64], ...]
    """4×4 of each, column vectors: from indices (x, y, z) of the volume to those of the component."""
    per_frame: NDArray[np.float64]
    """3×3: from there to voxels (x, y, z) a frame."""
    most: NDArray[np.float64]
    """[3], what no component is larger than: what is, outliers, is slowed down to it."""
    number: int = field(default_factory=lambda: next(_NUMBERS))
    """Tells it from all others of this process."""

    def reach(self, frames: float) -> NDArray[np.float64]:
        """Return how far anything moves, at most, along x, y and z: voxels, [3].

        Raises
        ------
        VolumeError
            Farther than `FARTHEST`.
        """
        reach: NDArray[np.float64] = abs(frames) * np.abs(self.per_frame) @ self.most
        if not reach.max() <= FARTHEST:
            raise VolumeError(
                f"{self.label}: moves something by {reach.max():.4g} voxels in {abs(frames):g} frames; up "
                f"to {FARTHEST} are possible: lower volume.velocity_scale, raise volume.velocity_fps, or "
                "volume.velocity_outlier_threshold if few voxels are that fast"
            )
        return reach

    def within(self, index_from_other: NDArray[np.float64]) -> Velocity:
        """Return the same for a volume whose indices become this one's by a 4×4 matrix."""
        return Velocity(
            self.label,
            self.components,
            tuple(matrix @ index_from_other for matrix in self.own_from_index),
            np.linalg.inv(index_from_other[:3, :3]) @ self.per_frame,
            self.most,
            self.number,
        )


def velocity_of(
    stored: StoredVelocity, asked: VelocityAsked, world_from_index: NDArray[np.float64], *, sanitize: bool
) -> Velocity:
    """Make what was read the velocity of a volume.

    Parameters
    ----------
    world_from_index
        4×4: where the volume lies in the world of these velocities.
    sanitize
        Set what is not finite to 0 instead of raising.

    Raises
    ------
    VolumeError
        A velocity that is not finite, or a transform that cannot be inverted.
    """
    components = tuple(_finite(one.leaves, stored.label, sanitize=sanitize) for one in stored.components)
    turned = np.linalg.inv(world_from_index[:3, :3]).astype(np.float64) * (asked.scale / asked.fps)
    return Velocity(
        stored.label,
        components,
        tuple(_relative(one, world_from_index, stored.label) for one in stored.components),
        turned,
        np.array([_most(leaves, asked.outlier_threshold) for leaves in components]),
    )


def _finite(leaves: Leaves, label: str, *, sanitize: bool) -> Leaves:
    if not leaves.not_finite():
        return leaves
    if not sanitize:
        raise VolumeError(
            f"{label} holds velocities that are infinite or NaN; set them to 0 with "
            "--set volume.sanitize=true, or use none: --set volume.velocity=false"
        )
    values = np.nan_to_num(leaves.values, nan=0.0, posinf=0.0, neginf=0.0)
    return Leaves(leaves.shape, leaves.first, leaves.coordinates, values)


def _most(leaves: Leaves, outliers: float) -> float:
    """Return the largest speed but for a share of outliers among the voxels that move."""
    values = leaves.values.reshape(-1)
    largest = float(np.abs(values).max(initial=0.0))
    some = np.abs(values[:: max(1, -(-values.size // LOOKED_AT))])
    some = some[some > 0]
    beyond = int(outliers * some.size)
    return float(np.partition(some, some.size - 1 - beyond)[some.size - 1 - beyond]) if beyond else largest


def _relative(one: Component, world_from_index: NDArray[np.float64], label: str) -> NDArray[np.float64]:
    """4×4 from the indices of a volume to those of a component."""
    if one.world_from_index is None:
        return np.eye(4)
    relative: NDArray[np.float64] = np.full((4, 4), np.nan)
    with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):
        relative = np.linalg.inv(one.world_from_index) @ world_from_index
    if not np.isfinite(relative).all():
        raise VolumeError(f"{label}: its transform cannot be inverted (a voxel has no volume)")
    aligned = np.rint(relative)
    return aligned if np.abs(relative - aligned).max() < ALIGNED else relative
