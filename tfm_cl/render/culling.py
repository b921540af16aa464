"""Light culling: the pixels that a light may change, and the lights that affect a block of pixels.

The camera ray of a pixel can meet the region that a light reaches only if the pixel lies in the projection of
every convex body around that region: the spot's cone, the sphere of its reach, the bounds of the medium. The
projection of a body is bounded by that of its corners, including those at infinity or behind the camera.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import Light

Floats = NDArray[np.float64]
Rectangle = tuple[int, int, int, int]

SIDES = 8
"""Number of sides of the pyramid around a cone, which is up to 8 % wider than the cone."""
MARGIN = 1
"""Margin in pixels on every side, for rounding errors."""
ROUNDING = 1e-9
"""Relative tolerance within which a corner counts as lying on the plane through the camera."""
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def pixel_bounds(light: Light, camera: Camera, bounds: Floats) -> Rectangle:
    """Return the rectangle of pixels x0, y0, x1, y1 (end excluded) that a light may change.

    Parameters
    ----------
    light
        A single light (`Light.parts`).
    camera
        The camera; its whole frame is considered.
    bounds
        Bounds of the medium and of the solids that may be lit, [2, 3], world; may be infinite.
    """
    x0, y0, x1, y1 = bounds_of_lights([light], camera, bounds)[0].tolist()
    return x0, y0, x1, y1


def bounds_of_lights(lights: Sequence[Light], camera: Camera, bounds: Floats) -> NDArray[np.int64]:
    """Return `pixel_bounds` of many lights, [lights, 4]; four zeros for a light that is not visible."""
    width, height = camera.res
    limits = np.empty((len(lights), 4))
    limits[:] = 0, 0, width, height
    if np.isfinite(bounds).all():
        limits = _common(limits, box_on_screen(bounds, camera)[None])
    check_cancelled()
    cones = [light.lit_cone() for light in lights]
    placed = np.array([i for i, cone in enumerate(cones) if cone is not None], dtype=np.intp)
    if len(placed):
        frames = np.stack([cone.world_from_light for cone in cones if cone is not None])
        slopes = np.array([cone.slope for cone in cones if cone is not None])
        reaches = np.array([cone.reach for cone in cones if cone is not None])
        ends = np.isfinite(reaches)
        if ends.any():
            balls = frames[ends, None, :3, 3] + CORNERS * reaches[ends, None, None]
            of_balls = _rectangles(balls, np.ones(balls.shape[:2]), camera)
            limits[placed[ends]] = _common(limits[placed[ends]], of_balls)
        spots = np.isfinite(slopes)
        if spots.any():
            of_cones = _cones(frames[spots], slopes[spots], reaches[spots], bounds, camera)
            limits[placed[spots]] = _common(limits[placed[spots]], of_cones)
    x0, y0, x1, y1 = limits.T
    with np.errstate(invalid="ignore"):  # an empty rectangle may lie at infinity
        shown = (x0 < x1) & (y0 < y1)
    limits[~shown] = 0
    whole = np.column_stack([np.floor(limits[:, :2]) - MARGIN, np.ceil(limits[:, 2:]) + MARGIN])
    inside: NDArray[np.int64] = np.clip(whole, 0, [width, height, width, height]).astype(np.int64)
    empty = ~shown | (inside[:, 0] >= inside[:, 2]) | (inside[:, 1] >= inside[:, 3])
    inside[empty] = 0
    return inside


def box_on_screen(bounds: Floats, camera: Camera) -> Floats:
    """Return the rectangle x0, y0, x1, y1, pixels, that bounds a camera's view of a box [2, 3], world.

    It may lie outside the frame and be infinite; x0 > x1 if the box is behind the camera.
    """
    middle, half = bounds.mean(axis=0), (bounds[1] - bounds[0]) / 2
    rectangle: Floats = _rectangles((middle + CORNERS * half)[None], np.ones((1, 8)), camera)[0]
    return rectangle


class BlockLists(NamedTuple):
    """The lights that affect each block of the picture."""

    starts: NDArray[np.int32]
    """[blocks + 1], the beginning of each block's list in ``lights``, row by row."""
    lights: NDArray[np.int32]
    """Indices of lights, in ascending order within a list."""
    first: tuple[int, int]
    """Column and row, in the whole frame, of the first block."""
    columns: int
    """Number of blocks in a row."""


