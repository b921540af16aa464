"""What media emit, as light on their surroundings: looked up at the points of a lattice.

What each of the lights (`tfm_cl.plan.emission`) brings to a point, and each medium there would scatter
towards the camera, is added up (``kernels/emission_lights.cl``); camera rays interpolate it as they do the
later orders of scattering (``kernels/view/orders.h``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from tfm_cl.device.launch import LOOK_UP
from tfm_cl.render.lattice_points import TowardsCamera, points_structs, see_points

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene

WHAT = "the lattice of emission"
"""What messages call it."""
RGB = 3

Variant = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""


def lights_variant(batch: Batch, media: MediaOnDevice, scattering: int) -> Variant:
    """Return those of the kernel that looks lights up; ``scattering``: media that bodies are made of."""
    headers, defines = batch.variant(media)
    return headers, defines | _of_media(scattering)


def pass_variant(media: MediaOnDevice, scattering: int, *, has_solids: bool) -> Variant:
    """Return those of the camera's pass through what is scattered."""
    defines = media.defines | media.channels(textured=False) | _of_media(scattering)
    return media.headers, defines | {"TFM_SHADOW": int(has_solids), "TFM_LATTICE": 2}


def _of_media(scattering: int) -> dict[str, int | str]:
    return {"TFM_ORDER_MEDIA": scattering, "TFM_ORDER_COLOURS": RGB * scattering}


@dataclass
class EmissionLattice:
    """The lights of emission of a frame.

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
    """

    launcher: Launcher
    scene: Scene
    media: MediaOnDevice
    view: cl.Buffer
    lattice: Lattice
    _added: int = 0

    @property
    def _scattering(self) -> int:
        """Media that bodies are made of."""
        return len({self.scene.medium_of(body) for body in self.scene.bodies})

    @cached_property
    def _struct(self) -> cl.Buffer:
        return self.launcher.upload(WHAT, points_structs(self.lattice, self.scene, self.lattice.samples))

    @cached_property
    def _numbers(self) -> cl.Buffer:
        return self.launcher.empty(WHAT, 4 * RGB * self._scattering * self.lattice.points, reuse=True)

    def add(self, batch: Batch, steps: int) -> float:
        """Look some of the lights up; returns device seconds.

        Parameters
        ----------
        steps
            Densities that are read on the way to a light, where no map holds them.
        """
        launcher, lanes = self.launcher, self.launcher.lanes
        headers, defines = lights_variant(batch, self.media, self._scattering)
        kernel = launcher.kernels.kernel("emission_lights", "emission_lights.cl", headers, defines)
        known = self.media.arguments | batch.arguments
        known |= {"view": self.view, "orders": self._struct, "light": self._numbers}
        items, seconds = -(-self.lattice.points // lanes), 0.0
        for number in range(len(batch.indices)):
            of_light = known | {"number": number, "begins": int(self._added == 0)}
            seconds += launcher.run_items(kernel, items, LOOK_UP * steps * lanes, of_light)
            self._added += 1
        return seconds

    def see(
        self,
        view: object,
        bounds: Rectangle,
        steps: int,
        frame: FrameBuffers,
        done: Callable[[float], None],
    ) -> float:
        """Add what the media scatter of all the lights to the camera; returns device seconds.

        Parameters
        ----------
        view
            The struct, on the device.
        bounds
            Pixels x0, y0, x1, y1 of the frame's buffers.
        steps
            Samples along a camera ray.
        """
        if not self._added:
            return 0.0
        headers, defines = pass_variant(self.media, self._scattering, has_solids=bool(self.scene.solids))
        defines |= frame.deep_defines
        kernel = self.launcher.kernels.kernel("order_pass", "order_pass.cl", headers, defines)
        known = self.media.arguments | {"view": view, "orders": self._struct}
        found = TowardsCamera(self._numbers, RGB * self._scattering, (1.0, 1.0, 1.0))
        return see_points(self.launcher, kernel, known, found, bounds, steps, frame, done)
