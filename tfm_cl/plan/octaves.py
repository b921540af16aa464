"""How much light each octave of scattering adds, where that is left open: by how deep the medium is.

Octaves are a look, whose brightness is right for one optical depth only: light is scattered again as often as
the medium is deep. The contribution with which 4 octaves are as bright as 80 orders of scattering follows, in
three volumes of three densities each (`README.md`), from one number: the geometric mean of the optical depths
of lines through the volume, weighted by their opacity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from tfm_cl.scene.bodies.base import MarchedBody

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

AT_DEPTH_1, AT_DEPTH_1_AHEAD = 0.33, -0.185
"""The contribution at an optical depth of 1: of what scatters evenly, and what a mean cosine of 1 adds."""
PER_E, PER_E_AHEAD = 0.165, 0.1
"""What a depth e times as large adds, likewise."""
LEAST, MOST = 0.05, 0.95
TIMES_SCATTERED = 1.1
"""Of one octave more, at an optical depth of 1; it grows with its root."""
SHALLOWEST = 1e-9
"""Optical depth that counts as none."""
SHARED = "medium"
"""Section of the medium of bodies that have none of their own."""
TINY = 1e-300
"""Least opacity, with which a mean has weights."""


class Contribution(NamedTuple):
    """Of the octaves of one medium, as decided."""

    section: str
    """Of the scene file that the medium stands in."""
    number: float
    why: str


def contributions(scene: Scene) -> list[Contribution]:
    """Decide what is left open."""
    sections, found = _sections(scene), []
    for section in dict.fromkeys(sections):
        bodies = [body for body, own in zip(scene.bodies, sections, strict=True) if own == section]
        medium = scene.medium_of(bodies[0])
        if medium.octaves > 1 and medium.contribution == "auto":
            depth = max(_depth(body, medium) for body in bodies)
            why = f"as bright as all orders, at an optical depth of {depth:.2g} in the mean"
            found.append(Contribution(section, _contribution(depth, medium), why))
    return found


def resolved(scene: Scene, decided: Sequence[Contribution]) -> Scene:
    """Return the scene with the numbers that were decided."""
    if not decided:
        return scene
    numbers = {one.section: one.number for one in decided}
    bodies = [
        body.with_medium(scene.medium_of(body).replace(contribution=numbers[section]))
        if section in numbers and body.own_medium is not None
        else body
        for body, section in zip(scene.bodies, _sections(scene), strict=True)
    ]
    medium = scene.medium
    if SHARED in numbers:
        medium = medium.replace(contribution=numbers[SHARED])
    return scene.replace(volume=bodies, medium=medium)


def _sections(scene: Scene) -> list[str]:
    """Where the medium of each body stands in a scene file."""
    several = len(scene.bodies) > 1
    return [
        SHARED if body.own_medium is None else f"volume{f'.{i}' if several else ''}.medium"
        for i, body in enumerate(scene.bodies)
    ]


def _contribution(depth: float, medium: Medium) -> float:
    ahead = max(medium.phase.mean_cosine, 0.0)
    at_1, per_e = AT_DEPTH_1 + AT_DEPTH_1_AHEAD * ahead, PER_E + PER_E_AHEAD * ahead
    white = at_1 + per_e * float(np.log(max(depth, SHALLOWEST)))
    scatters = np.divide(medium.sigma_s, medium.sigma_t, out=np.zeros(3), where=medium.sigma_t > 0)
    # Light loses the albedo each time that it is scattered: more often in what is deeper.
    left = float(scatters.mean()) ** (TIMES_SCATTERED * float(np.sqrt(depth)))
    return float(f"{left * float(np.clip(white, LEAST, MOST)):.2g}")


def _depth(body: Body, medium: Medium) -> float:
    """Geometric mean of the optical depths of lines through a body, weighted by their opacity."""
    extinction = float(medium.sigma_t.mean())
    if not isinstance(body, MarchedBody):  # of one density
        extent = np.ptp(body.occupied_bounds, axis=0)
        return float(body.largest_density.max()) * extinction * float(np.exp(np.log(extent).mean()))
    of_body = _DEPTHS.setdefault(body, {})
    if extinction not in of_body:
        of_body.clear()
        of_body[extinction] = _of_lines(body, extinction * getattr(body, "density_scale", 1.0))
    return of_body[extinction]


_DEPTHS: WeakKeyDictionary[MarchedBody, dict[float, float]] = WeakKeyDictionary()
"""What was found for an extinction: of a whole volume not in each frame."""


def _of_lines(body: MarchedBody, extinction: float) -> float:
    found = []
    for lines in body.line_depths():
        depths = lines * extinction
        depths = depths[depths > 0]  # none of a medium that only emits
        if depths.size:
            found.append(
                float(np.exp(np.average(np.log(depths), weights=np.maximum(-np.expm1(-depths), TINY))))
            )
    return float(np.mean(found)) if found else 0.0
