"""Deep samples of the camera's rays: counted first, then stored where the counts say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.files.image_io.image import DeepSamples

if TYPE_CHECKING:
    from tfm_cl.device.field import Met
    from tfm_cl.device.launch import Launcher, Output
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle

NUMBERS = 3
"""Of a sample: Z, ZBack and opacity, as in ``kernels/view/deep.h``."""
MOST_SAMPLES = 1 << 28
"""Of a picture: 3 GiB, and kernels count their numbers in an int."""


@dataclass(frozen=True)
class DeepBuffers:
    """Deep samples on the device."""

    counts: NDArray[np.int32]
    """[height, width] of the frame's buffers, on the host."""
    samples: Output

    def read(self, launcher: Launcher, rows: slice, columns: slice) -> DeepSamples:
        """Return those of a window of the buffers, beyond which there are none."""
        z, z_back, alpha = np.ascontiguousarray(launcher.read(self.samples).T)
        return DeepSamples(np.ascontiguousarray(self.counts[rows, columns]), z, z_back, alpha)


def see_deep(
    launcher: Launcher,
    media: MediaOnDevice,
    met: Met,
    view: Any,
    frame: FrameBuffers,
    shape: tuple[int, int],
    wanted: Rectangle,
    tolerance: float,
    steps: int,
    *,
    has_solids: bool,
) -> tuple[DeepBuffers, float]:
    """Make the deep samples of some pixels; returns device seconds too.

    Parameters
    ----------
    met
        What its rays meet.
    view
        The struct, on the device.
    shape
        Height and width of the frame's buffers.
    wanted
        Pixels x0, y0, x1, y1 of the frame that have samples.
    tolerance
        Of the transmittance along a ray.
    steps
        Of a camera ray.

    Raises
    ------
    SceneError
        More samples than there is room for.
    """
    defines = media.defines | media.channels(textured=False)
    defines |= {"TFM_SHADOW": int(has_solids), "TFM_DEEP": 1}
    kernel = launcher.kernels.kernel("deep_pass", "deep_pass.cl", media.headers, defines)
    counts = launcher.output("the deep samples", shape, np.int32)
    launcher.clear(counts.buffer, counts.nbytes)
    arguments = {"view": view, "tolerance": np.float32(tolerance), "counts": counts.buffer}
    arguments |= met.arguments | frame.arguments("places", "solid", "albedo")

    def run(firsts: Any, samples: Any, *, stores: bool) -> float:
        into = {"firsts": firsts, "samples": samples, "stores": int(stores)}
        return launcher.run_windows(kernel, wanted, steps + met.longest, arguments | into)

    nothing = launcher.upload("the deep samples", np.zeros(1, np.float32))
    seconds = run(nothing, nothing, stores=False)
    found = launcher.download(counts.buffer, shape, np.int32)
    ends = np.cumsum(found, dtype=np.int64)
    if ends[-1] > MOST_SAMPLES:
        raise SceneError(
            f"image.deep_tolerance = {tolerance:g}: asks for {ends[-1]:,} deep samples, more than "
            f"{MOST_SAMPLES:,}; take a larger one, or render parts of the picture (image.crop)"
        )
    firsts = launcher.upload("the deep samples", (ends - found.ravel()).astype(np.int32))
    samples = launcher.output("the deep samples", (int(ends[-1]), NUMBERS), np.float32)
    seconds += run(firsts, samples.buffer, stores=True)
    return DeepBuffers(found, samples), seconds
