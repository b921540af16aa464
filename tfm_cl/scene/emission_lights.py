"""What media emit as light on their surroundings: a few point lights for each body.

A piece of a medium of the volume dV that emits the radiance j per world unit has the radiant intensity
j dV, in all directions. Cells of a body (voxels, or some of them together) are gathered in clusters
(`tfm_cl.scene.clusters`), whose lights stand at their centroids and have their intensities' sums, so that no
energy is lost. A cell may belong to several in part, and as what glows changes from frame to frame, lights
change no faster. On its way out, from the centroid on, light is dimmed by what is there, as any other.

A light's falloff is that of a ball that shines evenly, `Light.core`, with the cluster's mean square σ² of
distances from its centroid: its radius is √(5/3) σ. Near the cluster, and in it, light is as finite as it is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.errors import SceneError
from tfm_cl.files.volume_io.leaves import LEAF
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.clusters import sums_of_clusters
from tfm_cl.scene.lights.point import PointLight

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfm_cl.files.volume_io.leaves import Leaves
    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]
T = TypeVar("T")

MOST_CELLS = 1 << 15
"""Of a body: where there are more voxels that emit, cells hold some of them together."""
CELLS_OF_SHAPE = 1 << 15
"""About so many does a body of constant density have."""
MANY_CUBES = 1 << 19
"""Parts of leaves, at most, that are put together once more."""
LEAVES_AT_ONCE = 4096
"""Worked on together (16 MiB)."""
BALL = 5 / 3
"""Square of a ball's radius, in mean squares of its points' distances from the middle."""


class EmissionLight(PointLight):
    """A cluster of what a medium emits.

    Its map shows all directions, since the medium is all around it.
    """

    type: Literal["point"] = "point"
    falloff: Literal["none", "inverse-square"] = "inverse-square"
    core_radius: float = Field(default=0.0, ge=0, description="of the ball that shines, world units")
    texels: int = Field(default=64, ge=1, description="of its map, along a side, at most")

    @property
    def core(self) -> float:
        """As `Light.core`."""
        return self.core_radius

    @property
    def most_texels(self) -> int | None:
        """As `Light.most_texels`."""
        return self.texels

    def is_smooth_in(self, bounds: Floats) -> bool:
        """As `Light.is_smooth_in`: it is within what it lights."""
        del bounds
        return False

    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """As `Light.fitted`: its map is that of all directions anyway."""
        del bounds, everything
        return self


class Cells(NamedTuple):
    """Where a body emits."""

    places: Floats
    """[n, 3], centroids, world."""
    intensities: Floats
    """[n, RGB], radiant intensity: radiance per world unit times volume."""
    squares: Floats
    """[n], mean square of the distances from the centroid within a cell, world units²."""

    @property
    def weights(self) -> Floats:
        """[n]: all colours' together."""
        weights: Floats = self.intensities.sum(axis=1)
        return weights


