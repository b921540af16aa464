"""Primitives: what rays gather of bodies made of many small things, exactly.

Whatever their size: the product widens what is narrower than a few texels or pixels, so that nothing slips
between rays; the reference does not. Both mean the same of what is larger than that. Strands and polygons are
crossed at one place, and leave all that they hold there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from tfm_cl.reference.geometry import Floats, Integers, Rays
from tfm_cl.scene.bodies.curves import Curves
from tfm_cl.scene.bodies.points import Points

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfm_cl.scene.bodies.primitives import Primitives
    from tfm_cl.scene.bodies.thin import ThinPrimitives

PAIRS = 1 << 20
"""Of a ray and a primitive, looked at at a time: bounds the memory."""
DEVIATIONS = 3.0
"""Standard deviations of a Gaussian point at its radius, where it ends."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss-Legendre, exact up to degree 7: a smooth point's density along a ray has degree 6."""
SINGULAR = 1e-12
"""Of the determinant were all at right angles: below that a ray runs along a strand or a triangle."""
TURNS_BACK = 1e-6
"""Length of the sum of two unit vectors, below which they point in opposite directions."""


class MetPoints(NamedTuple):
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
        return _summed(self.ray, held[:, None] * self.densities, self.rays)

    def whole(self) -> tuple[Integers, Floats, Floats]:
        """Return each pair's ray, the distance of the middle, and all that the ray gathers."""
        half = self.half / self.radius
        held = self.radius * _integral(self.profile, -half, half, half**2)
        return self.ray, self.middle, held[:, None] * self.densities

    def thin(self, begin: Floats, end: Floats) -> Floats:
        """As of `MetThin`: 0."""
        del end
        return np.zeros((2, len(begin)))

    def tangents(self, begin: Floats, end: Floats) -> Floats:
        """Points have none: 0."""
        del end
        return np.zeros((len(begin), 3, 3))


class MetThin(NamedTuple):
    """Where rays cross the strands or triangles of a body: an entry for each crossing."""

    rays: int
    """How many there are, whatever they meet."""
    ray: Integers
    """``[crossings]``: number of the ray."""
    distance: Floats
    """``[crossings]``."""
    depth: Floats
    """``[crossings]``: what is left there, without its colour."""
    densities: Floats
    """``[crossings, 1]``, or ``[crossings, RGB]``: with it."""
    tangent: Floats
    """``[crossings, 3]``: unit vectors along strands; 0 of triangles."""

    def between(self, begin: Floats, end: Floats) -> Floats:
        """As of `MetPoints`."""
        return _summed(self.ray, self._within(begin, end)[:, None] * self.densities, self.rays)

    def whole(self) -> tuple[Integers, Floats, Floats]:
        """As of `MetPoints`."""
        return self.ray, self.distance, self.densities

    def thin(self, begin: Floats, end: Floats) -> Floats:
        """Sum what is crossed between two distances, colours' mean, and that times where: ``[2, rays]``."""
        held = self._within(begin, end) * self.densities.mean(axis=1)
        return np.stack([np.bincount(self.ray, held * each, self.rays) for each in (1, self.distance)])

    def tangents(self, begin: Floats, end: Floats) -> Floats:
        """∑ depth t tᵀ ``[rays, 3, 3]`` over the strands crossed between two distances ``[rays]``."""
        weight = self._within(begin, end) * self.depth
        products = weight[:, None, None] * self.tangent[:, :, None] * self.tangent[:, None, :]
        return _summed(self.ray, products.reshape(-1, 9), self.rays).reshape(-1, 3, 3)

    def _within(self, begin: Floats, end: Floats) -> Floats:
        return ((self.distance >= begin[self.ray]) & (self.distance < end[self.ray])).astype(float)


Met = MetPoints | MetThin


def _summed(ray: Integers, values: Floats, rays: int) -> Floats:
    """Sum ``values [pairs, n]`` over the pairs of each ray, ``[rays, n]``."""
    return np.stack([np.bincount(ray, value, rays) for value in values.T], axis=-1)


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


def meet(body: Primitives, rays: Rays) -> Met:
    """Find which primitives of a body lie on the way of rays, on either side of their origins."""
    ray, number, middle, square = (np.concatenate(values) for values in zip(*_near(body, rays), strict=True))
    channels = np.ones((len(body.positions), 1)) if body.colour is None else body.colour.astype(float)
    densities = (body.densities[:, None] * channels)[number]
    if isinstance(body, Points):
        half, radius = np.sqrt(square), body.radii[number]
        return MetPoints(body.profile, len(rays.origins), ray, middle, half, radius, densities)
    corners = cast("ThinPrimitives", body).corners[number]
    origins, directions = rays.origins[ray], rays.directions[ray]
    tangent = np.zeros((len(number), 3))
    if isinstance(body, Curves):
        crossed, distance, place = _cross_strands(corners, body.widths[number] / 2, origins, directions)
        tangent[crossed] = tangents_of(body, number[crossed], place[crossed])
    else:
        crossed, distance = _cross_triangles(corners, origins, directions)
    return MetThin(
        len(rays.origins),
        ray[crossed],
        distance[crossed],
        body.densities[number[crossed]],
        densities[crossed],
        tangent[crossed],
    )


