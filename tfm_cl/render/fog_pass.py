"""The fog pass: media of constant density, in closed form and for many lights at once (TFM section 4)."""

from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from tfm_cl.device.launch import Launcher, Progress, Windows, int4
from tfm_cl.render.culling import BlockLists, Rectangle
from tfm_cl.render.view_pass import FrameBuffers
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.lights import Light
from tfm_cl.scene.scene import Scene

BLOCK = 16
"""Pixels along a side of a block that has a list of lights: a multiple of every tile's."""


@dataclass(frozen=True)
class FogVariant:
    """What the kernels must know of the lights of a launch when they are compiled."""

    headers: tuple[str, ...]
    """Of the lights' kind and chart."""
    inverse_square: bool
    textured: bool

    @classmethod
    def of(cls, light: Light) -> "FogVariant":
        """Return the one of a light."""
        return cls(light.headers, light.falloff == "inverse-square", light.texture_image() is not None)

    def compiled(
        self, scene: Scene, volume: Homogeneous, shadow_filter: int
    ) -> tuple[tuple[str, ...], dict[str, int]]:
        """Headers and macros."""
        grey = len(set(scene.medium.sigma_t.tolist())) == 1 and not self.textured
        return (*self.headers, scene.medium.phase.HEADER), {
            "TFM_INVERSE_SQUARE": int(self.inverse_square),
            "TFM_TEXTURE": int(self.textured),
            "TFM_CHANNELS": 1 if grey else 3,
            "TFM_SHADOW": shadow_filter,
            "TFM_MEDIUM": volume.KIND,
        }


@dataclass(frozen=True)
class FogLights:
    """Lights of one variant, on the device."""

    params: cl.Buffer
    """The parameters, one struct a light."""
    shadow: cl.Buffer
    """float: shadow maps, one after the other; not read without solids."""
    texture: cl.Buffer
    """float4: textures."""
    lit: cl.Buffer
    """uchar: which pixels of each light's rectangle show a solid that it lights; not read without solids."""
    blocks: BlockLists
    """Which block sees which."""
    window: Rectangle
    """The pixels that any of them touches."""


class FogPass:
    """Renders homogeneous media on one device.

    Parameters
    ----------
    launcher
        The device.
    """

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def see(
        self,
        variant: tuple[tuple[str, ...], dict[str, int]],
        crop: Rectangle,
        params: cl.Buffer,
        frame: FrameBuffers,
    ) -> float:
        """Fill in the transmittance of the camera rays, whatever the lights; returns device seconds."""
        kernel = self._launcher.kernels.kernel("fog_camera", "fog_pass.cl", *variant)
        windows = Windows(*crop, 1)
        seconds = 0.0
        for window in windows:
            seconds += windows.took(
                self._launcher.run_tiles(
                    kernel, window, params, frame.solid, frame.transmittance, int4(*window)
                )
            )
        return seconds

    def add_lights(
        self,
        variant: tuple[tuple[str, ...], dict[str, int]],
        steps: int,
        lights: FogLights,
        frame: FrameBuffers,
        stage: str,
        progress: Progress,
    ) -> float:
        """Add what lights give to medium and solids; returns device seconds.

        Parameters
        ----------
        steps
            Samples along a camera ray for each light.
        stage
            What ``progress`` calls it.
        """
        launcher = self._launcher
        kernel = launcher.kernels.kernel("fog_pass", "fog_pass.cl", *variant)
        blocks = lights.blocks
        place = int4(*blocks.first, blocks.columns, BLOCK)
        starts = launcher.upload("the lists of lights", blocks.starts)
        touching = launcher.upload("the lists of lights", blocks.lights)
        most = int(np.diff(blocks.starts).max(initial=1))
        windows = Windows(*lights.window, most * steps)
        seconds = 0.0
        for window in windows:
            seconds += windows.took(
                launcher.run_tiles(
                    kernel,
                    window,
                    lights.params,
                    starts,
                    touching,
                    lights.shadow,
                    lights.texture,
                    frame.solid,
                    frame.albedo,
                    lights.lit,
                    frame.radiance,
                    frame.light_seen,
                    frame.samples,
                    place,
                    int4(*window),
                )
            )
            progress(stage, windows.done)
        return seconds
