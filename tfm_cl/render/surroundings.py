"""Light from all around, looked up at the points of a lattice.

What each medium at a point scatters towards the camera of what arrives there (`tfm_cl.render.lattice_points`)
is added up (``kernels/surroundings_view.cl``), and camera rays interpolate that
(``kernels/view/surroundings.h``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tfm_cl.device.launch import LOOK_UP
from tfm_cl.render.lattice_points import RGB, Around, LightsAtPoints, Variant, view_variant

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import pyopencl as cl
    from numpy.typing import NDArray

    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.render.batches import LightVariant
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.lattice_points import Arrived
    from tfm_cl.render.tracing.tracer import Tracer

NEIGHBOURS = np.array([place for place in np.ndindex(3, 3, 3) if place != (1, 1, 1)]) - 1
"""Of a point, in distances along x, y, z."""
TOWARDS_CAMERA = 0.5
"""By how many distances a neighbour may be farther away that lies straight on the way to the camera."""


def pass_variant(media: MediaOnDevice, scattering: int, *, has_solids: bool) -> Variant:
    """Return those of the camera's pass through what is scattered."""
    defines = media.defines | media.channels(textured=False)
    return media.headers, defines | {
        "TFM_SHADOW": int(has_solids),
        "TFM_LATTICE": 3,
        "TFM_ORDER_MEDIA": scattering,
    }


@dataclass(kw_only=True)
class SurroundingsLattice(LightsAtPoints):
    """The lights from all around of a frame.

    Attributes
    ----------
    lights
        Numbers of all that are looked up there, ascending.
    tracer
        Of the solids; None without any.
    """

    WHAT: ClassVar[str] = "the lattice of light from all around"

    lights: list[int]
    tracer: Tracer | None
    _known_sources: tuple[Arrived, cl.Buffer] | None = None

    @property
    def _numbers(self) -> int:
        """Of a point, as ``kernels/view/surroundings.h`` has them."""
        sorts = 2 if self.media.defines["TFM_OCTAVES"] != 1 else 1
        return RGB * self._scattering * sorts + self.channels

    @cached_property
    def _structs(self) -> cl.Buffer:
        return self._structs_of(self.lights)

    def towards_camera(self, arrived: Arrived, of: LightVariant, lights: Sequence[int]) -> cl.Buffer:
        """Return what some of the lights, all of a kind, scatter towards the camera, at all points."""
        launcher = self.launcher
        scattered = launcher.zeros(self.WHAT, 4 * self._numbers * self.lattice.points)
        headers, defines = view_variant(of, self.media, self._scattering)
        kernel = launcher.kernels.kernel("surroundings_view", "surroundings_view.cl", headers, defines)
        places = np.array([self.lights.index(number) for number in lights], np.int32)
        known = {"media": self.media.arguments["media"], "view": self.view, "orders": self._struct}
        known |= {"lights": self._structs, "these": launcher.upload(self.WHAT, places), "many": len(lights)}
        known |= {"sources": self._sources(arrived)}
        known |= arrived.arguments | {"scattered": scattered}
        items = arrived.row // launcher.lanes
        samples = LOOK_UP * len(lights) * launcher.lanes
        self.seconds += launcher.run_items(kernel, items, samples, known)
        return scattered

    def _sources(self, arrived: Arrived) -> cl.Buffer:
        """Say, of each point that is listed, from which of them its light is taken: its place among them.

        What solids hide from the camera is within them, or on their other side: there it may be dark, or lit
        by what no sample in front of them sees. Such points take the light of one beside them that is seen.
        """
        if self._known_sources is None or self._known_sources[0] is not arrived:
            sources = np.zeros(arrived.row, np.int32)
            sources[: arrived.count] = np.arange(arrived.count)
            if self.tracer is not None:
                points = self.lattice.positions(arrived.numbers)
                ways = np.asarray(self.scene.camera.from_) - points
                lengths = np.linalg.norm(ways, axis=1)
                ways[lengths == 0] = 1, 0, 0  # of the camera's own place
                ways /= np.linalg.norm(ways, axis=1, keepdims=True)
                hidden = self.tracer.occluded(points, ways, lengths, by_seen=True)
                sources[: arrived.count] = beside_hidden(self.lattice.size, arrived.numbers, hidden, ways)
            self._known_sources = arrived, self.launcher.upload(self.WHAT, sources)
        return self._known_sources[1]

    def on_shared_samples(self, scattered: cl.Buffer, lights: int, layer: int | None) -> Around:
        """Return what the scatter pass takes to see so many lights, `towards_camera`, on its way.

        ``layer``: as of `see`.
        """
        arguments = {"orders": self._struct, "scattered": scattered, "surrounding": lights}
        arguments |= {"surrounding_layer": layer or 0}
        return Around({"TFM_AROUND": 1, "TFM_ORDER_MEDIA": self._scattering}, arguments)

    def see(
        self,
        view: cl.Buffer,
        scattered: cl.Buffer,
        lights: int,
        bounds: Rectangle,
        steps: int,
        frame: FrameBuffers,
        done: Callable[[float], None],
        layer: int | None = None,
    ) -> float:
        """Add what the media scatter of some lights to the camera; returns device seconds.

        Parameters
        ----------
        view
            The struct, on the device.
        scattered
            Of `towards_camera`, for so many ``lights``.
        bounds
            Pixels x0, y0, x1, y1 of the frame's buffers.
        steps
            Samples along a camera ray.
        layer
            Number of the layer that they belong to; None where none are asked for.
        """
        headers, defines = pass_variant(self.media, self._scattering, has_solids=bool(self.scene.solids))
        defines |= frame.defines
        kernel = self.launcher.kernels.kernel("surroundings_pass", "surroundings_pass.cl", headers, defines)
        arguments = self.media.arguments | {"view": view, "orders": self._struct, "scattered": scattered}
        arguments |= {"lights": lights} | ({} if layer is None else {"layer": layer})
        arguments |= frame.arguments("places", "solid") | frame.stored()
        return self.launcher.run_windows(kernel, bounds, steps, arguments, done)


