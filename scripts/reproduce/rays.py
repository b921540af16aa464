"""Single light rays, with the library's own functions."""

from __future__ import annotations

import numpy as np

import tfm_cl as tfm
from reproduce.lab import Floats, Lab
from tfm_cl import reference
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.resolved import resolve
from tfm_cl.scene.lights.base import texel_positions

CELLS = 512
"""Number of steps along a ray."""
EDGES: Floats = np.arange(CELLS + 1) / CELLS
MIDDLES: Floats = (np.arange(CELLS) + 0.5) / CELLS
DEPTHS = (0.5, 12.0)
"""Range of the optical depths of the rays studied: neither nearly transparent nor opaque."""


def reconstructed(basis: str, n: int, steps: Floats) -> Floats:
    """Optical depth from n coefficients, not clamped, [rays, `CELLS` + 1], at the edges of the steps.

    ``steps`` are optical depths of equal steps, [rays, `CELLS`].
    """
    make = BASES[basis].functions
    assert make is not None  # noqa: S101 - bases with functions only
    functions = make(resolve(tfm.MapSettings(basis=basis, coeffs=n)), None)
    depth: Floats = (steps @ functions.analysis(CELLS)) @ functions.values(EDGES).T
    return depth


def accumulated(steps: Floats) -> Floats:
    """Exact optical depth at the edges of the steps."""
    depth: Floats = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    return depth


def profiles(lab: Lab, name: str, *, per_ray: bool = False) -> Floats:
    """Optical depths of the steps of some of the light's rays, [rays, `CELLS`].

    All rays share one range, from the nearest to the farthest density, or each has that of the medium's box.
    """
    scene = lab.side(name)
    light = scene.lights[0]
    rays = reference.map_rays(light, texel_positions(lab.sizes.rays).reshape(-1, 2))
    begin, end = reference.march_bounds(scene.marched, *rays)
    rays, begin, end = rays.part(np.flatnonzero(end > begin)), begin[end > begin], end[end > begin]
    if not per_ray:
        near, far = np.full_like(begin, begin.min()), np.full_like(end, end.max())
        occupied = np.flatnonzero(_steps(scene, rays, near, far).any(axis=0))
        width = (far - near) / CELLS
        begin, end = near + occupied[0] * width, near + (occupied[-1] + 1) * width
    steps = _steps(scene, rays, begin, end)
    total = steps.sum(axis=1)
    chosen: Floats = steps[(total > DEPTHS[0]) & (total < DEPTHS[1])]
    return chosen


def _steps(scene: tfm.Scene, rays: reference.Rays, begin: Floats, end: Floats) -> Floats:
    sigma_t = float(scene.medium.sigma_t.mean())
    if scene.primitives:
        return sigma_t * depths_of_steps(scene, rays, begin, end, CELLS)
    distance = begin[:, None] + (end - begin)[:, None] * MIDDLES
    points = rays.origins[:, None] + distance[..., None] * rays.directions[:, None]
    steps: Floats = sigma_t * reference.density(scene.grids[0], points) * ((end - begin) / CELLS)[:, None]
    return steps


def depths_of_steps(scene: tfm.Scene, rays: reference.Rays, begin: Floats, end: Floats, count: int) -> Floats:
    """Return what primitives leave in equal steps of rays at σ = 1, in closed form, [rays, count]."""
    edges = begin[:, None] + (end - begin)[:, None] * np.arange(count + 1) / count
    each = zip(rays.origins, rays.directions, edges, strict=True)
    return np.array([sum(body.depths_along(*ray)[:, 0] for body in scene.primitives) for ray in each])


def most_features(steps: Floats) -> int:
    """Return the ray whose density rises most often, which is drawn."""
    smooth = np.apply_along_axis(lambda row: np.convolve(row, np.ones(25) / 25, "same"), 1, steps)
    high = smooth > 0.25 * smooth.max(axis=1, keepdims=True)
    return int((np.diff(high.astype(int), axis=1) > 0).sum(axis=1).argmax())
