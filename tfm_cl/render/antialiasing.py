"""Anti-aliasing: pixels that differ from those beside them are sampled again, and all are filtered.

One sample says enough where a picture is smooth: its second differences tell. Pixels whose samples differ, or
differ from those across their border, get four times as many more: an edge passes there. Where the last of
them show it leave a pixel, it is followed into the next. A pixel is the mean of all samples that it has.
Nothing depends on what lies further away than `MARGIN`: a crop shows what the whole frame would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import pairwise, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import check_cancelled
from tfm_cl.render.raster import BLOCK, block_order, pack, pattern
from tfm_cl.render.rows import rows_at_once
from tfm_cl.scene.pixel_filters import FILTERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfm_cl.render.buffers import Sums
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.raster import Samples

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

BEND = 0.08
"""Second difference beyond which a pixel is sampled again: of RGB over the brightest near; of alpha."""
SPREAD = 0.4
"""Difference between samples, likewise, beyond which their pixels get four times as many more.

For as much of the error, they cost several times what the first four do.
"""
ACROSS = 0.3
"""Difference, likewise, across the border of two pixels beyond which both do."""
FOLLOWED = 3
"""Pixels along which an edge is followed from one that has all samples."""
AROUND = 8
"""Pixels to each side in which the brightest is looked for: what is dark beside it is hardly seen."""
BLACK = 1e-4
"""Radiance below which nothing is seen."""
MARGIN = 20
"""Pixels around a crop that say something of it: `AROUND`, `FOLLOWED`, and one for each level, filter."""
MOST_SAMPLES = 1 << 20
"""That are held at once."""
QUADRATURE = 64
"""Points along a side of a pixel at which filters are summed up."""
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Steps y, x to the four pixels beside one, each before its opposite."""
SINGLE, FULL = -1, -2
"""Instead of a pixel's number: it has one sample; it has all, or lies outside."""


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
    spread: Floats
    """[n], how far the last of these, and the single one, are from each other."""
    borders: Floats
    """[n, sides, 2, 4], the least and the most RGBA of the last ones next to each of `SIDES`."""


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
        single, scale = sums.radiance, _scale(sums.radiance)
        numbers = np.pad(np.full(scale.shape, SINGLE, np.int32), 1, constant_values=FULL)
        inside, full = numbers[1:-1, 1:-1], []
        rest = taken = self._single(sums, scale, np.zeros((0, 2), np.int64))
        for step, per_pixel in enumerate(self._steps):
            wanted = _across(taken, rest, single, scale, numbers) if step else _bends(single, scale)
            x, y = rest.pixels.T
            more = wanted[y, x] | (rest.spread > SPREAD)
            first = np.argwhere(wanted & (inside == SINGLE))[:, ::-1]
            found = _concatenated([_rows(rest, more), self._single(sums, scale, first)])
            if not len(found.pixels):
                break
            rest, found = _rows(rest, ~more), _rows(found, block_order(found.pixels))
            taken = self._sampled(found, per_pixel, single, scale, crop, lanes, look)
            if per_pixel == self._steps[-1]:
                full.append(taken)
                x, y = taken.pixels.T
                inside[y, x] = FULL
            else:
                rest = _concatenated([rest, taken])
            x, y = rest.pixels.T
            inside[y, x] = np.arange(len(x))
        return [*full, rest]

    @cached_property
    def _steps(self) -> list[int]:
        """Samples along a side of a pixel."""
        levels = [2**k for k in range(1, self.samples.bit_length() // 2 + 1)]
        return levels + FOLLOWED * levels[-1:]

    def _sampled(
        self,
        found: _Level,
        per_pixel: int,
        single: Floats,
        scale: Floats,
        crop: Rectangle,
        lanes: int,
        look: Callable[[Samples], Sums],
    ) -> _Level:
        """Sample pixels, sorted by blocks, again, beside what they have."""
        weights, corner = self._weights.of_samples(per_pixel), np.array(crop[:2])
        taken, done = [], 0
        for pixels in _parts_of(found.pixels + corner, per_pixel):
            samples = pack(pixels, per_pixel, lanes)
            seen = look(samples).at(samples.index)
            before = _rows(found, slice(done, done + len(pixels)))
            taken.append(_joined(before, _level(pixels - corner, seen, weights, single, scale)))
            done += len(pixels)
        return _concatenated(taken)

    def _single(self, sums: Sums, scale: Floats, pixels: NDArray[np.int64]) -> _Level:
        """Return the single samples of some pixels."""
        index = pixels[:, 1:] * sums.samples.shape[1] + pixels[:, :1]
        return _level(pixels, sums.at(index), self._weights.of_samples(1), sums.radiance, scale)

    def _put_together(self, sums: Sums, levels: list[_Level]) -> Sums:
        """Filter single samples and levels; what the sums hold may be written over."""
        if sums.of_solids is not None:
            # Others may read the G-buffer.
            solids, albedo = sums.of_solids.copy(), sums.albedo.copy()
            sums = replace(sums, of_solids=solids, of_albedo=albedo, shows_through=_shows_through(sums))
        for level in levels:
            x, y = level.pixels.T
            sums.samples[y, x] = level.counts
            if level.nearest is not None:
                sums.solid[y, x], sums.albedo[y, x, 3] = level.nearest[:, :4], level.nearest[:, 4]
        if not self._weights.reach:
            for level in levels:
                _write(level, sums)
            return sums
        made = {name: self._filtered(part, name, levels) for name, part in _parts(sums).items()}
        return replace(
            sums,
            radiance=made["radiance"],
            light_seen=made["light_seen"],
            transmittance=_beside(made["transmittance"], _depth(made)),
            emitted=made.get("emission"),
            of_albedo=_beside(made["albedo"], sums.albedo[..., 3:]) if "albedo" in made else None,
            of_errors=made.get("errors"),
            of_lattice=made.get("lattice"),
            of_orders=made.get("orders"),
            of_emission_light=made.get("emission_light"),
            added=None if sums.added is None else _layers(made["added"]),
            of_orders_up_to=None if sums.of_orders_up_to is None else _layers(made["up to orders"]),
            shows_through=made.get("shows_through"),
        )

    @cached_property
    def _weights(self) -> _Weights:
        return _Weights(self.filter)

    def _filtered(self, part: Floats, name: str, levels: list[_Level]) -> Floats:
        """Filter a part of the sums, [h, w, channels]."""
        reach, out = self._weights.reach, part.copy()
        for level in levels:
            x, y = level.pixels.T
            out[y, x] = 0
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


def _shows_through(sums: Sums) -> Floats:
    """Return how much of a background is seen, […, 3]: of solids but holdouts, what haze hides of them."""
    is_free = np.isinf(sums.solid[..., 3]) | (sums.albedo[..., 3] > 0)
    through = np.empty((*is_free.shape, 3), np.float32)
    for rows in rows_at_once(through.shape):
        seen = sums.transmittance[rows]
        left, before = np.float32(1) - sums.radiance[rows, ..., 3], _together(seen) / np.float32(3)
        hidden = np.divide(left, before, out=np.zeros_like(left), where=before > 0)
        np.copyto(hidden, np.float32(1), where=is_free[rows])
        for channel in range(3):  # short axes are slow
            np.multiply(seen[..., channel], hidden, out=through[rows, ..., channel])
    return through


def _depth(parts: dict[str, Floats]) -> Floats:
    """Return the distance of what media hide, […, 1]."""
    opacity = parts["opacity"]
    return np.divide(parts["depth"], opacity, out=np.zeros_like(opacity), where=opacity > 0)


def _write(level: _Level, sums: Sums) -> None:
    """Put pixels that are filtered by themselves in the place of their single samples."""
    x, y = level.pixels.T
    made = {name: part[:, 0, 0] for name, part in level.parts.items()}
    sums.transmittance[y, x, 3:] = _depth(made)
    for name, picture in _pictures(sums).items():
        picture[y, x] = made[name].reshape(len(x), *picture.shape[2:])


def _pictures(sums: Sums) -> dict[str, Floats]:
    """Return what of the sums may be filtered, [h, w, …, channels], to be read and written."""
    pictures = {
        "radiance": sums.radiance,
        "light_seen": sums.light_seen,
        "transmittance": sums.transmittance[..., :3],
        "shows_through": sums.shows_through,
        "albedo": None if sums.of_solids is None else sums.albedo[..., :3],
        "emission": sums.emitted,
        "errors": sums.of_errors,
        "lattice": sums.of_lattice,
        "orders": sums.of_orders,
        "emission_light": sums.of_emission_light,
        "added": None if sums.added is None else np.moveaxis(sums.added, 0, -2),
        "up to orders": None if sums.of_orders_up_to is None else np.moveaxis(sums.of_orders_up_to, 0, -2),
    }
    return {name: picture for name, picture in pictures.items() if picture is not None}


def _parts(sums: Sums) -> dict[str, Floats]:
    """Return what is filtered, […, channels]."""
    opacity: Floats = np.float32(1) - (_together(sums.transmittance) / np.float32(3))[..., None]
    shape = opacity.shape[:-1]
    parts = {
        name: picture.reshape(*shape, math.prod(picture.shape[len(shape) :]))
        for name, picture in _pictures(sums).items()
    }
    return parts | {"opacity": opacity, "depth": opacity * sums.transmittance[..., 3:]}


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


def _spread(low: Floats, high: Floats, scale: Floats) -> Floats:
    """How far the samples of pixels are from each other, by the least and the most of them, [n, 4]."""
    width = high - low
    return np.asarray(np.maximum(_together(width) / scale, width[:, 3]))


def _range(samples: Floats) -> tuple[Floats, Floats]:
    """Return the least and the most of samples, […, samples, 4]; one by one: short axes are slow."""
    one_by_one = np.moveaxis(samples, -2, 0)
    return reduce(np.minimum, one_by_one), reduce(np.maximum, one_by_one)


def _next_to_sides(per_pixel: int) -> NDArray[np.intp]:
    """Return which samples of a pixel are the quarter next to each of its `SIDES`, [sides, samples]."""
    count = max(1, per_pixel**2 // 4)
    return np.array([np.argsort(pattern(per_pixel) @ (-x, -y), kind="stable")[:count] for y, x in SIDES])


def _across(new: _Level, others: _Level, single: Floats, scale: Floats, numbers: NDArray[np.int32]) -> Mask:
    """Find pixels that differ by more than `ACROSS` from those beside them, where they meet.

    Parameters
    ----------
    new
        Pixels that have just been sampled: they, and those beside them, are found.
    others
        Those that may be sampled more, and have been.
    single
        Of one sample for each pixel of the crop, [h, w, 4].
    scale
        Of all pixels.
    numbers
        [h + 2, w + 2], number in ``others`` of each pixel, with one around the crop; `SINGLE` or `FULL`.
    """
    found = np.zeros(scale.shape, dtype=bool)
    x, y = new.pixels.T
    for side, (dy, dx) in enumerate(SIDES):
        number = numbers[y + dy + 1, x + dx + 1]
        one = np.flatnonzero(number != FULL)
        row, column, number = y[one] + dy, x[one] + dx, number[one]
        low = high = single[row, column]
        several = np.flatnonzero(number != SINGLE)
        if len(several):
            low, high = low.copy(), high.copy()
            low[several], high[several] = others.borders[number[several], side ^ 1].swapaxes(0, 1)
        own_low, own_high = new.borders[one, side].swapaxes(0, 1)
        low, high = np.minimum(low, own_low), np.maximum(high, own_high)
        differs = _spread(low, high, scale[row, column]) > ACROSS
        found[row[differs], column[differs]] = found[y[one][differs], x[one][differs]] = True
    return found


def _parts_of(pixels: NDArray[np.int64], per_pixel: int) -> Iterator[NDArray[np.int64]]:
    """Cut pixels, sorted by block, into as many parts as memory needs: never within a block."""
    blocks = pixels // BLOCK
    begins = np.flatnonzero(np.r_[True, (blocks[1:] != blocks[:-1]).any(axis=1)])
    most = MOST_SAMPLES // per_pixel**2
    cuts = np.flatnonzero(np.diff(begins // most, prepend=-1))
    for first, end in pairwise([*begins[cuts].tolist(), len(pixels)]):
        yield pixels[first:end]


def _level(pixels: NDArray[np.int64], seen: Sums, weights: Floats, single: Floats, scale: Floats) -> _Level:
    """Put the samples of pixels together.

    Parameters
    ----------
    pixels
        x, y [n, 2] of the crop.
    seen
        Their samples, [n, samples, …].
    weights
        Of the samples, as `_Weights.of_samples` returns them.
    single, scale
        As of `_across`.
    """
    x, y = pixels.T
    low, high = _range(seen.radiance)
    low, high = np.minimum(low, single[y, x]), np.maximum(high, single[y, x])
    next_to = seen.radiance[:, _next_to_sides(math.isqrt(len(weights)))]
    nearest = None
    if seen.of_solids is not None:
        seen = replace(seen, shows_through=_shows_through(seen))
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
        _spread(low, high, scale[y, x]),
        np.stack(_range(next_to), axis=2),
    )


def _rows(level: _Level, rows: slice | Mask | NDArray[np.intp]) -> _Level:
    """Return some of the pixels."""
    return _Level(
        level.pixels[rows],
        {name: part[rows] for name, part in level.parts.items()},
        None if level.nearest is None else level.nearest[rows],
        level.counts[rows],
        level.taken[rows],
        level.spread[rows],
        level.borders[rows],
    )


def _joined(before: _Level, more: _Level) -> _Level:
    """Add further samples of the same pixels: all weigh the same."""
    nearest = more.nearest
    if before.nearest is not None and nearest is not None:
        nearest = np.where(before.nearest[:, 3:4] < nearest[:, 3:4], before.nearest, nearest)
    taken = before.taken + more.taken
    share: Floats = (more.taken / taken)[:, None, None, None]
    parts = {name: (1 - share) * part + share * more.parts[name] for name, part in before.parts.items()}
    return more._replace(parts=parts, nearest=nearest, counts=before.counts + more.counts, taken=taken)


def _concatenated(levels: list[_Level]) -> _Level:
    """Put parts of levels together, one behind the other."""
    nearest = [level.nearest for level in levels if level.nearest is not None]
    return _Level(
        np.concatenate([level.pixels for level in levels]),
        {name: np.concatenate([level.parts[name] for level in levels]) for name in levels[0].parts},
        np.concatenate(nearest) if nearest else None,
        *(np.concatenate(of_all) for of_all in zip(*(level[3:] for level in levels), strict=True)),
    )
