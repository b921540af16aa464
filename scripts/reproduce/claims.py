"""Claims of the papers, their criteria, and verdicts, which follow from measurements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from reproduce.lab import STAND_INS

# If a paper gives a number, that is the bound; if it gives a word, this is our reading of it.
INDISTINGUISHABLE = 0.99
"""Smallest SSIM that counts as 'almost indistinguishable': the least in TFM's table 1 with 8 coefficients is
0.9903."""
PLAUSIBLE = 0.9868
"""Smallest SSIM that counts as 'plausible': that of the worse of the paper's pictures with 2 coefficients."""
DRASTIC = 2.0
"""Factor by which the error falls if it is 'drastically reduced'."""
STEADY = 0.8
"""Smallest ratio of the frame rates with 16 and with 2 coefficients: the worse of the paper's two volumes has
0.81."""
COINCIDES = 0.02
"""Largest difference, as a fraction of full transmittance, at which two curves in a plot of a few hundred
pixels 'coincide almost exactly'."""
NEGLIGIBLE = 0.01
"""Largest change due to an outlier, and largest overshoot that is not ringing, as a fraction of full
transmittance."""
SAME_SIZE = 1.25
"""Largest ratio of two critical sizes, or of two costs, that are 'the same' or 'comparable'."""
MAP_PRICE = 1.5
"""Largest ratio of costs in 'at a disadvantage by as much as 1.5x'."""
FOURFOLD = (1.8, 5.0)
"""Factors of cost for four times the texels that are 'approximately proportional': the paper's own tables
have 1.9 to 4.0."""
LINEAR = 0.99
"""Smallest R² of a relation that is 'linear'."""


@dataclass(frozen=True)
class Case:
    """A claim under one condition."""

    where: str
    measured: dict[str, float]
    holds: bool


@dataclass(frozen=True)
class Claim:
    """A claim of a paper, and the measurements."""

    text: str
    paper: str
    """The paper's number or wording."""
    cases: tuple[Case, ...]

    @property
    def verdict(self) -> str:
        """``holds``, ``holds when …`` or ``does not hold``."""
        kept = [case.where for case in self.cases if case.holds]
        broken = [case.where for case in self.cases if not case.holds]
        if not kept:
            return "does not hold"
        if not broken:
            return "holds"
        return (
            f"holds when {'; '.join(kept)}"
            if len(kept) <= len(broken)
            else f"holds when not {'; '.join(broken)}"
        )

    @property
    def changed(self) -> str:
        """Where particles and hair say otherwise than the voxels that stood for them; may be empty."""
        outcomes = {case.where: case.holds for case in self.cases}
        pairs = (
            (case, case.where.replace(real, voxels, 1))
            for case in self.cases
            for real, voxels in STAND_INS.items()
            if case.where.startswith(real)
        )
        return "; ".join(case.where for case, other in pairs if outcomes.get(other, case.holds) != case.holds)

    @property
    def measured(self) -> str:
        """The measured values, in words."""
        return "; ".join(
            " ".join([f"{case.where}:" if case.where else "", ", ".join(_named(case.measured))]).strip()
            for case in self.cases
        )


def _named(values: dict[str, float]) -> Iterable[str]:
    return (f"{name} {shown(value)}".strip() for name, value in values.items())


def at_least(where: str, value: float, bound: float, what: str = "") -> Case:
    """Make a case that holds if a number is at least a bound."""
    return Case(where, {what: value}, value >= bound)


def at_most(where: str, value: float, bound: float, what: str = "") -> Case:
    """Make a case that holds if a number is at most a bound."""
    return Case(where, {what: value}, value <= bound)


def smaller(where: str, **values: float) -> Case:
    """Make a case that holds if the first of two numbers is smaller than the second."""
    first, second = values.values()
    return Case(where, {name.replace("_", " "): value for name, value in values.items()}, first < second)


@dataclass(frozen=True)
class Study:
    """A reproduced figure or table of a paper."""

    title: str
    how: str
    """The differences from the paper's setup."""
    claims: list[Claim]
    rows: list[list[str]]
    """Rows of a table, the header first."""
    figure: Figure | None = None


def shown(value: float) -> str:
    """Format a number with three significant digits; near 1, those of the difference from 1."""
    if not np.isfinite(value):
        return str(value)
    if 0.9 <= value < 1:  # noqa: PLR2004 - the range of SSIM and R²
        return f"{value:.4f}"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"  # noqa: PLR2004 - not 1e+03
