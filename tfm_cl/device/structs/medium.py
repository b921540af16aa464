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
    """Return the structs, [media], and then as many as hold the numbers of their phase functions' tables."""
    tables = [medium.phase.kernel_table() for medium in media]
    numbers = np.concatenate([table for table in tables if table is not None] or [np.zeros(0, np.float32)])
    width = MEDIUM.dtype.itemsize // numbers.itemsize
    structs = np.zeros(len(media) + -(-len(numbers) // width), MEDIUM.dtype)
    structs[len(media) :].view(np.float32)[: len(numbers)] = numbers
    kinds, begin = list(PHASES), len(media) * width
    for i, (struct, medium, table) in enumerate(zip(structs, media, tables, strict=False)):
        sigma_t = medium.sigma_t
        struct["sigma_t"] = sigma_t
        struct["sigma_s"] = medium.sigma_s
        struct["albedo"] = medium.albedo
        struct["phase_kind"] = kinds.index(medium.phase.type)
        phase = medium.phase.kernel_parameters()
        struct["phase"][: len(phase)] = phase
        for name, values in zip(("depth", "share", "cosine"), medium.octave_terms, strict=True):
            struct[f"octave_{name}"][: len(values)] = values
        if table is not None:
            struct["phase_table"] = begin - i * width
            begin += len(table)
        struct["emission"] = medium.emission
    return structs
