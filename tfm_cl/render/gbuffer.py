"""What pixels show of solids, traced once for all lights (deferred shading)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

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
    shown: NDArray[np.bool_]
    """[h, w]: which pixels these are."""

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
        padded[:height, :width] = np.where(self.shown, number, -1)
        blocks = padded.reshape(rows, self.EDGE, columns, self.EDGE).swapaxes(1, 2)
        return blocks.reshape(rows * columns, self.EDGE**2)

    @cached_property
    def occupied(self) -> NDArray[np.bool_]:
        """[blocks], which show a solid at all."""
        return np.asarray((self.pixels >= 0).any(axis=1))

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """[blocks, 2, 3], low and high corner around each block's points, world; 0 where there are none."""
        boxes = np.zeros((len(self.pixels), 2, 3))
        shown = self.pixels[self.occupied]
        numbers, empty = self.numbers[shown], shown < 0
        for axis, along in enumerate(np.ascontiguousarray(self.points.T)):  # short axes are slow to reduce
            values = along[numbers]
            boxes[self.occupied, 0, axis] = np.where(empty, np.inf, values).min(axis=1)
            boxes[self.occupied, 1, axis] = np.where(empty, -np.inf, values).max(axis=1)
        return boxes

    @property
    def nbytes(self) -> int:
        """Size, with `numbers` and `pixels`."""
        of_pixels = 2 * np.dtype(np.int32).itemsize * self.shown.size
        arrays = self.solid, self.albedo, self.points, self.starts, self.shown
        return sum(array.nbytes for array in arrays) + of_pixels


def trace_gbuffer(tracer: Tracer, scene: Scene, raster: Raster) -> GBuffer:
    """Trace the camera's rays."""
    shape = raster.shape
    where, origins, directions = raster.rays(scene.camera)
    hits = tracer.nearest(origins, directions, scene.camera.pixel_width / raster.per_pixel)
    solid = np.zeros((shape[0] * shape[1], 4), np.float32)
    solid[:, 3] = np.inf
    albedo, shown = np.zeros_like(solid), np.zeros(len(solid), dtype=bool)
    met = np.isfinite(hits.distance) & ~hits.holdout
    solid[where, :3], solid[where, 3] = hits.normal, hits.distance
    albedo[where, :3], albedo[where, 3] = hits.albedo, hits.holdout
    shown[where] = met
    points = origins[met] + hits.distance[met, None] * directions[met]
    starts = tracer.lifted(points + hits.raised[met], hits.flat[met], hits.distance[met])
    return GBuffer(solid.reshape(*shape, 4), albedo.reshape(*shape, 4), points, starts, shown.reshape(shape))
