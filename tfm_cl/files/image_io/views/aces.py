"""The look of ACES 1: Stephen Hill's fit of its reference rendering and sRGB output transforms.

Source: ``ACES.hlsl`` of Matt Pettineo's and David Neubelt's BakingLab
(https://github.com/TheRealMJP/BakingLab, MIT licence). OpenColorIO's ACES 1.3 shows greys from 0.04 to 16 and
moderate colours within 0.02 of the same codes (of 1); it has views neither for `filmic` nor for `agx`, so the
closed form is used with it installed or not.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

NAME = "aces"
SUMMARY = "ACES 1 (Hill's fit), contrasty"

_AP1_FROM_709 = np.array(  # with the transforms' desaturation
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_709_FROM_AP1 = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
# The published rows sum to 1 within 0.00001; greys stay grey if they do exactly.
_AP1_FROM_709 /= _AP1_FROM_709.sum(axis=1, keepdims=True)
_709_FROM_AP1 /= _709_FROM_AP1.sum(axis=1, keepdims=True)


def display(rgb: Floats) -> Floats:
    """Apply the view to linear colours [3, n]; greys below 0.003 are black."""
    x = _AP1_FROM_709 @ rgb
    curve = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    return np.clip(_709_FROM_AP1 @ curve, 0, 1)
