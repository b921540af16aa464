"""Constant density in all of space."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.bodies.homogeneous import Homogeneous


class EverywhereVolume(Homogeneous):
    """All of space."""

    KIND: ClassVar[int] = 3
    HEADER: ClassVar[str] = "body/everywhere.h"
    shape: Literal["everywhere"] = "everywhere"

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Infinite."""
        return np.array([[-np.inf] * 3, [np.inf] * 3])

    @property
    def content(self) -> float:
        """Infinite."""
        return np.inf

    def kernel_shape(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Nothing: it has no middle and no size."""
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """All of them."""
        return np.ones(points.shape[:-1], np.bool_)
