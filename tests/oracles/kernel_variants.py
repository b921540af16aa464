"""Every program that is built from the kernels, in enough variants to meet each choice beside each other.

A new kernel file is a line of ``PROGRAMS``, a new macro a line above it. Bases, lights and phase functions
come from their registries.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import PurePath

from tfm_cl.bases import BASES
from tfm_cl.lights import LIGHTS
from tfm_cl.phases import PHASES

Choices = Mapping[str, Sequence[int | str]]
"""Macros and their values, or kinds of header and the headers."""

RECORDS: Choices = {"TFM_VOXEL_BITS": (32, 16, 8)}
VOLUME: Choices = {**RECORDS, "TFM_POOLS": (1, 8)}
MAP: Choices = {
    "basis": [basis.header for basis in BASES.values()],
    "light": [light.HEADER for light in LIGHTS.values()],
    "TFM_STORAGE_BITS": (32, 16, 8),
    "TFM_N_COEFF": (1, 4, 8, 32),
    "TFM_INVERSE_SQUARE": (0, 1),
}
VIEW: Choices = {
    "phase": [phase.HEADER for phase in PHASES.values()],
    "TFM_METHOD_DUAL": (0, 1),
    "TFM_CHANNELS": (1, 3),
}

PROGRAMS: dict[str, Choices] = {
    "bricks.cl": {**RECORDS, "TFM_POOLS": (1,)},
    "light_pass.cl": {**VOLUME, **MAP},
    "view_pass.cl": {**VOLUME, **MAP, **VIEW},
}
"""Entry -> what it is compiled with."""

Variant = tuple[str, str, tuple[str, ...], dict[str, int]]
"""A label, and the arguments of `tfm_cl.program.source`: entry, headers and defines."""


def kernel_variants(lanes: int) -> Iterator[Variant]:
    """Yield the programs for devices that march so many rays a work-item (1 on GPUs)."""
    for entry, choices in PROGRAMS.items():
        for case in pairwise(choices):
            label = " ".join([entry, *(_short(name, value) for name, value in case.items())])
            headers = tuple(value for value in case.values() if isinstance(value, str))
            defines = {name: value for name, value in case.items() if isinstance(value, int)}
            yield label, entry, headers, {"TFM_LANES": lanes, **defines}


def pairwise(choices: Choices) -> list[dict[str, int | str]]:
    """Choose one of each so that any two choices meet in some case: far fewer cases than the product."""
    everything = list(product(*choices.values()))
    missing = set().union(*map(_pairs, everything))
    cases = []
    while missing:
        cases.append(max(everything, key=lambda case: len(missing & _pairs(case))))
        missing -= _pairs(cases[-1])
    return [dict(zip(choices, case, strict=True)) for case in cases]


def _short(name: str, value: int | str) -> str:
    if isinstance(value, str):
        return PurePath(value).stem
    return f"{name.removeprefix('TFM_').lower()}={value}"


def _pairs(case: tuple[int | str, ...]) -> set[tuple[tuple[int, int | str], ...]]:
    """Every two choices of a case; of a lone one the choice itself."""
    return set(combinations(enumerate(case), min(2, len(case))))
