"""Scattering by water droplets, of fog and clouds."""

from math import exp
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.scene.phases.base import Phase
from tfm_cl.scene.phases.draine import draine
from tfm_cl.scene.phases.henyey_greenstein import lobe


class Fit(NamedTuple):
    """What a droplet's phase function is put together from."""

    g_hg: float
    g_draine: float
    alpha: float
    weight: float
    """Share of Draine's."""


class Mie(Phase):
    """p(μ) = (1 - w) HG(g_hg, μ) + w Draine(g_d, α, μ), with all four fitted to droplets of a diameter.

    They are fits to Mie theory for fog and clouds of droplets about that size, without bows and glory.

    Source: J. Jendersie, E. d'Eon, "An Approximate Mie Scattering Function for Fog and Cloud Rendering",
    SIGGRAPH Talks 2023, eq. 4 to 7, for 5 µm ≤ d ≤ 50 µm.
    """

    HEADER: ClassVar[str] = "phase/mie.h"
    TAKES: ClassVar[str] = "the droplets' diameter in micrometres, as in mie:20"

    type: Literal["mie"] = "mie"
    diameter: float = Field(default=20.0, ge=5, le=50, description="of the droplets, µm: 5 to 50")

    def fit(self) -> Fit:
        """Return the fit for the diameter."""
        d = self.diameter
        return Fit(
            g_hg=exp(-0.0990567 / (d - 1.67154)),
            g_draine=exp(-2.20679 / (d + 3.91029) - 0.428934),
            alpha=exp(3.62489 - 8.29288 / (d + 5.52825)),
            weight=exp(-0.599085 / (d - 0.641583) - 0.665888),
        )

    def kernel_parameters(self) -> tuple[float, ...]:
        """(g_hg, g_d, α, w)."""
        return self.fit()

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        fit = self.fit()
        return (1 - fit.weight) * lobe(fit.g_hg, mu) + fit.weight * draine(fit.g_draine, fit.alpha, mu)
