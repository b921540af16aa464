"""What kernels are told of a medium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.declared import MEDIUM
from tfm_cl.scene.phases.base import PHASES

if TYPE_CHECKING:
    from tfm_cl.scene.medium import Medium


def medium_structs(media: Sequence[Medium]) -> NDArray[Any]:
    """Return the structs, [media]."""
    structs = np.zeros(len(media), MEDIUM.dtype)
    kinds = list(PHASES)
    for struct, medium in zip(structs, media, strict=True):
        sigma_t = medium.sigma_t
        struct["sigma_t"] = sigma_t
        struct["sigma_s"] = medium.sigma_s
        struct["albedo"] = np.divide(medium.sigma_s, sigma_t, out=np.zeros(3), where=sigma_t > 0)
        struct["phase_kind"] = kinds.index(medium.phase.type)
        phase = medium.phase.kernel_parameters()
        struct["phase"][: len(phase)] = phase
        for name, values in zip(("depth", "lobe", "even"), medium.octave_terms, strict=True):
            struct[f"octave_{name}"][: len(values)] = values
    return structs
