"""What the points of a lattice scatter to a camera, and the camera's pass through it (``order_pass.cl``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.program import Kernel
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle


class TowardsCamera(NamedTuple):
    """What points scatter to a camera."""

    numbers: cl.Buffer
    """Of the points one after the other."""
    colours: int
    """Numbers of each."""
    colour: tuple[float, float, float]
    """RGB that they are multiples of."""


def see_points(
    launcher: Launcher,
    kernel: Kernel,
    known: dict[str, Any],
    found: TowardsCamera,
    bounds: Rectangle,
    steps: int,
    frame: FrameBuffers,
    done: Callable[[float], None],
) -> float:
    """Add what the points of a lattice scatter to the camera; returns device seconds.

    Parameters
    ----------
    kernel
        Of ``order_pass.cl``.
    known
        Its arguments for the media, the camera and the points.
    bounds
        Pixels x0, y0, x1, y1 of the frame's buffers.
    steps
        Samples along a camera ray.
    """
    of_points = {"scattered": found.numbers, "colour": (*found.colour, 0.0)}
    arguments = known | of_points | frame.arguments("places", "solid", "later") | frame.deep
    return launcher.run_windows(kernel, bounds, steps, arguments, done)