def beside_hidden(
    size: tuple[int, int, int],
    numbers: NDArray[np.int32],
    hidden: NDArray[np.bool_],
    ways: NDArray[np.floating],
) -> NDArray[np.int32]:
    """Return of each point which one stands for it: itself, or a neighbour that is seen where it is hidden.

    Parameters
    ----------
    size
        Points of the lattice along x, y, z.
    numbers
        [n], ascending: those that count, x first.
    hidden
        [n]: those that are not seen.
    ways
        [n, 3]: unit vectors towards the camera.

    Returns
    -------
    [n], places in ``numbers``: the nearest of 26 neighbours, rather one towards the camera.
    """
    stands = np.arange(len(numbers), dtype=np.int32)
    behind = np.flatnonzero(hidden)
    if not len(behind) or len(behind) == len(numbers):
        return stands
    nx, ny, nz = size
    place_of = np.full(nx * ny * nz, -1, np.int32)
    place_of[numbers[~hidden]] = stands[~hidden]
    of_behind = numbers[behind]
    x, y, z = of_behind % nx, of_behind // nx % ny, of_behind // (nx * ny)
    best = np.full(len(behind), np.inf)
    for step in NEIGHBOURS:
        i, j, k = x + step[0], y + step[1], z + step[2]
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny) & (k >= 0) & (k < nz)
        found = place_of[np.where(inside, (k * ny + j) * nx + i, of_behind)]
        length = float(np.linalg.norm(step))
        away = length - TOWARDS_CAMERA * (ways[behind] @ step) / length
        nearer = (found >= 0) & (away < best)
        best[nearer], stands[behind[nearer]] = away[nearer], found[nearer]
    return stands
