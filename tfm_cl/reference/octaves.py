"""Octaves of scattering but the first: `tfm_cl.scene.medium.Medium.octave_terms`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.constants import OCTAVE_GROWTH
from tfm_cl.scene.phases.henyey_greenstein import HenyeyGreenstein

if TYPE_CHECKING:
    from tfm_cl.reference.geometry import Floats
    from tfm_cl.scene.medium import Medium


def later_octaves(medium: Medium, mu: Floats, transmittance: Floats, ray_depth: Floats | float) -> Floats:
    """Phase function times transmittance ``[n, RGB]`` of all octaves but the first; ``mu`` ``[n, 1]``."""
    octaves = [
        share * HenyeyGreenstein(cosine).evaluate(mu) * transmittance**depth
        for depth, share, cosine in medium.octave_terms.T[1:]
    ]
    found: Floats = np.asarray(ray_depth) ** OCTAVE_GROWTH * sum(octaves, np.zeros_like(transmittance))
    return found
