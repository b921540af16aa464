"""Legendre polynomials: the best polynomials for the optical depth.

With v in [0, 1] along the range of a light ray, B_j(v) = P_j(2v - 1) by Bonnet's recurrence,

    (j + 1) P_{j+1}(x) = (2j + 1) x P_j(x) - j P_{j-1}(x)
    ∫_0^v B_j = (P_{j+1} - P_{j-1})(2v - 1) / (2(2j + 1))

For the extinction, c_j = (2j + 1) ∫ σ B_j dv with steps of constant density. All integrals except the first
vanish at both ends, so that T(0) = 1 and T(1) are exact ("Fourier Opacity Mapping", section 5, with these
functions). The coefficients of an analytic function decay exponentially; those of a function with edges decay
like those of any other series.

Sources: Szegő, "Orthogonal Polynomials", AMS 1939, chapter 4; Jansen and Bavoil, "Fourier Opacity Mapping",
I3D 2010.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats, least_squares, middles

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Legendre:
    """P_j(2v - 1) for j = 0 … n - 1."""

    n: int
    of_extinction: bool
    modes = np.zeros(0, np.float32)

    def values(self, v: Floats) -> Floats:
        """Evaluate the polynomials, or their integrals."""
        polynomials: Floats = np.polynomial.legendre.legvander(2 * v - 1, self.n).astype(np.float64)
        if not self.of_extinction:
            return polynomials[:, :-1]
        before = np.concatenate([-np.ones((len(v), 1)), polynomials[:, : self.n - 1]], axis=1)
        integrals: Floats = (polynomials[:, 1:] - before) / (2 * (2 * np.arange(self.n) + 1))
        return integrals

    def analysis(self, steps: int) -> Floats:
        """Inner products with the polynomials; σ is constant over each step."""
        if not self.of_extinction:
            return least_squares(self.values(middles(steps)))
        return (
            np.diff(self.values(np.arange(steps + 1) / steps), axis=0) * steps * (2 * np.arange(self.n) + 1)
        )


def _functions(choices: Choices, curves: Curves | None) -> Legendre:
    del curves
    return Legendre(choices.coeffs, choices.target == "extinction")


LEGENDRE = Basis(
    name="legendre",
    header="basis/legendre.h",
    summary="Legendre polynomials",
    defaults=Defaults("optical-depth", "visibility", "visible", "interpolate"),
    functions=_functions,
    counts=tuple(range(1, 17)),
)
