"""A camera ray through all bodies, step by step.

Where a ray crosses the boxes of grids and primitives it takes the march's own number of steps; what lies
before and behind, in bodies of constant density alone, takes steps in proportion to its length. In each
step the density of grids is that at its middle; what primitives hold in it, and the way through homogeneous
bodies, are exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tfm_cl.reference.bodies import Matter, body_interval, channel_densities, march_bounds, optical_depths
from tfm_cl.reference.geometry import (
    Floats,
    Integers,
    Interval,
    Rays,
    hull,
    intersection,
    interval,
    overlap,
    warped,
)
from tfm_cl.reference.octaves import later_octaves
from tfm_cl.reference.primitives import meet
from tfm_cl.scene.bodies.everywhere import EverywhereVolume
from tfm_cl.scene.phases.base import Phase
from tfm_cl.scene.phases.kajiya_kay import KajiyaKay

LEAST_CUTOFF = 1e-7
"""Transmittance at which a camera ray ends that nothing else ends."""
FARTHEST = 1e15
"""World units: no camera ray in a medium without an end goes farther."""
ISOTROPIC_SINE = np.pi / 4 / np.sqrt(2 / 3)
"""Mean sine between a direction and all others, over its root mean square."""


class Crossing(NamedTuple):
    """Where camera rays cross bodies, up to solids."""

    boxes: Interval
    """From the first to the last of the boxes of grids and primitives."""
    inside: list[Interval]
    """Of each homogeneous body."""
    medium: Interval
    """From the first to the last of all bodies: what is marched."""

    def part(self, which: Integers) -> Crossing:
        """Take some of the rays."""

        def of(one: Interval) -> Interval:
            return one[0][which], one[1][which]

        return Crossing(of(self.boxes), [of(one) for one in self.inside], of(self.medium))


class Segment(NamedTuple):
    """A part of each ray with steps of its own."""

    begin: Floats
    end: Floats
    steps: Integers
    """``[rays]``: how many."""
    in_boxes: bool
    """Whether there may be grids and primitives in it."""


class Step(NamedTuple):
    """What some rays meet in one step."""

    rays: Integers
    """Which these are."""
    distance: Floats
    """``[n]``, of its middle."""
    mean: Floats
    """``[n, RGB]``: where its opacity is on the mean; the middle where grids may be, read there."""
    amounts: list[Floats]
    """Of each body, as in `Matter`: density times length, ``[n, 1]``, or ``[n, 3]`` of a coloured one."""
    depth: Floats
    """``[n, RGB]``: optical depth."""
    opacity: Floats
    """``[n, RGB]``: the part of the light at the camera that could come from here."""
    lit: Floats
    """``[n]``: where light is looked up for it; thin primitives count where they are crossed."""
    thin: Floats
    """``[n]``: the share of these in what it holds."""
    tangents: Floats
    """``[n, 3, 3]``: ∑ depth t tᵀ over the strands in it."""
    held: Interval
    """``[n]`` each: from where to where it holds anything; all of it where grids may be."""


def crossing_of(matter: Matter, rays: Rays, limit: Floats, cutoff: float) -> Crossing:
    """Find where rays, up to solids at ``limit``, cross bodies.

    A medium everywhere is marched from the camera until the colour that sees deepest has lost all but the
    cutoff in it; one that extinguishes nothing is not marched.
    """
    boxes = march_bounds(matter.marched, *rays, limit, matter.margin)
    inside = [body_interval(body, *rays, limit) for body in matter.homogeneous]
    endless = np.array([isinstance(body, EverywhereVolume) for body in matter.homogeneous], dtype=bool)
    extinction = matter.extinctions[endless].sum(axis=0)
    if (extinction > 0).any():
        visible = -math.log(max(cutoff, LEAST_CUTOFF)) / extinction[extinction > 0].min()
        end = np.minimum(limit, min(visible, FARTHEST))
        return Crossing(boxes, inside, interval(np.zeros(len(end)), end))
    bounded = [one for one, has_no_end in zip(inside, endless, strict=True) if not has_no_end]
    return Crossing(boxes, inside, hull(len(limit), [boxes, *bounded]))


def segments(crossing: Crossing, part: Interval, steps: int) -> list[Segment]:
    """Cut a part of rays at the ends of the boxes; without any on it, the first piece is all."""
    begin, end = part
    first, last = (np.clip(edge, begin, end) for edge in crossing.boxes)
    cut = last > first
    first, last = np.where(cut, first, end), np.where(cut, last, end)
    length = end - begin

    def beside(low: Floats, high: Floats) -> Segment:
        share = np.divide(high - low, length, out=np.zeros_like(length), where=length > 0)
        return Segment(low, high, np.ceil(steps * share).astype(np.intp), in_boxes=False)

    middle = Segment(first, last, np.where(last > first, steps, 0), in_boxes=True)
    return [beside(begin, first), middle, beside(last, end)]


def march(
    matter: Matter,
    rays: Rays,
    crossing: Crossing,
    parts: list[Segment],
    through: Floats,
    projective_depth: Callable[[Floats], Floats] | None = None,
    max_stretch: float = 1.0,
) -> Iterator[Step]:
    """Yield the steps in all segments, one after the other.

    Parameters
    ----------
    matter, rays, crossing, parts
        As of `crossing_of` and `segments`, of the same rays.
    through
        ``[rays, RGB]``, transmittance so far; each step changes it.
    projective_depth, max_stretch
        Of a light, at points, when steps are uniform in its projective space between the ends of each
        segment, see `warped`.
    """
    met = [meet(body, rays) for body in matter.primitives]
    for begin, end, counts, in_boxes in parts:
        w = None
        if projective_depth is not None:
            w = projective_depth(rays.at(begin)), projective_depth(rays.at(end))
        for n in range(counts.max(initial=0)):
            which = np.flatnonzero(n < counts)
            t0, t, t1 = (
                warped(
                    begin[which],
                    end[which],
                    at / counts[which],
                    w and (w[0][which], w[1][which]),
                    max_stretch,
                )
                for at in (n, n + 0.5, n + 1)
            )
            points, length = rays.part(which).at(t), (t1 - t0)[:, None]
            amounts = [
                channel_densities(grid, points) * length if in_boxes else np.zeros_like(length)
                for grid in matter.grids
            ]
            ends = np.zeros((2, len(through)))
            ends[:, which] = t0, t1
            amounts += [one.between(*ends)[which] for one in met]
            tangents = sum((one.tangents(*ends)[which] for one in met), np.zeros((len(which), 3, 3)))
            inside = [(low[which], high[which]) for low, high in crossing.inside]
            for body, one in zip(matter.homogeneous, inside, strict=True):
                amounts.append(body.density * overlap(one, t0, t1)[:, None])
            held = (t0, t1) if in_boxes else hull(len(which), [intersection(one, (t0, t1)) for one in inside])
            lit, thin = _lit_place(t, amounts, [one.thin(*ends)[:, which] for one in met])
            depth = _summed(matter.sigma_t, amounts)
            middle = np.broadcast_to(t[:, None], depth.shape)
            within = mean_distance(depth / np.where(length > 0, length, 1), length)
            mean = middle if in_boxes else t0[:, None] + within
            opacity = through[which] * -np.expm1(-depth)
            yield Step(which, t, mean, amounts, depth, opacity, lit, thin, tangents, held)
            through[which] *= np.exp(-depth)


def _lit_place(middle: Floats, amounts: list[Floats], thin: list[Floats]) -> tuple[Floats, Floats]:
    """Where light is looked up for a step, and the share of thin primitives in it, both ``[n]``.

    ``thin``: of each body of primitives, what is held by thin ones ``[n]``, and that times their distance.
    """
    held, moment = np.sum([np.zeros((2, len(middle))), *thin], axis=0)
    everything = sum((amount.mean(axis=1) for amount in amounts), np.zeros_like(middle))
    has_thin = held > 0
    share = np.divide(held, everything, out=np.zeros_like(held), where=has_thin)
    place = np.divide(moment, held, out=middle.copy(), where=has_thin)
    return middle + share * (place - middle), share


def scattered(matter: Matter, step: Step) -> Floats:
    """Part of a step's opacity that scatters, ``[n, RGB]``."""
    return _over_depth(step, _summed(matter.sigma_s, step.amounts))


