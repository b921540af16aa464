"""The numbers of the clear sky's model, which come with the package.

Hosek and Wilkie's dataset for linear Rec. 709, as in Mitsuba 3, under the licence in
``hosek_wilkie.LICENSE``; ``scripts/sky_data.py`` writes the file.
"""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FILE = Path(__file__).with_suffix(".npz")


class Dataset(NamedTuple):
    """Control points by turbidity, 1 to 10."""

    shape: Floats
    """[10, 2 albedos (0 and 1), 6 elevations, RGB, 9], parameters of the sky's distribution."""
    radiance: Floats
    """[10, 2, 6, RGB], mean radiance of the sky, W / (m² sr nm)."""
    sun: Floats
    """[10, 45 pieces of the elevation, RGB, 4], polynomials of the sun's irradiance, W / (m² nm)."""


@lru_cache(maxsize=1)
def dataset() -> Dataset:
    """Read the numbers, which are kept."""
    with np.load(FILE, allow_pickle=False) as arrays:
        return Dataset(*(arrays[name].astype(np.float64) for name in Dataset._fields))
