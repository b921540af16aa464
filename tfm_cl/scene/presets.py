"""Media by name, ``medium.preset``: one row each.

The numbers are those of visible light, R, G, B at about 610, 550 and 465 nm, for an extinction of 1 at
density 1: how dense a medium is, its grid and ``density_scale`` say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Preset:
    """What a medium is made of."""

    summary: str
    source: str
    """Of the numbers."""
    medium: dict[str, Any]
    """Keys of ``[medium]``."""
    optical_depth: float
    """That ``density_scale = "auto"`` gives typical lines of sight, where it shows both body and detail."""


def _of_albedo(*albedo: float) -> dict[str, list[float]]:
    return {"sigma_s": list(albedo), "sigma_a": [round(1 - part, 3) for part in albedo]}


PRESETS = {
    "cloud": Preset(
        "droplets of 20 µm, which absorb nothing",
        "effective radius of marine clouds, 9.6 µm: N. L. Miles, J. Verlinde, E. E. Clothiaux, J. Atmos. "
        "Sci. 57 (2000)",
        _of_albedo(1, 1, 1) | {"phase": {"type": "mie", "diameter": 20.0}},
        20.0,
    ),
    "smoke": Preset(
        "fresh smoke of burning plants, slightly bluish",
        "albedo at 440 to 870 nm of African savanna: O. Dubovik et al., J. Atmos. Sci. 59 (2002), table 1; "
        "0.85 at 550 nm: L. V. Leahy et al., Geophys. Res. Lett. 34 (2007)",
        _of_albedo(0.85, 0.86, 0.88) | {"phase": {"type": "hg", "g": 0.58}},
        7.0,
    ),
    "steam": Preset(
        "young droplets of 5 µm, which absorb nothing",
        "the smallest droplets of the fit of J. Jendersie, E. d'Eon, SIGGRAPH 2023 Talks",
        _of_albedo(1, 1, 1) | {"phase": {"type": "mie", "diameter": 5.0}},
        5.0,
    ),
    "dust": Preset(
        "mineral dust, which absorbs blue",
        "albedo and mean cosine at 440 to 870 nm of Arabian dust: O. Dubovik et al., J. Atmos. Sci. 59 "
        "(2002), table 1",
        _of_albedo(0.95, 0.94, 0.925) | {"phase": {"type": "hg", "g": 0.67}},
        5.0,
    ),
    "fog": Preset(
        "droplets of 10 µm, which absorb nothing",
        "droplets near the ground: I. Gultepe et al., Pure Appl. Geophys. 164 (2007)",
        _of_albedo(1, 1, 1) | {"phase": {"type": "mie", "diameter": 10.0}},
        3.0,
    ),
    "fire": Preset(
        "fresh soot, and a black body's glow where the grid 'temperature' is hot",
        "albedo of 0.2 to 0.3 at 550 nm: T. C. Bond, R. W. Bergstrom, Aerosol Sci. Technol. 40 (2006)",
        _of_albedo(0.25, 0.25, 0.25) | {"phase": {"type": "hg", "g": 0.3}, "temperature": "temperature"},
        4.0,
    ),
}
"""Name -> preset."""


def expanded(medium: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of ``[medium]`` with those of its preset that are not given themselves."""
    name = medium.get("preset")
    return {**PRESETS[name].medium, **medium} if isinstance(name, str) and name in PRESETS else medium
