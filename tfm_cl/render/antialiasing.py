"""Anti-aliasing: pixels that differ from those beside them are sampled again, and all are filtered.

One sample says enough where a picture is smooth: its second differences tell. Pixels whose samples differ, or
differ from those across their border, get four times as many more: an edge passes there. A pixel is the mean
of all samples that it has. Nothing depends on what lies further away than `MARGIN`: a crop shows what the
whole frame would.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import check_cancelled
from tfm_cl.render.raster import BLOCK, block_order, in_blocks, pack, pattern
from tfm_cl.render.rows import rows_at_once
from tfm_cl.scene.pixel_filters import FILTERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfm_cl.render.buffers import Sums
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.raster import Samples

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

BEND = 0.1
"""Second difference beyond which a pixel is sampled again: of RGB over the brightest near; of alpha."""
SPREAD = 0.2
"""Difference between samples, likewise, beyond which their pixels get four times as many more."""
AROUND = 8
"""Pixels to each side in which the brightest is looked for: what is dark beside it is hardly seen."""
BLACK = 1e-4
"""Radiance below which nothing is seen."""
MARGIN = 16
"""Pixels around a crop that say something of it: `AROUND`, and one for each level, the filter, neighbours."""
MOST_SAMPLES = 1 << 20
"""That are held at once."""
QUADRATURE = 64
"""Points along a side of a pixel at which filters are summed up."""
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Steps y, x to the four pixels beside one, each before its opposite."""


class _Level(NamedTuple):
    """Pixels that are made of samples."""

    pixels: NDArray[np.int64]
    """x, y [n, 2]."""
    parts: dict[str, Floats]
    """What of the sums each gives to the pixels around it, [n, y, x, channels]."""
    nearest: Floats | None
    """[n, 5], normal and distance of the nearest solid, and 1 for a holdout; None without any."""
    counts: NDArray[np.uint32]
    """[n], densities read."""
    taken: NDArray[np.float32]
    """[n], samples that they are made of."""


