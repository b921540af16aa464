"""John Hable's filmic curve, on each channel by itself ("Filmic Tonemapping Operators", 2010; GDC 2010).

It is the curve of Uncharted 2, with its published constants: a toe that darkens shadows, a straight part, and
a shoulder that ends at `WHITE`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

NAME = "filmic"
SUMMARY = "Hable's curve, with a toe and a shoulder"

BIAS = 2.0
"""The exposure that the constants were chosen with, a factor."""
WHITE = 11.2
"""What the curve shows as white, after `BIAS`."""
SHOULDER, LINEAR, ANGLE, TOE, NUMERATOR, DENOMINATOR = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30


def display(rgb: Floats) -> Floats:
    """Apply the curve to linear colours [3, n]."""
    return _curve(np.minimum(BIAS * rgb, WHITE)) / _curve(np.full((), WHITE))


def _curve(x: Floats) -> Floats:
    # Hable's quotient less E/F, on one denominator: exactly 0 at 0.
    straight = LINEAR * (ANGLE - NUMERATOR / DENOMINATOR)
    rising = x * (SHOULDER * (1 - NUMERATOR / DENOMINATOR) * x + straight)
    return rising / (x * (SHOULDER * x + LINEAR) + TOE * DENOMINATOR)