def block_lists(rectangles: NDArray[np.int64], crop: Rectangle, edge: int) -> BlockLists:
    """List the lights of each block.

    Parameters
    ----------
    rectangles
        Pixels that each light may change, [lights, 4], from `bounds_of_lights`.
    crop
        Pixels x0, y0, x1, y1 that the blocks cover; blocks are aligned to the corner of the whole frame.
    edge
        Edge of a block, pixels.
    """
    low, high = np.array(crop[:2]), np.array(crop[2:])
    first = low // edge
    columns, rows = -(-high // edge) - first
    corners = np.clip(rectangles.reshape(-1, 2, 2), low, high)
    begin, end = corners[:, 0] // edge - first, -(-corners[:, 1] // edge) - first
    shown = np.all(corners[:, 0] < corners[:, 1], axis=1, keepdims=True)
    size = np.where(shown, end - begin, 0)
    counts = size.prod(axis=1)
    light = np.repeat(np.arange(len(rectangles), dtype=np.int32), counts)
    within = np.arange(len(light)) - np.repeat(counts.cumsum() - counts, counts)
    row, column = np.divmod(within, np.maximum(size[light, 0], 1))
    block = (begin[light, 1] + row) * columns + begin[light, 0] + column
    starts = np.zeros(columns * rows + 1, np.int32)
    starts[1:] = np.bincount(block, minlength=columns * rows).cumsum()
    order = np.argsort(block, kind="stable")
    return BlockLists(starts, light[order], (int(first[0]), int(first[1])), int(columns))


def _cones(frames: Floats, slopes: Floats, reaches: Floats, bounds: Floats, camera: Camera) -> Floats:
    """Rectangles of the pyramids around cones, cut off where the light or the bounds end."""
    apex, axis = frames[:, :3, 3], frames[:, :3, 2]
    depths = reaches.copy()
    if np.isfinite(bounds).all():
        middle, half = bounds.mean(axis=0), (bounds[1] - bounds[0]) / 2
        deepest = ((middle - apex) * axis).sum(axis=1) + (np.abs(axis) * half).sum(axis=1)
        depths = np.minimum(depths, deepest)
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1) / np.cos(np.pi / SIDES)
    sides = np.einsum("nij,sj->nsi", frames[:, :3, :2], around) * slopes[:, None, None] + axis[:, None]
    ends = np.isfinite(depths)
    scale = np.where(ends, np.maximum(depths, 0), 1)[:, None, None]
    # An infinite cone has its base at infinity.
    base = sides * scale + np.where(ends[:, None, None], apex[:, None], 0)
    points = np.concatenate([apex[:, None], base], axis=1)
    weights = np.ones(points.shape[:2])
    weights[:, 1:] = ends[:, None]
    rectangles = _rectangles(points, weights, camera)
    rectangles[ends & (depths <= 0)] = np.inf, np.inf, -np.inf, -np.inf
    return rectangles


def _common(one: Floats, other: Floats) -> Floats:
    return np.concatenate(
        [np.maximum(one[:, :2], other[:, :2]), np.minimum(one[:, 2:], other[:, 2:])], axis=1
    )


def _rectangles(points: Floats, weights: Floats, camera: Camera) -> Floats:
    """Bound the projections of convex bodies, [bodies, 4]: x0, y0, x1, y1 in pixels, x0 > x1 where empty.

    Parameters
    ----------
    points
        Corners [bodies, corners, 3], world.
    weights
        [bodies, corners]: 0 for a direction to a corner at infinity, else 1.
    """
    width, height = camera.res
    position = np.asarray(camera.from_)
    local = (points - weights[..., None] * position) @ camera.world_from_camera[:3, :3]
    size = np.abs(local).max(axis=(1, 2), keepdims=True) + np.abs(position).max()
    near = ROUNDING * size
    local[..., :2] /= np.tan(np.radians(camera.fov) / 2) * np.array([width / height, 1.0])
    depth = local[..., 2:]
    front = depth > near
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.where(front, local[..., :2] / depth, np.nan)
    low = np.min(at, axis=1, initial=np.inf, where=front)
    high = np.max(at, axis=1, initial=-np.inf, where=front)
    # The projection of a body that crosses the plane through the camera is infinite on the side where it
    # crosses.
    mixed = np.flatnonzero((front.any(axis=1) & ~front.all(axis=1))[:, 0])
    if len(mixed):
        toward, behind = np.maximum(depth[mixed], near[mixed]), np.minimum(depth[mixed], 0)
        flat = local[mixed, :, :2]
        # Connect every corner in front of the plane to every one behind it: more than the edges, but the same
        # body.
        share = toward[:, :, None] / (toward[:, :, None] - behind[:, None])
        crossing = flat[:, :, None] + share * (flat[:, None] - flat[:, :, None])
        pairs = front[mixed, :, None] & ~front[mixed, None]
        near = near[mixed][..., None]
        low[mixed] = np.where((pairs & (crossing <= near)).any(axis=(1, 2)), -np.inf, low[mixed])
        high[mixed] = np.where((pairs & (crossing >= -near)).any(axis=(1, 2)), np.inf, high[mixed])
    x, y = [(low[:, i], high[:, i]) for i in range(2)]
    return np.stack(
        [(x[0] + 1) / 2 * width, (1 - y[1]) / 2 * height, (x[1] + 1) / 2 * width, (1 - y[0]) / 2 * height],
        axis=1,
    )
