"""Cosines: the paper's transform of the transmittance, and a cosine series of the extinction.

With v in [0, 1] along the range of a light ray, B_j(v) = cos(jπv).

``dct``: f = T^{1/α}, the density-weighted transmittance (TFM eq. 19) of the density alone (eq. 13):

    c_0 = ∫ f dv,   c_j = 2 ∫ f cos(jπv) dv,   f ≈ Σ_j c_j cos(jπv)      (TFM eq. 8–10, normalised)

The paper's equations lack the normalisation (the cosines are orthogonal, not orthonormal): taken
literally they give (T + mean T)/2. On M midpoints v = (x + ½)/M the cosine is eq. 10's
cos(jπ(2x + 1)/2M). M midpoints determine M coefficients; further ones are 0.
For T = e^{-τv}: c_0 = (1 - e^{-τ})/τ, c_j = 2τ(1 - (-1)^j e^{-τ})/(τ² + j²π²).

``hcos``: the half-range cosine series of the extinction σ, integrated analytically as in FOM eq. 3:

    τ(v) = c_0 v + Σ_j c_j sin(jπv)/(jπ)

T(0) = 1 and T(1) are exact for any n, a homogeneous medium needs one coefficient, and the coefficients are
linear in the density.

Sources: Delalandre, Gautron, Marvie, François, "Transmittance Function Mapping", I3D 2011 (TFM); Jansen and
Bavoil, "Fourier Opacity Mapping", I3D 2010, section 5 (FOM), of which ``hcos`` is a variant that the paper
does not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats, least_squares, middles

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Cosines:
    """cos(jπv) for j = 0 … n - 1."""

    n: int
    of_extinction: bool
    modes = np.zeros(0, np.float32)

    def values(self, v: Floats) -> Floats:
        """cos(jπv), or its integral."""
        angle = np.pi * np.arange(self.n)
        if not self.of_extinction:
            cosines: Floats = np.cos(np.multiply.outer(v, angle))
            return cosines
        with np.errstate(divide="ignore", invalid="ignore"):
            integrals: Floats = np.sin(np.multiply.outer(v, angle)) / angle
        integrals[..., 0] = v
        return integrals

    def analysis(self, steps: int) -> Floats:
        """Inner products with the cosines; for σ, over steps of optical depth d = σ / steps."""
        cosines = np.cos(np.multiply.outer(middles(steps), np.pi * np.arange(self.n)))
        return least_squares(cosines) * (steps if self.of_extinction else 1)


def _functions(choices: Choices, curves: Curves | None) -> Cosines:
    del curves
    return Cosines(choices.coeffs, choices.target == "extinction")


DCT = Basis(
    name="dct",
    header="basis/cosine.h",
    summary="cosines of the density-weighted transmittance (TFM eq. 8–10)",
    defaults=Defaults("transmittance", "l2", "box", "interpolate"),
    functions=_functions,
)
HCOS = Basis(
    name="hcos",
    header="basis/cosine.h",
    summary="half-range cosines of the extinction, integrated",
    defaults=Defaults("extinction", "l2", "box", "interpolate"),
    functions=_functions,
)
