"""Points of a lattice on the device: where they are, what lights bring there, what they scatter to a camera.

How much of a light arrives at a point does not depend on the camera, and is kept from frame to frame
(``kernels/points.cl``). What media scatter of it towards the camera is added up for each frame: see
`tfm_cl.render.surroundings` and `tfm_cl.render.emission`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.launch import LOOK_UP
from tfm_cl.device.structs.declared import ORDERS
from tfm_cl.device.structs.light import light_structs

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.program import Kernel
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene

RGB = 3
Variant = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""


def points_structs(lattice: Lattice, scene: Scene, samples: int, count: int = 1) -> NDArray[Any]:
    """Return structs [count] that tell kernels where points are, and what densities to read at each."""
    structs = np.zeros(count, ORDERS.dtype)
    structs["origin"] = np.subtract(lattice.origin, world_from_device(scene)[:3, 3])
    structs["spacing"], structs["size"], structs["samples"] = lattice.spacing, lattice.size, samples
    return structs


class Kind(Protocol):
    """What kernels must know of lights: `tfm_cl.render.batches.LightVariant`."""

    @property
    def headers(self) -> tuple[str, ...]:
        """Of the lights' kind and chart."""

    @property
    def falloff(self) -> tuple[tuple[str, int | str], ...]:
        """Macros."""


class Lights(Protocol):
    """Some lights on the device: `tfm_cl.render.batches.Batch`."""

    @property
    def indices(self) -> list[int]:
        """Their numbers in the scene."""

    @property
    def arguments(self) -> dict[str, Any]:
        """Of kernels that look them up."""

    def variant(self, media: MediaOnDevice) -> Variant:
        """Return headers and macros of such kernels."""


def depths_variant(batch: Lights, media: MediaOnDevice) -> Variant:
    """Return those of the kernels that look lights up."""
    headers, defines = batch.variant(media)
    return headers, defines | {"TFM_ORDER_COLOURS": RGB}


def view_variant(lights: Kind, media: MediaOnDevice, scattering: int) -> Variant:
    """Return those of kernels that scatter lights of a kind towards the camera.

    ``scattering``: media that bodies are made of.
    """
    defines = {**dict(lights.falloff), **media.defines, **media.channels(textured=False)}
    return (*media.headers, *lights.headers), defines | {"TFM_ORDER_MEDIA": scattering}


@dataclass(frozen=True)
class Arrived:
    """Optical depths on the ways from lights to points near density; they do not depend on the camera."""

    listed: cl.Buffer
    """int: numbers of the points, ascending."""
    count: int
    """Of these."""
    depths: cl.Buffer
    """float [lights, channels, row]."""
    row: int
    """``count``, rounded up to whole lanes."""
    numbers: NDArray[np.int32]
    """As ``listed``, on the host."""
    nbytes: int

    @property
    def arguments(self) -> dict[str, object]:
        """Of kernels that scatter this."""
        return {"listed": self.listed, "depths": self.depths, "count": self.count, "row": self.row}


@dataclass
class LightsAtPoints:
    """Lights of a frame that are looked up at the points of a lattice.

    Attributes
    ----------
    scene
        Of single, fitted lights; its media emit nothing.
    media
        These.
    view
        The struct of the whole picture, on the device.
    lattice
        Where the points are.
    seconds
        On the device, so far.
    """

    WHAT: ClassVar[str]
    """What messages call the lattice."""

    launcher: Launcher
    scene: Scene
    media: MediaOnDevice
    view: cl.Buffer
    lattice: Lattice
    seconds: float = 0.0

    @property
    def _scattering(self) -> int:
        """Media that bodies are made of."""
        return len({self.scene.medium_of(body) for body in self.scene.bodies})

    @property
    def channels(self) -> int:
        """Extinctions of a point: one where all colours have the same."""
        return self.media.channels(textured=False)["TFM_CHANNELS"]

    @cached_property
    def _struct(self) -> cl.Buffer:
        structs = points_structs(self.lattice, self.scene, self.lattice.samples)
        return self.launcher.upload(self.WHAT, structs)

    def _structs_of(self, lights: Sequence[int]) -> cl.Buffer:
        structs = light_structs(self.scene, [self.scene.lights[number] for number in lights])
        return self.launcher.upload(self.WHAT, structs)

    def arrived(self, batches: Sequence[Lights], steps: int) -> Arrived:
        """Look lights up: those of some batches, in the order of their numbers.

        Parameters
        ----------
        steps
            Densities that are read on the way to a light, where no map holds them.
        """
        launcher, lanes = self.launcher, self.launcher.lanes
        lights = sorted(light for batch in batches for light in batch.indices)
        near = self._near_density(batches[0])
        items = max(1, -(-len(near) // lanes))
        row = items * lanes
        nbytes = 4 * row * self.channels * len(lights)
        listed = launcher.upload(self.WHAT, near if len(near) else np.zeros(1, np.int32))
        depths = launcher.empty(self.WHAT, nbytes)
        for batch in batches:
            kernel = launcher.kernels.kernel("points_depths", "points.cl", *depths_variant(batch, self.media))
            known = self.media.arguments | batch.arguments
            known |= {"view": self.view, "orders": self._struct, "listed": listed, "depths": depths}
            known |= {"count": len(near), "row": row}
            for number, light in enumerate(batch.indices):
                of_light = known | {"number": number, "place": lights.index(light)}
                self.seconds += launcher.run_items(kernel, items, LOOK_UP * steps * lanes, of_light)
        return Arrived(listed, len(near), depths, row, near, nbytes + 2 * near.nbytes)

    def _near_density(self, batch: Lights) -> NDArray[np.int32]:
        """Numbers of the points that samples with density may read."""
        points = self.lattice.points
        if self.scene.homogeneous or self.media.bricks is None:
            return np.arange(points, dtype=np.int32)
        launcher, items = self.launcher, -(-points // self.launcher.lanes)
        variant = depths_variant(batch, self.media)
        kernel = launcher.kernels.kernel("points_near_density", "points.cl", *variant)
        near = launcher.empty(self.WHAT, points, reuse=True)
        known = {name: self.media.arguments[name] for name in ("grids", "bricks")}
        known |= {"orders": self._struct, "near": near}
        self.seconds += launcher.run_items(kernel, items, LOOK_UP * launcher.lanes, known)
        return np.flatnonzero(launcher.download(near, (points,), np.uint8)).astype(np.int32)


class Around(NamedTuple):
    """Light from all around, as points know it: for the scatter pass."""

    defines: dict[str, int | str]
    arguments: dict[str, Any]


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
