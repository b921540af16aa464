"""The error that a basis will have, from some light rays, before any map is built."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.bases.base import UNIFORM_SHARE, Floats, weighted_fit
from tfm_cl.bases.curves import CELLS

if TYPE_CHECKING:
    from tfm_cl.bases.base import Functions
    from tfm_cl.bases.curves import Curves
    from tfm_cl.settings import MapSettings


def error_of_fit(settings: MapSettings, functions: Functions | None, curves: Curves) -> float:
    """Relative error of T over all rays, √(Σ D (T̂ - T)² / Σ D T²), weighted by density.

    The fit is that of the light pass, over the cells' middles.

    Parameters
    ----------
    settings
        Resolved.
    functions
        Of the basis; a basis without has no estimate, and the answer is infinite.
    """
    if functions is None:
        return float("inf")
    depth = curves.middles
    middles = (np.arange(CELLS) + 0.5) / CELLS
    values = functions.values(middles)
    alpha = float(settings.density_weighting)
    of_transmittance = settings.target == "transmittance"
    target: Floats = -np.expm1(-depth / alpha) if of_transmittance else depth
    if settings.fit == "l2":
        analysis = functions.analysis(CELLS)
        steps = np.diff(curves.optical_depth, axis=1)
        numbers = (steps if settings.target == "extinction" else target) @ analysis
    else:
        weight = curves.visibility
        if of_transmittance:
            weight = weight * np.exp(np.minimum(2 * depth / alpha, 600))
        weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        weight = (1 - UNIFORM_SHARE) * weight + UNIFORM_SHARE / CELLS
        numbers = weighted_fit(weight, target, values)
    found = numbers @ values.T
    if of_transmittance:
        found = -alpha * np.log(np.clip(1 - found, 1e-37, 1))
    error = np.exp(-curves.extinction * np.maximum(found, 0)) - np.exp(-curves.extinction * depth)
    density = np.diff(curves.optical_depth, axis=1)
    light = float((density * np.exp(-2 * curves.extinction * depth)).sum())
    return float(np.sqrt((density * error**2).sum() / light)) if light > 0 else 0.0
