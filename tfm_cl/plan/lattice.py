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

from typing import TYPE_CHECKING, NamedTuple

from tfm_cl.plan.resolution import marched, occupied_bounds, voxel_depth

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

FEWEST_LIGHTS = 3
"""From which on a lattice is worth its error: it costs a look-up a voxel and light, not one a sample."""
ERROR_PER_DEPTH = 0.08
"""Its error at several lights, at most, over the optical depth of a typical voxel."""
TOLERATED = 0.02
"""Its error, at most, where nothing else is asked for."""


class Choice(NamedTuple):
    """Whether ``"auto"`` becomes a lattice."""

    is_lattice: bool
    why: str


def why_not(scene: Scene) -> str:
    """Tell what keeps every light of a scene from a lattice; empty where nothing does."""
    if not scene.grids:
        return "no grid has voxels to look light up at"
    if scene.homogeneous:
        return "bodies of constant density have no voxels"
    if scene.solids:
        return "the shadows of solids have edges within a voxel"
    if len({scene.medium_of(grid) for grid in scene.grids}) > 1:
        return "several media scatter differently"
    return ""


def smooth_lights(scene: Scene) -> list[int]:
    """Numbers of a scene's single lights that a lattice can hold: without an edge where there is density."""
    if why_not(scene):
        return []
    bounds = occupied_bounds(marched(scene))
    return [i for i, light in enumerate(scene.lights) if light.is_smooth_in(bounds)]


def left_out(scene: Scene) -> str:
    """Tell why a lattice leaves single lights of a scene to be looked up at every sample; empty: none."""
    others = len(scene.lights) - len(smooth_lights(scene))
    if not others:
        return ""
    edges = f"{others} of {len(scene.lights)} lights have an edge in the grids or are near them"
    why = why_not(scene) or edges
    return f'map.lookup = "lattice" cannot hold all light; the rest is looked up at every sample: {why}'


def choice(scene: Scene) -> Choice:
    """Decide what ``map.lookup = "auto"`` comes to."""
    why = why_not(scene)
    if why:
        return Choice(is_lattice=False, why=why)
    parts = scene.replace(lights=[part for light in scene.lights for part in light.parts()])
    lights = len(smooth_lights(parts))
    if lights < FEWEST_LIGHTS:
        return Choice(is_lattice=False, why=f"only {lights} lights have no edge in the grids")
    error = ERROR_PER_DEPTH * voxel_depth(marched(scene))
    tolerated = TOLERATED if scene.map.max_error is None else scene.map.max_error
    held = f"{lights} lights once a voxel; its error in the picture is about {error:.1g}"
    if error > tolerated:
        return Choice(is_lattice=False, why=f"a lattice of {held}, more than {tolerated:g}")
    return Choice(is_lattice=True, why=held)


def as_of(maps: MapSettings) -> Choice:
    """Decide the same for maps that are there already, with such settings."""
    return Choice(is_lattice=maps.lookup == "lattice", why="that of the maps that are there")
