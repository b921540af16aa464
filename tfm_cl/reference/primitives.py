"""Primitives: what rays gather of bodies made of many small things, exactly.

Whatever their size: the product widens what is narrower than twice the width of a texel or a pixel, so that
nothing slips between rays; the reference does not. Both mean the same of what is larger than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import erf

from tfm_cl.reference.geometry import Floats, Integers, Rays

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.points import Points

PAIRS = 1 << 20
"""Of a ray and a point, looked at at a time: bounds the memory."""
DEVIATIONS = 3.0
"""Standard deviations of a Gaussian point at its radius, where it ends."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss-Legendre, exact up to degree 7: a smooth point's density along a ray has degree 6."""


class Met(NamedTuple):
    """Where rays cross the points of a body: an entry for each pair of a ray and a point on its way."""

    profile: str
    rays: int
    """How many there are, whatever they meet."""
    ray: Integers
    """``[pairs]``: number of the ray."""
    middle: Floats
    """``[pairs]``: distance at which it is closest to the point's centre."""
    half: Floats
    """``[pairs]``: half the length that it crosses."""
    radius: Floats
    """``[pairs]``, of the point."""
    densities: Floats
    """``[pairs, 1]`` at its centre, or ``[pairs, RGB]``."""

    def between(self, begin: Floats, end: Floats) -> Floats:
        """∫ D dt ``[rays, 1]`` or ``[rays, RGB]`` between two distances ``[rays]`` along each ray."""
        low, high = (
            np.clip(at[self.ray] - self.middle, -self.half, self.half) / self.radius for at in (begin, end)
        )
        square = (self.half / self.radius) ** 2
        held = self.radius * _integral(self.profile, low, np.maximum(low, high), square)
        return np.stack(
            [np.bincount(self.ray, held * channel, self.rays) for channel in self.densities.T], axis=-1
        )


def _integral(profile: str, low: Floats, high: Floats, square: Floats) -> Floats:
    """∫ D ds of a point of radius and density 1, from ``low`` to ``high`` along a line.

    These are counted from the middle of what lies inside; the ``square`` is of half the length of that.
    """
    if profile == "ball":
        return high - low
    if profile == "gaussian":
        scale = DEVIATIONS / np.sqrt(2)
        along: Floats = (erf(scale * high) - erf(scale * low)) * np.sqrt(np.pi) / 2 / scale
        along *= np.exp(-(scale**2) * (1 - square))
        return along
    half, total = (high - low) / 2, np.zeros_like(low)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        total += weight * (square - (low + half + half * node) ** 2) ** 3
    return half * total


def meet(body: Points, rays: Rays) -> Met:
    """Find which points of a body lie on the way of rays, on either side of their origins."""
    channels = np.ones((len(body.positions), 1)) if body.colour is None else body.colour.astype(float)
    densities = body.densities[:, None] * channels
    found = []
    together = 1 + PAIRS // (1 + len(rays.origins))
    for first in range(0, len(body.positions), together):
        part = slice(first, first + together)
        away = body.positions[None, part] - rays.origins[:, None]
        middle = np.einsum("rpx,rx->rp", away, rays.directions)
        beside = away - middle[..., None] * rays.directions[:, None]
        square = body.radii[part] ** 2 - (beside**2).sum(axis=-1)
        ray, point = np.nonzero(square > 0)
        number = first + point
        found.append(
            (ray, middle[ray, point], np.sqrt(square[ray, point]), body.radii[number], densities[number])
        )
    pairs = [np.concatenate(values) for values in zip(*found, strict=True)]
    return Met(body.profile, len(rays.origins), *pairs)


def amounts(bodies: Sequence[Points], weights: Floats, rays: Rays, cuts: Floats) -> Floats:
    """∫ D dt ``[rays, n, K]`` of fields, between each two of the distances ``cuts [rays, n + 1]``.

    ``weights [bodies, 3, K]``: what a density of 1 of a body's channel adds to each.
    """
    total = np.zeros((cuts.shape[0], cuts.shape[1] - 1, weights.shape[-1]))
    for body, weight in zip(bodies, weights, strict=True):
        met = meet(body, rays)
        for n in range(total.shape[1]):
            channels = met.between(cuts[:, n], cuts[:, n + 1])
            total[:, n] += channels @ weight[: channels.shape[-1]]
    return total


def bounds_of(bodies: Sequence[Points]) -> Floats:
    """World box ``[2, 3]`` around all that primitives hold."""
    low = np.min([(body.positions - body.radii[:, None]).min(axis=0) for body in bodies], axis=0)
    high = np.max([(body.positions + body.radii[:, None]).max(axis=0) for body in bodies], axis=0)
    return np.stack([low, high])
