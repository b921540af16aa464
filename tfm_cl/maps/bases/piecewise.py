"""Extinction that is constant in equal parts of the range.

With v in [0, 1] along the range of a light ray and n coefficients, where part k extends from k/n to (k +
1)/n:

    c_k = ∫ over part k of σ dv,   τ(v) = Σ_k c_k clamp(nv - k, 0, 1)

These are the simplified functions of FOM section 5.1. The reconstruction is the same as that of ``slices``
with uniform planes, whose coefficients are the cumulative sums of these. T(0) = 1 and T at the ends of all
parts are exact.

Source: Jansen and Bavoil, "Fourier Opacity Mapping", I3D 2010 (FOM).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats, part_before

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves


@dataclass(frozen=True)
class Parts:
    """The indicator functions of n equal parts."""

    n: int
    modes = np.zeros(0, np.float32)

    def values(self, v: Floats) -> Floats:
        """Fraction of each part that lies before v."""
        shares: Floats = np.clip(np.subtract.outer(v * self.n, np.arange(self.n)), 0, 1)
        return shares

    def analysis(self, steps: int) -> Floats:
        """Fraction of each step that lies in each part."""
        return np.diff(part_before(np.arange(self.n + 1) / self.n, steps), axis=1)


def _functions(choices: Choices, curves: Curves | None) -> Parts:
    del curves
    return Parts(choices.coeffs)


PIECEWISE = Basis(
    name="piecewise",
    header="basis/piecewise.h",
    summary="extinction that is constant in equal parts of the range",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=_functions,
    targets=("extinction",),
)