NOTHING = Cells(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def emission_lights_of(body: Body, medium: Medium, flame: Volume | None) -> tuple[EmissionLight, ...]:
    """Return the lights of what a body's medium and its flame emit; none where it has, or asks for, none.

    Raises
    ------
    SceneError
        More light than float32 holds.
    """
    if not medium.emission_lights or not (medium.emits or medium.temperature is not None):
        return ()
    if isinstance(body, Volume):
        return _once(body, medium, "emission lights", lambda: _lights_of_volume(body, medium, flame))
    if isinstance(body, Homogeneous):
        return _lights_of_shape(body.with_medium(None), medium)
    return ()


def radius_of_emission(body: Body, medium: Medium, flame: Volume | None) -> float:
    """Return the radius of a ball that spreads as far as what a body's medium and its flame emit.

    0 where these emit nothing, and of bodies that have no end or are no volumes, boxes or spheres.
    """
    if not (medium.emits or medium.temperature is not None) or not np.isfinite(body.bounds).all():
        return 0.0
    if isinstance(body, Homogeneous):
        return _radius(_cells_of_shape(body, medium.emission))
    if isinstance(body, Volume):
        return _once(body, medium, "radius of emission", lambda: _radius(_of_volume(body, medium, flame)))
    return 0.0


def _once(volume: Volume, medium: Medium, what: str, make: Callable[[], T]) -> T:
    """Make what follows from a volume's emission, unless it has it of the same emission."""
    asked = medium.temperature, medium.temperature_offset, medium.temperature_scale, medium.Le_scale
    key, kept = (medium.emission_lights, medium.emission, asked, volume.density_key), volume.kept.get(what)
    if kept is None or kept[0] != key:
        kept = volume.kept[what] = key, make()
    made: T = kept[1]
    return made


def _radius(cells: Cells) -> float:
    if not 0 < float(cells.weights.sum()) < math.inf:
        return 0.0
    return float(_cores(_gathered(cells, 1, np.eye(3)))[0])


def _cores(cells: Cells) -> Floats:
    """Radii of balls that spread as far as cells do."""
    cores: Floats = np.sqrt(BALL * cells.squares)
    return cores


def _gathered(cells: Cells, count: int, axes: Floats) -> Cells:
    """Make clusters of those cells that shine, ``count`` at most: larger cells."""
    shines = cells.weights > 0
    places, intensities, squares = (values[shines] for values in cells)
    if not len(places):
        return NOTHING
    weights = intensities.sum(axis=1)
    middle = np.average(places, axis=0, weights=weights)
    offsets = places - middle
    moments = np.column_stack([offsets, (offsets**2).sum(axis=1), squares])
    sums = sums_of_clusters(
        places, weights, np.column_stack([intensities, weights[:, None] * moments]), count, axes
    )
    intensities, totals = sums[:, :3], sums[:, :3].sum(axis=1)
    *offsets, lengths, squares = sums[:, 3:].T / totals
    offsets = np.stack(offsets, axis=1)
    spread = np.maximum(lengths - (offsets**2).sum(axis=1), 0)
    return Cells(middle + offsets, intensities, spread + squares)


@lru_cache(maxsize=16)
def _lights_of_shape(body: Homogeneous, medium: Medium) -> tuple[EmissionLight, ...]:
    return _lights(_cells_of_shape(body, medium.emission), medium, np.eye(3))


def _lights_of_volume(volume: Volume, medium: Medium, flame: Volume | None) -> tuple[EmissionLight, ...]:
    edges = volume.world_from_index[:3, :3]
    return _lights(_of_volume(volume, medium, flame), medium, edges / np.linalg.norm(edges, axis=0))


def _lights(cells: Cells, medium: Medium, axes: Floats) -> tuple[EmissionLight, ...]:
    """Gather cells in clusters, a light each."""
    clusters = _gathered(cells, medium.emission_lights, axes)
    brightest = float(clusters.intensities.max(initial=0.0))
    if brightest > LARGEST_COLOUR:
        raise SceneError(
            f"medium.emission_lights = {medium.emission_lights}: a light of {brightest:.3g} per "
            f"steradian; the limit is {LARGEST_COLOUR:g}: lower medium.emission or medium.Le_scale"
        )
    return tuple(
        EmissionLight(from_=place, intensity=intensity, core_radius=core)
        for place, intensity, core in zip(
            clusters.places, clusters.intensities.tolist(), _cores(clusters).tolist(), strict=True
        )
    )


def _of_volume(volume: Volume, medium: Medium, flame: Volume | None) -> Cells:
    """Of its density, and of its flame."""
    parts = [_cells_of_grid(volume, medium.emission)] if medium.emits else []
    if flame is not None and flame.own_medium is not None:
        parts.append(_cells_of_grid(flame, flame.own_medium.emission))
    if not parts:
        return NOTHING
    return Cells(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _cells_of_grid(volume: Volume, emission: tuple[float, float, float]) -> Cells:
    """Voxels, each as wide as trilinear interpolation spreads it, or cubes of some."""
    matrix, channels = volume.world_from_index, volume.channel_leaves
    scale = volume.density_scale * abs(float(np.linalg.det(matrix[:3, :3]))) * np.asarray(emission)
    edge = max(map(_edge_of_cubes, channels))
    cubes = [_cubes(leaves, edge) for leaves in channels]
    cells = np.concatenate([found for found, _, _ in cubes])
    if not len(cells):
        return NOTHING
    # Where a voxel has one density, all colours are multiples of it.
    colours = np.diag(scale) if len(channels) > 1 else scale[None]
    sums = np.concatenate([np.outer(total, rgb) for (_, total, _), rgb in zip(cubes, colours, strict=True)])
    moments = np.concatenate([rgb.sum() * one for (*_, one), rgb in zip(cubes, colours, strict=True)])
    if len(channels) > 1:
        cells, sums, moments = _together(cells, sums, moments)
    while len(cells) > MOST_CELLS:
        edge *= 2
        cells, sums, moments = _together(cells // 2, sums, moments)
    total = sums.sum(axis=1, keepdims=True)
    index = np.divide(moments, total, out=np.zeros_like(moments), where=total > 0)
    # Of voxels in a row, (edge² - 1) / 12, and of a voxel's tent, 1/6; as if all were alike.
    square = float((matrix[:3, :3] ** 2).sum()) * (edge**2 + 1) / 12
    return Cells(index @ matrix[:3, :3].T + matrix[:3, 3], sums, np.full(len(sums), square))


def _together(
    cells: NDArray[np.int64], sums: Floats, moments: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Sum the numbers of cells that are the same."""
    cells, place = np.unique(cells, axis=0, return_inverse=True)
    place = place.reshape(-1)

    def summed(values: Floats) -> Floats:
        return np.stack([np.bincount(place, along) for along in values.T], axis=1)

    return cells, summed(sums), summed(moments)


def _edge_of_cubes(leaves: Leaves) -> int:
    """Voxels along the edges of cubes, so that they are not too many."""
    if leaves.active() <= MOST_CELLS:
        return 1
    fits = (edge for edge in (2, 4) if len(leaves.coordinates) * (LEAF // edge) ** 3 <= MANY_CUBES)
    return next(fits, LEAF)


def _cubes(leaves: Leaves, edge: int) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Sum voxels in cubes.

    Returns
    -------
    Which cubes hold anything, [n, 3], x first; sums, [n]; sums of voxels times their index, [n, 3].
    """
    count = LEAF // edge
    found = [(np.zeros((0, 3), np.int64), np.zeros(0), np.zeros((0, 3)))]
    for start in range(0, len(leaves.coordinates), LEAVES_AT_ONCE):
        corners = LEAF * leaves.coordinates[start : start + LEAVES_AT_ONCE].astype(np.int64)
        values = leaves.values[start : start + LEAVES_AT_ONCE].astype(np.float64)
        in_cubes = (len(values), count, edge, count, edge, count, edge)
        sums = values.reshape(in_cubes).sum(axis=(2, 4, 6))
        leaf, *place = np.nonzero(sums)
        moments = []
        for axis in (2, 1, 0):
            index = np.arange(LEAF).reshape([LEAF if i == axis else 1 for i in range(3)])
            index = index + (corners[:, axis] - leaves.first[axis]).reshape(-1, 1, 1, 1)
            moments.append((values * index).reshape(in_cubes).sum(axis=(2, 4, 6))[leaf, *place])
        cubes = np.stack(place[::-1], axis=1) + corners[leaf, ::-1] // edge
        found.append((cubes, sums[leaf, *place], np.stack(moments, axis=1)))
    cubes, sums, all_moments = (np.concatenate(values) for values in zip(*found, strict=True))
    return cubes, sums, all_moments


def _cells_of_shape(body: Homogeneous, emission: tuple[float, float, float]) -> Cells:
    """Equal boxes whose middle is inside, which share the body's light."""
    low, high = body.bounds
    edges, counts, left = high - low, np.ones(3, int), float(CELLS_OF_SHAPE)
    order = np.argsort(edges)
    for i, axis in enumerate(order):  # of a sheet, cells are as thick as it is
        cells = left / np.prod(edges[order[i:]] / edges[axis])
        counts[axis] = max(1, round(cells ** (1 / (3 - i))))
        left /= counts[axis]
    step = edges / counts
    along = [start + size * (np.arange(n) + 0.5) for start, size, n in zip(low, step, counts, strict=True)]
    places = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places[body.contains(places)]
    each = body.density * body.content / len(places)
    shares = np.broadcast_to(each * np.asarray(emission), (len(places), 3))
    return Cells(places, shares, np.full(len(places), (step**2).sum() / 12))
