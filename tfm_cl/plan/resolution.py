"""Map resolution and steps for ``"auto"``: as fine as the voxels, their optical depth and the image ask for.

Between voxel centres a density is trilinear: half a voxel a texel and 1.5 voxels a step follow it, unless a
voxel is optically thick. Then light falls within it, and texels and steps become shorter with its optical
depth. What is much smaller than a pixel is not seen.

Measured with 8 numbers of the basis ``klt`` over the lit pixels of 160×90, with the numbers for 640×360,
against the dual march in three times the steps or more, on volumes at the density that ``density_scale =
"auto"`` gives them and at four times that density. τ is that along a typical voxel's edge; "before" had
half a voxel a texel and 1.5 voxels a step whatever their optical depth.

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

What is left is mostly that of 8 numbers. The camera's steps alone err by at most 0.7 %.
"""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from tfm_cl.model import is_auto
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

VOXELS_PER_TEXEL = 0.5
"""Width of a texel where the light's rays cross the medium: two samples a voxel follow what is trilinear."""
PIXELS_PER_TEXEL = 0.25
"""The least width of a texel there. A pixel is one ray: at half a pixel the error grows to 4 % (64×36)."""
VOXELS_PER_STEP = 1.5
"""Length of a step along the grid's longest diagonal; along any other ray steps are shorter."""
DEPTH_PER_TEXEL = 0.1
"""Optical depth, across the light, that a texel may hold."""
DEPTH_PER_STEP = 0.25
"""Optical depth that a step along a camera ray may hold."""
TEXEL_POWER, LIGHT_STEP_POWER = 0.75, 0.5
"""Of the ratio by which texels and the light's steps become shorter where they would hold too much. The
camera's follow the ratio itself: of the three they err most, and cost least."""
TEXELS = (64, 2048)
"""Range of the resolution, which is a multiple of `TEXELS_MULTIPLE`."""
TEXELS_MULTIPLE = 32
HOMOGENEOUS_STEPS = 100
"""Along a camera ray through a medium of constant density."""
STEPS = (16, 1024)
"""Range of the number of steps."""


def joined(scene: Scene) -> Any:
    """The grids."""
    g = scene.grids
    return SimpleNamespace(
        parts=g,
        bounds=around([x.bounds for x in g]),
        occupied_bounds=around([x.occupied_bounds for x in g]),
        voxel_size=min((x.voxel_size for x in g), key=lambda s: s.min()),
    )


def voxel_depth(volume: Any, sigma_t: float) -> float:
    """Optical depth along the smallest edge of a typical voxel of the thickest volume.

    Parameters
    ----------
    sigma_t
        Extinction at density 1 of the colour that sees least far.
    """
    return sigma_t * max(part.typical_density * float(part.voxel_size.min()) for part in volume.parts)


def texels_for(volume: Any, light: Light, camera: Camera, sigma_t: float) -> float:
    """Return the texels along a side that a light's map should have.

    A texel is `VOXELS_PER_TEXEL` of the smallest edge of a voxel wide, halfway between the nearest and the
    farthest point of the occupied bounds as the light sees them: for a light outside that is near their
    centre, for one inside it is half of the farthest. It is not narrower than `PIXELS_PER_TEXEL` of the
    pixel's footprint at the point of the bounds nearest to the camera. Where it would hold more than
    `DEPTH_PER_TEXEL` of optical depth it is narrower, by that ratio to the power of `TEXEL_POWER`.
    """
    near, far = _distances(volume, light.frame().world_from_light[:3, 3])
    width = light.footprint((near + far) / 2)
    to_camera, _ = _distances(volume, np.asarray(camera.from_))
    pixel = 2 * math.tan(math.radians(camera.fov) / 2) * to_camera / camera.res[1]
    texel = max(VOXELS_PER_TEXEL * float(volume.voxel_size.min()), PIXELS_PER_TEXEL * pixel)
    depth = VOXELS_PER_TEXEL * voxel_depth(volume, sigma_t)
    return float(width / texel * max(1.0, depth / DEPTH_PER_TEXEL) ** TEXEL_POWER)


def steps_for(volume: Any, sigma_t: float, power: float = 1.0) -> float:
    """Return the steps that a ray should take, of the light or of the camera.

    The longest ray through the grid, its diagonal, takes steps of `VOXELS_PER_STEP` of the voxel's smallest
    edge; or shorter ones, where these would hold more than `DEPTH_PER_STEP` of optical depth, by that ratio
    to a ``power``. Steps spread over the part of a ray inside the grid, so that all other rays take shorter
    ones. Several volumes' longest ray is the diagonal of the box around them.
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
        Returned itself when there is nothing to replace. All its maps get the resolution that the most
        demanding light needs.
    maps
        Settings of maps that are there already: ``"auto"`` of the map then means their numbers.
    """
    of_map: dict[str, int] = {}
    of_march: dict[str, int] = {}
    if not scene.grids:
        # Nothing varies along a ray but the light.
        auto = {"steps": HOMOGENEOUS_STEPS} if is_auto(scene.march.steps) else {}
        return scene.replace(march=scene.march.replace(**auto)) if auto else scene
    wanted = _wanted(scene, joined(scene))
    if not wanted:
        return scene
    for (section, key), number in wanted.items():
        limits, multiple = (TEXELS, TEXELS_MULTIPLE) if key == "res" else (STEPS, 1)
        (of_map if section == "map" else of_march)[key] = _whole(number, limits, multiple)
    if maps is not None:
        of_map = {key: getattr(maps, key) for key in of_map}
    return scene.replace(map=scene.map.replace(**of_map), march=scene.march.replace(**of_march))


def limited(scene: Scene) -> tuple[str, ...]:
    """Say where ``"auto"`` asks for more than it may take, one line each."""
    if not scene.grids:
        return ()
    return tuple(
        f'{section}.{key} = "auto": {high} is the most it takes, {number:.0f} would follow the voxels; give '
        f"{section}.{key} to take more"
        for (section, key), number in _wanted(scene, joined(scene)).items()
        if number > (high := (TEXELS if key == "res" else STEPS)[1])
    )


def _wanted(scene: Scene, volume: Any) -> dict[tuple[str, str], float]:
    """Numbers for what is ``"auto"``, by section and key; they may be more than there can be."""
    sigma_t = float(scene.medium.sigma_t.max())
    wanted: dict[tuple[str, str], float] = {}
    if is_auto(scene.map.res):
        wanted["map", "res"] = wanted_res(scene, volume)
    if is_auto(scene.map.steps):
        wanted["map", "steps"] = steps_for(volume, sigma_t, LIGHT_STEP_POWER)
    if is_auto(scene.march.steps):
        wanted["march", "steps"] = steps_for(volume, sigma_t)
    return wanted


def wanted_res(scene: Scene, volume: Any) -> float:
    """Return the texels along a side that some light's map needs; they may be more than there can be."""
    bounds, sigma_t = volume.occupied_bounds, float(scene.medium.sigma_t.max())
    lights = (part.fitted(bounds) for light in scene.lights for part in light.parts())
    return max((texels_for(volume, light, scene.camera, sigma_t) for light in lights), default=0.0)


def _distances(volume: Any, point: np.ndarray) -> tuple[float, float]:
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
