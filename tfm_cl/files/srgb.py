"""The sRGB transfer function (IEC 61966-2-1)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_TEXELS = 1 << 26
"""Largest number of texels of an image that is decoded: 8192 × 8192."""


def linear_from_srgb(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert the sRGB transfer function."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)  # noqa: PLR2004


def srgb_from_linear(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply the sRGB transfer function to values ≥ 0."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)  # noqa: PLR2004


def decoded(picture: Any) -> NDArray[np.float32]:
    """Decode a picture that Pillow has opened: sRGB to linear, [height, width, RGB], 0 to 1.

    Raises
    ------
    ValueError
        It is too large.
    OSError, SyntaxError, …
        Whatever Pillow raises for damaged files.
    """
    width, height = picture.size
    if width * height > MAX_TEXELS:
        raise ValueError(f"an image of {width}×{height} texels; the limit is {MAX_TEXELS:,}")
    if picture.mode.startswith("I"):  # 16 bits of grey, which Pillow would clip
        grey = linear_from_srgb(np.clip(np.asarray(picture, np.float64) / 65535, 0, 1))
        return np.repeat(grey[..., None], 3, axis=2).astype(np.float32)
    table = linear_from_srgb(np.arange(256) / 255)
    linear: NDArray[np.float32] = table.astype(np.float32)[np.asarray(picture.convert("RGB"))]
    return linear
