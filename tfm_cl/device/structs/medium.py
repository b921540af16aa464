"""What kernels are told of a medium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.base import Field, Struct
from tfm_cl.scene.phases import PHASES

if TYPE_CHECKING:
    from tfm_cl.scene.medium import Medium

MEDIUM = Struct(
    "Medium",
    "One of the media, at density 1.",
    (
        Field("float", "sigma_t", 3, "extinction, RGB, per world unit"),
        Field("float", "sigma_s", 3, "scattering, RGB, per world unit"),
        Field("float", "albedo", 3, "sigma_s / sigma_t, RGB; 0 where sigma_t is 0"),
        Field("int", "phase_kind", 1, "number of the kind of its phase function"),
        Field("float", "phase", 4, "parameters of that"),
    ),
)


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
    return structs
