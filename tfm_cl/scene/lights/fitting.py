"""Where the map of a light with a place looks: at what the light reaches of the medium, and no farther."""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.frames import facing
from tfm_cl.scene.lights.charts import MARGIN, Chart, Hemisphere, Octahedron, Perspective

Floats = NDArray[np.float64]

WIDEST_SLOPE = 1.0
"""Tangent up to which a view is mapped in perspective: there its texels are as wide as a hemisphere's, on the
axis wider, at its side narrower."""
LEAST_GAIN = 1.1
"""A view must be that much narrower to be preferred to one named before it: maps should not turn about for
nothing."""
NEAR = 1e-3
"""Part of its distance that a point must lie before a light to be mapped in perspective."""


class View(NamedTuple):
    """How a map looks out of a light."""

    axes: Floats
    """3×3, orthonormal, world from light; the chart's middle is along z."""
    chart: Chart


class Cone(NamedTuple):
    """Light around an axis."""

    axes: Floats
    """3×3, world from light, the axis along z."""
    slope: float
    """Tangent of the half angle, finite."""


def whole_view(cone: Cone | None) -> View:
    """Look at all that a cone holds, or all around without one."""
    if cone is None:
        return View(np.eye(3), Octahedron.whole())
    if cone.slope <= WIDEST_SLOPE:
        return View(cone.axes, Perspective((-cone.slope, -cone.slope), (cone.slope, cone.slope)))
    return View(cone.axes, Hemisphere.around(cone.slope))


def fitted_view(origin: Floats, bounds: Floats, cone: Cone | None, reach: float) -> View:
    """Look at what a light reaches of a box, as closely as can be.

    Parameters
    ----------
    origin
        [3], the light, world.
    bounds
        [2, 3], the box, world.
    cone
        That holds all light; None for light to all sides.
    reach
        Distance where the light ends; may be infinite.

    Returns
    -------
    View
        `whole_view` where nothing is reached, or the box has no end.
    """
    low, high = np.maximum(bounds[0] - origin, -reach), np.minimum(bounds[1] - origin, reach)
    if not np.isfinite([low, high]).all() or (low >= high).any():
        return whole_view(cone)
    nearest = np.clip(0, low, high)
    candidates = [] if cone is None else [cone.axes]
    corners = np.array(list(itertools.product(*np.stack([low, high], axis=1))))
    outside = bool(np.linalg.norm(nearest) > NEAR * np.linalg.norm(high - low))
    if outside:
        towards = corners / np.linalg.norm(corners, axis=1, keepdims=True)
        candidates += [_facing(towards.mean(axis=0)), _facing(nearest)]
    best, least = None, math.inf
    for axes in candidates:
        window = _window(axes, corners if outside else None, cone)
        if window is None:
            continue
        if (window[0] >= window[1]).any():
            return whole_view(cone)
        size = float(np.abs(window).max())
        if size * LEAST_GAIN < least:
            best, least = View(axes, _with_margin(*window)), size
    if best is not None and least <= WIDEST_SLOPE:
        return best
    hemispheres = [] if cone is None else [cone]
    if outside:
        axes = _facing(nearest)
        along = corners @ axes
        slope = float((np.hypot(along[:, 0], along[:, 1]) / np.maximum(along[:, 2], 1e-30)).max())
        hemispheres.append(Cone(axes, slope))
    if not hemispheres:
        return whole_view(None)
    narrowest = min(hemispheres, key=lambda hemisphere: hemisphere.slope)
    return View(narrowest.axes, Hemisphere.around(narrowest.slope))


def _window(axes: Floats, corners: Floats | None, cone: Cone | None) -> Floats | None:
    """Box [2, 2] on the plane z = 1 that holds the corners and the cone, both; None if that has no end."""
    windows = []
    if corners is not None:
        local = corners @ axes
        if (local[:, 2] > NEAR * np.linalg.norm(local, axis=1)).all():
            places = local[:, :2] / local[:, 2:]
            windows.append((places.min(axis=0), places.max(axis=0)))
    if cone is not None and (seen := _window_of_cone(axes, cone)) is not None:
        windows.append(seen)
    if not windows:
        return None
    low, high = zip(*windows, strict=True)
    return np.stack([np.max(low, axis=0), np.min(high, axis=0)])


def _window_of_cone(axes: Floats, cone: Cone) -> tuple[Floats, Floats] | None:
    """Box on the plane z = 1 around a cone's section with it; None where that has no end."""
    axis = axes.T @ cone.axes[:, 2]
    sine = math.sin(math.atan(cone.slope))
    low, high = np.zeros(2), np.zeros(2)
    for side in (0, 1):
        # The planes through the other coordinate's axis that touch the cone.
        across = math.hypot(axis[side], axis[2])
        if sine >= across:
            return None
        middle, half = math.atan2(axis[side], axis[2]), math.asin(sine / across)
        if max(abs(middle - half), abs(middle + half)) > math.atan(1 / NEAR):
            return None
        low[side], high[side] = math.tan(middle - half), math.tan(middle + half)
    return low, high


def _with_margin(low: Floats, high: Floats) -> Perspective:
    margin = MARGIN * (high - low)
    (left, bottom), (right, top) = (low - margin).tolist(), (high + margin).tolist()
    return Perspective((left, bottom), (right, top))


def _facing(direction: Floats) -> Floats:
    """3×3, world from light: z along a direction, x horizontal."""
    return facing((0.0, 0.0, 0.0), tuple(direction.tolist()))[:3, :3]
