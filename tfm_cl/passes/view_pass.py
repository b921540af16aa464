"""The view pass: from the grid and the maps to radiance (TFM algorithm 1 with section 4.2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.bricks import BrickGrid
from tfm_cl.passes.launch import Launcher, Progress, Windows, int4
from tfm_cl.passes.light_pass import MapBuffers, map_variant
from tfm_cl.scene import Scene
from tfm_cl.settings import MapSettings


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
    """Runs ``view_pass.cl`` once a light; the first light's camera rays also give transmittance and depth."""

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

    def add_light(
        self,
        scene: Scene,
        index: int,
        crop: tuple[int, int, int, int],
        params: cl.Buffer,
        bricks: BrickGrid,
        settings: MapSettings,
        light_map: MapBuffers | None,
        frame: FrameBuffers,
        progress: Progress,
        *,
        shows_residual: bool = False,
    ) -> float:
        """Add one light's single scattering; returns device seconds.

        Parameters
        ----------
        settings
            Resolved ones of the map.
        light_map
            None for the dual march.
        shows_residual
            The map holds residuals, to be seen instead of the light's transmittance.
        """
        light = scene.lights[index]
        dual = light_map is None
        headers, defines = map_variant(settings, light, bricks)
        if shows_residual:
            headers = ("basis/single.h", *headers[1:])
            defines |= {"TFM_SHOW_RESIDUAL": 1}
        headers = (*headers, scene.medium.phase.HEADER)
        grey = len(set(scene.medium.sigma_t.tolist())) == 1
        defines |= {"TFM_METHOD_DUAL": int(dual), "TFM_CHANNELS": 1 if grey else 3}
        kernel = self._launcher.kernels.kernel("view_pass", "view_pass.cl", headers, defines)
        # The dual march has no map, but the kernel's arguments are the same.
        unused = self._launcher.empty("the map", 16) if light_map is None else None
        return self._over_windows(
            kernel,
            crop,
            scene.march.steps * (scene.map.steps if dual else 1),
            f"view pass, light {index + 1}",
            progress,
            params,
            *bricks.arguments,
            *((unused,) * 4 if light_map is None else light_map.arguments),
            frame.radiance,
            frame.light_seen,
            frame.transmittance,
            frame.samples,
            np.int32(index == 0),
        )

    def _over_windows(
        self,
        kernel: cl.Kernel,
        crop: tuple[int, int, int, int],
        samples_per_pixel: int,
        stage: str,
        progress: Progress,
        *args: Any,
    ) -> float:
        seconds = 0.0
        windows = Windows(*crop, samples_per_pixel)
        for window in windows:
            corners = int4(*window)
            seconds += windows.took(self._launcher.run_tiles(kernel, window, *args, corners))
            progress(stage, windows.done)
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
