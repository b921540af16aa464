"""Map resolution and steps for ``"auto"``: as fine as the voxels, their optical depth and the image require.

Between voxel centres a density is trilinear. Texels of half a voxel and steps of 1.5 voxels resolve it,
unless the voxels are optically thick: the light then changes within a voxel, and texels and steps become
shorter with its optical depth. Details much smaller than a pixel are not visible.

The table gives errors with 8 coefficients of the basis ``klt``, over the lit pixels of 160×90, with the
resolution and steps chosen for 640×360, against the dual march in at least three times the steps. The volumes
have the density that ``density_scale = "auto"`` gives them, and four times that density. τ is the optical
depth along the edge of a typical voxel. "before" used texels of half a voxel and steps of 1.5 voxels
regardless of the optical depth.

==================  =====  ======  =====  ==================  =====  ======  =====
at its density      τ      before  now    at four times that  τ      before  now
==================  =====  ======  =====  ==================  =====  ======  =====
cumulus             0.11   1.0 %   1.0 %                      0.44   2.9 %   1.7 %
plume               0.21   2.6 %   2.0 %                      0.85   7.5 %   3.7 %
figure              0.11   0.8 %   0.8 %                      0.44   2.9 %   1.4 %
Disney cloud, 1/16  0.12   1.1 %   1.1 %                      0.50   5.2 %   2.4 %
OpenVDB smoke       0.21   2.8 %   2.4 %                      0.85   4.1 %   3.6 %
teapot cloud        0.06   0.6 %   0.6 %                      0.24   1.9 %   1.5 %
voxels of 1×1×2     0.12   1.0 %   1.0 %                      0.47   3.1 %   1.8 %
a cube              0.24   1.6 %   0.7 %                      0.95   9.7 %   0.3 %
==================  =====  ======  =====  ==================  =====  ======  =====

Most of the remaining error is due to the 8 coefficients; that of the camera's steps alone is at most 0.7 %.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.model import is_auto
from tfm_cl.scene.bodies.homogeneous import Homogeneous

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.bodies.volumes import Volumes
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

VOXELS_PER_TEXEL = 0.5
"""Width of a texel in voxels, where the light's rays cross the medium: two samples per voxel resolve a
trilinear density."""
PIXELS_PER_TEXEL = 0.25
"""Smallest width of a texel in pixels, where the light's rays cross the medium. A pixel is a single ray; at
half a pixel the error grows to 4 % (64×36)."""
VOXELS_PER_STEP = 1.5
"""Length of a step in voxels along the grid's longest diagonal; along any other ray steps are shorter."""
DEPTH_PER_TEXEL = 0.1
"""Largest optical depth across a texel, perpendicular to the light."""
DEPTH_PER_STEP = 0.25
"""Largest optical depth of a step along a camera ray."""
TEXEL_POWER, LIGHT_STEP_POWER = 0.75, 0.5
"""Exponent of the ratio by which texels and the light's steps become shorter if their optical depth would be
too large. The camera's steps follow the ratio itself: of the three they cause the largest error and cost
least."""
TEXELS = (64, 2048)
"""Smallest and largest resolution of a map; it is a multiple of `TEXELS_MULTIPLE`."""
TEXELS_MULTIPLE = 32
HOMOGENEOUS_STEPS = 100
"""Steps along a camera ray through a medium of constant density."""
STEPS = (16, 1024)
"""Smallest and largest number of steps."""


def voxel_depth(volume: Volume | Volumes, sigma_t: float) -> float:
    """Optical depth along the shortest edge of a typical voxel of the thickest volume.

    Parameters
    ----------
    sigma_t
        Extinction at density 1 of the colour with the largest extinction.
    """
    return sigma_t * max(part.typical_density * float(part.voxel_size.min()) for part in volume.parts)


def texels_for(volume: Volume | Volumes, light: Light, camera: Camera, sigma_t: float) -> float:
    """Return the number of texels along each side that a light's map should have.

    The width of a texel is `VOXELS_PER_TEXEL` times the shortest edge of a voxel, at the mean of the light's
    distances to the nearest and the farthest point of the occupied bounds. For a light outside, that is near
    their centre; for one inside it is half the farthest distance. A texel is at least `PIXELS_PER_TEXEL`
    times as wide as the footprint of a pixel at the point of the bounds nearest to the camera. If its optical
    depth would exceed `DEPTH_PER_TEXEL`, it is narrower by that ratio to the power of `TEXEL_POWER`.
    """
    near, far = _distances(volume, light.frame().world_from_light[:3, 3])
    width = light.footprint((near + far) / 2)
    to_camera, _ = _distances(volume, np.asarray(camera.from_))
    pixel = 2 * math.tan(math.radians(camera.fov) / 2) * to_camera / camera.res[1]
    texel = max(VOXELS_PER_TEXEL * float(volume.voxel_size.min()), PIXELS_PER_TEXEL * pixel)
    depth = VOXELS_PER_TEXEL * voxel_depth(volume, sigma_t)
    return float(width / texel * max(1.0, depth / DEPTH_PER_TEXEL) ** TEXEL_POWER)


