"""What kernels are told of a transmittance function map: of one light and one field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.base import Field, Struct
from tfm_cl.maps.bases.base import UNIFORM_SHARE

MAP = Struct(
    "Map",
    "A transmittance function map, of one light and one field.",
    (
        Field("int", "res", 1, "texels along each side"),
        Field("int", "steps", 1, "steps along a light ray"),
        Field("float", "density_weighting", 1, "alpha of eq. 19"),
        Field("float", "inverse_weighting", 1, "1 / alpha"),
        Field("float", "reference_extinction", 1, "extinction at density 1 that visibility is meant for"),
        Field("float", "number_unit", 1, "optical depth or extinction that a stored 1 stands for"),
        Field("float", "uniform_share", 1, "of the uniform weight in the visibility-weighted fit"),
        Field("int", "range_res", 1, "entries along each side of the ranges of its rays"),
        Field("float", "longest_range_inverse", 1, "1 / longest of them, world"),
        Field("int", "first_number", 1, "where its coefficients begin, in units of NUMBERS_UNIT"),
        Field("int", "first_limit", 1, "where their limits begin, for 8 bits"),
        Field("int", "first_range", 1, "where its ranges begin"),
        Field("int", "first_mode", 1, "where what its basis evaluates begins"),
    ),
)


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
