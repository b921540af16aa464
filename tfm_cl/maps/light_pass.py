"""The light pass: from the density grid to one transmittance function map a light (TFM algorithm 2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.device.bricks import BrickGrid
from tfm_cl.device.launch import Launcher, Progress, Windows, int4
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import FITS, LOOKUPS, TARGETS, Functions
from tfm_cl.maps.prefilter import Prefilter
from tfm_cl.maps.resolved import STORAGE_BITS, ResolvedMap
from tfm_cl.scene.lights import Light

LARGEST_HALF = 4096.0
"""Numbers in half precision are stored in a unit that keeps the largest optical depth near this, far from
65504."""


RESIDUAL_STEPS = 4
"""Times the map's steps: of the march that a map is measured by, so that it is not measured by its own
errors."""
MARCH_LEVELS = 8
"""Numbers of steps that a range may take, as in ``kernels/light_pass.cl``."""


def steps_of_levels(settings: ResolvedMap) -> list[int]:
    """List the steps along ranges of each level; the medium's bounds take all of them."""
    if settings.range == "box":
        return [0] * (MARCH_LEVELS - 1) + [settings.steps]
    return [-(-settings.steps * level // MARCH_LEVELS) for level in range(1, MARCH_LEVELS + 1)]


def map_variant(
    settings: ResolvedMap, light: Light, bricks: BrickGrid, *, clipped: bool = False
) -> tuple[tuple[str, ...], dict[str, int]]:
    """Headers and macros of every kernel that reads or writes a map of such resolved settings.

    ``clipped``: solids end its rays.
    """
    headers = (BASES[settings.basis].header, *light.headers)
    defines = {
        "TFM_N_COEFF": settings.coeffs,
        "TFM_STORAGE_BITS": STORAGE_BITS[settings.storage],
        "TFM_TARGET": TARGETS[settings.target],
        "TFM_FIT": FITS[settings.fit],
        "TFM_RANGE": int(settings.range != "box"),
        "TFM_LOOKUP": LOOKUPS[settings.lookup],
        "TFM_INVERSE_SQUARE": int(light.falloff == "inverse-square"),
        "TFM_SHADOW": int(clipped),
    }
    return headers, defines | bricks.defines


@dataclass(frozen=True)
class MapPlan:
    """All that is decided before a map's rays are marched."""

    settings: ResolvedMap
    """Resolved."""
    field: NDArray[np.float32]
    """Ranges of the rays, [size, size, 4]; [1, 1, 4] of no meaning for the range ``box``."""
    functions: Functions | None
    """Of the basis; None where its kernel header accumulates in its own way."""
    number_unit: float
    clip: NDArray[np.float32] | None
    """[res, res] distances beyond which, for solids, a texel's ray lights nothing; None without solids."""


@dataclass(frozen=True)
class MapBuffers:
    """A map on the device."""

    coefficients: cl.Buffer
    """[res, res, n] in the map's storage type."""
    ranges: cl.Buffer
    """[n] lowest value and extent, for 8 bits."""
    field: cl.Buffer
    """float4 [size, size], ranges of the rays."""
    modes: cl.Buffer
    """What the basis needs to evaluate its functions."""
    seconds: float
    """Device time."""
    samples: int
    """Densities read."""
    hits: int
    """Texels whose ray has a range."""
    occupied: cl.Buffer
    """float2 [res, res]: where density begins and ends, distances from the light; 0 without."""
    clip: cl.Buffer
    """float [res, res]: the plan's, if any."""

    @property
    def arguments(self) -> tuple[cl.Buffer, cl.Buffer, cl.Buffer, cl.Buffer]:
        """What kernels that read the map take, in their order."""
        return self.coefficients, self.ranges, self.field, self.modes


class LightPass:
    """Runs ``light_pass.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self._prefilter = Prefilter(launcher)

    def build(
        self, plan: MapPlan, light: Light, params: cl.Buffer, bricks: BrickGrid, progress: Progress
    ) -> MapBuffers:
        """Project the transmittance along every light ray of the map.

        Parameters
        ----------
        params
            The struct of `tfm_cl.device.params` for this light and plan.
        bricks
            The density.
        """
        launcher, settings = self._launcher, plan.settings
        res = settings.res
        clipped = plan.clip is not None
        kernel = self._kernel("light_pass", settings, light, bricks, clipped=clipped)
        none = np.zeros(1, np.float32)
        clip = launcher.upload("the solids' distances", none if plan.clip is None else plan.clip)
        tables = [np.zeros(0, np.float32)] * MARCH_LEVELS
        modes = tables[0]
        if plan.functions is not None:
            basis, modes = BASES[settings.basis], plan.functions.modes
            tables = [
                basis.table(plan.functions, settings, steps) if steps else tables[0]
                for steps in steps_of_levels(settings)
            ]
        starts = np.cumsum([0, *map(len, tables[:-1])], dtype=np.int32)
        table = launcher.upload("the basis's tables", np.concatenate(tables))
        table_starts = launcher.upload("their starts", starts)
        field = launcher.upload("the field of ranges", plan.field)
        coefficients = self._allocate(settings, 32)
        occupied = launcher.empty("the map's occupied ranges", 8 * res * res, reuse=True)
        seconds, hits, samples = 0.0, 0, 0
        windows = Windows(0, 0, res, res, settings.steps)
        for window in windows:
            tiles = launcher.tiles(window)
            counts = launcher.empty("the counters", 8 * tiles[0] * tiles[1])
            seconds += windows.took(
                launcher.run_tiles(
                    kernel,
                    window,
                    params,
                    *bricks.arguments,
                    field,
                    table,
                    table_starts,
                    clip,
                    coefficients,
                    occupied,
                    counts,
                    int4(*window),
                )
            )
            met, read = launcher.download(counts, (*tiles, 2), np.uint32).sum(axis=(0, 1), dtype=np.int64)
            hits, samples = hits + int(met), samples + int(read)
            progress("light pass", windows.done)
        blurred, blurring = self._prefilter.blur(
            coefficients, res, settings.coeffs, settings.blur, settings.blur_kernel
        )
        packed, ranges, packing = self._pack(plan, light, bricks, blurred)
        return MapBuffers(
            coefficients=packed,
            ranges=ranges,
            field=field,
            modes=launcher.upload("the basis's functions", modes),
            seconds=seconds + blurring + packing,
            samples=samples,
            hits=hits,
            occupied=occupied,
            clip=clip,
        )

    def _allocate(self, settings: ResolvedMap, bits: int) -> cl.Buffer:
        """Make room for the map, and one texel more: two neighbours may be read at once."""
        nbytes = bits // 8 * settings.coeffs * (settings.res**2 + 1)
        if settings.res == 1:  # then the one beyond is read, and weighs 0
            return self._launcher.zeros("the map", nbytes)
        return self._launcher.empty("the map", nbytes, reuse=True)

    def _pack(
        self, plan: MapPlan, light: Light, bricks: BrickGrid, coefficients: cl.Buffer
    ) -> tuple[cl.Buffer, cl.Buffer, float]:
        """Store the coefficients in the type asked for; 8 bits span each coefficient's own range."""
        settings = plan.settings
        launcher, res, n = self._launcher, settings.res, settings.coeffs
        limits = np.zeros((n, 2), np.float32)
        if settings.storage == "f32":
            return coefficients, launcher.upload("the ranges", limits), 0.0
        if settings.storage == "u8":
            values = launcher.download(coefficients, (res * res, n), np.float32)
            limits[:, 0] = values.min(axis=0)
            limits[:, 1] = values.max(axis=0) - limits[:, 0]
        ranges = launcher.upload("the ranges", limits)
        packed = self._allocate(settings, STORAGE_BITS[settings.storage])
        kernel = self._kernel("pack_map", settings, light, bricks)
        scale = np.float32(1 / plan.number_unit)
        seconds = launcher.run(kernel, (res * res,), coefficients, packed, ranges, scale, np.int32(res * res))
        return packed, ranges, seconds

    def evaluate(
        self,
        settings: ResolvedMap,
        light: Light,
        params: cl.Buffer,
        bricks: BrickGrid,
        buffers: MapBuffers,
        points: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Optical depth of the density between the light and device-space points [N, 3]; -1 if unreached."""
        launcher, count = self._launcher, len(points)
        if count == 0:
            return np.zeros(0, np.float32)
        kernel = self._kernel("evaluate_map", settings, light, bricks)
        depths = launcher.empty("the optical depths", 4 * count)
        launcher.run(
            kernel,
            (count,),
            params,
            *buffers.arguments,
            launcher.upload("the points", points),
            depths,
            np.int32(count),
        )
        return launcher.download(depths, (count,), np.float32)

    def residual(
        self,
        settings: ResolvedMap,
        light: Light,
        params: cl.Buffer,
        bricks: BrickGrid,
        buffers: MapBuffers,
        *,
        clipped: bool,
    ) -> NDArray[np.float32]:
        """Integrals of D (T_map - T)² and of D T² along every texel's ray, [res, res, 2]."""
        launcher, res, steps = self._launcher, settings.res, RESIDUAL_STEPS * settings.steps
        kernel = self._kernel("map_residual", settings, light, bricks, clipped=clipped)
        residuals = launcher.empty("the map's residuals", 8 * res * res, reuse=True)
        windows = Windows(0, 0, res, res, steps)
        for window in windows:
            windows.took(
                launcher.run_tiles(
                    kernel,
                    window,
                    params,
                    *bricks.arguments,
                    *buffers.arguments,
                    buffers.clip,
                    residuals,
                    np.int32(steps),
                    int4(*window),
                )
            )
        return launcher.download(residuals, (res, res, 2), np.float32)

    def read(self, settings: ResolvedMap, buffers: MapBuffers, number_unit: float) -> NDArray[np.float32]:
        """Coefficients [y, x, n] as float32, whatever their storage."""
        shape = (settings.res, settings.res, settings.coeffs)
        launcher = self._launcher
        if settings.storage == "u8":
            ranges = launcher.download(buffers.ranges, (settings.coeffs, 2), np.float32)
            values = launcher.download(buffers.coefficients, shape, np.uint8)
            return (ranges[:, 0] + ranges[:, 1] * (values / 255.0)).astype(np.float32)
        stored: Any = np.float32 if settings.storage == "f32" else np.float16
        return number_unit * launcher.download(buffers.coefficients, shape, stored).astype(np.float32)

    def read_occupied(self, settings: ResolvedMap, buffers: MapBuffers) -> NDArray[np.float32]:
        """Distances from the light at which density begins and ends along every texel's ray, [y, x, 2]."""
        return self._launcher.download(buffers.occupied, (settings.res, settings.res, 2), np.float32)

    def _kernel(
        self, name: str, settings: ResolvedMap, light: Light, bricks: BrickGrid, *, clipped: bool = False
    ) -> cl.Kernel:
        headers, defines = map_variant(settings, light, bricks, clipped=clipped)
        return self._launcher.kernels.kernel(name, "light_pass.cl", headers, defines)
