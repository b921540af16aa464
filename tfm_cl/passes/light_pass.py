"""The light pass: from the density grid to one transmittance function map a light (TFM algorithm 2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.bases import BASES
from tfm_cl.lights import Light
from tfm_cl.passes.launch import SAMPLES_PER_LAUNCH, Launcher, Progress
from tfm_cl.settings import MapSettings

STORAGE_BITS = {"f32": 32, "f16": 16, "u8": 8}
PROBE_RES = 64
"""Texels along a side of the map that density_weighting = auto looks at."""


def map_variant(settings: MapSettings, light: Light) -> tuple[tuple[str, ...], dict[str, int]]:
    """Headers and macros of every kernel that reads or writes such a map."""
    headers = (BASES[settings.basis].header, light.HEADER)
    return headers, {"TFM_N_COEFF": settings.coeffs, "TFM_STORAGE_BITS": STORAGE_BITS[settings.storage]}


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
    """Density samples taken."""


class LightPass:
    """Runs ``light_pass.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def largest_optical_depth(
        self, settings: MapSettings, light: Light, params: cl.Buffer, grid: cl.Buffer
    ) -> float:
        """Largest optical depth of the density along the light's rays, on a coarse map."""
        launcher = self._launcher
        kernel = self._kernel("light_optical_depths", settings, light)
        depths = launcher.empty("the optical depths", 4 * PROBE_RES**2)
        launcher.run(kernel, (PROBE_RES, PROBE_RES), params, grid, depths)
        return float(launcher.download(depths, (PROBE_RES, PROBE_RES), np.float32).max())

    def build(
        self, settings: MapSettings, light: Light, params: cl.Buffer, grid: cl.Buffer, progress: Progress
    ) -> MapBuffers:
        """Project the transmittance along every light ray of the map.

        Parameters
        ----------
        params
            The struct of `tfm_cl.params` for this light.
        grid
            The padded density grid.
        """
        launcher, res, n = self._launcher, settings.res, settings.coeffs
        kernel = self._kernel("light_pass", settings, light)
        coefficients = launcher.empty("the map", 4 * n * res * res)
        hits = launcher.zeros("a counter", 4)
        seconds = 0.0
        rows = min(res, max(8, SAMPLES_PER_LAUNCH // (res * settings.steps) // 8 * 8))
        for row in range(0, res, rows):
            seconds += launcher.run(
                kernel, (res, min(rows, res - row)), params, grid, coefficients, hits, offset=(0, row)
            )
            progress("light pass", min(1.0, (row + rows) / res))
        packed, ranges, packing = self._pack(settings, light, coefficients)
        return MapBuffers(
            coefficients=packed,
            ranges=ranges,
            nbytes=STORAGE_BITS[settings.storage] // 8 * n * res * res,
            seconds=seconds + packing,
            samples=int(launcher.download(hits, (1,), np.uint32)[0]) * settings.steps,
        )

    def _pack(
        self, settings: MapSettings, light: Light, coefficients: cl.Buffer
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
        packed = launcher.empty("the map", STORAGE_BITS[settings.storage] // 8 * n * res * res)
        kernel = self._kernel("pack_map", settings, light)
        seconds = launcher.run(kernel, (res * res,), coefficients, packed, ranges)
        return packed, ranges, seconds

    def evaluate(
        self,
        settings: MapSettings,
        light: Light,
        params: cl.Buffer,
        buffers: MapBuffers,
        points: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Optical depth of the density between the light and device-space points [N, 3]; -1 if unreached."""
        launcher, count = self._launcher, len(points)
        if count == 0:
            return np.zeros(0, np.float32)
        kernel = self._kernel("evaluate_map", settings, light)
        depths = launcher.empty("the optical depths", 4 * count)
        launcher.run(
            kernel,
            (count,),
            params,
            buffers.coefficients,
            buffers.ranges,
            launcher.upload("the points", points),
            depths,
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

    def _kernel(self, name: str, settings: MapSettings, light: Light) -> cl.Kernel:
        headers, defines = map_variant(settings, light)
        return self._launcher.kernels.kernel(name, "light_pass.cl", headers, defines)
