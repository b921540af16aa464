"""The best linear basis for a particular map: its Karhunen–Loève basis, learnt from its own light rays.

A few thousand light rays of the map, sampled in `CELLS` cells, are approximated by Σ_j c_j B_j(v). The
functions B_j are *common* to all rays; each ray has coefficients c_j of its own.

With the fit ``visibility`` the functions minimise the sum over rays and cells of w (f - Σ_j c_j B_j)², where
every ray has its optimal coefficients. This is a weighted low-rank approximation, found by solving for the
coefficients and the functions alternately. w is the visibility of `kernels/map/projection.h`, so a ray is
weighted by the light that it loses. With the fit ``l2`` the weight is the mean over the rays, and the
solution is a singular value decomposition: the functions and the functionals that give the coefficients are
the same except for the weight (Eckart and Young), and the light pass costs no more than with cosines.

The functions are tabulated at the `CELLS` + 1 cell edges, with linear interpolation in between.

Sources: Eckart and Young, "The approximation of one matrix by another of lower rank", Psychometrika 1936;
Srebro and Jaakkola, "Weighted low-rank approximations", ICML 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from tfm_cl.maps.bases.base import UNIFORM_SHARE, Basis, Choices, Defaults, Floats, weighted_fit
from tfm_cl.maps.bases.curves import CELLS, Curves

ROUNDS = 6
"""Rounds of alternate solving. On six volumes, the error after 4 rounds is 5 to 12 % above that after 12
rounds; after 6 it is within 5 %."""
DEEPEST = 1e12
"""Optical depth from which all are scaled down, so that float32 holds products of their squares."""
TINY = 1e-300
"""Lower bound of weights, which avoids a division by 0 for rays without light."""
MEAN_SHARE = 0.1
"""Uniform share of the mean weight in the fit ``l2``."""


@dataclass(frozen=True)
class Learnt:
    """Functions given by their values at the cells' edges."""

    modes: NDArray[np.float32]
    """Values [`CELLS` + 1, n]; 0 at the first edge, where T = 1."""
    functionals: Floats
    """L2: c_j = Σ f_edge functionals[edge, j] over the edges from the second one on; [`CELLS`, n]."""

    def values(self, v: Floats) -> Floats:
        """Interpolate between the edges."""
        at = np.clip(v, 0, 1) * CELLS
        cell = np.minimum(at.astype(int), CELLS - 1)
        part = (at - cell)[:, None]
        modes = self.modes.astype(np.float64)
        values: Floats = (1 - part) * modes[cell] + part * modes[cell + 1]
        return values

    def analysis(self, steps: int) -> Floats:
        """Take the value at an edge as the mean over the steps within half a cell of it."""
        begin = (np.arange(CELLS) + 0.5) / CELLS
        end = np.minimum(begin + 1 / CELLS, 1)
        step = np.arange(steps)[:, None] / steps
        overlap = np.maximum(np.minimum(end, step + 1 / steps) - np.maximum(begin, step), 0)
        functionals: Floats = overlap / (end - begin) @ self.functionals
        return functionals


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def learn(choices: Choices, curves: Curves | None) -> Learnt:
    """Find the functions for some light rays."""
    assert curves is not None  # noqa: S101 - it learns
    # Threads of BLAS wait for more work by spinning, on the cores that the light pass needs next.
    with _blas().limit(limits=1, user_api="blas"):
        return _learn(choices, curves)


def _learn(choices: Choices, curves: Curves) -> Learnt:
    n = choices.coeffs
    x = np.linspace(-1, 1, CELLS + 1)[1:]
    polynomials = _orthonormal(np.polynomial.legendre.legvander(x, n - 1).astype(np.float64))
    if len(curves.optical_depth) == 0:  # no density: nothing to learn from, and nothing to represent
        return Learnt(_from_0(polynomials), polynomials / CELLS)
    depth = curves.optical_depth[:, 1:]
    depth = depth * min(1.0, DEEPEST / max(float(depth.max()), DEEPEST))  # the functions have no scale
    weight = _at_edges(curves.visibility)
    value: Floats = depth
    if choices.target == "transmittance":
        assert choices.density_weighting is not None  # noqa: S101 - these are the rays that it follows
        alpha = choices.density_weighting
        value = -np.expm1(-depth / alpha)
        weight = weight * np.exp(np.minimum(2 * depth / alpha, 600))
    if choices.fit == "l2":
        mean = weight.sum(axis=0)
        mean = (1 - MEAN_SHARE) * mean / max(float(mean.sum()), TINY) + MEAN_SHARE / CELLS
        root = np.sqrt(mean)[:, None]
        covariance = (value * root.T).T @ (value * root.T)
        best = np.linalg.eigh(covariance)[1][:, ::-1][:, :n]
        return Learnt(_from_0(best / root), root * best)
    lost = weight.sum(axis=1, keepdims=True)
    weight = (1 - UNIFORM_SHARE) * weight / np.maximum(lost, TINY) + UNIFORM_SHARE / CELLS
    by_ray = weight * (lost / max(float(lost.max()), TINY))
    functions = polynomials
    for _ in range(ROUNDS):
        numbers = weighted_fit(weight, value, functions)
        functions = _orthonormal(weighted_fit(by_ray.T, value.T, numbers))
    return Learnt(_from_0(functions), np.zeros((CELLS, n)))


def _orthonormal(functions: Floats) -> Floats:
    """Orthonormalise over [0, 1]; the span stays the same."""
    orthonormal: Floats = np.linalg.qr(functions)[0] * np.sqrt(len(functions))
    return orthonormal


def _at_edges(cells: Floats) -> Floats:
    """Distribute values in cells, [rays, `CELLS`], to the edges from the second one on."""
    shared = np.concatenate([cells, np.zeros((len(cells), 1))], axis=1)
    at_edges: Floats = 0.5 * (shared[:, :-1] + shared[:, 1:])
    return at_edges


def _from_0(functions: Floats) -> NDArray[np.float32]:
    return np.concatenate([np.zeros_like(functions[:1]), functions]).astype(np.float32)


def recalled(choices: Choices, modes: NDArray[np.float32]) -> Learnt:
    """As `Basis.recalled`; what is learnt already needs no functionals."""
    if modes.shape != (CELLS + 1, choices.coeffs):
        raise ValueError(f"should be {CELLS + 1}×{choices.coeffs} values")
    return Learnt(modes, np.zeros((CELLS, choices.coeffs)))


KLT = Basis(
    name="klt",
    header="basis/tabulated.h",
    summary="the best linear basis for the map, learnt from its own light rays",
    defaults=Defaults("optical-depth", "visibility", "visible", "interpolate"),
    functions=learn,
    targets=("transmittance", "optical-depth"),
    learns=lambda _: True,
    recalled=recalled,
    lasts=lambda choices: choices.fit == "visibility",  # the other fit has functionals besides
)
