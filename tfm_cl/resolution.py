"""Map resolution and steps for ``"auto"``: as fine as the voxels and the image, and no finer.

Between voxel centres a density is trilinear, and what is much smaller than a pixel is not seen: texels and
steps that are finer still cost time and show nothing.

Measured with n = 8 and α = 10 over the lit pixels, on plume, cumulus and figure (each alone and in its
scene) and on two real clouds of about 130×90×160 voxels. At 160×90, 320×180 and 640×360 pixels the numbers
chosen here add at most 1 % relative RMSE to a map of 1024² texels and 400 + 400 steps (0.2 to 0.9 %); at
64×36 at most 1.6 %. The paper's 1024² and 100 + 100 steps add 0.5 to 2.2 %. Against the dual march of 400 +
400 steps, where either has the error of 8 coefficients as well (11 to 45 %), no image of 160×90 pixels or
more is worse than with the paper's.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.homogeneous import Homogeneous
from tfm_cl.model import is_auto

if TYPE_CHECKING:
    from tfm_cl.camera import Camera
    from tfm_cl.lights import Light
    from tfm_cl.scene import Scene
    from tfm_cl.settings import MapSettings
    from tfm_cl.volume import Volume
    from tfm_cl.volumes import Volumes

VOXELS_PER_TEXEL = 0.5
"""Width of a texel where the light's rays cross the medium: two samples a voxel follow what is trilinear."""
PIXELS_PER_TEXEL = 0.25
"""The least width of a texel there. A pixel is one ray: at half a pixel the error grows to 4 % (64×36)."""
VOXELS_PER_STEP = 1.5
"""Length of a step along the grid's longest diagonal; along any other ray steps are shorter."""
TEXELS = (64, 2048)
"""Range of the resolution, which is a multiple of `TEXELS_MULTIPLE`."""
TEXELS_MULTIPLE = 32
HOMOGENEOUS_STEPS = 100
"""Along a camera ray through a medium of constant density."""
STEPS = (16, 1024)
"""Range of the number of steps."""


def map_res_for(volume: Volume | Volumes, light: Light, camera: Camera) -> int:
    """Choose the texels along a side of a light's map.

    A texel is `VOXELS_PER_TEXEL` of the smallest edge of a voxel wide, halfway between the nearest and the
    farthest point of the occupied bounds as the light sees them: for a light outside that is near their
    centre, for one inside it is half of the farthest. It is not narrower than `PIXELS_PER_TEXEL` of the
    pixel's footprint at the point of the bounds nearest to the camera.
    """
    near, far = _distances(volume, light.frame().world_from_light[:3, 3])
    width = light.footprint((near + far) / 2)
    to_camera, _ = _distances(volume, np.asarray(camera.from_))
    pixel = 2 * math.tan(math.radians(camera.fov) / 2) * to_camera / camera.res[1]
    texel = max(VOXELS_PER_TEXEL * float(volume.voxel_size.min()), PIXELS_PER_TEXEL * pixel)
    return _whole(width / texel, TEXELS, TEXELS_MULTIPLE)


def steps_for(volume: Volume | Volumes) -> int:
    """Choose the steps along a ray, of the light or of the camera.

    The longest ray through the grid, its diagonal, takes steps of `VOXELS_PER_STEP` of the voxel's smallest
    edge. Steps spread over the part of a ray inside the grid, so that all other rays take shorter ones.
    Several volumes' longest ray is the diagonal of the box around them.
    """
    if len(volume.parts) > 1:
        diagonal = float(np.linalg.norm(volume.bounds[1] - volume.bounds[0]))
    else:
        z, y, x = volume.parts[0].shape
        edges = volume.parts[0].world_from_index[:3, :3] * (x + 1, y + 1, z + 1)  # from border to border
        diagonal = max(
            float(np.linalg.norm(edges @ np.array([1, *signs])))
            for signs in itertools.product((1, -1), repeat=2)
        )
    return _whole(diagonal / (VOXELS_PER_STEP * float(volume.voxel_size.min())), STEPS, 1)


def resolved(scene: Scene, maps: MapSettings | None = None) -> Scene:
    """Replace ``"auto"`` in ``map.res``, ``map.steps`` and ``march.steps`` by numbers.

    Parameters
    ----------
    scene
        Returned itself when there is nothing to replace. All its maps get the resolution that the most
        demanding light needs.
    maps
        Settings of maps that are there already: ``"auto"`` of the map then means their numbers.
    """
    of_map, of_march = {}, {}
    if isinstance(scene.volume, Homogeneous):
        # Nothing varies along a ray but the light.
        auto = {"steps": HOMOGENEOUS_STEPS} if is_auto(scene.march.steps) else {}
        return scene.replace(march=scene.march.replace(**auto)) if auto else scene
    if is_auto(scene.map.res):
        of_map["res"] = (
            max(
                map_res_for(scene.volume, part.fitted(scene.volume.occupied_bounds), scene.camera)
                for light in scene.lights
                for part in light.parts()
            )
            if maps is None
            else maps.res
        )
    if is_auto(scene.map.steps):
        of_map["steps"] = steps_for(scene.volume) if maps is None else maps.steps
    if is_auto(scene.march.steps):
        of_march["steps"] = steps_for(scene.volume)
    if not of_map and not of_march:
        return scene
    return scene.replace(map=scene.map.replace(**of_map), march=scene.march.replace(**of_march))


def _distances(volume: Volume | Volumes, point: np.ndarray) -> tuple[float, float]:
    """Distances from a point to the nearest and the farthest point of the occupied bounds."""
    low, high = volume.occupied_bounds
    nearest = np.clip(point, low, high)
    farthest = np.where(point - low > high - point, low, high)
    return float(np.linalg.norm(nearest - point)), float(np.linalg.norm(farthest - point))


def _whole(number: float, limits: tuple[int, int], multiple: int) -> int:
    """Round up to a multiple, within limits; what is not finite becomes the upper one."""
    low, high = limits
    if not number < high:
        return high
    return max(low, math.ceil(number / multiple) * multiple)
