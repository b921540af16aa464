"""The light pass: from the density grid to one transmittance function map a light (TFM algorithm 2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.bases import BASES
from tfm_cl.bricks import BrickGrid
from tfm_cl.lights import Light
from tfm_cl.passes.launch import Launcher, Progress, Windows, int4
from tfm_cl.settings import MapSettings

STORAGE_BITS = {"f32": 32, "f16": 16, "u8": 8}
PROBE_RES = 64
"""Texels along a side of the map that density_weighting = auto looks at."""


def map_variant(
    settings: MapSettings, light: Light, bricks: BrickGrid
) -> tuple[tuple[str, ...], dict[str, int]]:
    """Headers and macros of every kernel that reads or writes such a map."""
    headers = (BASES[settings.basis].header, light.HEADER)
    defines = {
        "TFM_N_COEFF": settings.coeffs,
        "TFM_STORAGE_BITS": STORAGE_BITS[settings.storage],
        "TFM_INVERSE_SQUARE": int(light.falloff == "inverse-square"),
    }
    return headers, defines | bricks.defines


@dataclass(frozen=True)
class MapBuffers:
    """A map on the device."""

    coefficients: cl.Buffer
    """[res, res, n] in the map's storage type."""
    ranges: cl.Buffer
    """[n] lowest value and extent, for 8 bits."""
    nbytes: int
    seconds: float
    """Device time."""
    samples: int
    """Densities read."""
    hits: int
    """Texels whose ray meets the medium's bounds."""
    occupied: cl.Buffer
    """int2 [res, res]: the first light step with density and the one after the last; equal without any."""


class LightPass:
    """Runs ``light_pass.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def largest_optical_depth(
        self, settings: MapSettings, light: Light, params: cl.Buffer, bricks: BrickGrid
    ) -> float:
        """Largest optical depth of the density along the light's rays, on a coarse map."""
        launcher = self._launcher
        kernel = self._kernel("light_optical_depths", settings, light, bricks)
        depths = launcher.empty("the optical depths", 4 * PROBE_RES**2)
        launcher.run_tiles(
            kernel, (0, 0, PROBE_RES, PROBE_RES), params, *bricks.arguments, depths, np.int32(PROBE_RES)
        )
        return float(launcher.download(depths, (PROBE_RES, PROBE_RES), np.float32).max())

    def build(
        self, settings: MapSettings, light: Light, params: cl.Buffer, bricks: BrickGrid, progress: Progress
    ) -> MapBuffers:
        """Project the transmittance along every light ray of the map.

        Parameters
        ----------
        params
            The struct of `tfm_cl.params` for this light.
        bricks
            The density.
        """
        launcher, res, n = self._launcher, settings.res, settings.coeffs
        kernel = self._kernel("light_pass", settings, light, bricks)
        table = launcher.upload("the basis's table", BASES[settings.basis].table(settings.steps, n))
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
                    table,
                    coefficients,
                    occupied,
                    counts,
                    int4(*window),
                )
            )
            met, read = launcher.download(counts, (*tiles, 2), np.uint32).sum(axis=(0, 1), dtype=np.int64)
            hits, samples = hits + int(met), samples + int(read)
            progress("light pass", windows.done)
        packed, ranges, packing = self._pack(settings, light, bricks, coefficients)
        return MapBuffers(
            coefficients=packed,
            ranges=ranges,
            nbytes=STORAGE_BITS[settings.storage] // 8 * n * res * res,
            seconds=seconds + packing,
            samples=samples,
            hits=hits,
            occupied=occupied,
        )

    def _allocate(self, settings: MapSettings, bits: int) -> cl.Buffer:
        """Make room for the map, and one texel more: two neighbours may be read at once."""
        nbytes = bits // 8 * settings.coeffs * (settings.res**2 + 1)
        if settings.res == 1:  # then the one beyond is read, and weighs 0
            return self._launcher.zeros("the map", nbytes)
        return self._launcher.empty("the map", nbytes, reuse=True)

    def _pack(
        self, settings: MapSettings, light: Light, bricks: BrickGrid, coefficients: cl.Buffer
    ) -> tuple[cl.Buffer, cl.Buffer, float]:
        """Store the coefficients in the type asked for; 8 bits span each coefficient's own range."""
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
        seconds = launcher.run(kernel, (res * res,), coefficients, packed, ranges, np.int32(res * res))
        return packed, ranges, seconds

    def evaluate(
        self,
        settings: MapSettings,
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
            buffers.coefficients,
            buffers.ranges,
            launcher.upload("the points", points),
            depths,
            np.int32(count),
        )
        return launcher.download(depths, (count,), np.float32)

    def read(self, settings: MapSettings, buffers: MapBuffers) -> NDArray[np.float32]:
        """Coefficients [y, x, n] as float32, whatever their storage."""
        shape = (settings.res, settings.res, settings.coeffs)
        launcher = self._launcher
        if settings.storage == "u8":
            ranges = launcher.download(buffers.ranges, (settings.coeffs, 2), np.float32)
            values = launcher.download(buffers.coefficients, shape, np.uint8)
            return (ranges[:, 0] + ranges[:, 1] * (values / 255.0)).astype(np.float32)
        stored: Any = np.float32 if settings.storage == "f32" else np.float16
        return launcher.download(buffers.coefficients, shape, stored).astype(np.float32)

    def read_occupied(self, settings: MapSettings, buffers: MapBuffers) -> NDArray[np.float32]:
        """First and last u with density of every texel's ray, [y, x, 2]."""
        steps = self._launcher.download(buffers.occupied, (settings.res, settings.res, 2), np.int32)
        return (steps / settings.steps).astype(np.float32)

    def _kernel(self, name: str, settings: MapSettings, light: Light, bricks: BrickGrid) -> cl.Kernel:
        headers, defines = map_variant(settings, light, bricks)
        return self._launcher.kernels.kernel(name, "light_pass.cl", headers, defines)