def steps_for(volume: Volume | Volumes, sigma_t: float, power: float = 1.0) -> float:
    """Return the number of steps that a ray of the light or the camera should take.

    Along the longest ray through the grid, its diagonal, a step is `VOXELS_PER_STEP` times the shortest edge
    of a voxel. If its optical depth would exceed `DEPTH_PER_STEP`, it is shorter by that ratio to the power
    ``power``. Steps are spread over the part of a ray inside the grid, so that they are shorter along all
    other rays. With several volumes the longest ray is the diagonal of their common box.
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
    depth = VOXELS_PER_STEP * voxel_depth(volume, sigma_t)
    steps = diagonal / (VOXELS_PER_STEP * float(volume.voxel_size.min()))
    return float(steps * max(1.0, depth / DEPTH_PER_STEP) ** power)


def resolved(scene: Scene, maps: MapSettings | None = None) -> Scene:
    """Replace ``"auto"`` in ``map.res``, ``map.steps`` and ``march.steps`` by numbers.

    Parameters
    ----------
    scene
        Returned itself if there is nothing to replace. All its maps get the resolution that the most
        demanding light needs.
    maps
        Settings of existing maps: ``"auto"`` in the settings of the map then means their values.
    """
    of_map: dict[str, int] = {}
    of_march: dict[str, int] = {}
    if isinstance(scene.volume, Homogeneous):
        # Only the light varies along a ray.
        auto = {"steps": HOMOGENEOUS_STEPS} if is_auto(scene.march.steps) else {}
        return scene.replace(march=scene.march.replace(**auto)) if auto else scene
    wanted = _wanted(scene, scene.volume)
    if not wanted:
        return scene
    for (section, key), number in wanted.items():
        limits, multiple = (TEXELS, TEXELS_MULTIPLE) if key == "res" else (STEPS, 1)
        (of_map if section == "map" else of_march)[key] = _whole(number, limits, multiple)
    if maps is not None:
        of_map = {key: getattr(maps, key) for key in of_map}
    return scene.replace(map=scene.map.replace(**of_map), march=scene.march.replace(**of_march))


def limited(scene: Scene) -> tuple[str, ...]:
    """Report each ``"auto"`` that would need more than its limit, one line each."""
    if isinstance(scene.volume, Homogeneous):
        return ()
    return tuple(
        f'{section}.{key} = "auto": {high} is its upper limit, resolving the voxels takes {number:.0f}; set '
        f"{section}.{key} to use more"
        for (section, key), number in _wanted(scene, scene.volume).items()
        if number > (high := (TEXELS if key == "res" else STEPS)[1])
    )


def _wanted(scene: Scene, volume: Volume | Volumes) -> dict[tuple[str, str], float]:
    """Values for each ``"auto"``, by section and key; they may exceed the limits."""
    sigma_t = float(scene.medium.sigma_t.max())
    wanted: dict[tuple[str, str], float] = {}
    if is_auto(scene.map.res):
        wanted["map", "res"] = wanted_res(scene, volume)
    if is_auto(scene.map.steps):
        wanted["map", "steps"] = steps_for(volume, sigma_t, LIGHT_STEP_POWER)
    if is_auto(scene.march.steps):
        wanted["march", "steps"] = steps_for(volume, sigma_t)
    return wanted


def wanted_res(scene: Scene, volume: Volume | Volumes) -> float:
    """Return the largest number of texels per side that any light's map needs; it may exceed the limit."""
    bounds, sigma_t = volume.occupied_bounds, float(scene.medium.sigma_t.max())
    lights = (part.fitted(bounds) for light in scene.lights for part in light.parts())
    return max((texels_for(volume, light, scene.camera, sigma_t) for light in lights), default=0.0)


def _distances(volume: Volume | Volumes, point: np.ndarray) -> tuple[float, float]:
    """Distances from a point to the nearest and the farthest point of the occupied bounds."""
    low, high = volume.occupied_bounds
    nearest = np.clip(point, low, high)
    farthest = np.where(point - low > high - point, low, high)
    return float(np.linalg.norm(nearest - point)), float(np.linalg.norm(farthest - point))


def _whole(number: float, limits: tuple[int, int], multiple: int) -> int:
    """Round up to a multiple, within limits; a value that is not finite becomes the upper limit."""
    low, high = limits
    if not number < high:
        return high
    return max(low, math.ceil(number / multiple) * multiple)
