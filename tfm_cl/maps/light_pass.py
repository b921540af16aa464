"""The light pass: from one field of density to one transmittance function map (TFM algorithm 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.constants import MARCH_LEVELS, NUMBERS_UNIT, OWN_DEPTH_ROWS, STORAGE_BITS, TARGETS
from tfm_cl.device.running import Running
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import FITS, LOOKUPS
from tfm_cl.maps.prefilter import Prefilter
from tfm_cl.maps.probe import light_defines

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfm_cl.device.field import FieldOnDevice
    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.device.program import Kernel
    from tfm_cl.device.structs.base import Struct
    from tfm_cl.maps.planned import MapPlan
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.scene.lights import Light

RESIDUAL_STEPS = 4
"""Times the map's steps: of the march that a map is measured by, so that it is not measured by its own
errors."""

READ_AROUND = 3
"""Texels beyond those with a range that are read with them: neighbours between which is interpolated, and
theirs, with a weight of 0."""
MOST_PARTS = 4096
"""Parts of a map whose limits are found apart: enough work-items for any device, few enough for the host."""


def steps_of_tables(settings: ResolvedMap) -> list[int]:
    """List the steps of each table of the basis: one for each level, the medium's bounds take all steps.

    One more tells the depths of primitives apart that are not marched.
    """
    if settings.range == "box":
        levels = [0] * (MARCH_LEVELS - 1) + [settings.steps]
    else:
        levels = [-(-settings.steps * level // MARCH_LEVELS) for level in range(1, MARCH_LEVELS + 1)]
    return [*levels, *([OWN_DEPTH_ROWS] if settings.deposits == "depth" else [])]


def map_variant(settings: ResolvedMap) -> tuple[str, dict[str, int | str]]:
    """Header and macros of every kernel that reads or writes a map of such resolved settings."""
    return BASES[settings.basis].header, {
        "TFM_N_COEFF": settings.coeffs,
        "TFM_STORAGE_BITS": STORAGE_BITS[settings.storage],
        "TFM_TARGET": TARGETS[settings.target],
        "TFM_FIT": FITS[settings.fit],
        "TFM_RANGE": int(settings.range != "box"),
        "TFM_LOOKUP": LOOKUPS[settings.between_texels],
    }


@dataclass(frozen=True)
class Numbers:
    """Where a map's coefficients are on the device."""

    buffer: cl.Buffer
    """Of one or several maps: [res, res, n] each, in the map's storage type."""
    first: int
    """Where they begin, in units of `NUMBERS_UNIT`."""


