"""Bodies: the density of grids at points, what lies along rays, and what it is made of."""

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
from tfm_cl.reference.primitives import amounts, bounds_of
from tfm_cl.scene.bodies.base import MarchedBody
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.sphere import SphereVolume
from tfm_cl.scene.bodies.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.homogeneous import Homogeneous
    from tfm_cl.scene.scene import Scene

Grids = Volume | Sequence[Volume]
"""One or several; a scene's may be none."""
Marched = MarchedBody | Sequence[MarchedBody]
"""Likewise, grids or primitives."""


def grids_of(bodies: Marched) -> list[Volume]:
    """Return the grids one by one."""
    return [body for body in _listed(bodies) if isinstance(body, Volume)]


def primitives_of(bodies: Marched) -> list[Primitives]:
    """Return the bodies of primitives one by one."""
    return [body for body in _listed(bodies) if isinstance(body, Primitives)]


def _listed(bodies: Marched) -> Sequence[MarchedBody]:
    return [bodies] if isinstance(bodies, MarchedBody) else bodies


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
    """Densities ``[..., K]`` of scalar fields at ``points [..., 3]``, of grids.

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


# --- all that is marched -----------------------------------------------------------------------------------


def march_bounds(
    bodies: Marched,
    origins: Floats,
    directions: Floats,
    limit: Floats | float = np.inf,
    margin: float = 0.0,
) -> Interval:
    """Interval of each ray, up to ``limit``, from the first to the last of the boxes that it meets.

    A grid's is the index-space box [-1, N], outside of which its D = 0; all primitives have one, along the
    axes, with a ``margin`` on all sides. Between boxes D = 0 too, but steps are taken there.
    """
    boxes = [
        box_interval(
            np.full(3, -1.0),
            np.array(part.shape[::-1], dtype=float),
            _to_index(part, origins, 1),
            _to_index(part, directions, 0),
            limit,
        )
        for part in grids_of(bodies)
    ]
    if primitives := primitives_of(bodies):
        low, high = bounds_of(primitives)
        boxes.append(box_interval(low - margin, high + margin, origins, directions, limit))
    return hull(len(origins), boxes)


def optical_depths(
    bodies: Marched, weights: Floats, rays: Rays, ends: Interval, steps: int | Integers
) -> Floats:
    """∫ D dt ``[rays, K]`` of fields, see `field_density`.

    Of grids by the midpoint rule, whose steps may differ from ray to ray; of primitives exact. ``weights``
    are ``[bodies, 3, K]``, grids first.
    """
    grids, primitives = grids_of(bodies), primitives_of(bodies)
    tau = amounts(primitives, weights[len(grids) :], rays, np.stack(ends, axis=1))[:, 0]
    return tau + _depths_of_grids(grids, weights[: len(grids)], rays, ends, steps) if grids else tau


def step_depths(bodies: Marched, weights: Floats, rays: Rays, cuts: Floats, samples: Floats) -> Floats:
    """∫ D dt ``[rays, n, K]`` of the same fields between each two of the distances ``cuts [rays, n + 1]``.

    Grids are read at the distances ``samples [rays, n]``.
    """
    grids = grids_of(bodies)
    densities = [field_density(grids, weights[: len(grids)], rays.at(t)) for t in samples.T]
    depths = np.stack(densities, axis=1) * np.diff(cuts)[..., None]
    return depths + amounts(primitives_of(bodies), weights[len(grids) :], rays, cuts)


def _depths_of_grids(
    volume: Grids, weights: Floats, rays: Rays, ends: Interval, steps: int | Integers
) -> Floats:
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
    """The bodies of a scene, grids and flames first, then primitives, with what each is made of.

    Attributes
    ----------
    sigma_t, sigma_s
        ``[bodies, RGB]``, at density 1, per world unit.
    emission
        Likewise, radiance.
    weights
        ``[marched, 3, RGB]``: extinction of a density of 1 in each channel of what is marched.
    """

    def __init__(self, scene: Scene, margin: float = 0.0) -> None:
        self.grids, self.homogeneous = (*scene.grids, *scene.flames), scene.homogeneous
        self.primitives = primitives_of(scene.primitives)
        self.margin = margin
        self.media = [scene.medium_of(body) for body in (*self.marched, *self.homogeneous)]
        self.sigma_t = np.array([medium.sigma_t for medium in self.media])
        self.sigma_s = np.array([medium.sigma_s for medium in self.media], dtype=float)
        self.emission = np.array([medium.emission for medium in self.media], dtype=float)
        self.weights = np.zeros((len(self.marched), 3, 3))
        for weight, body, sigma_t in zip(self.weights, self.marched, self.sigma_t, strict=False):
            weight[...] = np.diag(sigma_t) if body.colour is not None else np.outer([1, 0, 0], sigma_t)

    @property
    def marched(self) -> list[MarchedBody]:
        """Grids, then primitives."""
        return [*self.grids, *self.primitives]

    @property
    def extinctions(self) -> Floats:
        """Of the homogeneous bodies, ``[bodies, RGB]``, per world unit."""
        densities = np.array([body.density for body in self.homogeneous])
        found: Floats = densities[:, None] * self.sigma_t[len(self.marched) :]
        return found

    @property
    def albedo(self) -> Floats:
        """Single-scattering albedo ``[bodies, RGB]``, 0 where nothing is extinguished."""
        none = np.zeros_like(self.sigma_s)
        found: Floats = np.divide(self.sigma_s, self.sigma_t, out=none, where=self.sigma_t > 0)
        return found
