"""Whether light is looked up once a voxel, and interpolated: ``map.lookup = "lattice"``.

The lattice's own error in the picture, against the same maps looked up at every sample (relative RMSE over
the lit pixels of 320×180, 24 coefficients, 300 steps), at the density that ``density_scale = "auto"`` gives
and at four times that. τ: optical depth along the edge of a typical voxel.

==================  =====  =======  ========  =====  =======  ========
volume              τ      1 light  8 lights  τ      1 light  8 lights
==================  =====  =======  ========  =====  =======  ========
plume               0.21   1.3 %    0.6 %     0.85   4.9 %    2.6 %
cumulus             0.11   0.5 %    0.3 %     0.44   2.5 %    1.6 %
figure              0.11   0.7 %    0.5 %     0.44   4.5 %    2.8 %
Disney cloud, 1/16  0.12   1.1 %    0.7 %     0.50   5.8 %    4.0 %
OpenVDB smoke       0.22   0.8 %    0.3 %     0.86   1.4 %    0.7 %
teapot cloud        0.06   0.3 %    0.2 %     0.24   1.6 %    0.9 %
==================  =====  =======  ========  =====  =======  ========
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.plan.marched import distances, finest_voxel, marched, occupied_bounds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.plan.marched import Marched
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.phases import Phase
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

MANY_LIGHTS = 3
"""From which on a lattice is worth its error where none is asked for: it costs a look-up a voxel and light,
not one a sample. Fewer are on it where ``map.max_error`` says what error is worth its time."""
WIDEST_PIXEL, WIDEST_PIXEL_OF_FEW = 0.75, 0.5
"""In voxels, where the camera's rays cross the grids: with wider pixels rays take fewer samples than there
are voxels, and a lattice costs more than it saves."""
ERROR_PER_DEPTH, ERROR_PER_DEPTH_OF_FEW = 0.08, 0.12
"""Its error at several lights, and at one or two, at most, over the optical depth along the longest edge of a
typical voxel; a cube, whose density ends within a voxel, has a fifth more."""
TOLERATED = 0.02
"""Its error, at most, where nothing else is asked for."""
OF_ASKED = 0.5
"""Its share, at most, of the error that ``map.max_error`` asks for: a quarter of the squared error."""
MOST_NEAR = 0.05
"""Largest error, between two voxels, of a light's falloff and of the phase function, which each sees from
directions of its own: both are known where light is looked up, and change fast near the light or camera."""
DIRECTIONS = 361
"""From 0° to 180°, for which that error is looked at."""
TURNS_PER_OCTAVE = 8
"""Angles between voxels are rounded up to so many for each factor of two."""


class Choice(NamedTuple):
    """Whether ``"auto"`` becomes a lattice."""

    is_lattice: bool
    why: str


def why_not(scene: Scene) -> str:
    """Tell what keeps every light of a scene from a lattice; empty where nothing does."""
    reasons = {
        "no grid has voxels to look light up at": not scene.grids,
        "primitives have no voxels": scene.primitives,
        "bodies of constant density have no voxels": scene.homogeneous,
        "flames have voxels of their own": scene.flames,
        "the shadows of solids have edges within a voxel": scene.solids,
        "several media scatter differently": len({scene.medium_of(grid) for grid in scene.grids}) > 1,
    }
    return next((why for why, holds in reasons.items() if holds), "")


def smooth_lights(scene: Scene) -> list[int]:
    """Numbers of a scene's single lights that a lattice can hold.

    They have no edge where there is density, and neither they nor the camera are too near to it.
    """
    return [number for number, error in _without_edges(scene) if error <= MOST_NEAR]


def left_out(scene: Scene) -> str:
    """Tell why lights of a scene are looked up at every sample instead; empty where a lattice holds all."""
    singles = _single_lights(scene)
    # Those at points are on a lattice of their own.
    singles = singles.replace(lights=[light for light in singles.lights if not light.is_at_points])
    smooth, lights = len(smooth_lights(singles)), len(singles.lights)
    if smooth == lights:
        return ""
    why = why_not(scene)
    edges = lights - len(_without_edges(singles))
    if not why and edges:
        why = f"{edges} of {lights} lights have an edge in the grids or are near them"
    if not why:
        why = "the camera or lights are so near that what is scattered changes within a voxel"
    return f'map.lookup = "lattice" cannot hold all light; the rest is looked up at every sample: {why}'


def is_taken(scene: Scene) -> bool:
    """Whether there is a lattice, if any of the scene's lights is smooth."""
    asked = scene.map.lookup
    return asked == "lattice" or (asked == "auto" and choice(scene).is_lattice)


