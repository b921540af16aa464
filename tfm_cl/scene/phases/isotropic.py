"""The isotropic phase function: p = 1/4π."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.scene.phases.base import Phase


class Isotropic(Phase):
    """Scatters equally in all directions, p = 1/4π."""

    HEADER: ClassVar[str] = "phase/isotropic.h"

    type: Literal["isotropic"] = "isotropic"

    @property
    def mean_cosine(self) -> float:
        """0."""
        return 0.0

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """1/4π for every μ."""
        return np.full(np.shape(mu), 1.0 / (4.0 * np.pi))
