"""A basis for tfm_cl: Chebyshev polynomials, which follow edges at both ends of a ray more closely."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.maps.bases.base import Choices, Defaults, Floats, least_squares, middles
from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Chebyshev:
    """T_j(2v - 1) for j = 0 … n - 1, with v in [0, 1] along a light ray."""

    n: int

    @property
    def modes(self) -> NDArray[np.float32]:
        """The kernel header needs no numbers besides the coefficients."""
        return np.zeros(0, np.float32)

    def values(self, v: Floats) -> Floats:
        """Evaluate them, [len(v), n]."""
        return np.polynomial.chebyshev.chebvander(2 * v - 1, self.n - 1).astype(np.float64)

    def analysis(self, steps: int) -> Floats:
        """Return what makes coefficients of the values in the middles of steps: a least-squares fit."""
        return least_squares(self.values(middles(steps)))


def functions(choices: Choices, curves: Curves | None) -> Chebyshev:
    """Make the functions of a map."""
    del curves  # light rays of the map, for bases that learn from them
    return Chebyshev(choices.coeffs)


CHEBYSHEV = tfm.Basis(
    name="chebyshev",
    header=str(Path(__file__).with_name("chebyshev.h")),
    summary="Chebyshev polynomials",
    defaults=Defaults(target="optical-depth", fit="visibility", range="visible", lookup="interpolate"),
    functions=functions,
    targets=("transmittance", "optical-depth"),
    counts=tuple(range(1, 17)),
)
