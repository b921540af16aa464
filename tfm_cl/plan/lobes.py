"""How the later orders of scattering know of a phase function that has a lobe.

Radiance at a point is known by its moments c_lm = ∫ L Y_lm dω up to a degree, which scattering multiplies by
the Legendre moments χ_l of the phase function. A lobe is more than these: what it has beyond is taken for a
peak straight on, of the part f = χ at the next degree (Wiscombe 1977). What goes straight on is scattered all
the same, and counts as an order.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from tfm_cl.constants import BEYOND_ANGLES, BEYOND_DEPTHS, BEYOND_HALF, MOST_DEGREE
from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.phases.base import Phase

Floats = NDArray[np.float64]
LEAST_DEGREE = 2
"""Of a lobe: what has none is even, of degree 0."""
SMALL = 0.13
"""A Legendre moment up to which a degree is the last: at g = 1/2 degree 2 is off by 2 %, as are 4 and 6."""
EVEN = 1e-6
"""Legendre moments of what has no lobe: above what they are rounded by."""
FARTHEST_DEGREE = 512
"""Of a lobe's remainder, which it fades out towards: narrower peaks are wider."""
LEAST_STRAIGHT = 1e-3
"""Part of a light that goes straight on so many times that the rest is left out."""


TRUSTED = (1.0, 1.0, 0.9, 0.6, 0.2)
"""By degree: the best of six beside a path tracer. With all of the last moments, or none, thin clouds that
are lit from the front are off by 11 %."""


class Lobe(NamedTuple):
    """A phase function as the later orders know it."""

    degree: int
    """The last of the spherical harmonics; 0: light is scattered evenly."""
    moments: tuple[float, ...]
    """χ_0 … χ_degree."""
    straight: float
    """f: the part of the scattered light that goes straight on."""

    @property
    def harmonics(self) -> int:
        """Moments of the radiance at a point."""
        return (self.degree + 1) ** 2

    @property
    def bent(self) -> Floats:
        """What is left of the moments without what goes straight on, ``[degree + 1]``."""
        return np.subtract(self.moments, self.straight)

    @property
    def seen(self) -> Floats:
        """The moments as far as they are trusted, ``[degree + 1]``."""
        return np.array(self.moments) * self.trusted

    @property
    def trusted(self) -> Floats:
        """The part of each moment that the camera sees by those of the radiance, the rest by `beyond`."""
        return np.array(TRUSTED[: self.degree + 1]) if self.straight > 0 else np.ones(self.degree + 1)

    def times_straight(self, orders: int) -> int:
        """Return how often a light goes straight on, at most, before it counts as nothing."""
        if self.straight == 0:
            return 0
        return min(orders, math.ceil(math.log(LEAST_STRAIGHT) / math.log(self.straight)))


def lobe_of(phase: Phase, degree: int = 0) -> Lobe:
    """Choose the degree, by the moments of the phase function; ``degree``: the least."""
    moments = phase.legendre_moments(MOST_DEGREE + 2)
    if np.abs(moments[1:]).max() < EVEN:
        return Lobe(degree, (1.0,) + (0.0,) * degree, 0.0)
    degree = max(degree, LEAST_DEGREE)
    while degree < MOST_DEGREE and np.abs(moments[degree + 1 :]).max() > SMALL:
        degree += 1
    # A peak backwards is none straight on.
    straight = max(float(moments[degree + 1]), 0.0) if moments[1] > EVEN else 0.0
    return Lobe(degree, tuple(moments[: degree + 1].tolist()), straight)


def lobes_of(phases: Sequence[Phase]) -> list[Lobe]:
    """Choose one degree for several phase functions: that of the narrowest lobe."""
    degree = max(lobe_of(phase).degree for phase in phases)
    return [lobe_of(phase, degree) for phase in phases]


def quadrature() -> tuple[Floats, Floats]:
    """Return directions [32, 3] and weights [32] that integrate polynomials of degree 9 over the sphere.

    The weights add up to 4π. Source: A. H. Stroud, "Approximate Calculation of Multiple Integrals" (1971),
    U3 9-1: the vertices of an icosahedron and of the dodecahedron that is dual to it.
    """
    golden, signs = (1 + math.sqrt(5)) / 2, (1.0, -1.0)
    icosahedron = [(0.0, a, b * golden) for a, b in product(signs, signs)]
    rectangles = [(0.0, a * golden, b / golden) for a, b in product(signs, signs)]
    turned = [
        [(p[n], p[n - 2], p[n - 1]) for p in points for n in range(3)] for points in (icosahedron, rectangles)
    ]
    points = np.array([*turned[0], *product(signs, signs, signs), *turned[1]])
    weights = np.repeat([5 / 168, 27 / 840], [len(turned[0]), len(points) - len(turned[0])])
    return points / np.linalg.norm(points, axis=1)[:, None], 4 * math.pi * weights


