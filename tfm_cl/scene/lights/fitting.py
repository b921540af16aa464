"""Fits the map of a light with a position to the part of the medium that the light reaches."""

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.frames import facing
from tfm_cl.scene.lights.charts import MARGIN, Chart, Hemisphere, Octahedron, Perspective

Floats = NDArray[np.float64]

WIDEST_SLOPE = 1.0
"""Tangent of the half angle up to which a view uses the perspective chart. At that angle its texels are as
wide as those of the hemisphere chart: wider on the axis, narrower at the edge."""
LEAST_GAIN = 1.1
"""Factor by which a view must be narrower than an earlier candidate to replace it, so that maps do not rotate
without a benefit."""
NEAR = 1e-3
"""Relative tolerance of distances: a point is in front of the light if its depth exceeds this fraction of its
distance, and the light is outside a box if its distance to it exceeds this fraction of the diagonal."""


class View(NamedTuple):
    """Orientation and chart of a light's map."""

    axes: Floats
    """3×3, orthonormal, world from light; z points to the centre of the chart."""
    chart: Chart


class Cone(NamedTuple):
    """A cone of light around an axis."""

    axes: Floats
    """3×3, world from light; z is the axis."""
    slope: float
    """Tangent of the half angle, finite."""


def whole_view(cone: Cone | None) -> View:
    """Cover a whole cone, or all directions without one."""
    if cone is None:
        return View(np.eye(3), Octahedron.whole())
    if cone.slope <= WIDEST_SLOPE:
        return View(cone.axes, Perspective((-cone.slope, -cone.slope), (cone.slope, cone.slope)))
    return View(cone.axes, Hemisphere.around(cone.slope))


def fitted_view(origin: Floats, bounds: Floats, cone: Cone | None, reach: float) -> View:
    """Cover the part of a box that a light reaches, as tightly as possible.

    Parameters
    ----------
    origin
        [3], position of the light, world.
    bounds
        [2, 3], low and high corner of the box, world.
    cone
        Cone that contains all the light; None for light in all directions.
    reach
        Distance at which the light ends; may be infinite.

    Returns
    -------
    View
        `whole_view` if the light does not reach the box, or the box is infinite.
    """
    of_cone = None if cone is None else (cone.axes.tobytes(), cone.slope)
    of_origin, of_bounds = (np.asarray(array, np.float64).tobytes() for array in (origin, bounds))
    return _fitted_view(of_origin, of_bounds, of_cone, reach)


@lru_cache(maxsize=1 << 14)
def _fitted_view(
    of_origin: bytes, of_bounds: bytes, of_cone: tuple[bytes, float] | None, reach: float
) -> View:
    """`fitted_view`, cached, since it is called in each frame and for many lights."""
    origin, bounds = np.frombuffer(of_origin), np.frombuffer(of_bounds).reshape(2, 3)
    cone = None if of_cone is None else Cone(np.frombuffer(of_cone[0]).reshape(3, 3), of_cone[1])
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
    """Intersection [2, 2] of the corners' and the cone's bounds on the plane z = 1; None if unbounded."""
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
    """Bounds of a cone's section with the plane z = 1; None if they are infinite."""
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
