"""Every program that is built from the kernels, in enough variants to meet each choice beside each other.

A new kernel file is a line of ``PROGRAMS``, a new macro a line above it. Bases, lights and phase functions
come from their registries.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import PurePath

from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import FITS, TARGETS
from tfm_cl.maps.resolved import resolve
from tfm_cl.scene.lights import LIGHTS
from tfm_cl.scene.lights.charts import Hemisphere, Octahedron, Perspective
from tfm_cl.scene.phases import PHASES
from tfm_cl.scene.settings import MapSettings

Value = int | str | tuple[str, dict[str, int]]
Choices = Mapping[str, Sequence[Value]]
"""Macros and their values, or kinds of header and the headers; a header may bring macros of its own."""

SETTINGS = [
    *(MapSettings(basis=name) for name in BASES),
    MapSettings(basis="dct", coeffs=1, target="optical-depth", fit="visibility"),
    MapSettings(basis="hcos", coeffs=16, fit="visibility"),
    MapSettings(basis="klt", coeffs=15, target="transmittance", fit="l2"),
]
"""Every basis by itself, and the kinds of target and fit."""


def _basis(settings: MapSettings) -> tuple[str, dict[str, int]]:
    resolved = resolve(settings)
    return BASES[resolved.basis].header, {
        "TFM_N_COEFF": resolved.coeffs,
        "TFM_TARGET": TARGETS[resolved.target],
        "TFM_FIT": FITS[resolved.fit],
    }


RECORDS: Choices = {"TFM_VOXEL_BITS": (32, 16, 8)}
VOLUME: Choices = {**RECORDS, "TFM_POOLS": (1, 8), "TFM_VOLUMES": (1, 3)}
LIGHT: Choices = {
    # A sun has none of its own, and takes no notice of one.
    "chart": [chart.HEADER for chart in (Perspective, Hemisphere, Octahedron)],
    "light": list(dict.fromkeys(light.HEADER for light in LIGHTS.values())),
    "TFM_INVERSE_SQUARE": (0, 1),
}
MAP: Choices = {
    "basis": [_basis(settings) for settings in SETTINGS],
    **LIGHT,
    "TFM_STORAGE_BITS": (32, 16, 8),
    "TFM_RANGE": (0, 1),
    "TFM_LOOKUP": (0, 1, 2),
}
"""Every map."""
VIEW: Choices = {
    # The kinds of evaluation; the light pass's program evaluates every basis.
    "basis": [_basis(MapSettings(basis=name)) for name in ("dct", "klt", "slices", "moments", "nodes")],
    "phase": [phase.HEADER for phase in PHASES.values()],
    "TFM_METHOD_DUAL": (0, 1),
    "TFM_CHANNELS": (1, 3),
    "TFM_SHADOW": (0, 1, 2),
    "TFM_TEXTURE": (0, 1),
}

PROGRAMS: dict[str, Choices] = {
    "ambient_pass.cl": {"TFM_SHADOW": (0, 1)},
    "bricks.cl": {**RECORDS, "TFM_POOLS": (1,), "TFM_VOLUMES": (1,)},
    "fog_pass.cl": {
        **LIGHT,
        "phase": VIEW["phase"],
        "TFM_MEDIUM": (1, 2, 3),
        "TFM_CHANNELS": (1, 3),
        "TFM_SHADOW": (0, 1, 2),
        "TFM_TEXTURE": (0, 1),
    },
    "light_pass.cl": {**VOLUME, **MAP, "TFM_SHADOW": (0, 1)},
    "light_probe.cl": {**VOLUME, **LIGHT, "TFM_SHADOW": (0, 1)},
    "prefilter.cl": {"TFM_GROUP": (1, 8, 64)},
    "solid_pass.cl": {**VOLUME, **MAP, **VIEW},
    "view_pass.cl": {**VOLUME, **MAP, **VIEW},
}
"""Entry -> what it is compiled with."""

Variant = tuple[str, str, tuple[str, ...], dict[str, int]]
"""A label, and the arguments of `tfm_cl.device.program.source`: entry, headers and defines."""


def kernel_variants(lanes: int) -> Iterator[Variant]:
    """Yield the programs for devices that march so many rays a work-item (1 on GPUs)."""
    for entry, choices in PROGRAMS.items():
        for case in pairwise(choices):
            label = " ".join([entry, *(_short(name, value) for name, value in case.items())])
            headers, defines = [], {}
            for name, value in case.items():
                if isinstance(value, int):
                    defines[name] = value
                elif isinstance(value, str):
                    headers.append(value)
                else:
                    headers.append(value[0])
                    defines |= value[1]
            yield label, entry, tuple(headers), {"TFM_LANES": lanes, **defines}


def pairwise(choices: Choices) -> list[dict[str, Value]]:
    """Choose one of each so that any two choices meet in some case: far fewer cases than the product."""
    sizes = [len(values) for values in choices.values()]
    missing = {
        ((one, i), (other, j))
        for one, other in combinations(range(len(sizes)), 2)
        for i, j in product(range(sizes[one]), range(sizes[other]))
    }
    if len(sizes) == 1:
        return [{name: value} for name, values in choices.items() for value in values]
    cases = []
    while missing:
        case = dict(min(missing))  # a pair that is not met yet, then of each the choice that meets most
        for place in range(len(sizes)):
            if place not in case:
                met = [
                    sum(tuple(sorted([(place, i), chosen])) in missing for chosen in case.items())
                    for i in range(sizes[place])
                ]
                case[place] = met.index(max(met))
        missing -= set(combinations(sorted(case.items()), 2))
        cases.append({name: values[case[place]] for place, (name, values) in enumerate(choices.items())})
    return cases


def _short(name: str, value: Value) -> str:
    if isinstance(value, tuple):
        return " ".join([PurePath(value[0]).stem, *(str(number) for number in value[1].values())])
    if isinstance(value, str):
        return PurePath(value).stem
    return f"{name.removeprefix('TFM_').lower()}={value}"
