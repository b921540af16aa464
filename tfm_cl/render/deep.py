"""Deep samples of the camera's rays: counted first, then stored where the counts say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.files.image_io.image import DeepSamples
from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.field import Met
    from tfm_cl.device.launch import Launcher, Output
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene

WHAT = "the deep samples"
NUMBERS = 3
"""Of a sample: Z, ZBack and opacity, as in ``kernels/view/deep_colours.h``."""
MOST_SAMPLES = 1 << 28
"""Of a picture: 3 GiB, and kernels count their numbers in an int."""


class DeepSettings(NamedTuple):
    """What deep samples are asked for."""

    tolerance: float
    """Of the transmittance along a ray."""
    colour: bool
    """Whether they have colours."""

    @classmethod
    def of(cls, scene: Scene, tolerance: float, *, colour: bool) -> Self:
        """Ask for them of a scene.

        Raises
        ------
        SceneError
            Colours of octaves.
        """
        if colour and any(medium.octaves > 1 for medium in scene.media):
            raise SceneError(
                "deep_colour: octaves are as bright as a whole ray lets them be, which samples cannot tell; "
                "leave deep_colour out, or use orders in place of octaves"
            )
        return cls(tolerance, colour)


@dataclass(frozen=True)
class DeepPass:
    """Makes the deep samples of the rays of one frame.

    Attributes
    ----------
    met
        What its rays meet.
    view
        The struct, on the device.
    shape
        Height and width of the frame's buffers.
    wanted
        Pixels x0, y0, x1, y1 of the frame that have samples.
    steps
        Of a camera ray.
    """

    launcher: Launcher
    media: MediaOnDevice
    met: Met
    view: Any
    frame: FrameBuffers
    shape: tuple[int, int]
    wanted: Rectangle
    steps: int
    has_solids: bool

    def see(self, settings: DeepSettings) -> tuple[DeepBuffers, float]:
        """Make them, still without colours; returns device seconds too.

        Raises
        ------
        SceneError
            More samples than there is room for.
        """
        launcher, tolerance = self.launcher, settings.tolerance
        counts = launcher.zeros(WHAT, 4 * math.prod(self.shape))
        known = {"tolerance": tolerance, "counts": counts} | self.frame.arguments("albedo")
        nothing = launcher.upload(WHAT, np.zeros(1, np.float32))
        into = {"firsts": nothing, "samples": nothing, "stores": 0}
        defines = {"TFM_DEEP": 1, "TFM_DEEP_COLOURS": int(settings.colour)}
        seconds = self._run("deep_pass", defines, known | into)
        found = launcher.download(counts, self.shape, np.int32)
        ends = np.cumsum(found, dtype=np.int64)
        if ends[-1] > MOST_SAMPLES:
            raise SceneError(
                f"image.deep_tolerance = {tolerance:g}: asks for {ends[-1]:,} deep samples, more than "
                f"{MOST_SAMPLES:,}; take a larger one, or render parts of the picture (image.crop)"
            )
        firsts = launcher.upload(WHAT, (ends - found.ravel()).astype(np.int32))
        count = int(ends[-1])
        samples = launcher.output(WHAT, (count, NUMBERS), np.float32)
        into = {"firsts": firsts, "samples": samples.buffer, "stores": 1}
        seconds += self._run("deep_pass", defines, known | into)
        colours = None
        if settings.colour:
            colours = launcher.output(WHAT, (count, 3), np.float32)
            launcher.clear(colours.buffer, colours.nbytes)
        return DeepBuffers(found, counts, firsts, samples, colours), seconds

    def add_own(self, buffers: DeepBuffers) -> float:
        """Add the ambient light that media scatter, and what they emit; returns device seconds."""
        return self._run("deep_own", {"TFM_DEEP": 2, "TFM_DEEP_COLOURS": 1}, buffers.arguments)

    def _run(self, name: str, macros: dict[str, int], arguments: dict[str, Any]) -> float:
        media = self.media
        defines = media.defines | media.channels(textured=False) | {"TFM_SHADOW": int(self.has_solids)}
        kernel = self.launcher.kernels.kernel(name, f"{name}.cl", media.headers, defines | macros)
        known = {"view": self.view} | self.met.arguments | self.frame.arguments("places", "solid")
        return self.launcher.run_windows(
            kernel, self.wanted, self.steps + self.met.longest, known | arguments
        )


@dataclass(frozen=True)
class DeepBuffers:
    """Deep samples on the device."""

    counts: NDArray[np.int32]
    """[height, width] of the frame's buffers."""
    on_device: cl.Buffer
    """The same there."""
    firsts: cl.Buffer
    """Number of the first sample of each pixel."""
    samples: Output
    colours: Output | None
    """RGB that each sends to the camera, through what is before it; None where that is not asked for."""

    @property
    def arguments(self) -> dict[str, cl.Buffer]:
        """Return those of kernels that add colours; none where there are none."""
        if self.colours is None:
            return {}
        return {
            "deep_firsts": self.firsts,
            "deep_counts": self.on_device,
            "deep_samples": self.samples.buffer,
            "deep_colours": self.colours.buffer,
        }

    def start_read(
        self, launcher: Launcher
    ) -> Callable[[NDArray[np.float32], tuple[slice, slice]], DeepSamples]:
        """Let the host have them when the passes that were started have ended.

        Returns what waits for these, and returns the samples of a window of the buffers, beyond which there
        are none: given ``[height, width, RGBA]`` of the frame's buffers, where a solid's is what media lack
        of it, and the window.
        """
        samples = launcher.start_read(self.samples)
        colours = None if self.colours is None else launcher.start_read(self.colours)
        return lambda radiance, part: self._read(samples, colours, radiance, part)

    def _read(
        self,
        found: Callable[[], NDArray[Any]],
        colours: Callable[[], NDArray[Any]] | None,
        radiance: NDArray[np.float32],
        part: tuple[slice, slice],
    ) -> DeepSamples:
        z, z_back, alpha = np.ascontiguousarray(found().T)
        samples = DeepSamples(np.ascontiguousarray(self.counts[part]), z, z_back, alpha)
        if colours is None:
            return samples
        check_cancelled()
        sent = colours().astype(np.float64)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(sent, axis=0)])
        counts, ends = samples.counts.ravel(), samples.ends
        check_cancelled()
        of_media = total[ends] - total[ends - counts]
        check_cancelled()
        some = np.flatnonzero(counts)
        last = ends[some] - 1
        solid = z[last] == z_back[last]
        sent[last[solid]] = (radiance[part][..., :3].reshape(-1, 3) - of_media)[some[solid]]
        check_cancelled()
        return replace(samples, rgb=(sent / samples.before[:, None]).astype(np.float32))
