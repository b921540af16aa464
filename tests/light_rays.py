"""Light rays of a small map, marched in float64, and what a basis should make of them."""

from typing import NamedTuple

import numpy as np

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.maps.bases.base import UNIFORM_SHARE, middles
from tfm_cl.scene.lights.base import texel_positions

RES = 8
STEPS = 40
RIDGE = 1e-6
"""``TFM_RIDGE`` of ``kernels/map/projection.h``."""


class LightRays(NamedTuple):
    """Rays through centres of texels inside the cone, row by row, between the bounds of the medium."""

    texels: np.ndarray
    """Their numbers."""
    origins: np.ndarray
    directions: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    def points(self, v):
        """World positions [rays, len(v), 3] at parts v of the rays' ranges."""
        distance = self.begin[:, None] + (self.end - self.begin)[:, None] * v
        return self.origins[:, None] + distance[:, :, None] * self.directions[:, None]

    def depths(self, volume, steps=STEPS):
        """Optical depth of each of equal steps, [rays, steps]."""
        density = reference.density(volume, self.points(middles(steps)))
        return density * ((self.end - self.begin) / steps)[:, None]


def slabs(seed, shape=(12, 9, 9)):
    """Layers across z with lumps and gaps, up to an optical depth of some 6 along it."""
    rng = np.random.default_rng(seed)
    density = rng.uniform(0, 1, (shape[0], 1, 1)) ** 3 * rng.uniform(0.2, 1, shape)
    density[2:5] = density[8:10] = 0
    return (120 * density).astype(np.float32)


def scene_of(density, **settings):
    """A volume of 1.5 × 1.5 × 2 units below a distant, nearly parallel spot light that looks down z."""
    size = np.array([1.5, 1.5, 2.0])
    voxel = size / density.shape[::-1]
    world_from_index = np.eye(4)
    world_from_index[:3, :3] = np.diag(voxel)
    world_from_index[:3, 3] = (voxel - size) / 2
    volume = tfm.Volume(density, world_from_index=world_from_index)
    light = tfm.SpotLight(from_=(0.03, 0.02, 9), to=(0, 0, 0), cone=4)
    return tfm.Scene(
        volume,
        medium=tfm.Medium(sigma_s=1.0, sigma_a=0.0),
        lights=[light],
        map=tfm.MapSettings(**{"res": RES, "steps": STEPS, "range": "box", **settings}),
    )


def light_rays(scene):
    """Rays of the scene's map that carry light and meet the bounds."""
    light = scene.lights[0].fitted(scene.volume.occupied_bounds)
    origins, directions = light.rays(texel_positions(scene.map.res))
    # A hair's breadth within the cone, and where the medium is.
    lit = light.reaches(origins + directions * (1 + 1e-9)) & (
        np.less(*reference.march_bounds(scene.volume, origins, directions))
    )
    texels = np.flatnonzero(lit)
    origins, directions = origins[texels], directions[texels]
    begin, end = reference.march_bounds(scene.volume, origins, directions)
    assert len(texels) > scene.map.res**2 / 2
    return LightRays(texels, origins, directions, begin, end)


def stored(light_map, rays):
    """The numbers of the map, [rays, n]."""
    return light_map.coefficients.reshape(-1, light_map.settings.coeffs)[rays.texels]


def transmittance(light_map, rays, v):
    """What a map says at parts v of its rays, [rays, len(v)]."""
    return light_map.evaluate(rays.points(np.asarray(v)))


def exact(depths, v):
    """T at v of steps of constant density, [rays, len(v)]."""
    edges = np.arange(depths.shape[1] + 1) / depths.shape[1]
    reached = np.concatenate([np.zeros((len(depths), 1)), depths.cumsum(axis=1)], axis=1)
    return np.exp(-np.array([np.interp(v, edges, ray) for ray in reached]))


def numbers(functions, settings, depths):
    """The numbers of every ray by the target and fit of resolved settings, [rays, n]."""
    steps = depths.shape[1]
    if settings.fit == "l2" and settings.target == "extinction":
        return depths @ functions.analysis(steps)
    before = depths.cumsum(axis=1) - depths
    middle = before + depths / 2
    target, error = middle, np.ones_like(middle)
    if settings.target == "transmittance":
        alpha = settings.density_weighting
        target = np.exp(-middle / alpha)
        error = np.exp(before / alpha)
    if settings.fit == "l2":
        return target @ functions.analysis(steps)
    values = functions.values(middles(steps))
    weight = np.exp(-2 * before) * error**2 * (1 - np.exp(-2 * depths))
    weight = (1 - UNIFORM_SHARE) * weight / weight.sum(axis=1, keepdims=True) + UNIFORM_SHARE / steps
    gram = np.einsum("rk,ki,kj->rij", weight, values, values)
    gram += (
        RIDGE * np.eye(values.shape[1]) * np.trace(gram, axis1=1, axis2=2)[:, None, None] / values.shape[1]
    )
    return np.linalg.solve(gram, np.einsum("rk,ki->ri", weight * target, values)[..., None])[..., 0]


def of_series(functions, settings, numbers_, v):
    """T that the numbers stand for at v, [rays, len(v)]."""
    series = numbers_ @ functions.values(np.asarray(v)).T
    if settings.target == "transmittance":
        return np.clip(series, 0, 1) ** settings.density_weighting
    return np.exp(-np.maximum(series, 0))
