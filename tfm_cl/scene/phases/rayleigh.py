"""Scattering by what is far smaller than the wavelength."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.scene.phases.base import Phase


class Rayleigh(Phase):
    """p(μ) = 3/(16π) (1 + μ²): molecules of air, of unpolarised light.

    Source: Lord Rayleigh, "On the light from the sky, its polarization and colour", Phil. Mag. 41 (1871).
    """

    HEADER: ClassVar[str] = "phase/rayleigh.h"

    type: Literal["rayleigh"] = "rayleigh"

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        density: NDArray[np.float64] = 3 / (16 * np.pi) * (1 + np.square(np.asarray(mu, dtype=np.float64)))
        return density
