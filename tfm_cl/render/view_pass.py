"""The view pass: from the grid and the maps to radiance (TFM algorithm 1 with section 4.2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.device.bricks import BrickGrid
from tfm_cl.device.launch import Launcher, Progress, Windows, float4, int4
from tfm_cl.maps.light_pass import MapBuffers, map_variant
from tfm_cl.maps.resolved import ResolvedMap
from tfm_cl.model import decided
from tfm_cl.render.visibility import GBuffer
from tfm_cl.scene.lights import Light
from tfm_cl.scene.scene import Scene


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
    solid: cl.Buffer
    """float4: normal and distance of the solid that a pixel shows; of no meaning without solids."""
    albedo: cl.Buffer
    """float4: its RGB albedo."""
    has_solids: bool


@dataclass(frozen=True)
class LightInputs:
    """What kernels are told of one light besides its parameters."""

    settings: ResolvedMap
    """Resolved ones of the map."""
    map: MapBuffers | None
    """None for the dual march."""
    shadow: cl.Buffer
    """float [res, res]: distances to solids."""
    texture: cl.Buffer
    """float4 [height, width]: RGB that colours the light."""
    shadow_filter: int
    """``TFM_SHADOW``: 0 without solids."""
    is_textured: bool

    def variant(
        self, scene: Scene, light: Light, bricks: BrickGrid
    ) -> tuple[tuple[str, ...], dict[str, int]]:
        """Headers and macros of the kernels that shade by this light."""
        headers, defines = map_variant(self.settings, light, bricks)
        grey = len(set(scene.medium.sigma_t.tolist())) == 1 and not self.is_textured
        return (*headers, scene.medium.phase.HEADER), defines | {
            "TFM_METHOD_DUAL": int(self.map is None),
            "TFM_CHANNELS": 1 if grey else 3,
            "TFM_SHADOW": self.shadow_filter,
            "TFM_TEXTURE": int(self.is_textured),
        }

    def arguments(self, launcher: Launcher) -> tuple[cl.Buffer, ...]:
        """``LIGHT_ARGUMENTS`` of the kernels; the dual march has no map, but takes the same."""
        of_map = (launcher.empty("the map", 16),) * 4 if self.map is None else self.map.arguments
        return (*of_map, self.shadow, self.texture)


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

    def allocate(self, crop: tuple[int, int, int, int], gbuffer: GBuffer | None = None) -> FrameBuffers:
        """Make empty buffers for the pixels x0, y0, x1, y1, with the solids that they show."""
        x0, y0, x1, y1 = crop
        pixels = (x1 - x0) * (y1 - y0)
        launcher = self._launcher
        none = np.zeros(4, np.float32)
        return FrameBuffers(
            (y1 - y0, x1 - x0),
            radiance=launcher.zeros("the image", 16 * pixels),
            light_seen=launcher.zeros("the image", 16 * pixels),
            transmittance=launcher.zeros("the image", 16 * pixels),
            samples=launcher.zeros("the image", 4 * pixels),
            solid=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.solid),
            albedo=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.albedo),
            has_solids=gbuffer is not None,
        )

    def add_light(
        self,
        scene: Scene,
        index: int,
        crop: tuple[int, int, int, int],
        params: cl.Buffer,
        bricks: BrickGrid,
        inputs: LightInputs,
        frame: FrameBuffers,
        progress: Progress,
        *,
        shows_residual: bool = False,
    ) -> float:
        """Add one light's single scattering; returns device seconds.

        Parameters
        ----------
        shows_residual
            The map holds residuals, to be seen instead of the light's transmittance.
        """
        headers, defines = inputs.variant(scene, scene.lights[index], bricks)
        if shows_residual:
            headers = ("basis/single.h", *headers[1:])
            defines |= {"TFM_SHOW_RESIDUAL": 1}
        kernel = self._launcher.kernels.kernel("view_pass", "view_pass.cl", headers, defines)
        return self._over_windows(
            kernel,
            crop,
            decided(scene.march.steps) * (decided(scene.map.steps) if inputs.map is None else 1),
            f"view pass, light {index + 1}",
            progress,
            params,
            *bricks.arguments,
            *inputs.arguments(self._launcher),
            frame.solid,
            frame.radiance,
            frame.light_seen,
            frame.transmittance,
            frame.samples,
            np.int32(index == 0),
        )

    def add_solids(
        self,
        scene: Scene,
        index: int,
        crop: tuple[int, int, int, int],
        params: cl.Buffer,
        bricks: BrickGrid,
        inputs: LightInputs,
        visible: NDArray[np.float32],
        frame: FrameBuffers,
        progress: Progress,
    ) -> float:
        """Add what solids reflect of one light, after its `add_light`; returns device seconds.

        Parameters
        ----------
        visible
            [height, width]: 1 where no solid hides the light from what the pixel shows.
        """
        headers, defines = inputs.variant(scene, scene.lights[index], bricks)
        kernel = self._launcher.kernels.kernel("solid_pass", "solid_pass.cl", headers, defines)
        return self._over_windows(
            kernel,
            crop,
            decided(scene.map.steps) if inputs.map is None else 1,
            f"solid pass, light {index + 1}",
            progress,
            params,
            *bricks.arguments,
            *inputs.arguments(self._launcher),
            frame.solid,
            frame.albedo,
            self._launcher.upload("the lit pixels", visible),
            frame.radiance,
            frame.transmittance,
            frame.samples,
        )

    def add_ambient(self, scene: Scene, params: cl.Buffer, frame: FrameBuffers) -> float:
        """Add the ambient light, after the first `add_light`; returns device seconds."""
        pixels = frame.shape[0] * frame.shape[1]
        defines = {"TFM_SHADOW": int(frame.has_solids)}
        kernel = self._launcher.kernels.kernel("ambient_pass", "ambient_pass.cl", (), defines)
        red, green, blue = scene.ambient.radiance
        return self._launcher.run(
            kernel,
            (pixels,),
            params,
            frame.transmittance,
            frame.albedo,
            frame.radiance,
            float4(red, green, blue, 0),
            np.int32(pixels),
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
