"""Latitude-longitude images as the camera sees them: sharp where it looks closely, and never aliased."""

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.lights.base import Floats


def means(image: NDArray[np.float32], directions: Floats, width: Floats) -> Floats:
    """Mean of an image [height, width, RGB] around unit directions [n, 3]: [n, RGB].

    The image lies as `EnvironmentLight` says. A circle of directions is an ellipse along its rows and
    columns; the mean is that over the rectangle around it, from a table of sums (Crow, "Summed-Area Tables
    for Texture Mapping", SIGGRAPH 1984). The rectangle is at least a pixel wide and high; then it is what
    bilinear interpolation between pixels' centres gives.

    Parameters
    ----------
    width
        [n], > 0, angle in radians.
    """
    height, columns = image.shape[:2]
    up = np.clip(directions[:, 1], -1, 1)
    y = (0.5 - np.arcsin(up) / np.pi) * height
    x = (0.5 - np.arctan2(directions[:, 0], directions[:, 2]) / (2 * np.pi)) * columns
    tall = np.maximum(width / np.pi * height, 1)
    circle = 2 * np.pi * np.sqrt(np.maximum(1 - up**2, (width / (2 * np.pi)) ** 2))
    wide = np.clip(width / circle * columns, 1, columns)
    top, bottom = np.maximum(y - tall / 2, 0), np.minimum(y + tall / 2, height)
    first, last = int(top.min()), min(int(np.ceil(bottom.max())), height)
    sums = np.zeros((last - first + 1, columns + 1, 3))
    sums[1:, 1:] = image[first:last]
    np.cumsum(sums, axis=0, out=sums)
    np.cumsum(sums, axis=1, out=sums)
    left, right = x - wide / 2, x + wide / 2
    total = np.zeros((len(directions), 3))
    for edge, sign in ((bottom, 1.0), (top, -1.0)):
        total += sign * (_summed(sums, right, edge - first) - _summed(sums, left, edge - first))
    # Differences of large sums are rounded, and may be below 0 where the image is black.
    mean: Floats = np.maximum(total / ((bottom - top) * wide)[:, None], 0)
    return mean


def _summed(sums: Floats, x: Floats, y: Floats) -> Floats:
    """Integral [n, RGB] of the image from its top and left to x and y, which goes on to the sides."""
    rows, columns = sums.shape[0] - 1, sums.shape[1] - 1
    turns = np.floor(x / columns)
    left = np.minimum((x - turns * columns).astype(np.intp), columns - 1)
    above = np.minimum(y.astype(np.intp), rows - 1)
    fx, fy = (x - turns * columns - left)[:, None], (y - above)[:, None]
    upper, lower = ((1 - fx) * sums[row, left] + fx * sums[row, left + 1] for row in (above, above + 1))
    if turns.any():  # as few do
        upper += turns[:, None] * sums[above, -1]
        lower += turns[:, None] * sums[above + 1, -1]
    integral: Floats = (1 - fy) * upper + fy * lower
    return integral
