"""How media find the light from all around: its parts are many, soft, and dim beside a sun.

Each part stands for a whole region of the sky. What it brings changes little within a free path of the
medium, so that its map needs no texels finer than that, and it is looked up at the points of a lattice
instead of at every sample of every ray (``kernels/points.cl``). What points find of a light's way stays
as long as media and lights do: a camera that moves only scatters it anew.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

import numpy as np

from tfm_cl.plan.marched import distances, marched, occupied_bounds
from tfm_cl.plan.orders import FARTHER, OF_SMALLEST_BODY, Lattice, OnLattice, serves_no_lattice
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.lights.surroundings import Surroundings
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

ERROR_PER_DEPTH = 0.042
"""Of pictures of clouds and smoke where all light is from points, over the optical depth between these; where
it is a share of the light, times that."""
TOLERATED = 0.01
"""That error, at most."""
VOXELS_APART = (1.0, 3.0)
"""Distance between points, in voxels, at least and at most, as long as they are not too many: nearer than
voxels they cost more than they save."""
SHARES = 10
"""Into which the light is cut for that: points stay where lights are dimmed a little."""
PARTS_OF_VOXEL = 4
"""Of which it is whole multiples."""
MOST_POINTS = 1 << 22
"""Of a lattice."""
MOST_NUMBERS = 1 << 25
"""Optical depths, of a way to each point from each light, from which on points are further apart."""
MANY_PARTS = 8
"""From which on points are worth their error where nothing else is asked for."""
WIDEST_TURN = 0.25
"""Angle, in radians, between the ways from neighbouring points to the camera, up to which what they scatter
towards it is much the same."""
KEYS = ("lookup", "map_res", "points_apart")
"""Of a light from all around, that are left open."""
TEXELS_MULTIPLE, FEWEST_TEXELS = 32, 64
BRIGHTEST_PART = 0.25
"""Share of the light from which on a part of an image throws shadows of solids that are seen: a sun."""
WIDEST_PIXEL = 1.0
"""In distances between points, where the camera's rays cross what has density: with wider pixels rays take
fewer samples than there are points."""


class Decided(NamedTuple):
    """What a light from all around leaves open."""

    light: int
    key: str
    value: float | str
    why: str


def is_key(key: str) -> bool:
    """Tell whether a dotted key of a scene file is one of `KEYS`."""
    return key.startswith("light.") and key.rsplit(".", maxsplit=1)[-1] in KEYS


def numbers_of(lights: Sequence[Light]) -> list[int]:
    """Numbers of the lights, of a scene's single ones, that are looked up at points."""
    return [number for number, light in enumerate(lights) if light.is_at_points]


def decided(scene: Scene, *, reads_maps: bool = True) -> list[Decided]:
    """Decide what is left open.

    Parameters
    ----------
    scene
        The request.
    reads_maps
        Whether there are any, instead of the dual march.
    """
    found: list[Decided] = []
    for number, light in _all_around(scene):
        lookup: str = light.lookup
        if light.lookup == "auto":
            lookup, why = _lookup(scene, light, reads_maps=reads_maps)
            found.append(Decided(number, "lookup", lookup, why))
        if light.points_apart == "auto" and lookup == "points" and _scattering_grids(scene):
            found.append(Decided(number, "points_apart", *_points_apart(scene)))
        if light.map_res == "auto" and reads_maps and _scattering_grids(scene):
            found.append(Decided(number, "map_res", *_texels(scene, light)))
    return found


def _all_around(scene: Scene) -> Iterator[tuple[int, Surroundings]]:
    return ((i, cast("Surroundings", light)) for i, light in enumerate(scene.lights) if light.surrounds)


def resolved(scene: Scene, decisions: Iterable[Decided]) -> Scene:
    """Return the scene with what was decided; itself where nothing was."""
    of: dict[int, dict[str, float | str]] = {}
    for one in decisions:
        of.setdefault(one.light, {})[one.key] = one.value
    if not of:
        return scene
    lights = [light.replace(**of.get(number, {})) for number, light in enumerate(scene.lights)]
    return scene.replace(lights=lights)


def _lookup(
    scene: Scene, light: Surroundings, *, reads_maps: bool
) -> tuple[Literal["points", "samples"], str]:
    if not reads_maps:
        return "samples", "light is marched there"
    lattice, why = lattice_of(scene)
    why_not = next(_why_not(scene, light, lattice, why), "")
    if lattice is None or why_not:
        return "samples", why_not
    return "points", "{}x{}x{} of them, ".format(*lattice.size) + why


def _why_not(scene: Scene, light: Surroundings, lattice: Lattice | None, why: str) -> Iterator[str]:
    """Yield what keeps a light from points."""
    yield from _asked_otherwise(scene.map)
    yield from _edges(scene, light)
    if lattice is None:
        yield why
        return
    share = share_of(scene)
    tolerated = _tolerated(scene, share)
    if tolerated < VOXELS_APART[0] * _finest(scene):
        yield f"{share:.0%} of the light is from all around: points would be nearer than voxels"
    if lattice.spacing > tolerated:
        yield why
    near, far = distances(scene.occupied_bounds, np.asarray(scene.camera.from_))
    if lattice.spacing > WIDEST_TURN * near:
        yield f"the camera is as near as points, {lattice.spacing:.2g} apart"
    if scene.camera.pixel_width * (near + far) / 2 > WIDEST_PIXEL * lattice.spacing:
        yield "the picture has fewer samples than there would be points"


def _asked_otherwise(settings: MapSettings) -> Iterator[str]:
    """Yield what is asked for of maps that are looked up at samples."""
    if settings.max_error is not None:
        yield f"map.max_error = {settings.max_error:g} is of maps that are looked up there"
    for key, value in (("res", settings.res), ("lookup", settings.lookup)):
        if value != "auto":
            yield f'map.{key} = {value}: points are for maps where it is "auto"'


