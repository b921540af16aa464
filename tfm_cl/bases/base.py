"""What a basis is to the rest of the project."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Basis:
    """A way to keep the transmittance along a light ray in a few numbers."""

    name: str
    """Name in scene files and on the command line."""
    header: str
    """Kernel header, below ``kernels/``, with the functions that ``kernels/basis/README.md`` names."""
    summary: str
    """One line for ``--help``."""
    table: Callable[[int, int], NDArray[np.float32]]
    """``table(steps, coeffs)``: what the kernel header needs for every step of the light march."""
    max_coeffs: int = 32