def _near(body: Primitives, rays: Rays) -> Iterator[tuple[Integers, Integers, Floats, Floats]]:
    """Pairs of a ray and a primitive whose ball it crosses, with the middle and half the length squared."""
    together = 1 + PAIRS // (1 + len(rays.origins))
    for first in range(0, len(body.positions), together):
        part = slice(first, first + together)
        away = body.positions[None, part] - rays.origins[:, None]
        middle = np.einsum("rpx,rx->rp", away, rays.directions)
        beside = away - middle[..., None] * rays.directions[:, None]
        square = body.radii[part] ** 2 - (beside**2).sum(axis=-1)
        ray, primitive = np.nonzero(square > 0)
        yield ray, first + primitive, middle[ray, primitive], square[ray, primitive]


def tangents_of(body: Curves, number: Integers, place: Floats) -> Floats:
    """Return unit tangents ``[n, 3]`` at places on segments, from 0 at one end to 1 at the other.

    Those at both ends are mixed; each is halfway between the directions of the segments that meet there. At
    the ends of a strand, and where it turns back, it is the direction of the segment itself.
    """
    own = _direction(body, number)
    first, last = own.copy(), own.copy()
    follows, leads = body.goes_on[number], np.append(body.goes_on[1:], False)[number]
    first[follows] += _direction(body, number[follows] - 1)
    last[leads] += _direction(body, number[leads] + 1)
    at_ends = [np.where(_length(both) > TURNS_BACK, _unit(both), own) for both in (first, last)]
    return _unit((1 - place[:, None]) * at_ends[0] + place[:, None] * at_ends[1])


def _direction(body: Curves, number: Integers) -> Floats:
    return _unit(body.corners[number, 1] - body.corners[number, 0])


def _length(vectors: Floats) -> Floats:
    length: Floats = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return length


def _unit(vectors: Floats) -> Floats:
    """Make vectors as long as 1; what has no length stays 0."""
    length = _length(vectors)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _cross_strands(
    ends: Floats, radii: Floats, origins: Floats, directions: Floats
) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """Find which rays cross which segments, how far away, and how far along these, from 0 to 1.

    Both lines are closest at t and u, the least squares of a + u (b - a) - (o + t d). ``ends [n, 2, 3]``,
    ``radii [n, 2]``.
    """
    along, away = ends[:, 1] - ends[:, 0], ends[:, 0] - origins
    lines = np.stack([directions, -along], axis=2)
    square = np.swapaxes(lines, 1, 2) @ lines
    solvable = np.linalg.det(square) > SINGULAR * square[:, 1, 1]
    found = np.zeros((len(ends), 2))
    right = (np.swapaxes(lines, 1, 2) @ away[..., None])[solvable]
    found[solvable] = np.linalg.solve(square[solvable], right)[..., 0]
    t, u = found.T
    apart = np.linalg.norm(ends[:, 0] + u[:, None] * along - origins - t[:, None] * directions, axis=1)
    return solvable & (u >= 0) & (u < 1) & (apart < (1 - u) * radii[:, 0] + u * radii[:, 1]), t, u


def _cross_triangles(
    corners: Floats, origins: Floats, directions: Floats
) -> tuple[NDArray[np.bool_], Floats]:
    """Find which rays cross which triangles ``[n, 3, 3]``, and where, from barycentric coordinates."""
    edges = corners[:, 1:] - corners[:, :1]
    matrices = np.stack([*np.moveaxis(edges, 1, 0), -directions], axis=2)
    size = np.prod(np.linalg.norm(edges, axis=2), axis=1)
    solvable = np.abs(np.linalg.det(matrices)) > SINGULAR * size
    found = np.full((len(corners), 3), -1.0)
    right = (origins - corners[:, 0])[solvable, :, None]
    found[solvable] = np.linalg.solve(matrices[solvable], right)[..., 0]
    u, v, t = found.T
    return (u >= 0) & (v >= 0) & (u + v < 1), t


def amounts(bodies: Sequence[Primitives], weights: Floats, rays: Rays, cuts: Floats) -> Floats:
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


def bounds_of(bodies: Sequence[Primitives]) -> Floats:
    """World box ``[2, 3]`` around all that primitives hold."""
    low = np.min([(body.positions - body.radii[:, None]).min(axis=0) for body in bodies], axis=0)
    high = np.max([(body.positions + body.radii[:, None]).max(axis=0) for body in bodies], axis=0)
    return np.stack([low, high])
