"""What is marched: the grids and primitives of a scene, each with the extinction of its medium."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.bodies.base import MarchedBody
    from tfm_cl.scene.scene import Scene


class Marched(NamedTuple):
    """A body, and the extinction at density 1 of the colour that sees least far into its medium."""

    body: MarchedBody
    sigma_t: float


def marched(scene: Scene) -> tuple[Marched, ...]:
    """Return a scene's bodies that are marched, each with the extinction of its own medium."""
    return tuple(Marched(body, float(scene.medium_of(body).sigma_t.max())) for body in scene.marched)


def finest_voxel(bodies: Sequence[Marched]) -> float:
    """Return the smallest edge of any grid's voxels, or what is as small elsewhere, world units."""
    return min(body.detail for body, _ in bodies)


def voxel_depth(bodies: Sequence[Marched]) -> float:
    """Optical depth along the smallest edge of a typical voxel of the body where that is largest."""
    return max(sigma_t * body.typical_density * body.detail for body, sigma_t in bodies)


def occupied_bounds(bodies: Sequence[Marched]) -> NDArray[np.float64]:
    """World box around what has density, [2, 3]."""
    return around([body.occupied_bounds for body, _ in bodies])


def distances(bounds: NDArray[np.float64], point: NDArray[np.float64]) -> tuple[float, float]:
    """Distances from a point to the nearest and the farthest point of a box."""
    low, high = bounds
    nearest = np.clip(point, low, high)
    farthest = np.where(point - low > high - point, low, high)
    return float(np.linalg.norm(nearest - point)), float(np.linalg.norm(farthest - point))
