"""Optical depth along some light rays of a map, from which data-driven bases learn."""

from __future__ import annotations

from collections.abc import Sequence
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
    extinction: float | NDArray[np.float64]
    """Extinction at density 1, with which visibility is computed; [rays, 1] where rays have their own."""

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

    @classmethod
    def together(cls, found: Sequence[Curves], most: int) -> Curves:
        """Put rays together, evenly chosen where there are more than ``most``."""
        depth = np.concatenate([curves.optical_depth for curves in found])
        extinctions = [np.full((len(one.optical_depth), 1), one.extinction) for one in found]
        some = np.linspace(0, len(depth) - 1, min(len(depth), most)).round().astype(int)
        return cls(depth[some], np.concatenate(extinctions)[some])
