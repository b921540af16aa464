"""Troy Sobotka's AgX, base look, in Benjamin Wrensch's closed form.

Sources: https://github.com/sobotka/AgX; matrices and polynomial of Wrensch's "Minimal AgX Implementation"
(https://iolite-engine.com/blog_posts/minimal_agx_implementation, MIT licence). The polynomial is within 0.002
(root mean square) of Sobotka's curve. Bright colours lose their saturation on the way to white.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

NAME = "agx"
SUMMARY = "Sobotka's AgX, soft, bright colours turn white"

LOWEST, HIGHEST = -12.47393, 4.026069
"""Stops between which the curve is defined: of 0.18, 10 below to 6.5 above."""
POLYNOMIAL = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)
"""The curve from the place between those to a display's code, the highest power first."""
GAMMA = 2.2
"""Of that code."""

_INSET = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_OUTSET = np.array(
    [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ]
)
# The published rows sum to 1 within 0.0002; greys stay grey if they do exactly.
_INSET /= _INSET.sum(axis=1, keepdims=True)
_OUTSET /= _OUTSET.sum(axis=1, keepdims=True)


def display(rgb: Floats) -> Floats:
    """Apply the view to linear colours [3, n]."""
    stops = np.log2(np.clip(_INSET @ rgb, 2.0**LOWEST, 2.0**HIGHEST))
    place = (stops - LOWEST) / (HIGHEST - LOWEST)
    code = np.full_like(place, POLYNOMIAL[0])
    for coefficient in POLYNOMIAL[1:]:
        code = code * place + coefficient
    return np.clip(_OUTSET @ code, 0, 1) ** GAMMA
