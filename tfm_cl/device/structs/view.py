"""What kernels are told of the camera, and of how its rays are marched."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.declared import VIEW
from tfm_cl.limits import LARGEST_COORDINATE

if TYPE_CHECKING:
    from tfm_cl.scene.fields import Fields
    from tfm_cl.scene.scene import Scene


LEAST_CUTOFF = 1e-7
"""Of a camera ray in a medium that may be infinite."""


def visible_depth(cutoff: float) -> float:
    """Optical depth at which a camera ray ends where the media are known in closed form."""
    return -math.log(max(cutoff, LEAST_CUTOFF))


def view_struct(
    scene: Scene, fields: Fields, crop: tuple[int, int, int, int], *, is_listed: bool = False
) -> NDArray[Any]:
    """Return the struct, a 0-d array.

    Parameters
    ----------
    crop
        Pixels x0, y0, x1, y1 that buffers hold.
    is_listed
        Whether rays pass through the frame where a list says, whatever these pixels.
    """
    view = np.zeros((), VIEW.dtype)
    camera = scene.camera
    device_from_world = np.linalg.inv(world_from_device(scene))
    width, height = camera.res
    right, up, forward, position = (device_from_world @ camera.world_from_camera)[:3].T
    tangent = np.tan(np.radians(camera.fov) / 2)
    view["position"] = position
    view["right"] = right * tangent * width / height
    view["up"] = up * tangent
    view["forward"] = forward
    view["image_size"] = camera.res
    view["crop"] = crop
    view["listed"] = is_listed
    march = scene.march
    view["steps"] = march.steps
    view["light_steps"] = scene.map.steps if scene.marched else 1
    view["projective"] = march.sampling == "projective"
    view["max_stretch"] = min(march.max_stretch, 1e30)
    view["paper_attenuation"] = march.attenuation == "paper"
    view["cutoff"] = march.cutoff
    view["end"] = _end(scene)
    matrix = np.zeros((3, 3))
    matrix[:, : fields.count] = fields.rgb_from_field
    view["rgb_from_field"] = matrix.ravel()
    view["ambient"] = scene.ambient.radiance
    view["haze"] = 0.0 if camera.haze is None else 1.0 / camera.haze
    return view


def _end(scene: Scene) -> float:
    """How far into the media anything is seen: of one body alone, else of those without an end."""
    alone = len(scene.bodies) == 1
    bodies = [body for body in scene.homogeneous if alone or not np.isfinite(body.bounds).all()]
    if not bodies:
        return LARGEST_COORDINATE
    extinction = sum(body.density * scene.medium_of(body).sigma_t for body in bodies)
    seen = np.asarray(extinction)[np.asarray(extinction) > 0]
    if not seen.size:
        return LARGEST_COORDINATE
    return min(visible_depth(scene.march.cutoff) / float(seen.min()), LARGEST_COORDINATE)
