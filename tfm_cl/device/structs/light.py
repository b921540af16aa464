"""What kernels are told of a light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import SMALLEST_SIZE, world_from_device
from tfm_cl.device.structs.declared import LIGHT
from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene


def light_structs(scene: Scene, lights: Sequence[Light]) -> NDArray[Any]:
    """Return the structs, [lights], of fitted lights; what says where a light's other data are is 0."""
    structs = np.zeros(len(lights), LIGHT.dtype)
    if not lights:
        return structs
    frames = []
    for light in lights:
        check_cancelled()
        frames.append(light.frame())
    device_from_world = np.linalg.inv(world_from_device(scene))
    device_from_light = device_from_world @ np.stack([frame.world_from_light for frame in frames])
    structs["world_from_light"] = device_from_light[:, :3].reshape(-1, 12)
    structs["light_from_world"] = np.linalg.inv(device_from_light)[:, :3].reshape(-1, 12)
    for struct, frame in zip(structs, frames, strict=True):
        struct["shape"][: len(frame.shape)] = frame.shape
    structs["chart"] = [frame.chart for frame in frames]
    structs["cone_from_light"] = [_rotation(frame.cone_from_light) for frame in frames]
    structs["intensity"] = [light.intensity for light in lights]
    structs["spread"] = np.searchsorted(scene.spreads, [light.spread for light in lights])
    structs["texture_size"] = 1
    # A sun is in no medium, wherever its map begins.
    placed = np.array([light.lit_cone() is not None for light in lights])
    for i, body in enumerate(scene.homogeneous):
        positions = np.stack([frame.world_from_light[:3, 3] for frame in frames])
        structs["inside_bodies"] |= (placed & body.contains(positions)).astype(np.int32) << i
    bounds = scene.finite_bounds
    if bounds is None:
        # Nothing else has a size where the media have none.
        sizes = np.linalg.norm(device_from_light[:, :3, 3], axis=1)
    else:
        sizes = np.full(len(lights), np.linalg.norm(np.diff(bounds, axis=0)))
    cores = np.array([light.core for light in lights])
    structs["nearest_inverse"] = 1 / np.maximum(1e-6 * np.maximum(sizes, SMALLEST_SIZE), cores)
    return structs


def _rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """3×3 to 3×4 row by row, without a translation."""
    return np.column_stack([matrix, np.zeros(3)]).ravel()
