"""The camera pass: what lies along the camera rays, whatever the lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tfm_cl.device.field import Met
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.running import Running
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle


def see(
    launcher: Launcher,
    media: MediaOnDevice,
    met: Met,
    view: Any,
    bounds: Rectangle,
    steps: int,
    frame: FrameBuffers,
    *,
    has_solids: bool,
) -> Running:
    """Begin to store what the camera sees without lights.

    Parameters
    ----------
    met
        What its rays meet.
    view
        The struct, on the device.
    bounds
        Pixels x0, y0, x1, y1 of the frame's buffers.
    steps
        Samples along a camera ray.
    """
    defines = media.defines | media.channels(textured=False) | {"TFM_SHADOW": int(has_solids)}
    defines |= frame.defines
    kernel = launcher.kernels.kernel("camera_pass", "camera_pass.cl", media.headers, defines)
    return launcher.start_windows(
        kernel,
        bounds,
        steps + met.longest,
        {"view": view} | met.arguments | frame.arguments("places", "solid", "albedo") | frame.stored(),
    )
