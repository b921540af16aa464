"""Numbers of octaves of scattering, where they are left open: by how deep the medium is.

How deep the whole medium is: the geometric mean of the optical depths of lines through the volume, weighted
by their opacity. How bright all octaves but the first are together, on a camera ray of an optical depth of 1,
and how even they are, follows from that and from the phase function, by powers of the depth. Deeper than
`AT_DEPTH` the powers are others: light that was scattered often is more even, so that a lobe leaves less of
it behind a cloud and more before it.

The numbers below make pictures the most like those of 64 orders of scattering: of three volumes of optical
depths of 3 to 40, lit from five sides, with mean cosines of 0, 0.5 and 0.85. They serve seven others, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from tfm_cl.scene.bodies.base import MarchedBody

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

AT_DEPTH = 5.0
"""Mean optical depth of which the numbers are these:"""
BRIGHTNESS, AHEAD, AHEAD_TWICE = 0.67, 0.29, -0.85
"""Of what scatters evenly, and what adds to its logarithm, times g and g²."""
ATTENUATION, ECCENTRICITY = 0.6, 0.7
DEEPEST = 17.0
"""Mean depth up to which media were compared: what is deeper is taken for as deep."""
TIMES_SCATTERED, TIMES_AHEAD = 0.77, 0.62
"""As often, for each optical depth, was the light of the octaves scattered besides once; and what adds to it,
times g: what goes ahead is scattered more often before it leaves."""
SPREAD = 2.0
"""Of how often that was, of which light some parts were scattered rarely, and others many times: the shape of
a gamma distribution."""
SHALLOWEST = 1e-9
"""Optical depth that counts as none."""
SHARED = "medium"
"""Section of the medium of bodies that have none of their own."""
ROUNDED = 1e-9
"""Imaginary part of a root that is real."""
TINY = 1e-300
"""Least opacity, with which a mean has weights."""


class Powers(NamedTuple):
    """Of the mean depth, over `AT_DEPTH`, that numbers change with."""

    brightness: float
    attenuation: float
    eccentricity: float


def _powers(depth: float, g: float) -> Powers:
    if depth < AT_DEPTH:
        return Powers(0.16 - 0.07 * g, 0.0, -0.15)
    return Powers(0.43 * g - 0.09, 0.9 * g - 0.45, -0.3)


class Decided(NamedTuple):
    """A number of the octaves of one medium."""

    section: str
    """Of the scene file that the medium stands in."""
    key: str
    number: float
    why: str


def numbers(scene: Scene) -> list[Decided]:
    """Decide what is left open."""
    sections, found = _sections(scene), []
    for section in dict.fromkeys(sections):
        bodies = [body for body, own in zip(scene.bodies, sections, strict=True) if own == section]
        medium = scene.medium_of(bodies[0])
        is_open = [key for key in KEYS if getattr(medium, key) == "auto"]
        if medium.octaves > 1 and is_open:
            depth = max(_depth(body, medium) for body in bodies)
            why = f"as bright as all orders, at an optical depth of {depth:.2g} in the mean"
            found += [Decided(section, key, KEYS[key](depth, medium), why) for key in is_open]
    return found


def resolved(scene: Scene, decided: Sequence[Decided]) -> Scene:
    """Return the scene with the numbers that were decided."""
    if not decided:
        return scene
    of: dict[str, dict[str, float]] = {}
    for one in decided:
        of.setdefault(one.section, {})[one.key] = one.number
    bodies = [
        body.with_medium(scene.medium_of(body).replace(**of[section]))
        if section in of and body.own_medium is not None
        else body
        for body, section in zip(scene.bodies, _sections(scene), strict=True)
    ]
    return scene.replace(volume=bodies, medium=scene.medium.replace(**of.get(SHARED, {})))


def _sections(scene: Scene) -> list[str]:
    """Where the medium of each body stands in a scene file."""
    several = len(scene.bodies) > 1
    return [
        SHARED if body.own_medium is None else f"volume{f'.{i}' if several else ''}.medium"
        for i, body in enumerate(scene.bodies)
    ]


def _ahead(medium: Medium) -> float:
    return max(medium.phase.mean_cosine, 0.0)


def _contribution(depth: float, medium: Medium) -> float:
    g = _ahead(medium)
    white = BRIGHTNESS * np.exp(AHEAD * g + AHEAD_TWICE * g**2)
    white *= _over_that(depth) ** _powers(depth, g).brightness
    return _over_the_one_before(_left(depth, medium) * float(white), medium.octaves)


def _left(depth: float, medium: Medium) -> float:
    """Return what absorption leaves: the mean of albedoⁿ, where light was scattered n times."""
    times = 1 + (TIMES_SCATTERED + TIMES_AHEAD * _ahead(medium)) * depth
    with np.errstate(divide="ignore"):  # an albedo of 0 leaves nothing
        lost = -np.log(medium.albedo.mean())
    return float((1 + times * lost / SPREAD) ** -SPREAD)


def _attenuation(depth: float, medium: Medium) -> float:
    return _rounded(ATTENUATION * _over_that(depth) ** _powers(depth, _ahead(medium)).attenuation)


def _eccentricity(depth: float, medium: Medium) -> float:
    return _rounded(ECCENTRICITY * _over_that(depth) ** _powers(depth, _ahead(medium)).eccentricity)


def _over_that(depth: float) -> float:
    return min(max(depth, SHALLOWEST), DEEPEST) / AT_DEPTH


KEYS: dict[str, Callable[[float, Medium], float]] = {
    "attenuation": _attenuation,
    "contribution": _contribution,
    "eccentricity": _eccentricity,
}
"""What follows from the depth of a medium, by key of its section."""


def _over_the_one_before(brightness: float, octaves: int) -> float:
    """Return the contribution with which all octaves but the first add up to a brightness; 1 at most."""
    coefficients = [*np.ones(octaves - 1), -brightness]
    roots = np.roots(coefficients)
    positive = roots[(np.abs(roots.imag) < ROUNDED) & (roots.real >= 0)].real
    return _rounded(positive.max(initial=0.0))


def _rounded(number: float) -> float:
    """Return a number that people may read, 1 at most."""
    return float(f"{min(number, 1.0):.3g}")


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
