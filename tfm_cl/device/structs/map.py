"""What kernels are told of a transmittance function map: of one light and one field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.declared import MAP
from tfm_cl.maps.bases.base import UNIFORM_SHARE


def map_struct(
    *,
    res: int,
    steps: int,
    density_weighting: float,
    extinction: float,
    number_unit: float,
    ranges: NDArray[np.float32],
) -> NDArray[Any]:
    """Return the struct, a 0-d array, of a map whose data begin their buffers.

    Parameters
    ----------
    extinction
        At density 1, that visibility is meant for.
    ranges
        [size, size, 4]: begin, end, slope beyond and last density of its rays.
    """
    struct = np.zeros((), MAP.dtype)
    longest = float((ranges[..., 1] - ranges[..., 0]).max())
    struct["res"], struct["steps"] = res, steps
    struct["density_weighting"], struct["inverse_weighting"] = density_weighting, 1.0 / density_weighting
    struct["reference_extinction"], struct["number_unit"] = extinction, number_unit
    struct["uniform_share"] = UNIFORM_SHARE
    struct["range_res"] = len(ranges)
    struct["longest_range_inverse"] = 1 / longest if longest > 0 else 0.0
    return struct
