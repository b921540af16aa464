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

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.model import decided
from tfm_cl.plan import emission, lattice, octaves, surroundings
from tfm_cl.plan.marched import distances, finest_voxel, marched, occupied_bounds, voxel_depth
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from tfm_cl.plan.marched import Marched
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

VOXELS_PER_TEXEL = 0.5
"""Width of a texel in voxels, where the light's rays cross the medium: two samples per voxel resolve a
trilinear density."""
VOXELS_PER_TEXEL_OF_LATTICE = 1.0
"""The same for maps that are looked up once a voxel."""
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
STEPS_WITHOUT_GRIDS = 100
"""Along a camera ray where nothing is marched but how light arrives."""
STEPS = (16, 1024)
"""Smallest and largest number of steps."""


class Wanted(NamedTuple):
    """What ``"auto"`` comes to."""

    number: int
    asked: float
    """Before limits: it may be more than there can be, and infinite."""
    why: str


def texels_for(grids: Sequence[Marched], light: Light, camera: Camera, voxels: float) -> float:
    """Return the texels along a side that a light's map should have.

    The width of a texel is ``voxels`` times the shortest edge of a voxel, at the mean of the light's
    distances to the nearest and the farthest point of the occupied bounds. For a light outside, that is near
    their centre; for one inside it is half the farthest distance. A texel is at least `PIXELS_PER_TEXEL`
    times as wide as the footprint of a pixel at the point of the bounds nearest to the camera. If its optical
    depth would exceed `DEPTH_PER_TEXEL`, it is narrower by that ratio to the power of `TEXEL_POWER`.
    """
    bounds = occupied_bounds(grids)
    near, far = distances(bounds, light.frame().world_from_light[:3, 3])
    width = light.footprint((near + far) / 2)
    to_camera, _ = distances(bounds, np.asarray(camera.from_))
    pixel = camera.pixel_width * to_camera
    texel = max(voxels * finest_voxel(grids), PIXELS_PER_TEXEL * pixel)
    depth = voxels * voxel_depth(grids)
    return float(width / texel * max(1.0, depth / DEPTH_PER_TEXEL) ** TEXEL_POWER)


def steps_for(grids: Sequence[Marched], power: float = 1.0) -> float:
    """Return the steps that a ray should take, of the light or of the camera.

    The longest ray through the grid, its diagonal, takes steps of `VOXELS_PER_STEP` of the voxel's smallest
    edge; or shorter ones, where these would hold more than `DEPTH_PER_STEP` of optical depth, by that ratio
    to a ``power``. Steps spread over the part of a ray inside the grid, so that all other rays take shorter
    ones. Several grids' longest ray is the diagonal of the box around them.
    """
    depth = VOXELS_PER_STEP * voxel_depth(grids)
    steps = _diagonal(grids) / (VOXELS_PER_STEP * finest_voxel(grids))
    return float(steps * max(1.0, depth / DEPTH_PER_STEP) ** power)


def wanted(
    scene: Scene, maps: MapSettings | None = None, *, on_lattice: bool | None = None
) -> dict[str, Wanted]:
    """Return a number for each of ``map.res``, ``map.steps`` and ``march.steps`` that is ``"auto"``.

    Maps and the march towards lights are there where there are grids and lights; without grids a camera ray
    takes `STEPS_WITHOUT_GRIDS`. All maps get the resolution that the most demanding light needs, or where
    maps are there already, with the settings ``maps``, theirs. ``on_lattice``: whether light is looked up
    there where it can be; None where that has not been decided.
    """
    found: dict[str, Wanted] = {}
    grids = marched(scene)
    if not grids:
        if scene.march.steps == "auto":
            why = "no grid is marched: only how the light arrives varies along a camera ray"
            found["march.steps"] = Wanted(STEPS_WITHOUT_GRIDS, STEPS_WITHOUT_GRIDS, why)
        return found
    if maps is not None:
        for key, asked_for in (("res", scene.map.res), ("steps", scene.map.steps)):
            if asked_for == "auto":
                number = decided(getattr(maps, key))
                found[f"map.{key}"] = Wanted(number, number, "that of the maps that are there")
    elif scene.is_lit:
        if scene.map.res == "auto":
            found["map.res"] = _wanted_res(scene, grids, on_lattice=on_lattice)
        if scene.map.steps == "auto":
            asked = steps_for(grids, LIGHT_STEP_POWER)
            found["map.steps"] = Wanted(_whole(asked, STEPS, 1), asked, _why_steps(grids))
    if scene.march.steps == "auto":
        asked = steps_for(grids)
        found["march.steps"] = Wanted(_whole(asked, STEPS, 1), asked, _why_steps(grids))
    return found


