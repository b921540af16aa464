"""What is marched: the grids of a scene, each with the extinction of its medium."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.scene import Scene


class Marched(NamedTuple):
    """A grid, and the extinction at density 1 of the colour that sees least far into its medium."""

    grid: Volume
    sigma_t: float


def marched(scene: Scene) -> tuple[Marched, ...]:
    """Return a scene's grids, each with the extinction of its own medium."""
    return tuple(Marched(grid, float(scene.medium_of(grid).sigma_t.max())) for grid in scene.grids)


def finest_voxel(grids: Sequence[Marched]) -> float:
    """Return the smallest edge of any grid's voxels, world units."""
    return min(float(grid.voxel_size.min()) for grid, _ in grids)


def voxel_depth(grids: Sequence[Marched]) -> float:
    """Optical depth along the smallest edge of a typical voxel of the grid where that is largest."""
    return max(sigma_t * grid.typical_density * float(grid.voxel_size.min()) for grid, sigma_t in grids)


def occupied_bounds(grids: Sequence[Marched]) -> NDArray[np.float64]:
    """World box around what has density, [2, 3]."""
    return around([grid.occupied_bounds for grid, _ in grids])


def distances(bounds: NDArray[np.float64], point: NDArray[np.float64]) -> tuple[float, float]:
    """Distances from a point to the nearest and the farthest point of a box."""
    low, high = bounds
    nearest = np.clip(point, low, high)
    farthest = np.where(point - low > high - point, low, high)
    return float(np.linalg.norm(nearest - point)), float(np.linalg.norm(farthest - point))
