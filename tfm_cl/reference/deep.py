"""Deep samples: stretches of constant extinction that follow a camera ray's transmittance to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.files.image_io.image import DeepSamples
from tfm_cl.model import decided
from tfm_cl.reference.bodies import Matter
from tfm_cl.reference.fitting import margin_of, with_numbers
from tfm_cl.reference.geometry import Floats
from tfm_cl.reference.march import crossing_of, march, segments
from tfm_cl.reference.picture import Crop, camera_rays
from tfm_cl.reference.solids import Obstacles

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene

MOST = 10.0
"""Optical depth that counts as opaque."""
PART = 0.5
"""Optical depth of a step between the points at which the transmittance is looked at."""
KEPT = 0.9
"""Part of the tolerance that a line keeps to at these points."""
WHOLE = 1e-4
"""By how much the transmittance of a whole ray may be off."""


class Curve(NamedTuple):
    """The transmittance along a ray: its logarithm is linear between points."""

    distance: Floats
    """``[points]``, Z: along the camera's viewing direction, world units."""
    depth: Floats
    """``[points]``: -log of the mean over the colours."""
    solid: float
    """Z of the solid that it ends at, and shows; infinite without."""
    opacity: float = 1.0
    """Of that, as far as haze lets it be seen."""

    def transmittance(self, z: Floats) -> Floats:
        """Return what is left at some depths."""
        if not len(self.distance):
            return np.ones_like(z)
        through: Floats = np.exp(-np.interp(z, self.distance, self.depth))
        return np.where(z >= self.solid, (1 - self.opacity) * through, through)


def curves(scene: Scene, crop: Crop | None = None) -> list[Curve]:
    """March all camera rays, row by row, up to solids."""
    scene = with_numbers(scene)
    rays, matter = camera_rays(scene.camera, crop), Matter(scene, margin_of(scene))
    surfaces = Obstacles(scene, "exact").surfaces(rays)
    crossing = crossing_of(matter, rays, surfaces.distance, scene.march.cutoff)
    forward = scene.camera.world_from_camera[:3, 2]
    per_distance = rays.directions @ forward
    count = len(per_distance)
    points: list[list[tuple[float, float]]] = [[] for _ in range(count)]
    through, before = np.ones((count, 3)), np.zeros(count)
    parts = segments(crossing, crossing.medium, decided(scene.march.steps))
    for step in march(matter, rays, crossing, parts, through):
        begin, end = step.held
        left = through[step.rays] * np.exp(-step.depth)
        # What the march counts as nothing is nothing.
        with np.errstate(divide="ignore"):
            after = np.minimum(-np.log(left.mean(axis=-1)), 1 / np.finfo(float).tiny)
        for i, ray in enumerate(step.rays.tolist()):
            if end[i] > begin[i] and before[ray] < MOST:
                share = min((MOST - before[ray]) / (after[i] - before[ray]), 1) if after[i] > MOST else 1
                middle = begin[i] + share * (end[i] - begin[i])
                points[ray] += [(begin[i], before[ray]), (middle, min(after[i], MOST))]
        before[step.rays] = after
    solid = np.where(surfaces.holdout, np.inf, surfaces.distance) * per_distance
    clear = scene.camera.seen_of(np.where(np.isfinite(solid), surfaces.distance, 0))
    found = [np.array(some).reshape(-1, 2).T for some in points]
    return [
        Curve(distance * per, depth, float(end), float(opacity))
        for (distance, depth), per, end, opacity in zip(found, per_distance, solid, clear, strict=True)
    ]


def deep_samples(scene: Scene, tolerance: float, crop: Crop | None = None) -> DeepSamples:
    """Fit the samples of all camera rays, without colours."""
    width, height = scene.camera.res if crop is None else (crop[2] - crop[0], crop[3] - crop[1])
    cutoff = -math.log(max(scene.march.cutoff, np.finfo(float).tiny)) if Matter(scene).marched else np.inf
    fitted = [
        [(z, z_back, alpha) for z, z_back, alpha in fit(curve, tolerance, cutoff) if alpha > 0]
        for curve in curves(scene, crop)
    ]
    counts = np.array([len(samples) for samples in fitted], np.int32).reshape(height, width)
    flat = np.array([sample for samples in fitted for sample in samples], np.float32).reshape(-1, 3)
    return DeepSamples(counts, *np.ascontiguousarray(flat.T))


def fit(curve: Curve, tolerance: float, cutoff: float) -> Iterator[tuple[float, float, float]]:
    """Yield Z, ZBack and opacity of one ray's samples: the swing filter, never deeper than the curve.

    ``cutoff``: optical depth at which the march counts nothing as left.
    """
    kept = KEPT * tolerance
    begin = depth = 0.0
    low, high, points = 0.0, math.inf, [(0.0, 0.0)]
    for z, exact in _points(curve):
        if len(points) == 1 and exact <= points[-1][1]:  # nothing yet
            begin, points = z, [(z, exact)]
            continue
        lower = min(-math.log(math.exp(-exact) + kept), exact)
        if (lower - depth) / (z - begin) > high or (exact - depth) / (z - begin) < low:
            end, adds = points[-1][0], _adds(begin, depth, points[-1], low, high)
            yield begin, end, -math.expm1(-adds)
            begin, depth, low, high, points = end, depth + adds, 0.0, math.inf, points[-1:]
        low = max(low, (lower - depth) / (z - begin))
        high = max(min(high, (exact - depth) / (z - begin)), low)
        points.append((z, exact))
    if len(points) > 1:
        end, exact = points[-1]
        whole = MOST if exact > cutoff else exact
        adds = _adds(begin, depth, (end, whole), low, high)
        misses = abs(math.exp(-depth - adds) - math.exp(-whole)) > WHOLE
        if misses and len(points) > 2:  # noqa: PLR2004 - begin and end
            adds = _adds(begin, depth, points[-2], low, high)
            yield begin, points[-2][0], -math.expm1(-adds)
            begin, depth = points[-2][0], depth + adds
            adds = max(whole - depth, 0.0)
        yield begin, end, -math.expm1(-adds)
    if math.isfinite(curve.solid):
        yield curve.solid, curve.solid, curve.opacity


def _points(curve: Curve) -> Iterator[tuple[float, float]]:
    """Yield those of a curve without those where nothing was added, thick steps in parts."""
    last = last_depth = 0.0
    for z, depth in zip(curve.distance.tolist(), curve.depth.tolist(), strict=True):
        if z <= last * (1 + 1e-9):
            continue
        parts = max(math.ceil((depth - last_depth) / PART), 1)
        for i in range(1, parts + 1):
            yield last + (z - last) * i / parts, last_depth + (depth - last_depth) * i / parts
        last, last_depth = z, depth


def _adds(begin: float, depth: float, end: tuple[float, float], low: float, high: float) -> float:
    """Optical depth of a sample that ends at a point, as close to it as its slope may be."""
    length = end[0] - begin
    return max(min((end[1] - depth) / length, high), low) * length
