"""How much light each octave of scattering adds, where that is left open: by how deep the medium is.

How bright all octaves but the first are together, on a camera ray of an optical depth of 1, follows from the
phase function and from how deep the whole medium is: the geometric mean of the optical depths of lines
through the volume, weighted by their opacity. The numbers below, and the defaults of `tfm_cl.scene.medium`,
make 31 pictures the most like those of 64 orders of scattering: of five volumes, of three densities, lit from
five sides, with mean cosines of 0, 0.5 and 0.85. Numbers for all but one of these volumes serve that one too.
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

AT_DEPTH_1, AHEAD = 0.52, 0.85
"""Brightness of what scatters evenly, at a mean depth of 1, and what takes from its logarithm, times g²."""
BY_DEPTH, BY_DEPTH_AHEAD = 0.16, 0.18
"""Power of the mean depth with which it grows, of what scatters evenly, and what a mean cosine of 1 adds."""
LEAST, MOST = 0.05, 1.5
TIMES_SCATTERED = 1.1
"""As often, at an optical depth of 1, was the light of the octaves scattered; it grows with its root."""
SHALLOWEST = 1e-9
"""Optical depth that counts as none."""
SHARED = "medium"
"""Section of the medium of bodies that have none of their own."""
ROUNDED = 1e-9
"""Imaginary part of a root that is real."""
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
    power = BY_DEPTH + BY_DEPTH_AHEAD * ahead
    white = AT_DEPTH_1 * np.exp(-AHEAD * ahead**2) * max(depth, SHALLOWEST) ** power
    # Light loses the albedo each time that it is scattered: more often in what is deeper.
    left = float(medium.albedo.mean()) ** (TIMES_SCATTERED * float(np.sqrt(depth)))
    return _over_the_one_before(left * float(np.clip(white, LEAST, MOST)), medium.octaves)


def _over_the_one_before(brightness: float, octaves: int) -> float:
    """Return the contribution with which all octaves but the first add up to a brightness; 1 at most."""
    coefficients = [*np.ones(octaves - 1), -brightness]
    roots = np.roots(coefficients)
    positive = roots[(np.abs(roots.imag) < ROUNDED) & (roots.real >= 0)].real
    return float(f"{min(positive.max(initial=0.0), 1.0):.3g}")


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
