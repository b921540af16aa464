"""Looking images up between their texels."""

import numpy as np
from numpy.typing import NDArray


def look_up(image: NDArray[np.floating], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate [height, width, n] bilinearly at u, v [points, 2]: v = 1 is the top, clamped at the edges.

    ``kernels/core/texture.h`` in float64.
    """
    height, width = image.shape[:2]
    x = np.clip(positions[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - positions[:, 1]) * height - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    upper = (1 - fx) * image[top, left] + fx * image[top, right]
    lower = (1 - fx) * image[below, left] + fx * image[below, right]
    mixed: NDArray[np.float64] = (1 - fy) * upper + fy * lower
    return mixed
