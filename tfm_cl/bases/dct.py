"""The discrete cosine transform of the weighted transmittance: the paper's basis.

With u in [0, 1] the position on the light ray between its entry into the medium's bounds and its exit,
and f(u) = T(u)^{1/α} the density-weighted transmittance (TFM eq. 19) of the density alone (eq. 13):

    c_0 = ∫ f du,   c_j = 2 ∫ f cos(jπu) du,   f ≈ Σ_j c_j cos(jπu)      (eq. 8–10, normalised)

The paper's equations lack the normalisation (the cosines are orthogonal, not orthonormal): taken
literally they give (T + mean T)/2. On M midpoints u = (x + ½)/M the cosine is eq. 10's
cos(jπ(2x + 1)/2M); M midpoints determine M coefficients, and those beyond are 0.

For T = e^{-τu}: c_0 = (1 - e^{-τ})/τ, c_j = 2τ(1 - (-1)^j e^{-τ})/(τ² + j²π²).

Source: Delalandre, Gautron, Marvie, François, "Transmittance Function Mapping", I3D 2011.
"""

import numpy as np
from numpy.typing import NDArray

from tfm_cl.bases.base import Basis


def suffix_sums(steps: int, coeffs: int) -> NDArray[np.float32]:
    """Sum the cosines over the steps from each one on, [steps, coeffs]: S_j(n) of ``kernels/basis/dct.h``.

    Columns beyond ``steps`` are 0: M midpoints determine M cosines, higher ones would only alias.
    """
    u = (np.arange(steps) + 0.5) / steps
    cosines = np.cos(np.pi * u[:, None] * np.arange(coeffs)) / steps
    cosines[:, steps:] = 0
    return cosines[::-1].cumsum(axis=0)[::-1].astype(np.float32)


DCT = Basis(
    name="dct",
    header="basis/dct.h",
    table=suffix_sums,
    summary="cosines of the density-weighted transmittance (TFM eq. 8–10)",
)
