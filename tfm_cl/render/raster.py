"""Which camera rays a frame has, and where in its buffers they lie: a crop's, or samples of some pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.launch import TILE
from tfm_cl.render.culling import BlockLists, block_lists

if TYPE_CHECKING:
    from collections.abc import Hashable

    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.camera import Camera

Floats = NDArray[np.float64]
CELLS = {1: (1, 1), 2: (2, 1), 4: (2, 2)}
"""Pixels that share a tile -> along x and y."""
BLOCK = 16
"""Pixels along a side of a block that has a list of lights: a multiple of tiles and work-groups."""
NOWHERE = -1.0
"""Place of a ray that there is not."""


class Raster(Protocol):
    """The rays of a frame."""

    @property
    def bounds(self) -> Rectangle:
        """Pixels x0, y0, x1, y1 of the buffers, which launches cover."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the buffers."""

    @property
    def key(self) -> Hashable:
        """What tells it from others; None: what it sees is not kept."""

    @property
    def places(self) -> NDArray[np.float32]:
        """[n, 2], where rays pass through the frame, pixels; not read where all pixels of a crop have one."""

    @property
    def is_listed(self) -> bool:
        """Whether places are read."""

    @property
    def per_pixel(self) -> int:
        """Samples along a side of a pixel."""

    def rays(self, camera: Camera, part: slice) -> tuple[slice | NDArray[np.intp], Floats, Floats]:
        """Which elements of a part of the buffers, row by row, have rays, and origins and directions.

        Both [rays, 3], world.
        """

    def spans(self, touched: NDArray[np.int64]) -> NDArray[np.int64]:
        """Pixels of the buffers, x0, y0, x1, y1, around those that show some of the frame's, both [n, 4]."""

    def window(self, touched: NDArray[np.int64]) -> Rectangle:
        """Pixels of the buffers around all of these."""

    def lists(self, touched: NDArray[np.int64], window: Rectangle) -> BlockLists:
        """List the lights of each block of a window of the buffers, by pixels of the frame [n, 4]."""

    def lists_of_buffers(self, touched: NDArray[np.int64], edge: int) -> BlockLists:
        """List the lights of each block of the buffers, from their corner on, ``edge`` pixels wide."""


@dataclass(frozen=True)
class Crop:
    """One ray through the centre of each pixel of a crop."""

    bounds: Rectangle

    is_listed = False
    per_pixel = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the buffers."""
        x0, y0, x1, y1 = self.bounds
        return y1 - y0, x1 - x0

    @property
    def key(self) -> Hashable:
        """What tells it from others."""
        return self.bounds

    @property
    def places(self) -> NDArray[np.float32]:
        """Not read."""
        return np.zeros((1, 2), np.float32)

    def rays(self, camera: Camera, part: slice) -> tuple[slice | NDArray[np.intp], Floats, Floats]:
        """Which elements of a part of the buffers have rays, and their origins and directions."""
        x0, y0, x1, _ = self.bounds
        y, x = np.divmod(np.arange(part.start, part.stop), x1 - x0)
        return part, *camera.rays_through(x + (x0 + 0.5), y + (y0 + 0.5))

    def spans(self, touched: NDArray[np.int64]) -> NDArray[np.int64]:
        """Pixels of the buffers around those that show some of the frame's."""
        return touched

    def window(self, touched: NDArray[np.int64]) -> Rectangle:
        """Pixels of the buffers around all of these."""
        x0, y0 = touched[:, :2].min(axis=0).tolist()
        x1, y1 = touched[:, 2:].max(axis=0).tolist()
        return x0, y0, x1, y1

    def lists(self, touched: NDArray[np.int64], window: Rectangle) -> BlockLists:
        """List the lights of each block of a window."""
        return block_lists(touched, window, BLOCK)

    def lists_of_buffers(self, touched: NDArray[np.int64], edge: int) -> BlockLists:
        """List the lights of each block of the buffers, from their corner on."""
        x0, y0, x1, y1 = self.bounds
        return block_lists(touched - (x0, y0, x0, y0), (0, 0, x1 - x0, y1 - y0), edge)


