"""Light on a lattice: many lights at the price of looking each up once a voxel.

Where the light of a scene is smooth within its grids, what all lights scatter towards the camera is found at
the voxels of every block with density, and camera rays interpolate it as they do the density
(``kernels/view/lattice.h``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import BLOCK_BRICKS, BLOCK_NUMBERS, BRICK_EDGE, LATTICE_AT_ONCE, MOST_SHARED
from tfm_cl.device.bricks import MAX_INDEX, record_voxels
from tfm_cl.device.cache import Same
from tfm_cl.device.structs.bodies import padded_from_index
from tfm_cl.scene.lights.colours import common_colour

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import pyopencl as cl

    from tfm_cl.device.bricks import BrickGrid
    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.program import Kernel
    from tfm_cl.device.running import InTurn, Running
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene

MOST_APART = 8
"""Layers of lights that a lattice holds: each takes a look-up a sample."""
LOOK_UPS = 1 << 22
"""Of a light at voxels, at most, in a launch."""
BEAMS = 16
"""Parts of a light's map, along each side, whose blocks are looked up one after the other."""


@dataclass(frozen=True)
class _Records:
    """Records on the device, in an order."""

    numbers: cl.Buffer
    count: int

    @property
    def nbytes(self) -> int:
        """Size."""
        return int(self.numbers.size)


@dataclass(frozen=True)
class _Places:
    """Where the lattice of some grids has light of its own."""

    numbers: NDArray[np.int32]
    """Of the records, one for each block."""
    centres: NDArray[np.float64]
    """[records, 3]: the middles of their blocks, in the world."""
    records: _Records
    """The same numbers."""
    marks: cl.Buffer
    """Which work-items have voxels to look a light up at, and which of theirs."""

    @property
    def nbytes(self) -> int:
        """Size, on host and device."""
        return self.numbers.nbytes + self.centres.nbytes + self.records.nbytes + int(self.marks.size)


Variant = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""


def voxels_variant(batch: Batch, media: MediaOnDevice, colours: int, apart: int) -> Variant:
    """Return those of the kernels that look lights up.

    Parameters
    ----------
    colours
        Numbers that hold the radiance,
    apart
        of so many parts of the light.
    """
    headers, defines = batch.variant(media)
    return headers, defines | {"TFM_LATTICE_COLOURS": colours, "TFM_LATTICE_APART": apart}


def pass_variant(media: MediaOnDevice, colours: int, apart: int) -> Variant:
    """Return those of the camera's pass through the lattice."""
    defines = media.defines | media.channels(textured=False)
    return media.headers, defines | {
        "TFM_SHADOW": 0,
        "TFM_LATTICE": 1,
        "TFM_LATTICE_COLOURS": colours,
        "TFM_LATTICE_APART": apart,
    }