def numbers_size(settings: ResolvedMap) -> int:
    """Room for a map and one texel more, as two neighbours may be read at once; in `NUMBERS_UNIT`."""
    return -(-settings.coeffs * (settings.res**2 + 1) // NUMBERS_UNIT)


def map_bytes(settings: ResolvedMap) -> int:
    """Bytes on the device of a map's coefficients."""
    return numbers_size(settings) * NUMBERS_UNIT * STORAGE_BITS[settings.storage] // 8


class Counts:
    """What a light pass counted: its launches, when they have ended, and what was known before.

    Parameters
    ----------
    hits
        Texels whose ray has a range.
    samples
        Densities read.
    """

    def __init__(self, hits: int = 0, samples: int = 0) -> None:
        self._totals = hits, samples
        self._copies: list[Callable[[], NDArray[np.uint32]]] = []

    def add(self, copied: Callable[[], NDArray[np.uint32]]) -> None:
        """Add what the tiles of a launch counted, [..., 2]; ``copied`` waits for it."""
        self._copies.append(copied)

    @property
    def totals(self) -> tuple[int, int]:
        """Hits and samples, of launches that are waited for."""
        while self._copies:
            met, read = self._copies[-1]().reshape(-1, 2).sum(axis=0, dtype=np.int64)
            self._totals = self._totals[0] + int(met), self._totals[1] + int(read)
            self._copies.pop()
        return self._totals


@dataclass(frozen=True)
class MapBuffers:
    """A map on the device."""

    numbers: Numbers
    limits: NDArray[np.float32]
    """[n, 2] lowest value and extent, for 8 bits."""
    occupied: cl.Buffer
    """float2 [res, res]: where density begins and ends, distances from the light; 0 without."""
    window: tuple[int, int, int, int]
    """Texels x0, y0, x1, y1 outside of which no ray has a range: there both hold anything, which means 0."""
    running: Running
    """Its light pass, which may not have ended: what is asked of that waits. Kernels that read the map need
    not be waited for, as the device takes one after the other."""
    counts: Counts
    """Of the pass, when it has ended."""
    before: float = 0.0
    """Device time of what was done for the map before its pass."""

    @property
    def seconds(self) -> float:
        """Device time."""
        return self.before + self.running.wait()

    @property
    def samples(self) -> int:
        """Densities read."""
        self.running.wait()
        return self.counts.totals[1]

    @property
    def hits(self) -> int:
        """Texels whose ray has a range."""
        self.running.wait()
        return self.counts.totals[0]


@dataclass(frozen=True)
class StoredNumbers:
    """A map on the host, bit by bit."""

    values: NDArray[Any]
    """[res, res, n], in the type of `STORED`."""
    limits: NDArray[np.float32]
    """[n, 2], as of `MapBuffers`."""
    occupied: NDArray[np.float32]
    """[res, res, 2], as of `MapBuffers`."""
    samples: int
    hits: int


STORED: dict[str, type[np.generic]] = {"f32": np.float32, "f16": np.float16, "u8": np.uint8}
"""Storage of a map -> type of its numbers."""


class LightPass:
    """Runs ``light_pass.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher, self.turn = launcher, launcher.turn
        self._prefilter = Prefilter(launcher)
        self._last_tables: tuple[ResolvedMap, tuple[cl.Buffer, cl.Buffer]] | None = None

    def room(self, settings: ResolvedMap, maps: int) -> list[Numbers]:
        """Allocate room for some maps, in as few buffers as the device allows."""
        launcher, size, nbytes = self._launcher, numbers_size(settings), map_bytes(settings)
        together = max(1, launcher.largest_buffer // nbytes)
        found: list[Numbers] = []
        for start in range(0, maps, together):
            count = min(together, maps - start)
            if settings.res == 1:  # then the texel beyond is read, and weighs 0
                buffer = launcher.zeros("the map", count * nbytes)
            else:
                buffer = launcher.empty("the map" if count == 1 else "the maps", count * nbytes, reuse=True)
            found += [Numbers(buffer, i * size) for i in range(count)]
        return found

    def build(
        self,
        plan: MapPlan,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        room: Numbers,
        progress: Progress,
        meanwhile: Callable[[], None] | None = None,
    ) -> MapBuffers:
        """Begin to project the transmittance along every light ray of the map.

        Parameters
        ----------
        of_light
            The light's struct.
        medium
            The density.
        room
            Where the coefficients go.
        meanwhile
            What the host does first while the device is at it.
        """
        launcher, settings = self._launcher, plan.settings
        res = settings.res
        kernel = self._kernel("light_pass", settings, light, medium, clipped=plan.clip is not None)
        none = np.zeros(1, np.float32)
        tables, starts = self._tables(plan)
        # Straight to where they stay, unless something is still done to them.
        is_last = settings.storage == "f32" and settings.blur == 0
        struct = plan.struct()
        struct["first_number"] = room.first if is_last else 0
        target = room.buffer if is_last else self._floats(settings)
        occupied = launcher.empty("the map's occupied ranges", 8 * res * res, reuse=True)
        window = written = 0, 0, res, res
        if settings.target != "transmittance":  # of which zeros may mean something
            window = launcher.widened(plan.window, (res, res), READ_AROUND)
            if is_last:
                written = window
            else:
                launcher.clear(target, 4 * NUMBERS_UNIT * numbers_size(settings))
                launcher.clear(occupied, 8 * res * res)
        counting = _Counting(launcher, window)
        met = medium.met_by(light, of_light, res)
        running = launcher.start_windows(
            kernel,
            window,
            settings.steps + met.longest,
            {
                **met.arguments,
                "light": of_light,
                "map": launcher.upload("the map's parameters", struct),
                "ranges": launcher.upload("the ranges of the rays", plan.field),
                "tables": tables,
                "table_starts": starts,
                "clip": launcher.upload("the solids' distances", none if plan.clip is None else plan.clip),
                "coefficients": target,
                "occupied": occupied,
                "counts": counting.buffer,
            },
            done=lambda part: progress("light pass", part),
            begun=counting.add,
            meanwhile=meanwhile,
        )
        limits = np.zeros((settings.coeffs, 2), np.float32)
        if not is_last:
            blurred, blurring = self._prefilter.blur(
                target, res, settings.coeffs, settings.blur, settings.blur_kernel
            )
            limits, packing = self._pack(plan, light, medium, blurred, room)
            seconds = running.wait() + blurring + packing
            running = Running(lambda: seconds)
        return MapBuffers(room, limits, occupied, written, running, counting.counts)

    def _tables(self, plan: MapPlan) -> tuple[cl.Buffer, cl.Buffer]:
        """Return the tables of the basis, one behind the other, and where each begins.

        Those of functions that are not learnt are the same in the next frame.
        """
        settings = plan.settings.without_alpha  # which follows each frame
        if self._last_tables is not None and self._last_tables[0] == settings:
            return self._last_tables[1]
        basis, functions = BASES[plan.settings.basis], plan.functions
        tables = [
            basis.table(functions, plan.settings, steps)
            if steps and functions is not None
            else np.zeros(0, np.float32)
            for steps in steps_of_tables(plan.settings)
        ]
        starts = np.cumsum([0, *map(len, tables[:-1])], dtype=np.int32)
        found = (
            self._launcher.upload("the basis's tables", np.concatenate(tables)),
            self._launcher.upload("their starts", starts),
        )
        if not plan.settings.learns:
            self._last_tables = settings, found
        return found

    def _floats(self, settings: ResolvedMap) -> cl.Buffer:
        nbytes = 4 * NUMBERS_UNIT * numbers_size(settings)
        return self._launcher.empty("the map's coefficients", nbytes, reuse=True)

    def _pack(
        self, plan: MapPlan, light: Light, medium: FieldOnDevice, coefficients: cl.Buffer, room: Numbers
    ) -> tuple[NDArray[np.float32], float]:
        """Store the coefficients in the type asked for; 8 bits span each coefficient's own range."""
        settings = plan.settings
        launcher, texels, n = self._launcher, settings.res**2, settings.coeffs
        limits, seconds = np.zeros((n, 2), np.float32), 0.0
        if settings.storage == "u8":
            kernel = self._kernel("coefficient_limits", settings, light, medium)
            limits, seconds = self._limits(kernel, coefficients, texels, n)
        struct = plan.struct()
        struct["first_number"] = room.first
        seconds += launcher.run(
            self._kernel("pack_map", settings, light, medium),
            (texels,),
            {
                "map": launcher.upload("the map's parameters", struct),
                "coefficients": coefficients,
                "numbers": room.buffer,
                "limits": launcher.upload("the coefficients' limits", limits),
                "scale": 1 / plan.number_unit,
                "count": texels,
            },
        )
        return limits, seconds

    def _limits(
        self, kernel: Kernel, coefficients: cl.Buffer, texels: int, n: int
    ) -> tuple[NDArray[np.float32], float]:
        """Return the lowest value and the extent of each coefficient, [n, 2], and the device's seconds."""
        launcher, part = self._launcher, -(-texels // MOST_PARTS)
        parts = -(-texels // part)
        lowest, highest = (
            launcher.empty("the coefficients' limits", 4 * parts * n, reuse=True) for _ in range(2)
        )
        seconds = launcher.run(
            kernel,
            (parts,),
            {
                "coefficients": coefficients,
                "lowest": lowest,
                "highest": highest,
                "part": part,
                "count": texels,
            },
        )
        low = launcher.download(lowest, (parts, n), np.float32).min(axis=0)
        high = launcher.download(highest, (parts, n), np.float32).max(axis=0)
        return np.stack([low, high - low], axis=1), seconds

    def arguments(self, plan: MapPlan, buffers: MapBuffers) -> dict[str, Any]:
        """Return what kernels that read this map alone take."""
        upload = self._launcher.upload
        struct = plan.struct()
        struct["first_number"] = buffers.numbers.first
        return {
            "maps": upload("the map's parameters", struct),
            "numbers": buffers.numbers.buffer,
            "limits": upload("the coefficients' limits", buffers.limits),
            "ranges": upload("the ranges of the rays", plan.field),
            "modes": upload("the basis's functions", plan.modes),
        }

    def evaluate(
        self,
        plan: MapPlan,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        buffers: MapBuffers,
        points: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Optical depth of the density between the light and device-space points [N, 3]; -1 if unreached."""
        launcher, count = self._launcher, len(points)
        if count == 0:
            return np.zeros(0, np.float32)
        depths = launcher.empty("the optical depths", 4 * count)
        launcher.run(
            self._kernel("evaluate_map", plan.settings, light, medium),
            (count,),
            {
                "grids": medium.arguments["grids"],
                "light": of_light,
                **self.arguments(plan, buffers),
                "points": launcher.upload("the points", points),
                "optical_depths": depths,
                "count": count,
            },
        )
        return launcher.download(depths, (count,), np.float32)

    def residual(
        self,
        plan: MapPlan,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        buffers: MapBuffers,
    ) -> NDArray[np.float32]:
        """Integrals of D (T_map - T)² and of D T² along every texel's ray, [res, res, 2]."""
        launcher, res, steps = self._launcher, plan.settings.res, RESIDUAL_STEPS * plan.settings.steps
        kernel = self._kernel("map_residual", plan.settings, light, medium, clipped=plan.clip is not None)
        residuals = launcher.empty("the map's residuals", 8 * res * res, reuse=True)
        clip = np.zeros(1, np.float32) if plan.clip is None else plan.clip
        met = medium.met_by(light, of_light, res)
        launcher.run_windows(
            kernel,
            (0, 0, res, res),
            steps + met.longest,
            {
                **met.arguments,
                "light": of_light,
                **self.arguments(plan, buffers),
                "clip": launcher.upload("the solids' distances", clip),
                "residuals": residuals,
                "steps": steps,
            },
        )
        return launcher.download(residuals, (res, res, 2), np.float32)

    def read(self, plan: MapPlan, buffers: MapBuffers) -> NDArray[np.float32]:
        """Coefficients [y, x, n] as float32, whatever their storage."""
        values = self._values(plan.settings, buffers)
        if plan.settings.storage == "u8":
            return (buffers.limits[:, 0] + buffers.limits[:, 1] * (values / 255.0)).astype(np.float32)
        read: NDArray[np.float32] = plan.number_unit * values.astype(np.float32)
        return read

    def stored(self, settings: ResolvedMap, buffers: MapBuffers) -> StoredNumbers:
        """Copy a map to the host."""
        return StoredNumbers(
            self._values(settings, buffers),
            buffers.limits,
            self.read_occupied(settings, buffers),
            buffers.samples,
            buffers.hits,
        )

    def held(self, settings: ResolvedMap, numbers: StoredNumbers) -> MapBuffers:
        """Put a map on the device that was built elsewhere."""
        (room,) = self.room(settings, 1)
        self._launcher.write(room.buffer, numbers.values)
        occupied = self._launcher.upload("the map's occupied ranges", numbers.occupied)
        counts = Counts(numbers.hits, numbers.samples)
        whole = 0, 0, settings.res, settings.res
        return MapBuffers(room, numbers.limits, occupied, whole, Running(lambda: 0.0), counts)

    def struct(self, buffer: cl.Buffer, count: int, struct: Struct) -> NDArray[Any]:
        """Copy structs to the host."""
        return self._launcher.download(buffer, (count,), struct.dtype)

    def _values(self, settings: ResolvedMap, buffers: MapBuffers) -> NDArray[Any]:
        """Copy the numbers [y, x, n] to the host as they are stored."""
        room, stored = buffers.numbers, STORED[settings.storage]
        first = room.first * NUMBERS_UNIT * np.dtype(stored).itemsize
        shape = settings.res, settings.res, settings.coeffs
        return _within(buffers.window, self._launcher.download(room.buffer, shape, stored, first))

    def read_occupied(self, settings: ResolvedMap, buffers: MapBuffers) -> NDArray[np.float32]:
        """Distances from the light at which density begins and ends along every texel's ray, [y, x, 2]."""
        shape = settings.res, settings.res, 2
        return _within(buffers.window, self._launcher.download(buffers.occupied, shape, np.float32))

    def _kernel(
        self,
        name: str,
        settings: ResolvedMap,
        light: Light,
        medium: FieldOnDevice,
        *,
        clipped: bool = False,
    ) -> Kernel:
        header, defines = map_variant(settings)
        return self._launcher.kernels.kernel(
            name,
            "light_pass.cl",
            (*medium.headers, header, *light.headers),
            defines
            | light_defines(light)
            | medium.defines
            | {"TFM_SHADOW": int(clipped), "TFM_OWN_DEPTH": int(settings.deposits == "depth")},
        )


class _Counting:
    """Lets what the tiles of each launch counted be copied before the next counts there too.

    Parameters
    ----------
    whole
        The texels x0, y0, x1, y1 that launches cover: any of them has room.
    """

    def __init__(self, launcher: Launcher, whole: tuple[int, int, int, int]) -> None:
        self._launcher, self.counts = launcher, Counts()
        tiles = launcher.tiles(whole)
        self.buffer = launcher.empty("the counters", 8 * tiles[0] * tiles[1], reuse=True)

    def add(self, window: tuple[int, int, int, int]) -> None:
        """Add what a launch over a window counts."""
        shape = *self._launcher.tiles(window), 2
        self.counts.add(self._launcher.start_download(self.buffer, shape, np.uint32))


def _within(window: tuple[int, int, int, int], texels: NDArray[Any]) -> NDArray[Any]:
    """Clear what lies outside of a window x0, y0, x1, y1 of some texels [y, x, …], and return them."""
    x0, y0, x1, y1 = window
    texels[:y0], texels[y1:], texels[:, :x0], texels[:, x1:] = 0, 0, 0, 0
    return texels
