"""A plugin of one file: Schlick's phase function."""

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

import tfm_cl as tfm


class Schlick(tfm.Phase):
    """p(μ) = (1 - k²) / (4π (1 - k μ)²): nearly Henyey and Greenstein's, without a square root.

    Source: Blasi, Le Saëc and Schlick, "A Rendering Algorithm for Discrete Volume Density Objects", 1993.
    """

    HEADER: ClassVar[str] = str(Path(__file__).with_name("schlick.h"))
    TAKES: ClassVar[str] = "its parameter, as in schlick:0.5"

    type: Literal["schlick"] = "schlick"
    k: float = Field(0.5, gt=-1, lt=1, description="> 0 scatters forwards, < 0 backwards")

    def kernel_parameters(self) -> tuple[float, ...]:
        """(k,), which the kernel finds in ``medium->phase``."""
        return (self.k,)

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        values: NDArray[np.float64] = (1 - self.k**2) / (4 * np.pi * (1 - self.k * np.asarray(mu)) ** 2)
        return values


tfm.register_phase(Schlick)
