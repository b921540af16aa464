"""The interface of a basis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import RIDGE, SUMS_BLOCK
from tfm_cl.errors import InputError

if TYPE_CHECKING:
    from tfm_cl.maps.bases.curves import Curves

Floats = NDArray[np.float64]
Target = Literal["transmittance", "optical-depth", "extinction"]
Fit = Literal["l2", "visibility"]
Range = Literal["box", "trimmed", "visible", "global"]
Lookup = Literal["interpolate", "reconstruct", "stochastic"]

FITS: dict[Fit, int] = {"l2": 0, "visibility": 1}
"""Methods of finding the coefficients, and their numbers in the kernels."""
RANGES: tuple[Range, ...] = ("box", "trimmed", "visible", "global")
LOOKUPS: dict[Lookup, int] = {"interpolate": 0, "reconstruct": 1, "stochastic": 2}
USUAL_COUNTS = tuple(range(1, 33))
"""Numbers of coefficients of a basis that has no others of its own."""
UNIFORM_SHARE = 0.02
"""Uniform share of the weight of the visibility fit; it constrains the function where no light arrives. On
six volumes, the values 0.01, 0.02 and 0.03 differ by a few per cent, while 0.1 and 0.3 are worse by 10 and 20
%."""


class Choices(Protocol):
    """What a basis has to know of a map: decided, nothing is ``"auto"``."""

    @property
    def coeffs(self) -> int:
        """Numbers a texel."""

    @property
    def target(self) -> Target:
        """What is approximated."""

    @property
    def fit(self) -> Fit:
        """How its numbers are found."""

    @property
    def slicing(self) -> str:
        """Where the bases of planes have theirs: ``uniform``, ``density`` or ``gamma``."""

    @property
    def density_weighting(self) -> float | None:
        """α of eq. 19; there where it matters: the target is the transmittance and rays have been seen."""


class Functions(Protocol):
    """The functions B_j(v) of one map, v in [0, 1] along the range of a light ray.

    The target is approximated by Σ_j c_j B_j(v); for the extinction, τ(v) = Σ_j c_j ∫_0^v B_j.
    """

    @property
    def modes(self) -> NDArray[np.float32]:
        """Data that the kernel header needs to evaluate them, besides the coefficients; may be empty."""

    def values(self, v: Floats) -> Floats:
        """B_j of the target at v, [len(v), n]; if the target is the extinction, their integrals."""

    def analysis(self, steps: int) -> Floats:
        """L2: the linear functionals that give the coefficients, [steps, n].

        c_j = Σ_k f_k a_jk over the midpoints of the steps or, for the extinction, Σ_k d_k a_jk with the
        optical depth d_k of every step.
        """


@dataclass(frozen=True)
class Defaults:
    """The choices of a basis for settings that are ``auto``."""

    target: Target
    fit: Fit
    range: Range
    lookup: Lookup


def _never(choices: Choices) -> bool:
    del choices
    return False


@dataclass(frozen=True)
class Basis:
    """A representation of the transmittance along a light ray by a few coefficients."""

    name: str
    """Name in scene files and on the command line."""
    header: str
    """Kernel header, relative to ``kernels/``; ``kernels/basis/README.md`` lists the functions it
    provides."""
    summary: str
    """One-line description for ``--help``."""
    defaults: Defaults
    functions: Callable[[Choices, Curves | None], Functions] | None
    """Makes the functions of a map; None where the kernel header accumulates in its own way.
    `Curves`, light rays of the map itself, are given where `learns` says so."""
    targets: tuple[Target, ...] = ("transmittance", "optical-depth", "extinction")
    """The targets that the basis can approximate."""
    fits: tuple[Fit, ...] = ("l2", "visibility")
    learns: Callable[[Choices], bool] = _never
    """Whether the functions of a map depend on its own light rays."""
    recalled: Callable[[Choices, NDArray[np.float32]], Functions] | None = None
    """Makes learnt functions again of their `Functions.modes`, for maps from files and functions that
    were given; raises `ValueError` for modes that are none. None where nothing is ever learnt."""
    lasts: Callable[[Choices], bool] = _never
    """Whether what was learnt for some maps, `recalled`, can be fitted to others: those of other frames."""
    lerps: bool = True
    """Whether the coefficients of neighbouring texels may be interpolated."""
    counts: tuple[int, ...] = USUAL_COUNTS
    """Numbers of coefficients per texel that the basis supports."""

    def table(self, functions: Functions, choices: Choices, steps: int) -> NDArray[np.float32]:
        """Make the table that ``kernels/map/projection.h`` needs for every step of a march.

        Parameters
        ----------
        choices
            Of the map.
        steps
            Number of steps along the range of a ray.

        Raises
        ------
        InputError
            Functions that return something else than they should.
        """
        n = choices.coeffs
        if choices.fit == "l2":
            analysis = self._checked("analysis", functions.analysis(steps), steps, n)
            rows = analysis if choices.target == "extinction" else _suffix_sums(analysis)
            return rows.astype(np.float32).ravel()
        values = self._checked("values", functions.values(middles(steps)), steps, n)
        below = _lower_triangle(n)
        products = np.zeros((steps, -(-len(below[0]) // SUMS_BLOCK) * SUMS_BLOCK))
        products[:, : len(below[0])] = values[:, below[0]] * values[:, below[1]]
        rows = np.concatenate([_suffix_sums(values / steps), values, products], axis=1)
        return np.concatenate([products.mean(axis=0), rows.ravel()]).astype(np.float32)

    def _checked(self, what: str, found: Floats, steps: int, n: int) -> Floats:
        """Refuse what functions should not return, as those of a plugin may."""
        shape = np.shape(found)
        if shape != (steps, n) or not np.isfinite(found).all():
            raise InputError(
                f"basis '{self.name}': {what} should return finite numbers of the shape ({steps}, {n}); got "
                f"{'others' if shape == (steps, n) else f'the shape {shape}'}"
            )
        return found


def middles(steps: int) -> Floats:
    """Midpoints of equal steps in [0, 1]."""
    return (np.arange(steps) + 0.5) / steps


def part_before(v: Floats, steps: int) -> Floats:
    """Fraction of each of equal steps that lies before each v: [steps, len(v)]."""
    shares: Floats = np.clip(v * steps - np.arange(steps)[:, None], 0, 1)
    return shares


def least_squares(values: Floats) -> Floats:
    """Functionals of the plain least-squares fit to values at the steps' midpoints, [steps, n].

    ``values`` holds the functions, [steps, n]. For cosines at the midpoints the result is TFM's eq. 10,
    normalised, since the cosines are orthogonal there too. M midpoints determine M coefficients; further ones
    would only alias and are 0.
    """
    found = np.zeros_like(values)
    found[:, : len(values)] = np.linalg.pinv(values[:, : len(values)]).T
    return found


def weighted_fit(weight: Floats, target: Floats, functions: Floats) -> Floats:
    """Weighted least-squares coefficients [rows, n] of every row of ``target`` [rows, points]."""
    n = functions.shape[1]
    products = (functions[:, :, None] * functions[:, None, :]).reshape(len(functions), -1)
    # In float32: this is most of the work, and the ridge limits the useful precision anyway.
    gram = (weight.astype(np.float32) @ products.astype(np.float32)).astype(np.float64).reshape(-1, n, n)
    ridge = RIDGE / n * np.trace(gram, axis1=1, axis2=2) + 1e-300
    right = ((weight * target) @ functions)[:, :, None]
    solved: Floats = np.linalg.solve(gram + ridge[:, None, None] * np.eye(n), right)[:, :, 0]
    return solved


@cache
def _lower_triangle(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.tril_indices(n)


def _suffix_sums(rows: Floats) -> Floats:
    return rows[::-1].cumsum(axis=0)[::-1]
