"""How what media emit lights their surroundings: ``medium.emission_lights``.

Each of these lights has a small map: its shadows are as soft as its cluster is wide. And as there are many,
all of them smooth, they are looked up at the points of a lattice, and what they bring is linear in between
(``kernels/emission_lights.cl``).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.plan.marched import distances, marched, occupied_bounds
from tfm_cl.plan.orders import (
    FARTHER,
    OF_SMALLEST_BODY,
    SAME,
    VOXELS_APART,
    Lattice,
    OnLattice,
    points_along,
    serves_no_lattice,
)
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.scene import Scene

Floats = NDArray[np.float64]

TEXELS = (64, 128)
"""Fewest and most along a side of a map of such a light."""
TEXELS_MULTIPLE = 32
MOST_POINTS = 1 << 22
"""Of the lattice."""
LOOK_UPS = 1 << 26
"""Points times lights, from which on points are further apart."""
COARSEST = 2.0
"""Distance between points, in radii of the lights, from which on a lattice would lose them."""


class Texels(NamedTuple):
    """Of a map of such a light, along a side."""

    number: int
    why: str


def texels_of(scene: Scene) -> Texels:
    """Decide the resolution of the lights' maps: texels as wide as half of a light's ball.

    As for other lights inside, at half the distance of the farthest point.
    """
    lights = scene.emission_lights
    few, many = TEXELS
    if scene.marched:
        bounds = occupied_bounds(marched(scene))
        far = [distances(bounds, np.asarray(light.from_))[1] for light in lights]
        wanted = max(
            light.footprint(away / 2) / max(light.core, 1e-30)
            for light, away in zip(lights, far, strict=True)
        )
    else:
        wanted = few
    whole = math.ceil(min(wanted, many) / TEXELS_MULTIPLE) * TEXELS_MULTIPLE
    number = min(max(whole, few), many)
    core = float(np.median([light.core for light in lights]))
    return Texels(number, f"shadows are as soft as the clusters, whose radius is {core:.2g}")


def lights_of(scene: Scene) -> list[Light]:
    """Return the lights of what media emit, as they are used."""
    lights = scene.emission_lights
    if not lights:
        return []
    texels, (lattice, _) = texels_of(scene).number, lattice_of(scene)
    # A lattice knows nothing of balls that fit between its points.
    least = 0.0 if lattice is None else lattice.spacing
    return [light.replace(texels=texels, core_radius=max(light.core_radius, least)) for light in lights]


def lattice_of(scene: Scene) -> OnLattice:
    """Decide where points lie at which the lights are looked up; at every sample where no lattice serves."""
    lights = scene.emission_lights
    if why := serves_no_lattice(scene):
        return OnLattice(None, why)
    grids = [grid for grid in scene.grids if any(scene.medium_of(grid).sigma_s)]
    shapes = [body for body in scene.homogeneous if any(scene.medium_of(body).sigma_s)]
    if not grids and not shapes:
        return OnLattice(None, "no medium scatters")
    low, high = around([body.occupied_bounds for body in (*grids, *shapes)])
    core, extent = float(np.median([light.core for light in lights])), np.maximum(high - low, 0.0)
    thin = [OF_SMALLEST_BODY * float((body.bounds[1] - body.bounds[0]).min()) for body in shapes]
    details = [VOXELS_APART * grid.detail for grid in grids] + [max(one, core / 4) for one in thin]
    wanted = spacing = min(details)
    most = min(MOST_POINTS, LOOK_UPS // len(lights))
    while math.prod(points_along(extent, spacing)) > most:
        spacing *= FARTHER
    if spacing > COARSEST * core:
        return OnLattice(None, f"points {spacing:.2g} apart would lose lights of a radius of {core:.2g}")
    size = points_along(extent, spacing)
    x, y, z = _first(grids, low, high, spacing, size).tolist()
    why = f"{spacing:.2g} apart, " + (
        f"as near as {VOXELS_APART:g} voxels, or as bodies are thin"
        if spacing == wanted
        else f"as near as {most:,} points allow"
    )
    return OnLattice(Lattice((x, y, z), spacing, size, 1, why), why)


def _first(
    grids: Sequence[Volume], low: Floats, high: Floats, spacing: float, size: tuple[int, int, int]
) -> Floats:
    """Return where the first point lies, world.

    Points lie fast to the voxels of a grid: as it grows from frame to frame there are more, but at the same
    places, and light does not jump.
    """
    if not grids:
        return np.asarray((low + high) / 2 - spacing * (np.array(size) - 1) / 2)
    anchor = min(grids, key=lambda grid: grid.detail).anchor
    return np.asarray(anchor + spacing * np.floor((low - anchor) / spacing + SAME))


def numbers_of(lights: Sequence[Light]) -> list[int]:
    """Numbers of the lights, of a scene's single ones, that media emit: those with a core."""
    return [number for number, light in enumerate(lights) if light.core > 0]
