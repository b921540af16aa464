"""Which pixels show a solid that a light sees: shadow rays from those that it could light, no others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import check_cancelled
from tfm_cl.render.tracing.threads import CHUNK, in_chunks
from tfm_cl.scene.transform import dots, lengths_of

if TYPE_CHECKING:
    from tfm_cl.render.culling import BlockLists
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.regions import LitRegions
    from tfm_cl.render.tracing.tracer import Tracer

ON_EDGE = 1e-9
"""Cosine by which a point may lie outside a cone: kernels, in float32, have the last word on its edge."""


@dataclass(frozen=True)
class LitPixels:
    """Of each of some lights a rectangle of pixels, outside of which it lights no solid."""

    rectangles: NDArray[np.int64]
    """[lights, 4], x0, y0, x1, y1 in pixels of the buffers; empty for a light without."""
    first: NDArray[np.int64]
    """[lights], where each begins in ``lit``."""
    lit: NDArray[np.uint8]
    """1 where no other solid stops the light, row by row."""

    @property
    def nbytes(self) -> int:
        """Size."""
        return self.rectangles.nbytes + self.first.nbytes + self.lit.nbytes


def lit_pixels(
    tracer: Tracer,
    gbuffer: GBuffer,
    regions: LitRegions,
    lists: BlockLists,
    count: int,
    shaded: NDArray[np.bool_],
) -> LitPixels:
    """Trace what lights see of the solids that pixels show.

    Parameters
    ----------
    regions
        Of the lights.
    lists
        Which of them may change the pixels of each block, of `GBuffer.EDGE`.
    count
        Number of lights.
    shaded
        [lights]: which of them solids may keep from what is seen; of the others no ray is traced.
    """
    height, width = gbuffer.shown.shape
    edge = gbuffer.EDGE
    block = np.repeat(np.arange(len(lists.starts) - 1), np.diff(lists.starts))
    near = np.flatnonzero(gbuffer.occupied[block])
    met, boxes = np.empty(len(near), dtype=bool), gbuffer.boxes

    def meet(part: slice) -> None:
        pairs = near[part]
        met[part] = regions[lists.lights[pairs]].touch_boxes(boxes[block[pairs]])

    in_chunks(len(near), meet)
    near = near[met]
    block, light = block[near], lists.lights[near]
    low, high = np.full((2, count), max(width, height)), np.zeros((2, count), np.int64)
    row, column = np.divmod(block, lists.columns)
    for axis, (number, length) in enumerate(((column, width), (row, height))):  # short axes are slow here
        np.minimum.at(low[axis], light, number * edge)
        np.maximum.at(high[axis], light, np.minimum((number + 1) * edge, length))
    low, high = np.minimum(low, high).T, high.T
    sizes = high - low
    areas = sizes.prod(axis=1)
    first = areas.cumsum() - areas
    lit = np.zeros(int(areas.sum()) + 1, np.uint8)
    # Where a pixel shows no solid nothing asks.
    for unshaded in np.flatnonzero(~shaded):
        check_cancelled()
        lit[first[unshaded] : first[unshaded] + areas[unshaded]] = 1
    asks = shaded[light]
    block, light = block[asks], light[asks]

    def trace(part: slice) -> None:
        pair, within = np.nonzero(gbuffer.pixels[block[part]] >= 0)
        of, pixel = light[part][pair], gbuffer.pixels[block[part][pair], within]
        y, x = np.divmod(pixel, width)
        place = first[of] + (y - low[of, 1]) * sizes[of, 0] + x - low[of, 0]
        towards = _turned_towards(gbuffer, regions, of, pixel)
        place = place[towards]
        found, rays = _shadow_rays(gbuffer, regions, of[towards], pixel[towards])
        if len(found):
            lit[place[found]] = ~tracer.occluded(*rays)

    in_chunks(len(light), trace, CHUNK // edge**2)
    return LitPixels(np.concatenate([low, high], axis=1), first, lit)


def _turned_towards(
    gbuffer: GBuffer, regions: LitRegions, light: NDArray[np.int32], pixel: NDArray[np.int32]
) -> NDArray[np.intp]:
    """Which of some pixels may face a light, both [n]; known before anything else of parallel ones."""
    normals = gbuffer.solid.reshape(-1, 4)[pixel, :3].astype(np.float64)
    return np.flatnonzero(~regions.parallel[light] | (dots(regions.axis[light], normals) < 0))


def _shadow_rays(
    gbuffer: GBuffer,
    regions: LitRegions,
    light: NDArray[np.int32],
    pixel: NDArray[np.int32],
) -> tuple[NDArray[np.intp], tuple[NDArray[np.float64], ...]]:
    """Rays from pixels' points towards lights, both [n], and for which of them; a light may face away."""
    number = gbuffer.numbers[pixel]
    points = gbuffer.points[number]
    apex, axis, parallel = regions.apex[light], regions.axis[light], regions.parallel[light]
    offset = points - apex
    distance = lengths_of(offset)
    within = dots(offset, axis) >= (np.cos(regions.angle[light]) - ON_EDGE) * distance
    reached = np.flatnonzero(parallel | (within & (distance < regions.reach[light]) & (distance > 0)))
    normals = gbuffer.solid.reshape(-1, 4)[pixel[reached], :3].astype(np.float64)
    direction = np.where(
        parallel[reached, None],
        axis[reached],
        offset[reached] / np.where(parallel, 1, distance)[reached, None],
    )
    facing = dots(direction, normals) < 0
    found = reached[facing]
    at = gbuffer.starts[number[found]]
    length = np.where(parallel[found], np.inf, lengths_of(at - apex[found]))
    return found, (at, -direction[facing], length)
