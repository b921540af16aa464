"""The view pass: from the grid and the maps to radiance (TFM algorithm 1 with section 4.2)."""

from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.passes.launch import Launcher, Progress, tiles
from tfm_cl.passes.light_pass import MapBuffers, map_variant
from tfm_cl.scene import Scene


@dataclass(frozen=True)
class FrameBuffers:
    """What the camera sees, on the device, for the pixels of the crop."""

    shape: tuple[int, int]
    """(height, width)."""
    radiance: cl.Buffer
    """float4: RGB single scattering, summed over lights."""
    light_seen: cl.Buffer
    """float4: light transmittance times opacity RGB, and the opacity, summed over lights."""
    transmittance: cl.Buffer
    """float4: transmittance RGB, and the opacity-weighted mean distance."""
    samples: cl.Buffer
    """uint: density samples taken."""


@dataclass(frozen=True)
class Frame:
    """`FrameBuffers` on the host: [H, W, 4] float32, and [H, W] uint32 samples."""

    radiance: NDArray[np.float32]
    light_seen: NDArray[np.float32]
    transmittance: NDArray[np.float32]
    samples: NDArray[np.uint32]


class ViewPass:
    """Runs ``medium_pass.cl`` once a frame and ``view_pass.cl`` once a light."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def allocate(self, crop: tuple[int, int, int, int]) -> FrameBuffers:
        """Make empty buffers for the pixels x0, y0, x1, y1."""
        x0, y0, x1, y1 = crop
        pixels = (x1 - x0) * (y1 - y0)
        launcher = self._launcher
        return FrameBuffers(
            (y1 - y0, x1 - x0),
            radiance=launcher.zeros("the image", 16 * pixels),
            light_seen=launcher.zeros("the image", 16 * pixels),
            transmittance=launcher.zeros("the image", 16 * pixels),
            samples=launcher.zeros("the image", 4 * pixels),
        )

    def march_medium(
        self,
        scene: Scene,
        crop: tuple[int, int, int, int],
        params: cl.Buffer,
        grid: cl.Buffer,
        frame: FrameBuffers,
        progress: Progress,
    ) -> float:
        """Fill transmittance and depth; returns device seconds."""
        kernel = self._launcher.kernels.kernel("medium_pass", "medium_pass.cl")
        return self._over_tiles(
            kernel,
            crop,
            scene.march.steps,
            "medium",
            progress,
            params,
            grid,
            frame.transmittance,
            frame.samples,
        )

    def add_light(
        self,
        scene: Scene,
        index: int,
        method: str,
        crop: tuple[int, int, int, int],
        params: cl.Buffer,
        grid: cl.Buffer,
        light_map: MapBuffers | None,
        frame: FrameBuffers,
        progress: Progress,
    ) -> float:
        """Add one light's single scattering; returns device seconds."""
        light = scene.lights[index]
        dual = method == "dual"
        headers, defines = map_variant(scene.map, light)
        headers = (*headers, scene.medium.phase.HEADER)
        kernel = self._launcher.kernels.kernel(
            "view_pass", "view_pass.cl", headers, {**defines, "TFM_METHOD_DUAL": int(dual)}
        )
        # The dual march has no map, but the kernel's arguments are the same.
        unused = self._launcher.empty("the map", 16) if light_map is None else None
        return self._over_tiles(
            kernel,
            crop,
            scene.march.steps * (scene.map.steps if dual else 1),
            f"view pass, light {index + 1}",
            progress,
            params,
            grid,
            unused if light_map is None else light_map.coefficients,
            unused if light_map is None else light_map.ranges,
            frame.radiance,
            frame.light_seen,
            frame.samples,
        )

    def _over_tiles(
        self,
        kernel: cl.Kernel,
        crop: tuple[int, int, int, int],
        samples_per_pixel: int,
        stage: str,
        progress: Progress,
        *args: cl.Buffer | None,
    ) -> float:
        seconds, done = 0.0, 0
        x0, y0, x1, y1 = crop
        for x, y, width, height in tiles(*crop, samples_per_pixel):
            seconds += self._launcher.run(kernel, (width, height), *args, offset=(x, y))
            done += width * height
            progress(stage, done / ((x1 - x0) * (y1 - y0)))
        return seconds

    def read(self, frame: FrameBuffers) -> Frame:
        """Copy the frame to the host."""
        download = self._launcher.download
        shape = (*frame.shape, 4)
        return Frame(
            radiance=download(frame.radiance, shape, np.float32),
            light_seen=download(frame.light_seen, shape, np.float32),
            transmittance=download(frame.transmittance, shape, np.float32),
            samples=download(frame.samples, frame.shape, np.uint32),
        )