def choice(scene: Scene) -> Choice:
    """Decide what ``map.lookup = "auto"`` comes to."""
    why = why_not(scene)
    if why:
        return Choice(is_lattice=False, why=why)
    smooth = [error for _, error in _without_edges(_single_lights(scene)) if error <= MOST_NEAR]
    asked, grids, many = scene.map.max_error, marched(scene), len(smooth) >= MANY_LIGHTS
    if not many and (asked is None or not smooth):
        return Choice(is_lattice=False, why=f"only {len(smooth)} lights are smooth in the grids")
    if _pixel(scene.camera, grids) > (WIDEST_PIXEL if many else WIDEST_PIXEL_OF_FEW) * finest_voxel(grids):
        return Choice(is_lattice=False, why="the picture has fewer samples than the grids have voxels")
    error = (ERROR_PER_DEPTH if many else ERROR_PER_DEPTH_OF_FEW) * depth_of_voxels(scene) + max(smooth)
    tolerated = TOLERATED if asked is None else OF_ASKED * asked
    lights = f"{len(smooth)} light{'s' * (len(smooth) > 1)}"
    held = f"{lights} once a voxel; its error in the picture is about {error:.1g}"
    if error > tolerated:
        return Choice(is_lattice=False, why=f"a lattice of {held}, more than {tolerated:g}")
    return Choice(is_lattice=True, why=held)


def as_of(maps: MapSettings) -> Choice:
    """Decide the same for maps that are there already, with such settings."""
    return Choice(is_lattice=maps.lookup == "lattice", why="that of the maps that are there")


def _single_lights(scene: Scene) -> Scene:
    return scene.replace(lights=[part for light in scene.lights for part in light.parts()])


def _without_edges(scene: Scene) -> list[tuple[int, float]]:
    """Return the single lights without an edge, and the error due to their and the camera's nearness."""
    if why_not(scene):
        return []
    grids = marched(scene)
    bounds, edge = occupied_bounds(grids), _longest_edge(scene)
    medium = scene.medium_of(scene.grids[0])
    to_camera, _ = distances(bounds, np.asarray(scene.camera.from_))
    found = []
    for number, light in enumerate(scene.lights):
        if light.is_smooth_in(bounds) and not light.is_at_points:
            of_light = edge / max(light.nearest(bounds), edge)
            angle = edge / max(to_camera, edge) + of_light
            rounded = 2 ** (math.ceil(TURNS_PER_OCTAVE * math.log2(angle)) / TURNS_PER_OCTAVE)
            # Of d⁻², whose logarithm is interpolated.
            falloff = of_light**2 / 4 if light.falloff == "inverse-square" else 0.0
            phase = medium.phase.widened(light.spread)
            found.append((number, turned_error(phase, rounded) + falloff))
    return found


@cache
def turned_error(phase: Phase, angle: float) -> float:
    """Largest relative error of a phase function whose logarithm is interpolated over an angle."""

    def logarithm(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.log(np.maximum(phase.evaluate(np.cos(angles)), np.finfo(np.float32).tiny))

    middles = np.linspace(0, np.pi, DIRECTIONS)
    between = (logarithm(middles - angle / 2) + logarithm(middles + angle / 2)) / 2
    return float(np.expm1(np.abs(logarithm(middles) - between).max()))


def _pixel(camera: Camera, grids: Sequence[Marched]) -> float:
    """Width of a pixel at the middle of what has density, world units."""
    near, far = distances(occupied_bounds(grids), np.asarray(camera.from_))
    return camera.pixel_width * (near + far) / 2


def _longest_edge(scene: Scene) -> float:
    """Longest edge of any grid's voxels, world units."""
    return max(float(grid.voxel_size.max()) for grid in scene.grids)


def depth_of_voxels(scene: Scene) -> float:
    """Optical depth along the longest edge of what is densest: grids may shade each other's voxels."""
    return _longest_edge(scene) * max(sigma_t * body.typical_density for body, sigma_t in marched(scene))
