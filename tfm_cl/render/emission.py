"""What media emit, as light on their surroundings: looked up at the points of a lattice.

What each of the lights (`tfm_cl.plan.emission`) brings to a point (`tfm_cl.render.lattice_points`), and each
medium there would scatter towards the camera, is added up (``kernels/emission_lights.cl``); camera rays
interpolate it as they do the later orders of scattering (``kernels/view/orders.h``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

from tfm_cl.device.launch import LOOK_UP
from tfm_cl.render.lattice_points import RGB, LightsAtPoints, TowardsCamera, Variant, see_points, view_variant

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import pyopencl as cl

    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.render.batches import LightVariant
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.lattice_points import Arrived


def lights_variant(lights: LightVariant, media: MediaOnDevice, scattering: int) -> Variant:
    """Return those of the kernel that scatters lights; ``scattering``: media that bodies are made of."""
    headers, defines = view_variant(lights, media, scattering)
    return headers, defines | _of_media(scattering)


def pass_variant(media: MediaOnDevice, scattering: int, *, has_solids: bool) -> Variant:
    """Return those of the camera's pass through what is scattered."""
    defines = media.defines | media.channels(textured=False) | _of_media(scattering)
    return media.headers, defines | {"TFM_SHADOW": int(has_solids), "TFM_LATTICE": 2}


def _of_media(scattering: int) -> dict[str, int | str]:
    return {"TFM_ORDER_MEDIA": scattering, "TFM_ORDER_COLOURS": RGB * scattering}


@dataclass
class EmissionLattice(LightsAtPoints):
    """The lights of emission of a frame."""

    WHAT: ClassVar[str] = "the lattice of emission"

    _added: int = 0

    @cached_property
    def _numbers(self) -> cl.Buffer:
        return self.launcher.zeros(self.WHAT, 4 * RGB * self._scattering * self.lattice.points)

    def add(self, arrived: Arrived, of: LightVariant, lights: Sequence[int]) -> None:
        """Add what is scattered of some lights, all of a kind, towards the camera.

        Parameters
        ----------
        arrived
            Of these, in their order: by number.
        """
        launcher = self.launcher
        headers, defines = lights_variant(of, self.media, self._scattering)
        kernel = launcher.kernels.kernel("emission_lights", "emission_lights.cl", headers, defines)
        known = {"media": self.media.arguments["media"], "view": self.view, "orders": self._struct}
        known |= {"lights": self._structs_of(lights), "many": len(lights), "light": self._numbers}
        samples = LOOK_UP * len(lights) * launcher.lanes
        items = arrived.row // launcher.lanes
        self.seconds += launcher.run_items(kernel, items, samples, known | arrived.arguments)
        self._added += len(lights)

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
