"""Haar wavelets of the extinction.

With v in [0, 1] along the range of a light ray, B_0 = 1, and for each level l = 0, 1 … and k = 0 … 2^l - 1

    ψ(v) = 2^(l/2) on the first half of the part from k/2^l to (k + 1)/2^l, and -2^(l/2) on the second
    c_j = ∫ σ B_j dv,   τ(v) = Σ_j c_j ∫_0^v B_j

Like those of Fourier opacity maps, the coefficients are sums over what lies along the ray, in any order, and
T(0) = 1 and T(1) are exact: only the integral of B_0 does not vanish at the end. All levels up to l span what
is constant in 2^(l + 1) equal parts, which is the space of ``piecewise`` and of uniform ``slices`` (OSM); but
a wavelet is 0 outside its own part, so that few coefficients are large where few things lie along a ray.

The integrals are piecewise linear, with bends at multiples of 1/n: their table of `CELLS` cells is exact.

Source: Aizenshtein, Smal, McGuire, "Wavelet Transparency", arXiv 2201.00094, 2022.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import TABULATED_CELLS as CELLS
from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Haar:
    """1, and the wavelets of the first levels; n is a power of two."""

    n: int

    @property
    def modes(self) -> NDArray[np.float32]:
        """Their integrals at the cells' edges, [`CELLS` + 1, n]."""
        return self.values(np.arange(CELLS + 1) / CELLS).astype(np.float32)

    def values(self, v: Floats) -> Floats:
        """Integrals from 0 to v, [len(v), n]."""
        values = np.zeros((len(v), self.n))
        values[:, 0] = v
        for j in range(1, self.n):
            parts = 1 << (j.bit_length() - 1)
            within = np.clip(v * parts - (j - parts), 0, 1)
            values[:, j] = np.minimum(within, 1 - within) / np.sqrt(parts)
        return values

    def analysis(self, steps: int) -> Floats:
        """Inner products with the wavelets; σ is constant over each step."""
        functionals: Floats = np.diff(self.values(np.arange(steps + 1) / steps), axis=0) * steps
        return functionals


def _functions(choices: Choices, curves: Curves | None) -> Haar:
    del curves
    return Haar(choices.coeffs)


WAVELETS = Basis(
    name="wavelets",
    header="basis/tabulated.h",
    summary="Haar wavelets of the extinction",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=_functions,
    targets=("extinction",),
    counts=(1, 2, 4, 8, 16, 32),
)
