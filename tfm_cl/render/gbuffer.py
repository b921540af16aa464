"""What pixels show of solids, traced once for all lights (deferred shading)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import check_cancelled
from tfm_cl.render.tracing.threads import CHUNK, in_chunks
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from tfm_cl.render.raster import Raster
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.scene import Scene


@dataclass(frozen=True)
class GBuffer:
    """The solids that the pixels of a crop show, [height, width, …]."""

    solid: NDArray[np.float32]
    """[h, w, 4]: unit normal (for shading, world, on the camera's side) and distance, world units; infinite
    without."""
    albedo: NDArray[np.float32]
    """[h, w, 4]: RGB, and 1 on holdouts, else 0."""
    points: NDArray[np.float64]
    """[hits, 3] where camera rays meet solids that are no holdouts, world, row by row."""
    starts: NDArray[np.float64]
    """[hits, 3] where their shadow rays start, world."""
    bounds: NDArray[np.float64] | None
    """Low and high corner around all points, [2, 3], world; None without any."""
    shown: NDArray[np.bool_]
    """[h, w]: which pixels the points are of."""

    EDGE: ClassVar[int] = 16
    """Pixels along a side of a block, within which points lie close together."""

    @cached_property
    def numbers(self) -> NDArray[np.int32]:
        """[h·w], number of each pixel's point, where it has one."""
        return self.shown.ravel().cumsum(dtype=np.int32) - np.int32(1)

    @cached_property
    def pixels(self) -> NDArray[np.int32]:
        """[blocks, `EDGE`²], numbers in the crop of each block's pixels, row by row; -1: shows nothing."""
        height, width = self.shown.shape
        rows, columns = -(-height // self.EDGE), -(-width // self.EDGE)
        padded = np.full((rows * self.EDGE, columns * self.EDGE), -1, np.int32)
        number = np.arange(height * width, dtype=np.int32).reshape(height, width)
        check_cancelled()
        padded[:height, :width] = np.where(self.shown, number, -1)
        check_cancelled()
        blocks = padded.reshape(rows, self.EDGE, columns, self.EDGE).swapaxes(1, 2)
        return blocks.reshape(rows * columns, self.EDGE**2)

    @cached_property
    def occupied(self) -> NDArray[np.bool_]:
        """[blocks], which show a solid at all."""
        return np.asarray((self.pixels >= 0).any(axis=1))

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """[blocks, 2, 3], low and high corner around each block's points, world; 0 where there are none."""
        shown, number_of = self.pixels[self.occupied], self.numbers
        found, boxes = np.empty((len(shown), 2, 3)), np.zeros((len(self.pixels), 2, 3))

        def bound(part: slice) -> None:
            numbers, empty = number_of[shown[part]], shown[part] < 0
            for axis in range(3):  # short axes are slow to reduce
                values = self.points[:, axis][numbers]
                found[part, 0, axis] = np.where(empty, np.inf, values).min(axis=1)
                found[part, 1, axis] = np.where(empty, -np.inf, values).max(axis=1)

        in_chunks(len(shown), bound, CHUNK // self.EDGE**2)
        boxes[self.occupied] = found
        return boxes

    @property
    def nbytes(self) -> int:
        """Size, with `numbers` and `pixels`."""
        of_pixels = 2 * np.dtype(np.int32).itemsize * self.shown.size
        arrays = self.solid, self.albedo, self.points, self.starts, self.shown
        return sum(array.nbytes for array in arrays) + of_pixels


def trace_gbuffer(tracer: Tracer, scene: Scene, raster: Raster) -> GBuffer:
    """Trace the camera's rays."""
    shape, spread = raster.shape, scene.camera.pixel_width / raster.per_pixel
    count = shape[0] * shape[1]
    solid, albedo = np.zeros((count, 4), np.float32), np.zeros((count, 4), np.float32)
    shown = np.zeros(count, dtype=bool)
    points_of: dict[int, NDArray[np.float64]] = {}
    starts_of: dict[int, NDArray[np.float64]] = {}
    """By the first pixel of a part."""
    boxes: list[NDArray[np.float64]] = []

    def trace(part: slice) -> None:
        where, origins, directions = raster.rays(scene.camera, part)
        hits = tracer.nearest(origins, directions, spread)
        met = np.isfinite(hits.distance) & ~hits.holdout
        solid[part, 3] = np.inf
        solid[where, :3], solid[where, 3] = hits.normal, hits.distance
        albedo[where, :3], albedo[where, 3] = hits.albedo, hits.holdout
        shown[where] = met
        points = origins[met] + hits.distance[met, None] * directions[met]
        points_of[part.start] = points
        starts_of[part.start] = tracer.lifted(points + hits.raised[met], hits.flat[met], hits.distance[met])
        if len(points):
            axes = np.ascontiguousarray(points.T)  # short axes are slow to reduce
            boxes.append(np.stack([axes.min(axis=1), axes.max(axis=1)]))

    in_chunks(count, trace)
    points, starts = _joined(points_of), _joined(starts_of)
    return GBuffer(
        solid.reshape(*shape, 4),
        albedo.reshape(*shape, 4),
        points,
        starts,
        around(boxes) if boxes else None,
        shown.reshape(shape),
    )


def _joined(parts: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Put parts [n, 3], by their places, one behind the other."""
    joined, first = np.empty((sum(map(len, parts.values())), 3)), 0
    for place in sorted(parts):
        check_cancelled()
        end = first + len(parts[place])
        joined[first:end], first = parts[place], end
    return joined