@dataclass(frozen=True)
class Samples:
    """Samples within some pixels of a frame, packed into a column of blocks.

    A block of the column has samples of one block of the frame, and thus its lights; those of a pixel
    fill whole tiles, alone or with pixels beside it, whatever else is sampled. Made by `pack`.
    """

    places: NDArray[np.float32]
    blocks: NDArray[np.int64]
    """[blocks, 2], column and row in the frame of each block, row by row."""
    index: NDArray[np.intp]
    """[pixels, samples], elements of the buffers with the samples of each pixel."""
    per_pixel: int

    is_listed = True

    @property
    def bounds(self) -> Rectangle:
        """Pixels of the column."""
        return 0, 0, BLOCK, BLOCK * len(self.blocks)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the buffers."""
        return BLOCK * len(self.blocks), BLOCK

    @property
    def key(self) -> Hashable:
        """None: the next frame may sample other pixels."""
        return None

    def rays(self, camera: Camera, part: slice) -> tuple[slice | NDArray[np.intp], Floats, Floats]:
        """Which elements of a part of the buffers have rays, and their origins and directions."""
        there = part.start + np.flatnonzero(self.places[part, 0] != NOWHERE)
        x, y = self.places[there].astype(np.float64).T
        return there, *camera.rays_through(x, y)

    def spans(self, touched: NDArray[np.int64]) -> NDArray[np.int64]:
        """Pixels of the buffers around those that show some of the frame's."""
        lists = self.lists(touched, self.bounds)
        block = np.repeat(np.arange(len(self.blocks)), np.diff(lists.starts))
        first, end = np.full(len(touched), len(self.blocks)), np.zeros(len(touched), np.int64)
        np.minimum.at(first, lists.lights, block)
        np.maximum.at(end, lists.lights, block + 1)
        first = np.minimum(first, end)
        side = np.where(first < end, BLOCK, 0)
        return np.stack([np.zeros_like(side), BLOCK * first, side, BLOCK * end], axis=1)

    def window(self, touched: NDArray[np.int64]) -> Rectangle:  # noqa: ARG002
        """Pixels of the buffers around all of these: blocks without them have empty lists."""
        return self.bounds

    def lists(self, touched: NDArray[np.int64], window: Rectangle) -> BlockLists:  # noqa: ARG002
        """List the lights of each block: those of the frame's block that it has samples of."""
        low, high = self.blocks.min(axis=0), self.blocks.max(axis=0) + 1
        x0, y0, x1, y1 = np.concatenate([BLOCK * low, BLOCK * high]).tolist()
        of_frame = block_lists(touched, (x0, y0, x1, y1), BLOCK)
        column, row = (self.blocks - low).T
        number = row * of_frame.columns + column
        counts = np.diff(of_frame.starts)[number]
        starts = np.zeros(len(number) + 1, np.int32)
        starts[1:] = counts.cumsum()
        within = np.arange(starts[-1]) - np.repeat(starts[:-1], counts)
        lights = of_frame.lights[np.repeat(of_frame.starts[number], counts) + within]
        return BlockLists(starts, lights, (0, 0), 1)

    def lists_of_buffers(self, touched: NDArray[np.int64], edge: int) -> BlockLists:  # noqa: ARG002
        """List the lights of each block of the buffers: an edge is `BLOCK`."""
        return self.lists(touched, self.bounds)


def pattern(per_pixel: int) -> Floats:
    """Return where the samples of a pixel lie in it, [per_pixel², 2] in 0 to 1, row by row.

    A rotated grid: one in each cell of an upright one, and no two in a row or column, so that upright and
    level edges cross them one by one.
    """
    y, x = np.divmod(np.arange(per_pixel**2), per_pixel)
    turned = per_pixel - 1 - x
    shifted = np.stack([x + (y + 0.5) / per_pixel, y + (turned + 0.5) / per_pixel], axis=1)
    return np.asarray(shifted / per_pixel)


def pack(pixels: NDArray[np.int64], per_pixel: int, lanes: int) -> Samples:
    """Pack the samples within pixels x, y [n, 2], one or more, all of one frame.

    Parameters
    ----------
    pixels
        Sorted by block (`block_order`), each once.
    per_pixel
        Samples along a side of a pixel.
    lanes
        Rays that a work-item carries.
    """
    count = per_pixel**2
    tiles = max(1, -(-count // lanes))
    # Pixels beside each other share a tile that one alone would not fill.
    wide, high = CELLS[max(1, lanes // count)]
    x, y = (pixels // (wide, high)).T
    numbers, of_cell = np.unique((y << 32) + x, return_inverse=True)
    cells: NDArray[np.int64] = np.stack([numbers & 0xFFFFFFFF, numbers >> 32], axis=1)
    block_of_cell = cells * (wide, high) // BLOCK
    order = np.lexsort((cells[:, 0], cells[:, 1], block_of_cell[:, 0], block_of_cell[:, 1]))
    cells, block_of_cell = cells[order], block_of_cell[order]
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    # Cells fill the blocks of the column; those of a block of the frame begin a new one.
    room = BLOCK**2 // (tiles * lanes)
    begins = np.flatnonzero(np.r_[True, (block_of_cell[1:] != block_of_cell[:-1]).any(axis=1)])
    sizes = np.diff(np.r_[begins, len(cells)])
    blocks_of = -(-sizes // room)
    first_block = blocks_of.cumsum() - blocks_of
    within = np.arange(len(cells)) - np.repeat(begins, sizes)
    block = np.repeat(first_block, sizes) + within // room
    slot = block * BLOCK**2 + within % room * (tiles * lanes)
    inside = pixels - cells[rank[of_cell]] * (wide, high)
    sample = (inside[:, 1] * wide + inside[:, 0])[:, None] * count + np.arange(count)
    index = _element(slot[rank[of_cell], None] + sample, lanes)
    total = int(blocks_of.sum())
    places = np.full((total * BLOCK**2, 2), NOWHERE, np.float32)
    places[index] = pixels[:, None] + pattern(per_pixel)
    return Samples(places, np.repeat(block_of_cell[begins], blocks_of, axis=0), index, per_pixel)


def block_order(pixels: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the order of pixels x, y [n, 2] by the blocks they lie in, row by row."""
    x, y = pixels.T
    return np.lexsort((x, y, x // BLOCK, y // BLOCK))


def _element(slot: NDArray[np.intp], lanes: int) -> NDArray[np.intp]:
    """Where in a column's buffers slots are that fill its tiles one after the other."""
    width, height = TILE[lanes]
    tile, lane = np.divmod(slot, lanes)
    row, column = np.divmod(tile, BLOCK // width)
    y, x = np.divmod(lane, width)
    return np.asarray((row * height + y) * BLOCK + column * width + x)
