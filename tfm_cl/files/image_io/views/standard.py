"""No curve: light is shown as it is and clipped at the display's white, so that pictures can be measured."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

NAME = "standard"
SUMMARY = "only a clip, for measurements"


def display(rgb: Floats) -> Floats:
    """Clip linear colours [3, n]."""
    return np.minimum(rgb, 1)
