"""The phase function of Draine (2003), for dust."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.scene.phases.base import Phase
from tfm_cl.scene.phases.henyey_greenstein import lobe


class Draine(Phase):
    """p(μ) = HG(g, μ) (1 + α μ²) / (1 + α (1 + 2 g²)/3).

    α = 0 is Henyey and Greenstein's, α = 1 that of Cornette and Shanks (1992), and with g = 0 Rayleigh's. The
    mean cosine is g (1 + α (3 + 2 g²)/5) / (1 + α (1 + 2 g²)/3).

    Source: B. T. Draine, "Scattering by Interstellar Dust Grains. I. Optical and Ultraviolet", ApJ 598
    (2003).
    """

    HEADER: ClassVar[str] = "phase/draine.h"
    TAKES: ClassVar[str] = "g and alpha, as in draine:0.5:1"

    type: Literal["draine"] = "draine"
    g: float = Field(
        default=0.5, gt=-1, lt=1, description="mean cosine at alpha = 0: > 0 scatters forwards, < 0 backwards"
    )
    alpha: float = Field(
        default=1.0, ge=0, le=1e4, description="how much more goes along the light than aside"
    )

    def kernel_parameters(self) -> tuple[float, ...]:
        """(g, α)."""
        return self.g, self.alpha

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        return draine(self.g, self.alpha, mu)


def draine(g: float, alpha: float, mu: ArrayLike) -> NDArray[np.float64]:
    """p(μ), in double precision."""
    shape = 1 + alpha * np.square(np.asarray(mu, dtype=np.float64))
    return lobe(g, mu) * shape / (1 + alpha * (1 + 2 * g**2) / 3)
