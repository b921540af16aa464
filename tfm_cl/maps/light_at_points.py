"""What each light of a scene brings to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

EMISSION = "emission"
"""Name of what media emit, as a light."""


@dataclass(frozen=True, eq=False)
class LightAtPoints:
    """What each light of a scene brings to points."""

    names: tuple[str, ...]
    """Of the lights, as their layers are called; of what media emit, `EMISSION`."""
    transmittance: NDArray[np.float32]
    """[lights, ..., RGB], in [0, 1]: what media and solids leave of the light that would arrive without them.

    0 where none would. Of a light of several points it is their mean, by what each would bring.
    """
    irradiance: NDArray[np.float32]
    """[lights, ..., RGB]: what arrives, on a plane that faces each of the light's points; the same unit as a
    sun's ``intensity``. The sum over all directions, without later orders of scattering and ambient light:
    the fluence rate."""