def resolved(scene: Scene, maps: MapSettings | None = None) -> Scene:
    """Replace ``"auto"`` in media, ``map.res``, ``map.steps`` and ``march.steps`` by numbers.

    Parameters
    ----------
    scene
        Returned itself when there is nothing to replace. What there is no use for stays ``"auto"``.
    maps
        Settings of existing maps: ``"auto"`` in the settings of the map then means their values.
    """
    scene = octaves.resolved(scene, octaves.numbers(scene))
    scene = surroundings.resolved(scene, surroundings.decided(scene))
    found = {key: found.number for key, found in wanted(scene, maps).items()}
    return with_numbers(scene, found)


def with_numbers(scene: Scene, numbers: Mapping[str, int]) -> Scene:
    """Set numbers of the map and the march by dotted key; returns the scene itself where there are none."""
    if not numbers:
        return scene
    of: dict[str, dict[str, int]] = {"map": {}, "march": {}}
    for name, number in numbers.items():
        section, key = name.split(".")
        of[section][key] = number
    return scene.replace(map=scene.map.replace(**of["map"]), march=scene.march.replace(**of["march"]))


def limited(scene: Scene) -> tuple[str, ...]:
    """Report each ``"auto"`` that would need more than its limit, one line each."""
    return tuple(
        f'{name} = "auto": {number} is its upper limit, following the voxels takes {asked:.0f}; '
        f"set {name} to use more"
        for name, (number, asked, _) in wanted(scene).items()
        if asked > number
    )


def _why_steps(grids: Sequence[Marched]) -> str:
    why = (
        f"steps of {VOXELS_PER_STEP} voxels, {VOXELS_PER_STEP * finest_voxel(grids):.3g}, along the diagonal"
    )
    if VOXELS_PER_STEP * voxel_depth(grids) > DEPTH_PER_STEP:
        why += f", shorter where a voxel holds an optical depth of {voxel_depth(grids):.2g}"
    return why


def _wanted_res(scene: Scene, grids: Sequence[Marched], *, on_lattice: bool | None) -> Wanted:
    if not scene.lights:
        number, why = emission.texels_of(scene)
        return Wanted(number, number, f"of lights of what media emit: {why}")
    bounds = occupied_bounds(grids)
    singles = [(number, part) for number, light in enumerate(scene.lights, 1) for part in light.parts()]
    parts = [part for _, part in singles]
    if on_lattice is None:
        on_lattice = lattice.is_taken(scene)
    held = lattice.smooth_lights(scene.replace(lights=parts)) if on_lattice else []
    sizes = np.full(len(parts), VOXELS_PER_TEXEL)
    sizes[held] = VOXELS_PER_TEXEL_OF_LATTICE
    asked = [
        texels_for(grids, part.fitted(bounds), scene.camera, size)
        for part, size in zip(parts, sizes.tolist(), strict=True)
    ]
    most = max(range(len(asked)), key=asked.__getitem__)
    voxels = float(sizes[most])
    why = (
        f"texels of {voxels:g} voxels, {voxels * finest_voxel(grids):.3g}, or "
        f"{PIXELS_PER_TEXEL} pixels where those are wider, across the grids"
    )
    if voxels * voxel_depth(grids) > DEPTH_PER_TEXEL:
        why += f", narrower where a voxel holds an optical depth of {voxel_depth(grids):.2g}"
    if len(scene.lights) > 1:
        why += f"; light {singles[most][0]} needs most"
    return Wanted(_whole(asked[most], TEXELS, TEXELS_MULTIPLE), asked[most], why)


def _diagonal(bodies: Sequence[Marched]) -> float:
    """Length of the longest ray through the bodies."""
    if len(bodies) > 1:
        low, high = around([body.bounds for body, _ in bodies])
        return float(np.linalg.norm(high - low))
    ((body, _),) = bodies
    return body.longest_ray


def _whole(number: float, limits: tuple[int, int], multiple: int) -> int:
    """Round up to a multiple, within limits; a value that is not finite becomes the upper limit."""
    low, high = limits
    if not number < high:
        return high
    return max(low, math.ceil(number / multiple) * multiple)