def scattered_light(
    matter: Matter,
    step: Step,
    ways: tuple[Floats, Floats],
    transmittance: Floats,
    spread: float,
    ray_depth: Floats,
) -> Floats:
    """Part of a step's opacity that scatters a light to the camera, per steradian, ``[n, RGB]``.

    ``spread``: of the light; ``ways``: directions ``[n, 3]`` of its travel, and to the camera;
    ``transmittance`` ``[n, RGB]``: of the bodies between the light and the step; ``ray_depth`` ``[n, RGB]``:
    optical depth of the whole camera ray.
    """
    amounts = []
    for amount, medium in zip(step.amounts, matter.media, strict=True):
        seen = medium.replace(phase=medium.phase.widened(spread))
        source = _phase(seen.phase, step, *ways)[:, None] * transmittance
        if seen.octaves > 1:
            mu = (ways[0] * ways[1]).sum(axis=-1, keepdims=True)
            source = source + later_octaves(seen, mu, transmittance, ray_depth)
        amounts.append(amount * source)
    return _over_depth(step, _summed(matter.sigma_s, amounts))


def _over_depth(step: Step, of_all: Floats) -> Floats:
    return np.divide(of_all, step.depth, out=np.zeros_like(of_all), where=step.depth > 0)


def emitted(matter: Matter, step: Step) -> Floats:
    """Radiance ``[n, RGB]`` at the begin of a step of what its bodies emit, dimmed by their constant density.

    ∫ ε D e^{-σ_t D t} dt: (1 - e^{-τ}) / τ of what is emitted.
    """
    has_depth = step.depth > 0
    share = np.divide(-np.expm1(-step.depth), step.depth, out=np.ones_like(step.depth), where=has_depth)
    return share * _summed(matter.emission, step.amounts)