@dataclass(frozen=True)
class Antialiasing:
    """How the samples of a picture are chosen and put together.

    Attributes
    ----------
    samples
        Of a pixel, at most: a power of 4.
    filter
        One of `tfm_cl.scene.pixel_filters.FILTERS`.
    """

    samples: int = 1
    filter: str = "box"

    @property
    def is_plain(self) -> bool:
        """Whether pixels are what their one sample says."""
        return self.samples == 1 and self.filter == "box"

    def around(self, crop: Rectangle, res: tuple[int, int]) -> Rectangle:
        """Return the pixels x0, y0, x1, y1 that a crop depends on: whole tiles of a frame."""
        if self.is_plain:
            return crop
        x0, y0, x1, y1 = crop
        width, height = res
        low = [max(at - MARGIN, 0) // BLOCK * BLOCK for at in (x0, y0)]
        high = [min(-(-(at + MARGIN) // BLOCK) * BLOCK, end) for at, end in ((x1, width), (y1, height))]
        return low[0], low[1], high[0], high[1]

    def resolve(
        self, sums: Sums, crop: Rectangle, lanes: int, look: Callable[[Samples], Sums]
    ) -> tuple[Sums, int]:
        """Return the picture, and how many of its pixels were sampled again.

        Parameters
        ----------
        sums
            Of one sample for each pixel of the crop.
        lanes
            Rays that a work-item carries.
        look
            Renders samples.
        """
        if self.is_plain:
            return sums, 0
        levels = self._levels(sums, crop, lanes, look) if self.samples > 1 else []
        return self._put_together(sums, levels), sum(len(level.pixels) for level in levels)

    def _levels(
        self, sums: Sums, crop: Rectangle, lanes: int, look: Callable[[Samples], Sums]
    ) -> list[_Level]:
        """Sample pixels again, in ever more samples; each pixel is of one level."""
        scale = _scale(sums.radiance)
        wanted = _bends(sums.radiance, scale)
        corner, levels = np.array(crop[:2]), []
        counts, is_single = sums.samples.copy(), ~wanted
        before, per_pixel = self._single(sums, _in_blocks(wanted)), 2
        while per_pixel**2 <= self.samples and len(before.pixels):
            weights, nearest = self._weights.of_samples(per_pixel), _nearest_to_sides(per_pixel)
            is_last = (2 * per_pixel) ** 2 > self.samples
            found, wanted, outermost, done = [], np.zeros_like(wanted), [], 0
            for pixels in _parts_of(before.pixels + corner, per_pixel):
                samples = pack(pixels, per_pixel, lanes)
                seen = look(samples).at(samples.index)
                part = _level(pixels - corner, seen, weights)
                found.append(_joined(_rows(before, slice(done, done + len(pixels))), part))
                done += len(pixels)
                x, y = part.pixels.T
                counts[y, x] += part.counts
                if not is_last:
                    wanted[y, x] = _spread(seen.radiance, sums.radiance[y, x], scale[y, x]) > SPREAD
                    outermost.append(seen.radiance[:, nearest])
            if outermost:
                sides = np.concatenate(outermost)
                wanted |= _across(before.pixels, sides, sums.radiance, scale, is_single)
            more = [self._single(sums, np.argwhere(wanted & is_single)[:, ::-1])]
            is_single &= ~wanted
            for part in _taken(found):
                levels.append(_some(part, ~wanted, counts))
                more.append(_some(part, wanted, counts))
            before, per_pixel = _concatenated(more), 2 * per_pixel
        return levels

    def _single(self, sums: Sums, pixels: NDArray[np.int64]) -> _Level:
        """Return the single samples of some pixels."""
        index = pixels[:, 1:] * sums.samples.shape[1] + pixels[:, :1]
        return _level(pixels, sums.at(index), self._weights.of_samples(1))

    def _put_together(self, sums: Sums, levels: list[_Level]) -> Sums:
        """Filter single samples and levels."""
        made = {name: self._filtered(part, name, levels) for name, part in _parts(sums).items()}
        opacity = made["opacity"]
        depth = np.divide(made["depth"], opacity, out=np.zeros_like(opacity), where=opacity > 0)
        counts, albedo = sums.samples.copy(), None
        solid = None
        if sums.of_solids is not None:
            solid = _beside(sums.of_solids, sums.albedo[..., 3:])
        for level in levels:
            x, y = level.pixels.T
            counts[y, x] = level.counts
            if solid is not None and level.nearest is not None:
                solid[y, x] = level.nearest
        if "albedo" in made and solid is not None:
            albedo = _beside(made["albedo"], solid[..., 4:])
        return replace(
            sums,
            radiance=made["radiance"],
            light_seen=made["light_seen"],
            transmittance=_beside(made["transmittance"], depth),
            samples=counts,
            emitted=made.get("emission"),
            of_solids=None if solid is None else solid[..., :4],
            of_albedo=albedo,
            of_errors=made.get("errors"),
            of_lattice=made.get("lattice"),
            of_orders=made.get("orders"),
            of_emission_light=made.get("emission_light"),
            added=None if sums.added is None else _layers(made["added"]),
            of_orders_up_to=None if sums.of_orders_up_to is None else _layers(made["up to orders"]),
            shows_through=made["shows_through"],
        )

    @cached_property
    def _weights(self) -> _Weights:
        return _Weights(self.filter)

    def _filtered(self, part: Floats, name: str, levels: list[_Level]) -> Floats:
        """Filter a part of the sums, [h, w, channels]."""
        reach, out = self._weights.reach, _beside(part)
        for level in levels:
            x, y = level.pixels.T
            out[y, x] = 0 if reach else level.parts[name][:, 0, 0]
        if not reach:
            return out
        out = self._weights.spread(out)
        height, width = part.shape[:2]
        for level, dy, dx in product(levels, range(-reach, reach + 1), range(-reach, reach + 1)):
            x, y = (level.pixels - (dx, dy)).T
            here = (x >= 0) & (y >= 0) & (x < width) & (y < height)
            out[y[here], x[here]] += level.parts[name][here, dy + reach, dx + reach]
        return self._weights.normalised(out)


PLAIN = Antialiasing()


class _Weights:
    """What a filter makes of single samples, which stand for all of their pixel, and of several.

    Parameters
    ----------
    name
        Of the filter.
    """

    def __init__(self, name: str) -> None:
        self._filter = FILTERS[name]
        self.reach = int(np.ceil(self._filter.radius - 0.5))
        """Pixels to each side."""
        along = (np.arange(QUADRATURE) + 0.5) / QUADRATURE - 0.5
        shares = self._filter(self._offsets[:, None] + along).mean(axis=1)
        self._of_pixels = shares / shares.sum()

    @property
    def _offsets(self) -> NDArray[np.int64]:
        return np.arange(-self.reach, self.reach + 1)

    def of_samples(self, per_pixel: int) -> Floats:
        """Return the weights [samples, 2 reach + 1, 2 reach + 1] for pixels above and left of theirs (y, x).

        Those of an offset add up to what a single sample weighs there: an even picture stays even.
        """
        at = pattern(per_pixel) - 0.5
        x, y = (self._filter(self._offsets + place[:, None]) for place in at.T)
        raw = y[:, :, None] * x[:, None, :]
        together = raw.sum(axis=0)
        shares = np.divide(raw, together, out=np.full_like(raw, 1 / len(raw)), where=together > 0)
        return np.asarray(shares * self._of_pixels[:, None] * self._of_pixels, np.float32)

    def spread(self, picture: Floats) -> Floats:
        """Filter single samples, [h, w, …]; beyond its edges there are none."""
        for axis in range(2) if self.reach else ():
            picture = np.moveaxis(picture, axis, 0)
            out = np.float32(self._of_pixels[self.reach]) * picture
            for k in range(1, self.reach + 1):
                share = np.float32(self._of_pixels[self.reach + k])
                out[k:] += share * picture[:-k]
                out[:-k] += share * picture[k:]
            picture = np.moveaxis(out, 0, axis)
        return picture

    def normalised(self, picture: Floats) -> Floats:
        """Make up for what lies beyond the edges."""
        if self.reach:
            height, width = picture.shape[:2]
            picture = picture / self.spread(np.ones((height, width, 1), np.float32))
        return picture


def _parts(sums: Sums) -> dict[str, Floats]:
    """Return what of the sums may be filtered, […, channels]."""
    opacity: Floats = np.float32(1) - (_together(sums.transmittance) / np.float32(3))[..., None]
    parts: dict[str, Floats] = {
        "radiance": sums.radiance,
        "light_seen": sums.light_seen,
        "transmittance": sums.transmittance[..., :3],
        "opacity": opacity,
        "depth": opacity * sums.transmittance[..., 3:],
        "shows_through": sums.transmittance[..., :3],
    }
    if sums.of_solids is not None:
        is_free = np.isinf(sums.of_solids[..., 3:]) | (sums.albedo[..., 3:] > 0)
        through = np.empty((*is_free.shape[:-1], 3), np.float32)
        for rows in rows_at_once(through.shape):
            through[rows] = sums.transmittance[rows, :, :3]
            # What haze hides of solids, the background shows: then they are not opaque.
            left = np.float32(1) - sums.radiance[rows, :, 3:]
            before = through[rows].mean(axis=-1, keepdims=True)
            hazy = np.divide(left, before, out=np.zeros_like(left), where=before > 0)
            through[rows] *= np.where(is_free[rows], np.float32(1), hazy)
        parts["shows_through"] = through
        parts["albedo"] = sums.albedo[..., :3]
    others = {
        "emission": sums.emitted,
        "errors": sums.of_errors,
        "lattice": sums.of_lattice,
        "orders": sums.of_orders,
        "emission_light": sums.of_emission_light,
    }
    for name, several in (("added", sums.added), ("up to orders", sums.of_orders_up_to)):
        if several is not None:
            beside = several.shape[0] * several.shape[-1]
            others[name] = np.moveaxis(several, 0, -2).reshape(*opacity.shape[:-1], beside)
    return parts | {name: part for name, part in others.items() if part is not None}


def _layers(added: Floats) -> Floats:
    """Return layers [layers, h, w, 4] that were beside each other, [h, w, 4 layers]."""
    return np.moveaxis(added.reshape(*added.shape[:2], -1, 4), 2, 0)


def _together(rgb: Floats) -> Floats:
    """Add up three channels: NumPy's own sum is slow along so short an axis."""
    together: Floats = rgb[..., 0] + rgb[..., 1] + rgb[..., 2]
    return together


def _scale(radiance: Floats) -> Floats:
    """Return the brightest around each pixel, RGB summed up."""
    brightest = _together(radiance)
    for axis in range(2):
        brightest = _largest_around(np.moveaxis(brightest, axis, 0)).swapaxes(0, axis)
    return np.asarray(np.maximum(brightest, np.float32(3 * BLACK)))


def _largest_around(values: Floats) -> Floats:
    """Return the largest of rows up to `AROUND` above and below, none of which is negative."""
    largest, rows = np.pad(values, ((AROUND, AROUND), (0, 0))), 1
    while rows < 2 * AROUND + 1:
        check_cancelled()
        more = min(rows, 2 * AROUND + 1 - rows)
        largest, rows = np.maximum(largest[:-more], largest[more:]), rows + more
    return largest


def _bends(radiance: Floats, scale: Floats) -> Mask:
    """Find the pixels that are not, along x and y, about the mean of those beside them."""
    bends, last = np.empty(scale.shape, dtype=bool), len(scale) - 1
    for rows in rows_at_once(scale.shape):
        some, around = radiance[rows], scale[rows]
        beside = radiance[np.clip(np.arange(rows.start - 1, rows.stop + 1), 0, last)]
        columns = np.diff(some, axis=1, prepend=some[:, :1], append=some[:, -1:])
        found = np.zeros(around.shape, dtype=bool)
        for second in (np.diff(beside, 2, axis=0), np.diff(columns, axis=1)):
            np.abs(second, out=second)
            found |= (_together(second) > BEND * around) | (second[..., 3] > BEND)
        bends[rows] = found
    return bends


def _beside(*parts: Floats) -> Floats:
    """Copy pictures [h, w, channels], their channels beside each other."""
    copied = np.empty((*parts[0].shape[:2], sum(part.shape[2] for part in parts)), np.float32)
    for rows in rows_at_once(copied.shape):
        np.concatenate([part[rows] for part in parts], axis=2, out=copied[rows])
    return copied


def _spread(samples: Floats, single: Floats, scale: Floats) -> Floats:
    """How far the samples of pixels, [n, samples, 4] and [n, 4], are from each other."""
    width = np.maximum(samples.max(axis=1), single) - np.minimum(samples.min(axis=1), single)
    return np.asarray(np.maximum(_together(width) / scale, width[:, 3]))


def _nearest_to_sides(per_pixel: int) -> NDArray[np.intp]:
    """Return which sample of a pixel is the nearest to each of its `SIDES`."""
    return np.array([(pattern(per_pixel) @ (x, y)).argmax() for y, x in SIDES])


def _across(
    pixels: NDArray[np.int64], outermost: Floats, single: Floats, scale: Floats, is_single: Mask
) -> Mask:
    """Find pixels that differ by more than `SPREAD` from those beside them, where they meet.

    Parameters
    ----------
    pixels
        x, y [n, 2], all that were sampled.
    outermost
        [n, sides, 4], RGBA of their samples nearest to each of `SIDES`.
    single
        Of one sample for each pixel of the crop, [h, w, 4].
    scale
        Of all pixels.
    is_single
        Those that have no more than that, which are found too.
    """
    height, width = scale.shape
    x, y = pixels.T
    number = np.full((height + 2, width + 2), -1, np.int32)
    number[y + 1, x + 1] = np.arange(len(pixels))
    found = np.zeros_like(is_single)
    for side, (dy, dx) in enumerate(SIDES):
        row, column = y + dy, x + dx
        other = number[row + 1, column + 1]
        inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
        alone = np.zeros_like(inside)
        alone[inside] = is_single[row[inside], column[inside]]
        one = np.flatnonzero((other >= 0) | alone)
        row, column, other, alone = row[one], column[one], other[one], alone[one]
        there = np.where(alone[:, None], single[row, column], outermost[other, side ^ 1])
        differs = _spread(outermost[one, side, None], there, scale[row, column]) > SPREAD
        found[row[differs], column[differs]] = True
    return found


def _in_blocks(wanted: Mask) -> NDArray[np.int64]:
    """Return the pixels x, y [n, 2] of a mask, sorted by blocks."""
    return in_blocks(np.argwhere(wanted)[:, ::-1])


def _parts_of(pixels: NDArray[np.int64], per_pixel: int) -> Iterator[NDArray[np.int64]]:
    """Cut pixels, sorted by block, into as many parts as memory needs: never within a block."""
    blocks = pixels // BLOCK
    begins = np.flatnonzero(np.r_[True, (blocks[1:] != blocks[:-1]).any(axis=1)])
    most = MOST_SAMPLES // per_pixel**2
    cuts = np.flatnonzero(np.diff(begins // most, prepend=-1))
    for first, end in pairwise([*begins[cuts].tolist(), len(pixels)]):
        yield pixels[first:end]


def _level(pixels: NDArray[np.int64], seen: Sums, weights: Floats) -> _Level:
    """Put the samples of pixels together.

    Parameters
    ----------
    pixels
        x, y [n, 2] of the crop.
    seen
        Their samples, [n, samples, …].
    weights
        Of the samples, as `_Weights.of_samples` returns them.
    """
    nearest = None
    if seen.of_solids is not None:
        solids = np.concatenate([seen.of_solids, seen.albedo[..., 3:]], axis=-1)
        nearest = solids[np.arange(len(pixels)), solids[..., 3].argmin(axis=1)]
    flat = weights.reshape(len(weights), -1)
    return _Level(
        pixels,
        {
            name: (flat.T @ part).reshape(len(pixels), *weights.shape[1:], part.shape[-1])
            for name, part in _parts(seen).items()
        },
        nearest,
        seen.samples.sum(axis=1, dtype=np.uint32),
        np.full(len(pixels), len(weights), np.float32),
    )


def _taken(parts: list[_Level]) -> Iterator[_Level]:
    """Take parts off a list, which holds them no longer."""
    while parts:
        yield parts.pop()


def _rows(level: _Level, rows: slice | Mask | NDArray[np.intp]) -> _Level:
    """Return some of the pixels."""
    return _Level(
        level.pixels[rows],
        {name: part[rows] for name, part in level.parts.items()},
        None if level.nearest is None else level.nearest[rows],
        level.counts[rows],
        level.taken[rows],
    )


def _some(level: _Level, kept: Mask, counts: NDArray[np.uint32]) -> _Level:
    """Return those of the pixels that are kept, with all densities that were read for them."""
    x, y = level.pixels.T
    part = _rows(level, kept[y, x])
    x, y = part.pixels.T
    return part._replace(counts=counts[y, x])


def _joined(before: _Level, more: _Level) -> _Level:
    """Add further samples of the same pixels: all weigh the same."""
    nearest = more.nearest
    if before.nearest is not None and nearest is not None:
        nearest = np.where(before.nearest[:, 3:4] < nearest[:, 3:4], before.nearest, nearest)
    taken = before.taken + more.taken
    share: Floats = (more.taken / taken)[:, None, None, None]
    parts = {name: (1 - share) * part + share * more.parts[name] for name, part in before.parts.items()}
    return _Level(more.pixels, parts, nearest, more.counts, taken)


def _concatenated(levels: list[_Level]) -> _Level:
    """Put parts of a level together, sorted by blocks."""
    nearest = [level.nearest for level in levels if level.nearest is not None]
    together = _Level(
        np.concatenate([level.pixels for level in levels]),
        {name: np.concatenate([level.parts[name] for level in levels]) for name in levels[0].parts},
        np.concatenate(nearest) if nearest else None,
        np.concatenate([level.counts for level in levels]),
        np.concatenate([level.taken for level in levels]),
    )
    return _rows(together, block_order(together.pixels))
