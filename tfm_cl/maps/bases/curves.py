"""Optical depth along some light rays of a map: what data-driven bases learn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import CURVE_CELLS as CELLS

__all__ = ["CELLS", "Curves"]


@dataclass(frozen=True)
class Curves:
    """Light rays sampled over their ranges."""

    optical_depth: NDArray[np.float64]
    """Of the density, [rays, `CELLS` + 1], from 0 at the range's begin to its end."""
    extinction: float
    """At density 1, for which visibility is meant."""

    @property
    def middles(self) -> NDArray[np.float64]:
        """Optical depth at the cells' middles, [rays, `CELLS`]."""
        depth = self.optical_depth
        return 0.5 * (depth[:, 1:] + depth[:, :-1])

    @property
    def visibility(self) -> NDArray[np.float64]:
        """Light that the density of each cell meets, squared: ∫ D T² over the cell, [rays, `CELLS`]."""
        through = np.exp(-2 * self.extinction * self.optical_depth)
        return (through[:, :-1] - through[:, 1:]) / 2