@dataclass
class Lattice:
    """The lights of a frame at the voxels of its grids.

    Attributes
    ----------
    cache
        Of the session: where there is density, and in which order lights are looked up there.
    scene
        Of single, fitted lights.
    media
        Its media; all grids have one.
    view
        The struct, on the device.
    lights
        Numbers of those that are on the lattice; all are added before the camera sees them.
    layers
        Numbers of the layers that all lights of the scene belong to; None where none are asked for.
    """

    launcher: Launcher
    cache: Cache
    scene: Scene
    media: MediaOnDevice
    view: object
    lights: list[int]
    layers: list[int] | None = None
    _added: int = 0
    _launches: InTurn = field(init=False)

    def __post_init__(self) -> None:
        """Nothing is under way."""
        self._launches = self.launcher.in_turn()

    @cached_property
    def apart(self) -> list[int]:
        """Layers whose light is known apart."""
        return [] if self.layers is None else list(dict.fromkeys(self.layers[i] for i in self.lights))

    @property
    def _parts(self) -> int:
        return max(1, len(self.apart))

    def _part(self, light: int) -> int:
        return 0 if self.layers is None else self.apart.index(self.layers[light])

    @cached_property
    def _numbers(self) -> cl.Buffer:
        # What nobody sees has no light: it may be read, and weighs nothing.
        return self.launcher.zeros("the lattice of light", self.nbytes)

    @property
    def _bricks(self) -> BrickGrid:
        assert self.media.bricks is not None  # noqa: S101 - there are grids
        return self.media.bricks

    @property
    def _groups(self) -> int:
        """Work-items of a record."""
        lanes = self.launcher.lanes
        return -(-((BLOCK_BRICKS * BRICK_EDGE + MOST_SHARED[lanes]) ** 3) // (lanes * LATTICE_AT_ONCE[lanes]))

    @property
    def nbytes(self) -> int:
        """Size on the device."""
        voxels = self._bricks.records * record_voxels(self.launcher.lanes)
        # All octaves but the first are known apart: how much there is of them differs from ray to ray.
        sorts = 2 if self.media.defines["TFM_OCTAVES"] != 1 else 1
        return 4 * voxels * (sorts * self._parts * self._colours + self._channels)

    @property
    def fits(self) -> bool:
        """Whether kernels can reach all of it."""
        return self.nbytes <= min(self.launcher.largest_buffer, 4 * MAX_INDEX)

    @property
    def _channels(self) -> int:
        return self.media.channels(textured=False)["TFM_CHANNELS"]

    @cached_property
    def _colour(self) -> NDArray[np.float64] | None:
        """The colour, at most 1, that those of all lights are multiples of; None where they differ."""
        return common_colour([self.scene.lights[i].intensity for i in self.lights])

    @property
    def _colours(self) -> int:
        """Numbers that hold the radiance: 1 where all lights have one colour, else 3."""
        return 3 if self._colour is None or self._channels == 3 else 1  # noqa: PLR2004 - red, green, blue

    def add(self, batch: Batch) -> None:
        """Begin to look some of the lights up."""
        launcher, media = self.launcher, self.media
        headers, defines = voxels_variant(batch, media, self._colours, self._parts)

        def start(name: str, records: _Records, arguments: dict[str, Any]) -> None:
            kernel = launcher.kernels.kernel(name, "light_lattice.cl", headers, defines)
            for launch in self._over_records(kernel, records, arguments):
                self._launches.add(launch)

        def find() -> _Places:
            blocks = launcher.download(self._bricks.blocks, (self._bricks.records, BLOCK_NUMBERS), np.int32)
            numbers = np.flatnonzero(blocks[:, 3] >= 0).astype(np.int32)
            records = self._uploaded(numbers)
            marks = launcher.empty("the marks of a lattice", self._bricks.records * self._groups)
            arguments = {name: media.arguments[name] for name in ("grids", "bricks")} | {"marks": marks}
            start("mark_voxels", records, arguments)
            self._launches.wait()  # what fails is not kept
            return _Places(numbers, self._centres(blocks[numbers]), records, marks)

        places = self.cache.get("lattice", self._key, find, lambda found: found.nbytes)
        of_all = {**media.arguments, **batch.arguments, "view": self.view, "count": len(self.lights)}
        lattice = {"lattice": self._numbers}
        of_all |= {"marks": places.marks} | lattice
        for number, light in enumerate(batch.indices):
            begins, ends = self._added == 0, self._added + 1 == len(self.lights)
            of_light = {"number": number, "begins": int(begins), "ends": int(ends)}
            of_light["part"] = self._part(light)
            start("light_lattice", self._along_beams(places, light), of_all | of_light)
            self._added += 1
        if self.is_full:
            start("share_lattice", places.records, lattice)

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """All that the places of a lattice depend on."""
        return Same(self._bricks), *(grid.world_from_index.tobytes() for grid in self.scene.grids)

    def _centres(self, blocks: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return the middles of some blocks, [records, 3], in the world."""
        x, y, z, grids, *_ = blocks.T
        centres = BLOCK_BRICKS * BRICK_EDGE * (np.stack([x, y, z], axis=-1) + 0.5)
        for number, grid in enumerate(self.scene.grids):
            world_from_padded = grid.world_from_index @ np.linalg.inv(padded_from_index())
            here = grids == number
            centres[here] = centres[here] @ world_from_padded[:3, :3].T + world_from_padded[:3, 3]
        return centres

    def _uploaded(self, numbers: NDArray[np.int32]) -> _Records:
        return _Records(self.launcher.upload("the records of a lattice", numbers), len(numbers))

    def _along_beams(self, places: _Places, light: int) -> _Records:
        """Sort the records so that those near each other read the same part of a light's map."""
        asked = self.scene.lights[light]

        def sort() -> _Records:
            arrival = asked.arrival(places.centres)
            u, v = np.floor(BEAMS * arrival.position.T)
            return self._uploaded(places.numbers[np.lexsort((arrival.distance, u, v))])

        key = self._key, asked.map_key()
        return self.cache.get("lattice order", key, sort, lambda order: order.nbytes)

    def _over_records(
        self, kernel: Kernel, records: _Records, arguments: dict[str, Any]
    ) -> Iterator[Running]:
        """Start a kernel over records, in launches of `LOOK_UPS`, and yield each."""
        launcher, groups = self.launcher, self._groups
        most = max(1, LOOK_UPS // record_voxels(launcher.lanes))
        arguments = {**arguments, "blocks": self._bricks.blocks, "records": records.numbers}
        for first in range(0, records.count, most):
            end = min(first + most, records.count)
            yield launcher.start(kernel, ((end - first) * groups,), arguments | {"window": (first, end)})

    @property
    def is_full(self) -> bool:
        """Whether all lights have been added."""
        return self._added == len(self.lights)

    def see(
        self,
        view: object,
        bounds: Rectangle,
        steps: int,
        frame: FrameBuffers,
        done: Callable[[float], None],
    ) -> float:
        """Store what lies along the camera rays, and what the lights scatter there.

        Returns device seconds, with those of looking lights up since this was called last.

        Parameters
        ----------
        view
            The struct, on the device.
        bounds
            Pixels x0, y0, x1, y1 of the frame's buffers.
        steps
            Samples along a camera ray.
        """
        launcher, media = self.launcher, self.media
        headers, defines = pass_variant(media, self._colours, self._parts)
        defines |= frame.defines
        kernel = launcher.kernels.kernel("lattice_pass", "lattice_pass.cl", headers, defines)
        lights = np.array([self.scene.lights[i].intensity for i in self.lights])
        # Of a colour that no light has, logarithms hold a little.
        colour = np.where(lights.any(axis=0), 1.0, 0.0)
        if self._colour is not None and self._colours == 1:
            colour = self._colour
        layers = {}
        if self.apart:
            layers["layers"] = launcher.upload("the layers' numbers", np.array(self.apart, np.int32))
        seconds = launcher.run_windows(
            kernel,
            bounds,
            steps,
            media.arguments
            | frame.arguments("places", "albedo")
            | frame.stored()
            | {
                "view": view,
                "lattice": self._numbers,
                "colour": (*colour.tolist(), 0.0),
                "lights": len(self.lights),
            }
            | layers,
            done,
        )
        seconds += self._launches.wait()
        self._launches = launcher.in_turn()
        return seconds
