"""Density for a body that comes without a sensible one."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.limits import LARGEST_COLOUR

OPTICAL_DEPTH = 7.0
"""τ along axis-aligned lines of sight, their mean weighted by itself, of a medium that is nothing in
particular."""


class HasLines(Protocol):
    """A body, as far as its optical depth goes."""

    def line_depths(self) -> list[NDArray[np.float64]]:
        """Integrals of the density along lines of some directions, before any scale."""


def why_density(optical_depth: float) -> str:
    """Say why the density is scaled as it is."""
    return f"an optical depth of {optical_depth:g} along typical lines of sight at σ_t = 1"


def density_scale_for(body: HasLines, optical_depth: float = OPTICAL_DEPTH) -> float:
    """Scale the density to an optical depth that shows both body and detail.

    It is that of σ_t = 1, so that a medium given by hand does what its numbers say.
    """
    depths = body.line_depths()
    lines = np.concatenate(depths)
    if lines.max(initial=0.0) <= 0:
        return 1.0
    lines /= lines.max()
    # Weighted by themselves: wisps fill much of the frame, but the body is what is looked at.
    typical = float((lines**2).sum() / lines.sum()) * max(float(depth.max()) for depth in depths)
    # Two digits are enough, and read better where the choice is printed.
    return float(f"{optical_depth / max(typical, optical_depth / LARGEST_COLOUR):.2g}")
