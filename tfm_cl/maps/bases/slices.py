"""Optical depth at planes across the light: opacity shadow maps.

With v in [0, 1] along the range of a light ray and n planes 0 < v_1 < … < v_n = 1,

    c_j = τ(v_j) = ∫_0^{v_j} σ dv

and τ(0) = 0. ``slices`` is linear between planes (OSM, note 5). It is exact for a homogeneous medium, has an
error of O(n⁻²) where σ is smooth, is monotone and never rings. ``slices-cubic`` is the higher-order
interpolation that OSM mentions, from four planes each: cubic Hermite splines whose slope at a plane is that
of the chord between its neighbours (Catmull and Rom; the first and last interval use their own chord at the
ends). Its error is O(n⁻³), but it overshoots at edges.

Both are linear in the coefficients, Σ_j c_j B_j(v), and the coefficients are linear in the density: a step of
the march that straddles a plane contributes the part before it.

The planes (OSM figure 3) may be ``uniform``; ``density``, a 1-D binary space partition in which the interval
with most of the rays' mean density is halved until there are n; or ``gamma``, v_j = (j/n)², closer near the
light, where shadows vary most.

Source: Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on Rendering 2001 (OSM).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tfm_cl.maps.bases.base import Basis, Choices, Defaults, Floats, part_before
from tfm_cl.maps.bases.curves import CELLS, Curves

MOST_PLANES = 512
"""Of ``slices``, the only basis whose numbers are worth it by the hundred: OSM's plates have up to 500."""
GAMMA = 2.0
"""Exponent of the slicing ``gamma``: roughly the gamma of a display, as in OSM figure 3c."""
EVEN_SHARE = 0.02
"""Share of an interval's width, beside its density, in the measure by which the slicing ``density`` chooses
the interval to halve: it keeps intervals from becoming far narrower than the density requires."""


@dataclass(frozen=True)
class Slices:
    """The cardinal functions of interpolation between planes."""

    planes: Floats
    """Positions of the planes, v_1 … v_n = 1, ascending."""
    cubic: bool

    @property
    def modes(self) -> NDArray[np.float32]:
        """Beginning and 1 / width of the interval before each plane, [n, 2]."""
        return np.column_stack([self._begins, 1 / self._widths]).astype(np.float32)

    @property
    def _begins(self) -> Floats:
        return np.concatenate([[0.0], self.planes[:-1]])

    @property
    def _widths(self) -> Floats:
        return np.diff(self.planes, prepend=0.0)

    def values(self, v: Floats) -> Floats:
        """Interpolate between planes, with τ = 1 at one plane and 0 at the others."""
        widths = self._widths
        part = np.clip((v[:, None] - self._begins) / widths, 0, 1)
        rise = np.eye(len(widths)) - np.eye(len(widths), k=-1)
        values: Floats = part @ rise
        if self.cubic:
            # Slopes at both ends of every interval, times its width.
            begin, end = rise.copy(), rise.copy()
            chords = (rise[1:] + rise[:-1]) / (widths[1:] + widths[:-1])[:, None]
            begin[1:], end[:-1] = widths[1:, None] * chords, widths[:-1, None] * chords
            bump = part * (1 - part)
            values += (bump * (1 - part)) @ (begin - rise) - (bump * part) @ (end - rise)
        return values

    def analysis(self, steps: int) -> Floats:
        """Fraction of each step that lies before each plane."""
        return part_before(self.planes, steps)


def planes(choices: Choices, curves: Curves | None) -> Floats:
    """Place n planes in [0, 1], the last one at 1."""
    n = choices.coeffs
    if choices.slicing == "density":
        assert curves is not None  # noqa: S101 - _by_density
        return _halved_by_density(n, curves)
    even = np.arange(1, n + 1) / n
    return even**GAMMA if choices.slicing == "gamma" else even


def _halved_by_density(n: int, curves: Curves) -> Floats:
    grid = np.arange(CELLS + 1) / CELLS
    held = EVEN_SHARE * grid
    if len(curves.optical_depth):
        mean = curves.optical_depth.mean(axis=0)
        held += (1 - EVEN_SHARE) * mean / max(float(mean[-1]), np.finfo(float).tiny)
    edges = [0.0, 1.0]
    while len(edges) <= n:
        fullest = int(np.diff(np.interp(edges, grid, held)).argmax())
        edges.insert(fullest + 1, (edges[fullest] + edges[fullest + 1]) / 2)
    return np.array(edges[1:])


def _by_density(choices: Choices) -> bool:
    return choices.slicing == "density"


def _linear(choices: Choices, curves: Curves | None) -> Slices:
    return Slices(planes(choices, curves), cubic=False)


def _cubic(choices: Choices, curves: Curves | None) -> Slices:
    return Slices(planes(choices, curves), cubic=True)


def _recalled(choices: Choices, modes: NDArray[np.float32], *, cubic: bool) -> Slices:
    """As `Basis.recalled`: planes by density halve the range, so that float32 holds them."""
    if modes.shape != (choices.coeffs, 2):
        raise ValueError(f"should be {choices.coeffs}×2 values")
    found = np.append(modes[1:, 0].astype(np.float64), 1.0)
    if not (np.diff(found, prepend=0.0) > 0).all():
        raise ValueError("should be planes one behind the other")
    return Slices(found, cubic)


SLICES = Basis(
    name="slices",
    header="basis/slices.h",
    summary="optical depth at planes, linear in between (opacity shadow maps)",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=_linear,
    targets=("extinction",),
    learns=_by_density,
    recalled=partial(_recalled, cubic=False),
    lasts=_by_density,
    counts=tuple(range(1, MOST_PLANES + 1)),
)
SLICES_CUBIC = Basis(
    name="slices-cubic",
    header="basis/slices_cubic.h",
    summary="optical depth at planes, cubic in between",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=_cubic,
    targets=("extinction",),
    learns=_by_density,
    recalled=partial(_recalled, cubic=True),
    lasts=_by_density,
)