def harmonics(directions: Floats, degree: int) -> Floats:
    """Real spherical harmonics ``[n, (degree + 1)²]`` of unit vectors ``[n, 3]``; Y_lm at l² + l + m.

    Orthonormal, as in ``kernels/view/harmonics.h``; up to degree 4.
    """
    x, y, z = np.asarray(directions, dtype=np.float64).T
    root = math.sqrt
    found = [
        root(1 / 4) * np.ones_like(x),
        root(3 / 4) * y,
        root(3 / 4) * z,
        root(3 / 4) * x,
        root(15 / 4) * x * y,
        root(15 / 4) * y * z,
        root(5 / 16) * (3 * z**2 - 1),
        root(15 / 4) * x * z,
        root(15 / 16) * (x**2 - y**2),
        root(35 / 32) * y * (3 * x**2 - y**2),
        root(105 / 4) * x * y * z,
        root(21 / 32) * y * (5 * z**2 - 1),
        root(7 / 16) * z * (5 * z**2 - 3),
        root(21 / 32) * x * (5 * z**2 - 1),
        root(105 / 16) * z * (x**2 - y**2),
        root(35 / 32) * x * (x**2 - 3 * y**2),
        root(315 / 16) * x * y * (x**2 - y**2),
        root(315 / 32) * y * z * (3 * x**2 - y**2),
        root(45 / 16) * x * y * (7 * z**2 - 1),
        root(45 / 32) * y * z * (7 * z**2 - 3),
        root(9 / 256) * (35 * z**4 - 30 * z**2 + 3),
        root(45 / 32) * x * z * (7 * z**2 - 3),
        root(45 / 64) * (x**2 - y**2) * (7 * z**2 - 1),
        root(315 / 32) * x * z * (x**2 - 3 * y**2),
        root(315 / 256) * (x**2 * (x**2 - 3 * y**2) - y**2 * (3 * x**2 - y**2)),
    ]
    values: Floats = np.stack(found[: (degree + 1) ** 2], axis=-1) / root(math.pi)
    return values


def zonal(moments: Floats, mu: Floats) -> Floats:
    """Σ (2l + 1) / 4π moments_l P_l(μ): the function of these Legendre moments."""
    weights = (2 * np.arange(len(moments)) + 1) / (4 * np.pi)
    return np.asarray(legendre.legval(mu, (weights * moments.T).T), dtype=np.float64)


def far_moments(phase: Phase) -> Floats:
    """Return the Legendre moments ``[FARTHEST_DEGREE]``, fading out towards the last."""
    fades: Floats = np.exp(-8 * (np.arange(FARTHEST_DEGREE) / FARTHEST_DEGREE) ** 2)
    return phase.legendre_moments(FARTHEST_DEGREE) * fades


def beyond(
    phase: Phase, lobe: Lobe, orders: int, way: Floats | None = None, spread: float = 0.0
) -> NDArray[np.float32]:
    """Tabulate what the orders after the first scatter of a light beyond the lobe's degree.

    In a small angle around its way, light that was scattered k times has the moments χ_l^k, and there is
    e^-τ (ϖ τ)^k / k! of it, with the optical depth τ of that way. ``[BEYOND_DEPTHS, BEYOND_ANGLES]``, per
    steradian: the sum over k from 1 to orders - 1 of e^-s s^k / k! Σ (2l + 1) / 4π χ_l^(k+1) P_l(μ) over all
    l > degree, and of the others as far as they are not trusted. Rows are even in s / (s + BEYOND_HALF), of
    s = ϖ τ, columns in ((1 - μ) / 2)^(1/4). ``way``: the moments `far_moments` of what scatters on the way,
    where that is not this phase function alone, which then is that of the last scattering. ``spread``: as of
    `Light.spread`.

    Source: H. C. van de Hulst, "Multiple Light Scattering" (1980), small-angle scattering.
    """
    check_cancelled()
    table = np.zeros((BEYOND_DEPTHS, BEYOND_ANGLES), np.float32)
    if lobe.straight == 0:  # light that turns back does not stay on its way
        return table
    moments = far_moments(phase)
    unknown = np.ones(FARTHEST_DEGREE)
    unknown[: lobe.degree + 1] -= lobe.trusted
    unknown *= phase.left_by_spread(np.arange(FARTHEST_DEGREE), spread)
    way = moments if way is None else way
    mu = 1 - 2 * np.linspace(0, 1, BEYOND_ANGLES) ** 4
    part = np.linspace(0, 1, BEYOND_DEPTHS)[:-1]  # nothing is left at the last
    depth = BEYOND_HALF * part / (1 - part)
    term, total = np.exp(-depth)[:, None] * moments, np.zeros((len(depth), len(moments)))
    for k in range(1, orders):
        term = term * (depth[:, None] / k * way)
        total += term
        if np.abs(term).max() < EVEN * np.abs(total).max() and k > depth.max():
            break
    table[:-1] = zonal((unknown * total).T, mu)
    return table
