"""Two lobes, of which one scatters forwards and one backwards."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.scene.phases.base import Phase
from tfm_cl.scene.phases.henyey_greenstein import lobe


class DoubleHenyeyGreenstein(Phase):
    """p(μ) = w HG(g1, μ) + (1 - w) HG(g2, μ); its mean cosine is w g1 + (1 - w) g2.

    By default four fifths go into a narrow lobe forwards and one fifth into a wide one backwards: clouds with
    a bright rim against the light, which are not dark with the light behind the camera; the mean is 0.62.

    Source: G. W. Kattawar, "A three-parameter analytic phase function for multiple scattering calculations",
    JQSRT 15 (1975).
    """

    HEADER: ClassVar[str] = "phase/double_henyey_greenstein.h"
    TAKES: ClassVar[str] = (
        "the mean cosines of two lobes and the share of the first, as in double-hg:0.85:-0.3:0.8"
    )

    type: Literal["double-hg"] = "double-hg"
    g1: float = Field(default=0.85, gt=-1, lt=1, description="mean cosine of the first lobe")
    g2: float = Field(default=-0.3, gt=-1, lt=1, description="mean cosine of the second lobe")
    weight: float = Field(default=0.8, ge=0, le=1, description="w: share of the first lobe")

    def kernel_parameters(self) -> tuple[float, ...]:
        """(g1, g2, w)."""
        return self.g1, self.g2, self.weight

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        return self.weight * lobe(self.g1, mu) + (1 - self.weight) * lobe(self.g2, mu)
