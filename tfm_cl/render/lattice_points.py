"""Points of a lattice on the device: where they are, what they scatter to a camera, its pass through them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.declared import ORDERS

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.program import Kernel
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene


def points_structs(lattice: Lattice, scene: Scene, samples: int, count: int = 1) -> NDArray[Any]:
    """Return structs [count] that tell kernels where points are, and what densities to read at each."""
    structs = np.zeros(count, ORDERS.dtype)
    structs["origin"] = np.subtract(lattice.origin, world_from_device(scene)[:3, 3])
    structs["spacing"], structs["size"], structs["samples"] = lattice.spacing, lattice.size, samples
    return structs


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
