"""What kernels are told of bodies: those of constant density, and grids."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.declared import BODY, GRID
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from tfm_cl.device.bricks import BrickGrid
    from tfm_cl.scene.scene import Scene


BOX_MARGIN = 1e-5
"""Of the longest edge: how far the box around primitives is from them, so that float32 keeps them inside."""


def body_structs(scene: Scene) -> NDArray[Any]:
    """Return the structs of the bodies of constant density; one of no meaning where there are none."""
    bodies = scene.homogeneous
    structs = np.zeros(max(1, len(bodies)), BODY.dtype)
    origin = world_from_device(scene)[:3, 3]
    for struct, body in zip(structs, bodies, strict=False):
        centre, size = body.kernel_shape()
        struct["kind"], struct["density"] = body.KIND, body.density
        struct["centre"], struct["size"] = np.subtract(centre, origin) if any(size) else 0, size
    return structs


def grid_structs(
    scene: Scene,
    bricks: BrickGrid | None,
    weights: NDArray[np.float64] | None = None,
    margin: float = 0.0,
    *,
    flames: bool = False,
) -> NDArray[Any]:
    """Return the structs of the boxes that are marched; one of no meaning where there are none.

    The grids come first, then flames, then the box around all primitives.

    Parameters
    ----------
    bricks
        Their voxels on the device; without, no density can be read.
    weights
        float [grids, 3]: what densities of each channel are multiplied by, 1 for all by default.
    margin
        World units, by which primitives reach beyond their bounds.
    flames
        Whether there are any.
    """
    grids = (*scene.grids, *scene.flames) if flames else scene.grids
    structs = np.zeros(max(1, len(grids) + bool(scene.primitives)), GRID.dtype)
    moved = world_from_device(scene)
    if scene.primitives:
        structs[-1:] = _box_struct(scene, moved, margin)
    first = 0
    for i, grid in enumerate(grids):
        struct = structs[i]
        z, y, x = grid.shape
        padded_from_device = padded_from_index() @ np.linalg.inv(grid.world_from_index) @ moved
        struct["index_from_world"] = padded_from_device[:3].ravel()
        struct["world_from_index"] = np.linalg.inv(padded_from_device)[:3].ravel()
        struct["size"] = (x + 2, y + 2, z + 2)
        struct["skip_empty"] = scene.march.skip_empty
        if bricks is None:
            continue
        struct["pool_size"] = bricks.pool_size
        struct["brick_count"] = bricks.brick_counts[i]
        struct["first_brick"] = first
        exponents = bricks.exponents[i]
        struct["channel_records"] = int(len(exponents) > 1)
        scales = grid.density_scale * 2.0 ** np.resize(exponents, 3)
        struct["density_scale"] = scales if weights is None else scales * weights[i]
        first += math.prod(bricks.brick_counts[i])
    return structs


def _box_struct(scene: Scene, moved: NDArray[np.float64], margin: float) -> NDArray[Any]:
    """Return the struct of the box around all primitives, whose index space is [0, 1]³."""
    low, high = around([body.bounds for body in scene.primitives])
    margin += BOX_MARGIN * float((high - low).max() + margin)
    world_from_box = np.eye(4)
    world_from_box[:3, :3] = np.diag(high - low + 2 * margin)
    world_from_box[:3, 3] = low - margin
    device_from_box = np.linalg.inv(moved) @ world_from_box
    struct = np.zeros(1, GRID.dtype)
    struct["index_from_world"] = np.linalg.inv(device_from_box)[:3].ravel()
    struct["world_from_index"] = device_from_box[:3].ravel()
    struct["size"] = 2
    struct["skip_empty"] = scene.march.skip_empty
    return struct


def padded_from_index() -> NDArray[np.float64]:
    """4×4: from voxel indices to the grid with its border of one voxel."""
    matrix = np.eye(4)
    matrix[:3, 3] = 1.0
    return matrix
