"""Fourier series of the extinction: Fourier opacity maps.

With v in [0, 1] along the range of a light ray and n = 2K + 1 coefficients,

    c_0 = ∫ σ dv,   a_k = 2 ∫ σ cos(2πkv) dv,   b_k = 2 ∫ σ sin(2πkv) dv      (FOM eq. 1–2)
    τ(v) = c_0 v + Σ_k (a_k sin(2πkv) + b_k (1 - cos(2πkv))) / (2πk)           (FOM eq. 3)

in the order c_0, a_1, b_1, a_2, b_2 … (c_0 is the paper's a_0/2). T(0) = 1 and T(1) are exact for any K, a
homogeneous medium needs one coefficient, and the coefficients are sums over the steps of the march, in any
order. The integrals assume steps of constant density, so that there is no aliasing for any number of steps:
the cosines at the midpoints (FOM eq. 5–6, where a step is a primitive) times sin(πk/M) / (πk/M). The series
is periodic, so it rings where σ(0) ≠ σ(1); the half-range cosines of ``hcos`` do not.

The same functions serve the other targets, f ≈ c_0 + Σ_k a_k cos(2πkv) + b_k sin(2πkv).

Source: Jansen and Bavoil, "Fourier Opacity Mapping", I3D 2010 (FOM).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats, least_squares, middles

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Fourier:
    """The functions 1, cos(2πv), sin(2πv), cos(4πv) and so on."""

    n: int
    of_extinction: bool
    modes = np.zeros(0, np.float32)

    def values(self, v: Floats) -> Floats:
        """Evaluate the functions, or their integrals."""
        k = np.arange(1, self.n // 2 + 1)
        angle = 2 * np.pi * np.multiply.outer(v, k)
        values = np.empty((len(v), self.n))
        if self.of_extinction:
            values[:, 0] = v
            values[:, 1::2] = np.sin(angle) / (2 * np.pi * k)
            values[:, 2::2] = (1 - np.cos(angle)) / (2 * np.pi * k)
        else:
            values[:, 0] = 1
            values[:, 1::2] = np.cos(angle)
            values[:, 2::2] = np.sin(angle)
        return values

    def analysis(self, steps: int) -> Floats:
        """Inner products with the functions; σ is constant over each step."""
        if not self.of_extinction:
            return least_squares(self.values(middles(steps)))
        norms = np.where(np.arange(self.n) == 0, 1, 0.5)
        return np.diff(self.values(np.arange(steps + 1) / steps), axis=0) * steps / norms


def _functions(choices: Choices, curves: Curves | None) -> Fourier:
    del curves
    return Fourier(choices.coeffs, choices.target == "extinction")


FOURIER = Basis(
    name="fourier",
    header="basis/fourier.h",
    summary="Fourier series of the extinction, integrated (Fourier opacity maps)",
    defaults=Defaults("extinction", "l2", "box", "interpolate"),
    functions=_functions,
    counts=tuple(range(1, 32, 2)),
)