def _phase(phase: Phase, step: Step, travel: Floats, to_camera: Floats) -> Floats:
    """Evaluate a medium's phase function ``[n]``."""
    mu = (travel * to_camera).sum(axis=-1)
    if not isinstance(phase, KajiyaKay):
        return np.asarray(phase.evaluate(mu))
    weight = np.trace(step.tangents, axis1=1, axis2=2)
    has_strands = weight > 0
    mean = step.tangents / np.where(has_strands, weight, 1)[:, None, None]

    def product(a: Floats, b: Floats) -> Floats:
        found: Floats = np.einsum("ni,nij,nj->n", a, mean, b)
        return found

    sines = [np.sqrt(np.maximum(1 - product(way, way), 0)) for way in (travel, to_camera)]
    mirrored = np.clip(product(travel, to_camera) + sines[0] * sines[1], 0, 1) ** phase.exponent
    s, _, scale = phase.kernel_parameters()
    # Of one strand the mean sine is its root mean square; it is less where they lie in all directions.
    spread = 1.5 * np.maximum(1 - (mean**2).sum(axis=(1, 2)), 0)
    light = sines[0] * (1 - (1 - ISOTROPIC_SINE) * spread)
    strands = light * ((1 - s) / np.pi**2 + s * scale * mirrored)
    return np.where(has_strands, strands, phase.evaluate(mu))


def _summed(sigma: Floats, amounts: list[Floats]) -> Floats:
    """Sum over the bodies of coefficient times amount, ``[n, RGB]``."""
    total = np.zeros((len(amounts[0]), 3))
    for coefficient, amount in zip(sigma, amounts, strict=True):
        total += coefficient * amount
    return total


def homogeneous_depth(matter: Matter, crossing: Crossing, begin: Floats, end: Floats) -> Floats:
    """Optical depth ``[rays, RGB]`` of the homogeneous bodies between two distances, exact."""
    total = np.zeros((len(begin), 3))
    for extinction, inside in zip(matter.extinctions, crossing.inside, strict=True):
        total += extinction * overlap(inside, begin, end)[:, None]
    return total


def boxed_depth(
    matter: Matter, rays: Rays, crossing: Crossing, begin: Floats, end: Floats, steps: int
) -> Floats:
    """Optical depth ``[rays, RGB]`` of grids and primitives between two distances, by the march's steps.

    There are ``steps`` of them from the first to the last of the boxes, and their share elsewhere.
    """
    near, far = crossing.boxes
    begin, end = np.maximum(begin, near), np.minimum(end, far)
    share = np.divide(end - begin, far - near, out=np.zeros_like(near), where=end > begin)
    counts = np.ceil(steps * share).astype(np.intp)
    return optical_depths(matter.marched, matter.weights, rays, interval(begin, end), counts)


def mean_distance(extinction: Floats, length: Floats) -> Floats:
    """Mean distance from where a homogeneous segment begins to where its opacity is, by the opacity.

    1/σ - length T/(1 - T); both ``[rays, RGB]``.
    """
    x = extinction * length
    path = np.divide(1, extinction, out=np.zeros_like(x), where=extinction > 0)
    thick = path - length * np.exp(-x) / np.where(x > 0, -np.expm1(-x), 1)
    thin = length * (0.5 - x / 12 + x**3 / 720)
    return np.where(x < 1e-2, thin, thick)  # noqa: PLR2004 - the series errs by x⁵/30240
