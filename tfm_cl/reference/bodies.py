"""Bodies: the density of grids at points, the part of rays inside homogeneous ones, and optical depths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.reference import geometry
from tfm_cl.reference.geometry import (
    FAR,
    Floats,
    Integers,
    Interval,
    Rays,
    ball_interval,
    box_interval,
    hull,
    interval,
)
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.sphere import SphereVolume
from tfm_cl.scene.bodies.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.homogeneous import Homogeneous
    from tfm_cl.scene.scene import Scene

Grids = Volume | Sequence[Volume]
"""One or several; a scene's may be none."""


def grids_of(volume: Grids) -> Sequence[Volume]:
    """Return the grids one by one."""
    return [volume] if isinstance(volume, Volume) else volume


# --- grids -----------------------------------------------------------------------------------------------


def density(volume: Grids, points: Floats) -> Floats:
    """D at world-space ``points [..., 3]``: the sum of all grids', whatever their colours."""
    total = np.zeros(points.shape[:-1])
    for part in grids_of(volume):
        total += _density_of_one(part, points)
    return total


def _density_of_one(volume: Volume, points: Floats) -> Floats:
    """Trilinear between voxel centres, 0 one voxel beyond them."""

    def neighbours(at: Floats, count: int) -> list[tuple[Integers, Floats]]:
        at = np.clip(at, -1, count)  # all further out is 0 as well
        low = np.floor(at).astype(np.intp)
        weighted = (low, low + 1 - at), (low + 1, at - low)
        return [
            (voxel.clip(0, count - 1), weight * (voxel == voxel.clip(0, count - 1)))
            for voxel, weight in weighted
        ]

    index = np.ascontiguousarray(np.moveaxis(_to_index(volume, points, 1), -1, 0))
    total = np.zeros(points.shape[:-1])
    for (x, in_x), (y, in_y), (z, in_z) in product(*map(neighbours, index, volume.shape[::-1])):
        total += in_x * in_y * in_z * volume.data[z, y, x]
    return volume.density_scale * total


def channel_densities(volume: Volume, points: Floats) -> Floats:
    """D ``[..., 1]``; of a coloured grid red, green and blue ``[..., 3]``, each the product's trilinear."""
    parts = [volume] if volume.colour is None else volume.channels
    return np.stack([density(part, points) for part in parts], axis=-1)


def field_density(volume: Grids, weights: Floats, points: Floats) -> Floats:
    """Densities ``[..., K]`` of scalar fields at ``points [..., 3]``.

    ``weights [grids, 3, K]`` say what a density of 1 of a grid's channel adds to each, as
    `tfm_cl.scene.fields.Fields.weights`.
    """
    total = np.zeros((*points.shape[:-1], weights.shape[-1]))
    for grid, weight in zip(grids_of(volume), weights, strict=True):
        channels = channel_densities(grid, points)
        total += channels @ weight[: channels.shape[-1]]
    return total


def _to_index(volume: Volume, vectors: Floats, w: int) -> Floats:
    """Points (w = 1) or directions (w = 0) from world to index space."""
    matrix = np.linalg.inv(volume.world_from_index)
    index: Floats = vectors @ matrix[:3, :3].T + w * matrix[:3, 3]
    return index


def march_bounds(
    volume: Grids, origins: Floats, directions: Floats, limit: Floats | float = np.inf
) -> Interval:
    """Interval of each ray, up to ``limit``, from the first to the last of the grids' boxes that it meets.

    A grid's is the index-space box [-1, N], outside of which its D = 0. Between boxes D = 0 too, but steps
    are taken there.
    """
    boxes = (
        box_interval(
            np.full(3, -1.0),
            np.array(part.shape[::-1], dtype=float),
            _to_index(part, origins, 1),
            _to_index(part, directions, 0),
            limit,
        )
        for part in grids_of(volume)
    )
    return hull(len(origins), boxes)


def optical_depths(
    volume: Grids, weights: Floats, rays: Rays, ends: Interval, steps: int | Integers
) -> Floats:
    """∫ D dt ``[rays, K]`` of `field_density` by the midpoint rule; steps may differ from ray to ray."""
    begin, end = ends
    counts = np.broadcast_to(steps, begin.shape)
    length, tau = (end - begin) / np.maximum(counts, 1), np.zeros((len(begin), weights.shape[-1]))
    most, together = counts.max(initial=0), 1 + geometry.CHUNK // (1 + len(begin))
    for first in range(0, most, together):  # few rays take many steps at once
        block = np.arange(first, min(first + together, most))
        t = begin[:, None] + (block + 0.5) * length[:, None]
        points = rays.origins[:, None] + t[:, :, None] * rays.directions[:, None]
        taken = (block < counts[:, None])[..., None]
        tau += length[:, None] * np.where(taken, field_density(volume, weights, points), 0).sum(axis=1)
    return tau


# --- homogeneous bodies ------------------------------------------------------------------------------------


def body_interval(
    body: Homogeneous, origins: Floats, directions: Floats, limit: Floats | float = np.inf
) -> Interval:
    """Part of rays, up to ``limit``, inside a body of constant density; `FAR` is as far as any goes."""
    limit = np.minimum(limit, FAR)
    if isinstance(body, BoxVolume):
        return box_interval(np.array(body.from_), np.array(body.to), origins, directions, limit)
    if isinstance(body, SphereVolume):
        return ball_interval(np.array(body.centre), body.radius, origins, directions, limit)
    return interval(np.zeros(len(origins)), np.broadcast_to(limit, len(origins)))


# --- what they are made of ---------------------------------------------------------------------------------


class Matter:
    """The bodies of a scene, grids first, with what each is made of.

    Attributes
    ----------
    sigma_t, sigma_s
        ``[bodies, RGB]``, at density 1, per world unit.
    weights
        ``[grids, 3, RGB]``: extinction of a density of 1 in each of a grid's channels, for `field_density`.
    """

    def __init__(self, scene: Scene) -> None:
        self.grids, self.homogeneous = scene.grids, scene.homogeneous
        media = [scene.medium_of(body) for body in (*self.grids, *self.homogeneous)]
        self.sigma_t = np.array([medium.sigma_t for medium in media])
        self.sigma_s = np.array([medium.sigma_s for medium in media], dtype=float)
        self.phases = [medium.phase for medium in media]
        self.weights = np.zeros((len(self.grids), 3, 3))
        for weight, grid, sigma_t in zip(self.weights, self.grids, self.sigma_t, strict=False):
            weight[...] = np.diag(sigma_t) if grid.colour is not None else np.outer([1, 0, 0], sigma_t)

    @property
    def extinctions(self) -> Floats:
        """Of the homogeneous bodies, ``[bodies, RGB]``, per world unit."""
        densities = np.array([body.density for body in self.homogeneous])
        found: Floats = densities[:, None] * self.sigma_t[len(self.grids) :]
        return found

    @property
    def albedo(self) -> Floats:
        """Single-scattering albedo ``[bodies, RGB]``, 0 where nothing is extinguished."""
        none = np.zeros_like(self.sigma_s)
        found: Floats = np.divide(self.sigma_s, self.sigma_t, out=none, where=self.sigma_t > 0)
        return found