def _edges(scene: Scene, light: Surroundings) -> Iterator[str]:
    """Yield why its light is not soft, or where it has edges."""
    parts = sum(part.spread > 0 for part in light.parts())
    if parts < MANY_PARTS:
        yield f"only {parts} parts"
    if not all(solid.visible for solid in scene.solids):
        yield "of solids that the camera does not see, it sees the edges of their shadows"
    if scene.solids and (brightest := _brightest(light)) > BRIGHTEST_PART:
        yield f"{brightest:.0%} of it are from one direction, and solids throw shadows"


def _brightest(light: Surroundings) -> float:
    """Return the share of the brightest part."""
    brings = [float(np.sum(part.intensity)) for part in light.parts() if part.spread > 0]
    return max(brings) / max(sum(brings), 1e-300)


def _texels(scene: Scene, light: Surroundings) -> tuple[int, str]:
    if scene.map.res != "auto" or scene.map.max_error is not None:
        return light.part_texels, "the most that are of use"
    bounds, texel = occupied_bounds(marched(scene)), _apart(scene, share_of(scene))
    parts = [part for part in light.parts() if part.spread > 0]
    wanted = max((part.fitted(bounds).footprint(0.0) for part in parts), default=0.0) / texel
    number = max(math.ceil(min(wanted, light.part_texels) / TEXELS_MULTIPLE) * TEXELS_MULTIPLE, FEWEST_TEXELS)
    degrees = math.degrees(max((part.spread for part in parts), default=0.0))
    why = f"texels of {texel:.3g}, where each part of the sky is {degrees:.0f} degrees wide"
    return min(number, light.part_texels), why


def _points_apart(scene: Scene) -> tuple[float, str]:
    share = share_of(scene)
    apart = _apart(scene, share)
    return apart, f"{apart / _finest(scene):.3g} voxels, as {share:.0%} of the light is from all around"


def share_of(scene: Scene) -> float:
    """Return which share of all that lights bring to the middle of what has density is from soft ones."""
    bounds, soft, all_ = scene.occupied_bounds, 0.0, 0.0
    middle = bounds.mean(axis=0, keepdims=True)
    for light in scene.lights:
        for part in light.parts():
            if part.core > 0:  # of what media emit, which has a lattice of its own
                continue
            fitted = part.fitted(bounds) if part.needs_fitting else part
            brings = float(np.sum(fitted.intensity) * fitted.arrival(middle).strength[0])
            all_ += brings
            soft += brings if part.spread > 0 else 0.0
    return soft / all_ if all_ > 0 else 1.0


def lattice_of(scene: Scene) -> OnLattice:
    """Decide where points lie."""
    if why := serves_no_lattice(scene):
        return OnLattice(None, why)
    grids = _scattering_grids(scene)
    shapes = [body for body in scene.homogeneous if any(scene.medium_of(body).sigma_s)]
    if not grids:
        return OnLattice(None, "no grid scatters")
    low, high = around([body.occupied_bounds for body in (*grids, *shapes)])
    thin = [OF_SMALLEST_BODY * float((body.bounds[1] - body.bounds[0]).min()) for body in shapes]
    share = share_of(scene)
    wanted = spacing = min(_apart(scene, share), *thin, math.inf)
    lights = sum(part.spread > 0 for light in scene.lights for part in light.parts())
    most = min(MOST_POINTS, MOST_NUMBERS // max(lights, 1))
    first, size = _points(low, high, spacing)
    while math.prod(size) > most:
        spacing *= FARTHER
        first, size = _points(low, high, spacing)
    x, y, z = (spacing * first).tolist()
    why = f"{spacing:.2g} apart: {share:.0%} of the light is from all around"
    if spacing > wanted:
        why = f"{spacing:.2g} apart, as near as {most:,} points allow"
    return OnLattice(Lattice((x, y, z), spacing, size, 1, why), why)


def _scattering_grids(scene: Scene) -> list[Volume]:
    return [grid for grid in scene.grids if any(scene.medium_of(grid).sigma_s)]


def _tolerated(scene: Scene, share: float) -> float:
    """Return the distance between points, world units, with which grids are off by `TOLERATED`."""
    rounded = max(round(SHARES * share), 1) / SHARES
    depth = TOLERATED / (ERROR_PER_DEPTH * rounded)
    grids = _scattering_grids(scene)
    extinctions = [float(scene.medium_of(grid).sigma_t.max()) * grid.typical_density for grid in grids]
    return depth / max(*extinctions, 1e-30)


def _finest(scene: Scene) -> float:
    """Return the shortest edge of voxels of what scatters, world units."""
    return min(grid.detail for grid in _scattering_grids(scene))


def _apart(scene: Scene, share: float) -> float:
    """Return the distance between points, world units: what is asked for, or what grids ask for."""
    asked = [light.asked_apart for light in scene.lights if light.asked_apart is not None]
    if asked:
        return min(asked)
    least, most = VOXELS_APART
    voxels = min(max(_tolerated(scene, share) / _finest(scene), least), most)
    return _finest(scene) * math.floor(PARTS_OF_VOXEL * voxels) / PARTS_OF_VOXEL


def _points(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, tuple[int, int, int]]:
    """First point, in distances from the world's origin, and numbers along x, y, z.

    Where they lie does not follow what has density: as it changes from frame to frame, they stay.
    """
    first = np.floor(low / spacing)
    x, y, z = (np.maximum(np.ceil(high / spacing) - first, 1) + 1).astype(int).tolist()
    return first, (x, y, z)
