"""What is learnt of a light's rays before its map is built: where they hold density, and how."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.device.running import Running
from tfm_cl.maps.bases.curves import CELLS, Curves

if TYPE_CHECKING:
    from tfm_cl.device.field import FieldOnDevice
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.program import Kernel
    from tfm_cl.device.running import Finding
    from tfm_cl.scene.lights import Light

VISIBLE_DEPTH = 8.0
"""Optical depth of the medium at which the range ``visible`` ends: 0.03 % of the light is left. Of 6, 8 and
12 it gave the least error of T at 8 numbers on six volumes; beyond it τ goes on with its mean slope."""
RAYS = 640
"""Light rays that a data-driven basis learns from."""
TEXELS_OF_RAY = 32
"""Of maps that are small because their light is soft: for so many texels there is one of these rays."""
PROBE_BYTES = 20 + 16
"""Of each ray of a probe: its numbers, and those of its place in the field of ranges."""
SEED = 20110218
"""Of their choice: the same scene gives the same map."""


@dataclass(frozen=True)
class Probe:
    """Coarse light rays of one light, distances from the light in world units."""

    begin: NDArray[np.float32]
    """[size, size], where density begins."""
    end: NDArray[np.float32]
    """Where it ends, or the optical depth asked for is reached; equal to ``begin`` where there is none."""
    slope: NDArray[np.float32]
    """Mean density from there to the last density."""
    optical_depth: NDArray[np.float32]
    """Of the density along the whole ray."""
    last: NDArray[np.float32]
    """Where the last density is."""

    @cached_property
    def field(self) -> NDArray[np.float32]:
        """Ranges for all texels between these rays: begin, end, slope, last; float32 [size, size, 4].

        Every entry holds the ranges of its neighbours too, so that what is interpolated between entries
        holds those of all rays in between that look like them. Entries without density get the next ones'.
        """
        dense = self.end > self.begin
        if not dense.any():
            return np.zeros((*dense.shape, 4), np.float32)
        # What is far from all density is the same everywhere.
        near = _box_around(dense, 2)
        found = self._ranges(dense, near)
        nothing = found[..., 0].min()
        field = np.full((*dense.shape, 4), (nothing, nothing, 0, nothing), np.float32)
        field[near] = found
        return field

    def _ranges(self, dense: NDArray[np.bool_], near: tuple[slice, slice]) -> NDArray[np.float32]:
        """Return the part of `field` that holds all density, and two entries around it."""
        dense = dense[near]
        begin = np.where(dense, self.begin[near], np.inf)
        end = np.where(dense, self.end[near], -np.inf)
        begin, end = _over_neighbours(begin, np.minimum), _over_neighbours(end, np.maximum)
        # The next ring: what lies between it and the ranges above is still interpolated smoothly.
        missing = ~np.isfinite(begin)
        begin = np.where(missing, _over_neighbours(begin, np.minimum), begin)
        end = np.where(missing, _over_neighbours(end, np.maximum), end)
        # Nothing is near the rest.
        missing = ~np.isfinite(begin)
        nothing = begin.min()
        begin, end = np.where(missing, nothing, begin), np.where(missing, nothing, end)
        slope = np.where(dense, self.slope[near], 0)
        # Without density there is none beyond: the end serves, so that what is interpolated stays whole.
        last = np.where(dense, self.last[near], end)
        return np.stack([begin, end, slope, last], axis=-1).astype(np.float32, copy=False)

    def global_field(self) -> NDArray[np.float32]:
        """One range for all rays, that of the nearest and the farthest density; float32 [2, 2, 4]."""
        dense = self.end > self.begin
        near, far = (self.begin[dense].min(), self.end[dense].max()) if dense.any() else (0.0, 0.0)
        margin = GLOBAL_MARGIN * (far - near)
        return np.broadcast_to(
            np.array([max(near - margin, 0.0), far + margin, 0, 0], np.float32), (2, 2, 4)
        ).copy()


GLOBAL_MARGIN = 0.02
"""Of the range ``global``, at either end: density between the coarse rays may begin before theirs."""


class LightProbe:
    """Runs ``probe.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def ranges(
        self,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        size: int,
        cut: float,
        steps: int,
        clip: NDArray[np.float32] | None = None,
    ) -> Finding[Probe]:
        """Begin to march coarse light rays, ``size`` × ``size`` of them.

        Parameters
        ----------
        of_light
            The light's struct.
        medium
            The density.
        cut
            Optical depth of the density at which a range ends; infinite for none.
        steps
            Along a ray between the medium's bounds.
        clip
            Distances [size, size] beyond which nothing is lit; None for none.
        """
        launcher = self._launcher
        kernel = self._kernel("light_ranges", light, medium, clipped=clip is not None)
        ranges = launcher.empty("the light's ranges", 16 * size * size, reuse=True)
        lasts = launcher.empty("the light's ranges", 4 * size * size, reuse=True)
        met = medium.met_by(light, of_light, size)
        running = launcher.start_windows(
            kernel,
            (0, 0, size, size),
            steps + met.longest,
            {
                **met.arguments,
                "light": of_light,
                "clip": launcher.upload(
                    "the solids' distances", np.zeros(1, np.float32) if clip is None else clip
                ),
                "ranges": ranges,
                "lasts": lasts,
                "size": size,
                "steps": steps,
                "cut": min(cut, 1e30),
            },
        )
        copied = launcher.start_download(ranges, (size, size, 4), np.float32)
        copied_last = launcher.start_download(lasts, (size, size), np.float32)

        def read() -> Probe:
            found = copied()
            return Probe(found[..., 0], found[..., 1], found[..., 2], found[..., 3], copied_last())

        return launcher.finding(running, read, PROBE_BYTES * size * size)

    def curves(
        self,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        probe: Probe,
        field: NDArray[np.float32] | None,
        extinction: float,
    ) -> Finding[Curves]:
        """Begin to sample some rays that meet density.

        Parameters
        ----------
        field
            Their ranges, for each of the probe's rays or one for all; None for the medium's bounds.
        """
        launcher = self._launcher
        size = len(probe.begin)
        most = RAYS if light.most_texels is None else min(RAYS, light.most_texels**2 // TEXELS_OF_RAY)
        y, x = some_of(probe.optical_depth > 0, most)
        ranges = np.broadcast_to(np.array([0, np.inf], np.float32), (len(x), 2))
        if field is not None:
            each = len(field) == size
            ranges = field[y, x, :2] if each else np.broadcast_to(field[0, 0, :2], (len(x), 2))
        rays = np.column_stack([(x + 0.5) / size, (y + 0.5) / size, ranges]).astype(np.float32)
        if len(rays) == 0:
            none = Curves(np.zeros((0, CELLS + 1)), extinction)
            return launcher.finding(Running(lambda: 0.0), lambda: none, 0)
        out = launcher.empty("the light's curves", 4 * len(rays) * (CELLS + 1), reuse=True)
        running = launcher.start(
            self._kernel("light_curves", light, medium),
            (-(-len(rays) // launcher.lanes),),
            {
                **medium.met_by(light, of_light, size).arguments,
                "light": of_light,
                "rays": launcher.upload("the light's rays", rays),
                "size": size,
                "curves": out,
                "count": len(rays),
            },
        )
        copied = launcher.start_download(out, (len(rays), CELLS + 1), np.float32)

        def read() -> Curves:
            return Curves(copied().astype(np.float64), extinction)

        return launcher.finding(running, read, 8 * len(rays) * (CELLS + 1))

    def _kernel(self, name: str, light: Light, medium: FieldOnDevice, *, clipped: bool = False) -> Kernel:
        defines = light_defines(light) | {"TFM_SHADOW": int(clipped)} | medium.defines
        return self._launcher.kernels.kernel(name, "probe.cl", (*medium.headers, *light.headers), defines)


def some_of(rays: NDArray[np.bool_], most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Choose some of the rays [size, size] that there are: y, x.

    Each has its turn, whichever others there are: as a medium moves on, few of the chosen change, and so do
    the functions that are learnt from them.
    """
    order = _in_turn(rays.size)
    some = order[np.flatnonzero(rays.ravel()[order])[:most]]
    y, x = np.divmod(some, rays.shape[1])
    return y, x


@lru_cache(maxsize=4)
def _in_turn(count: int) -> NDArray[np.intp]:
    """Return the numbers of so many rays in the order in which they have their turns."""
    order: NDArray[np.intp] = np.argsort(np.random.default_rng(SEED).permutation(count))
    return order


def light_defines(light: Light) -> dict[str, int | str]:
    """Return macros of every kernel that knows of a light."""
    falls_off = light.falloff == "inverse-square"
    return {"TFM_INVERSE_SQUARE": 2 if falls_off and light.core > 0 else int(falls_off)}


def _box_around(entries: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """Return the rows and columns that hold all entries that are set, and a margin."""
    lines = (np.flatnonzero(entries.any(axis=axis)) for axis in (1, 0))
    rows, columns = (slice(max(int(found[0]) - margin, 0), int(found[-1]) + margin + 1) for found in lines)
    return rows, columns


def _over_neighbours(values: NDArray[np.floating], choose: np.ufunc) -> NDArray[np.floating]:
    """Reduce every entry and its eight neighbours."""
    rows = values.copy()
    choose(rows[1:], values[:-1], out=rows[1:])
    choose(rows[:-1], values[1:], out=rows[:-1])
    chosen = rows.copy()
    choose(chosen[:, 1:], rows[:, :-1], out=chosen[:, 1:])
    choose(chosen[:, :-1], rows[:, 1:], out=chosen[:, :-1])
    return chosen
