"""Scattering in water, by particles of many sizes."""

from functools import cached_property
from math import log1p, pi
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.constants import FORWARD_DISK
from tfm_cl.scene.phases.base import Phase

SERIES_NEAR = 1e-3
"""|1 - δ| below which the first terms of a series stand for differences of what is almost the same."""


class Numbers(NamedTuple):
    """What the function is evaluated from."""

    delta_back: float
    """δ at θ = 180°."""
    nu: float
    """nu, between -1 and 0."""
    second: float
    """c, of the term c (3 μ² - 1), which integrates to 0."""
    disk: float
    """p on the disk around θ = 0."""


class FournierForand(Phase):
    """Particles whose sizes follow a power law, as in the sea.

    With s = sin²(θ/2), δ = 4 s / (3 (n - 1)²) and E(δ) = (δ^-nu - 1)/(1 - δ), the part of the light that is
    scattered by θ at most is 1 + (1 - s) E(δ) - μ (1 - μ²) E(δ at 180°)/8, and p(μ) its derivative by the
    solid angle. nu is such that the fraction B goes backwards. B = 1/2 is Rayleigh's function.

    At θ = 0 it is infinite, though what goes into any cone around it is not. Within 0.27°, a disk as wide as
    the Sun, it is therefore the mean over that disk, and the integral stays 1.

    Source: G. R. Fournier, J. L. Forand, "Analytic phase function for ocean water", Ocean Optics XII (1994),
    in the form of G. R. Fournier, M. Jonasz, "Computer-based underwater imaging analysis", Proc. SPIE 3761
    (1999); nu of B as in Blender's Cycles.
    """

    HEADER: ClassVar[str] = "phase/fournier_forand.h"
    TAKES: ClassVar[str] = (
        "the index of refraction and the fraction that goes backwards, as in fournier-forand:1.33:0.1"
    )

    type: Literal["fournier-forand"] = "fournier-forand"
    ior: float = Field(
        default=1.33,
        ge=1.001,
        le=2,
        description="n: the particles' index of refraction over that of the medium",
    )
    backscatter: float = Field(
        default=0.1,
        ge=1e-4,
        le=0.5,
        description="B: fraction of the light that is scattered backwards, at most half",
    )

    @cached_property
    def numbers(self) -> Numbers:
        """What the function is evaluated from."""
        delta_back = 4 / (3 * (self.ior - 1) ** 2)
        above = delta_back / 2 - 1  # δ - 1 at 90°
        nu = -log1p(2 * self.backscatter * above) / log1p(above) if above else -2 * self.backscatter
        e, _ = _differences(np.float64(delta_back), nu)
        second = -float(e) / (16 * pi)
        at_edge, _ = _differences(np.float64(delta_back * FORWARD_DISK), nu)
        mu = 1 - 2 * FORWARD_DISK
        inside = 1 + float(at_edge) * (1 - FORWARD_DISK) + 2 * pi * second * mu * (1 - mu**2)
        return Numbers(delta_back, nu, second, inside / (4 * pi * FORWARD_DISK))

    def kernel_parameters(self) -> tuple[float, ...]:
        """(δ at 180°, nu, c, p on the disk)."""
        return self.numbers

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        delta_back, nu, second, disk = self.numbers
        mu = np.asarray(mu, dtype=np.float64)
        s = np.maximum((1 - mu) / 2, FORWARD_DISK)
        e, r = _differences(delta_back * s, nu)
        outside = ((r - e) / s - r) / (4 * np.pi) + second * (3 * mu**2 - 1)
        return np.where((1 - mu) / 2 < FORWARD_DISK, disk, outside)


def _differences(delta: ArrayLike, nu: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """E = (δ^-nu - 1)/(1 - δ) and R = (E - nu δ^-nu)/(1 - δ), which are finite at δ = 1."""
    delta = np.asarray(delta, dtype=np.float64)
    a = 1 - delta
    is_near = np.abs(a) < SERIES_NEAR
    over = 1 / np.where(is_near, 1, a)
    power_less_1 = np.expm1(-nu * np.log(delta))
    e = power_less_1 * over
    r = (e - nu * (power_less_1 + 1)) * over
    terms = [nu]  # (nu)ₖ/k!
    for k in range(1, 5):
        terms.append(terms[-1] * (nu + k) / (k + 1))
    e_series = sum(term * a**k for k, term in enumerate(terms))
    r_series = sum(term * a**k * (1 - nu) * (k + 1) / (k + 2) for k, term in enumerate(terms))
    return np.where(is_near, e_series, e), np.where(is_near, r_series, r)
