"""Optical depth along some light rays of a map, from which data-driven bases learn."""

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
    """Optical depth of the density at the cells' edges, [rays, `CELLS` + 1]; 0 at the beginning of the
    range."""
    extinction: float
    """Extinction at density 1, with which visibility is computed."""

    @property
    def middles(self) -> NDArray[np.float64]:
        """Optical depth at the cells' midpoints, [rays, `CELLS`]."""
        depth = self.optical_depth
        return 0.5 * (depth[:, 1:] + depth[:, :-1])

    @property
    def visibility(self) -> NDArray[np.float64]:
        """Visibility of the density in each cell: ∫ D T² over the cell, [rays, `CELLS`]."""
        through = np.exp(-2 * self.extinction * self.optical_depth)
        return (through[:, :-1] - through[:, 1:]) / 2
