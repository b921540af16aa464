"""The phase function of Henyey and Greenstein (1941)."""

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.scene.phases.base import Phase


class HenyeyGreenstein(Phase):
    """p(μ) = (1 - g²) / (4π (1 + g² - 2 g μ)^{3/2}); g is the mean cosine.

    Source: L. G. Henyey, J. L. Greenstein, "Diffuse radiation in the galaxy", ApJ 93 (1941).
    """

    HEADER: ClassVar[str] = "phase/henyey_greenstein.h"
    TAKES: ClassVar[str] = "its mean cosine, as in hg:0.3"

    type: Literal["hg"] = "hg"
    g: float = Field(
        default=0.0,
        gt=-1,
        lt=1,
        description="mean cosine: > 0 scatters forwards, < 0 backwards, 0 is isotropic",
    )

    def __init__(self, /, g: float = 0.0, **values: Any) -> None:
        super().__init__(**{"g": g, **values})

    def kernel_parameters(self) -> tuple[float, ...]:
        """(g,)."""
        return (self.g,)

    @property
    def mean_cosine(self) -> float:
        """It is g."""
        return self.g

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        return lobe(self.g, mu)


def lobe(g: float, mu: ArrayLike) -> NDArray[np.float64]:
    """p(μ) of mean cosine g, in double precision; several phase functions are made of such lobes."""
    size, peak = abs(g), np.copysign(1.0, g)
    # 1 + g² - 2 g μ, written so as to avoid cancellation at the peak.
    base = (1 - size) ** 2 + 2 * size * np.maximum(1 - peak * np.asarray(mu, dtype=np.float64), 0)
    density: NDArray[np.float64] = (1 - size) * (1 + size) / (4 * np.pi * base**1.5)
    return density
