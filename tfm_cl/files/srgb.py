"""The sRGB transfer function (IEC 61966-2-1)."""

import numpy as np
from numpy.typing import NDArray


def linear_from_srgb(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert the sRGB transfer function."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)  # noqa: PLR2004


def srgb_from_linear(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply the sRGB transfer function to values ≥ 0."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)  # noqa: PLR2004
