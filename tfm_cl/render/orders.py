"""The later orders of scattering: light that is scattered again and again on a lattice.

Of what lights bring to a point (their reduced intensity), a part is scattered there, evenly; where that
arrives it is scattered once more:

    J₁(x) = Σ I T / 4π,    J_{k+1}(x) = ∫ L_k(x, ω) dω / 4π,    dL_k/ds = σ_t (ϖ J_k - L_k)

Order k of the radiance that the camera sees has ϖ J_k as its source. The first order is found without the
lattice, at each sample of the camera's rays and with the medium's own phase function. The later ones are
those of the medium that similarity theory puts in its place (`Medium.reduced`): what a lobe scatters nearly
straight on counts as not scattered. Where there is a lobe, the first order of that medium takes part, too,
less what of it the first order of the other shows, which is extinguished sooner.

For each of a few directions that are evenly spread and turned from order to order, light is swept through the
lattice plane by plane (``kernels/order_sweep.cl``). This is the method of discrete ordinates (Chandrasekhar,
"Radiative Transfer", 1950), by successive orders.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.declared import ORDERS, SWEEP
from tfm_cl.model import decided
from tfm_cl.plan.orders import DIRECTIONS, directions, medium_of, orders_of
from tfm_cl.scene.lights.colours import common_colour

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.program import Kernel
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.scene.scene import Scene

RADIANCE_BYTES = 256 << 20
"""Of the radiances of the directions that are swept together."""
POINTS_AT_ONCE = 1 << 24
"""Points times directions of a launch."""
SAMPLES_AT_ONCE = 1 << 21
"""Of the density, or of light, in a launch."""
WHAT = "the lattice of later orders"
"""What messages call it."""
RGB = 3

Variant = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""
Both = tuple["cl.Buffer", "cl.Buffer"]
"""Numbers of points in rows along x, and along y."""


def media_variant(media: MediaOnDevice, colours: int) -> Variant:
    """Return those of the kernel that looks at the density; ``colours``: numbers that hold light."""
    return media.headers, media.defines | {
        "TFM_CHANNELS": channels_of(media),
        "TFM_ORDER_COLOURS": colours,
    }


def lights_variant(batch: Batch, media: MediaOnDevice, colours: int) -> Variant:
    """Return those of the kernel that looks lights up."""
    headers, defines = batch.variant(media)
    return headers, defines | {"TFM_ORDER_COLOURS": colours, "TFM_CHANNELS": channels_of(media)}


def channels_of(media: MediaOnDevice) -> int:
    """Extinctions of a point: one where all colours have the same."""
    return media.channels(textured=False)["TFM_CHANNELS"]


def sweep_variant(channels: int, colours: int) -> Variant:
    """Return those of the kernels that sweep light through the lattice."""
    return (), {"TFM_CHANNELS": channels, "TFM_ORDER_COLOURS": colours}


def pass_variant(media: MediaOnDevice, colours: int, *, has_solids: bool) -> Variant:
    """Return those of the camera's pass through what later orders scatter."""
    defines = media.defines | {
        "TFM_CHANNELS": channels_of(media),
        "TFM_SHADOW": int(has_solids),
        "TFM_LATTICE": 2,
        "TFM_ORDER_COLOURS": colours,
    }
    return media.headers, defines


def rows_of(size: tuple[int, int, int], pad: int) -> tuple[Rows, Rows]:
    """Return how numbers of points lie in memory, in rows along x and along y."""
    x, y, z = size
    return (
        Rows((0, 1, 2), (1, x + 2 * pad, (x + 2 * pad) * (y + 2)), (x + 2 * pad) * (y + 2) * (z + 2)),
        Rows((1, 0, 2), (y + 2 * pad, 1, (y + 2 * pad) * (x + 2)), (y + 2 * pad) * (x + 2) * (z + 2)),
    )


class Rows(NamedTuple):
    """Where the numbers of points are."""

    axes: tuple[int, int, int]
    """From that whose neighbours are neighbours in memory to that whose are furthest apart."""
    strides: tuple[int, int, int]
    """From a point to the next along x, y, z."""
    numbers: int
    """Of all points, and those around them."""


def sweeps_of(lattice: Lattice, order: int, pad: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the structs of the directions in which light of an order goes.

    Those along y and z, whose planes have rows along x; those along x.
    """
    rows = rows_of(lattice.size, pad)
    found: tuple[list[Any], list[Any]] = [], []
    for direction in directions(DIRECTIONS, order):
        axis = int(np.abs(direction).argmax())
        turned, along = int(axis == 0), abs(direction[axis])
        strides = rows[turned].strides
        columns, across = (other for other in rows[turned].axes if other != axis)
        struct = np.zeros((), SWEEP.dtype)
        struct["columns"], struct["rows"] = lattice.size[columns], lattice.size[across]
        struct["planes"], struct["backwards"] = lattice.size[axis], direction[axis] < 0
        struct["row"], struct["plane"] = strides[across], strides[axis]
        struct["slope"] = direction[columns] / along, direction[across] / along
        struct["length"] = lattice.spacing / along
        found[turned].append(struct)
    along_x, along_y = (np.array(some, SWEEP.dtype) for some in found)
    return along_x, along_y


def rays_of(sweeps: NDArray[Any], lanes: int) -> int:
    """Work-items that the rays of any of some directions take, in chunks of lanes, at most."""
    shifts = np.ceil(np.abs(sweeps["slope"]) * sweeps["planes"][:, None]).astype(np.int64) + 1
    chunks = -(-(sweeps["columns"] + 1 + shifts[:, 0]) // lanes)
    return int((chunks * (sweeps["rows"] + 1 + shifts[:, 1])).max(initial=0))


@dataclass(frozen=True)
class Scattered:
    """Light of all later orders, at the points of a lattice.

    Attributes
    ----------
    colour
        RGB that it is a multiple of, where a point has one number for three.
    """

    numbers: cl.Buffer
    first: cl.Buffer | None
    """What arrives unscattered through the medium itself, where it is not its own reduced one."""
    nbytes: int
    colours: int
    colour: tuple[float, float, float]


class Seen(NamedTuple):
    """A medium on the device, and the struct of the camera that says how maps speak of it."""

    media: MediaOnDevice
    view: cl.Buffer

    @property
    def arguments(self) -> dict[str, Any]:
        """Of kernels, by name."""
        return {**self.media.arguments, "view": self.view}


class _Room(NamedTuple):
    """Memory that all orders use one after the other."""

    following: Both
    """Of what arrives at points next."""
    radiance: cl.Buffer
    """Of rays."""


@dataclass
class Orders:
    """The later orders of a frame.

    Attributes
    ----------
    scene
        Of single, fitted lights, and the medium of similarity theory.
    even
        That medium.
    own
        The medium itself.
    mean_cosine
        Of its phase function.
    """

    launcher: Launcher
    scene: Scene
    even: Seen
    own: Seen
    mean_cosine: float
    lattice: Lattice
    seconds: float = 0.0

    @cached_property
    def _struct(self) -> cl.Buffer:
        struct = np.zeros((), ORDERS.dtype)
        struct["origin"] = np.subtract(self.lattice.origin, world_from_device(self.scene)[:3, 3])
        struct["spacing"], struct["size"] = self.lattice.spacing, self.lattice.size
        struct["samples"] = self.lattice.samples
        struct["albedo"] = self._albedo
        return self.launcher.upload(WHAT, struct)

    @property
    def _albedo(self) -> NDArray[np.float64]:
        medium = medium_of(self.scene)
        return np.divide(medium.sigma_s, medium.sigma_t, out=np.zeros(3), where=medium.sigma_t > 0)

    @cached_property
    def _colour(self) -> NDArray[np.float64] | None:
        """The colour of all that is scattered, at most 1; None where lights or orders differ in theirs."""
        lights, albedo = self.scene.lights, self._albedo
        is_grey = channels_of(self.even.media) == 1 and np.ptp(albedo) == 0
        if not is_grey or any(light.is_textured for light in lights):
            return None
        return common_colour([light.intensity for light in lights])

    @property
    def _colours(self) -> int:
        return RGB if self._colour is None else 1

    def scatter(
        self, arrive: Callable[[Callable[[Batch], None]], None], done: Callable[[float], None]
    ) -> Scattered:
        """Find all later orders.

        Parameters
        ----------
        arrive
            Calls what it is given with batches of all lights, one after the other.
        done
            Called with the part that is done.
        """
        lattice, colours, channels = self.lattice, self._colours, channels_of(self.even.media)
        extinction, light = self._numbers(channels), self._numbers(colours)
        headers, defines = media_variant(self.even.media, colours)
        of_density = self.launcher.kernels.kernel("order_media", "order_media.cl", headers, defines)
        known = self.even.arguments | {"orders": self._struct}
        self._over_points(of_density, known | {"extinction": extinction[0]}, lattice.samples**3)
        self._turn(extinction, channels)
        nbytes = 4 * lattice.points * colours
        total, first = self.launcher.zeros(WHAT, nbytes), None
        if self.mean_cosine:
            first = self.launcher.empty(WHAT, nbytes, reuse=True)
            arrive(lambda batch: self._add_lights(batch, self.own, light[0]))
            self._pack(light[0], first)
            self.launcher.clear(light[0], 4 * colours * self._rows[0].numbers)
        arrive(lambda batch: self._add_lights(batch, self.even, light[0]))
        if first is not None:
            self._pack(light[0], total)
            nbytes *= 2
        room = _Room(self._numbers(colours), self.launcher.empty(WHAT, self._radiance_bytes, reuse=True))
        # What the last order needs is where light is scattered last but once.
        last = orders_of(self.scene) - 1
        for order in range(1, last + 1):
            self._turn(light, colours)
            self._sweep(order, extinction, light, room, total)
            done(order / last)
        colour = (1.0, 1.0, 1.0) if self._colour is None else tuple(self._colour.tolist())
        return Scattered(total, first, nbytes, colours, colour)

    @property
    def _pad(self) -> int:
        """Numbers before and behind each row: as kernels have it."""
        return self.launcher.lanes + 1

    @cached_property
    def _rows(self) -> tuple[Rows, Rows]:
        return rows_of(self.lattice.size, self._pad)

    @property
    def _together(self) -> int:
        """Directions that are swept at once."""
        of_direction = max(rows.numbers for rows in self._rows)
        most = min(RADIANCE_BYTES // (4 * self._colours * of_direction), POINTS_AT_ONCE // of_direction)
        return max(1, min(DIRECTIONS, most))

    @property
    def _radiance_bytes(self) -> int:
        return 4 * self._colours * self._together * max(rows.numbers for rows in self._rows)

    def _numbers(self, count: int) -> Both:
        """Make room for so many numbers of each point, in rows along x and along y, all 0."""
        first, second = (self.launcher.zeros(WHAT, 4 * count * rows.numbers) for rows in self._rows)
        return first, second

    def _over_points(self, kernel: Kernel, arguments: dict[str, Any], cost: int) -> None:
        """Run a kernel over all points, in launches of bounded time."""
        lanes = self.launcher.lanes
        items = -(-self.lattice.points // lanes)
        most = max(1, SAMPLES_AT_ONCE // (cost * lanes))
        for first in range(0, items, most):
            end = min(first + most, items)
            self._run(kernel, (end - first,), arguments | {"items": (first, end)})

    def _pack(self, light: cl.Buffer, packed: cl.Buffer) -> None:
        """Write light of the points one after the other."""
        items = -(-self.lattice.points // self.launcher.lanes)
        known = {"orders": self._struct, "light": light, "packed": packed}
        self._run(self._kernel("order_pack"), (items,), known)

    def _add_lights(self, batch: Batch, through: Seen, light: cl.Buffer) -> None:
        headers, defines = lights_variant(batch, through.media, self._colours)
        kernel = self.launcher.kernels.kernel("order_lights", "order_lights.cl", headers, defines)
        steps = decided(self.scene.map.steps) if batch.is_dual else 1
        arguments = through.arguments | {"orders": self._struct, "light": light}
        for number in range(len(batch.indices)):
            of_light = arguments | batch.arguments | {"number": number}
            self._over_points(kernel, of_light, self.lattice.samples**3 * steps)

    def _kernel(self, name: str) -> Kernel:
        headers, defines = sweep_variant(channels_of(self.even.media), self._colours)
        return self.launcher.kernels.kernel(name, "order_sweep.cl", headers, defines)

    def _run(self, kernel: Kernel, size: tuple[int, ...], arguments: dict[str, Any]) -> None:
        self.seconds += self.launcher.run(kernel, size, arguments)

    def _turn(self, numbers: Both, count: int) -> None:
        """Write numbers in rows along x once more in rows along y."""
        along_x, along_y = numbers
        items = -(-self.lattice.points // self.launcher.lanes)
        known = {"orders": self._struct, "numbers": along_x, "turned": along_y, "count": count}
        self._run(self._kernel("order_turn"), (items,), known)

    def _sweep(self, order: int, extinction: Both, light: Both, room: _Room, total: cl.Buffer) -> None:
        """Let what was scattered last arrive at all points, and add it to the total."""
        lanes, together = self.launcher.lanes, self._together
        for turned, sweeps in enumerate(sweeps_of(self.lattice, order, self._pad)):
            rows = self._rows[turned]
            x, y, z = (self.lattice.size[axis] for axis in rows.axes)
            for first in range(0, len(sweeps), together):
                some = sweeps[first : first + together]
                known = {
                    "sweeps": self.launcher.upload("the directions", some),
                    "radiance": room.radiance,
                    "count": len(some),
                    "size": rows.numbers,
                }
                of_points = {
                    "orders": self._struct,
                    "extinction": extinction[turned],
                    "light": light[turned],
                }
                self._run(self._kernel("order_sweep"), (rays_of(some, lanes), len(some)), known | of_points)
                adds = {"next": room.following[turned], "begins": int(first == 0)}
                self._run(self._kernel("order_gather"), (-(-x // lanes) * y * z,), known | adds)
            if not len(sweeps):
                self.launcher.clear(room.following[turned], 4 * self._colours * rows.numbers)
        items = -(-self.lattice.points // lanes)
        means = {"orders": self._struct, "light": light[0], "total": total, "share": 1 / DIRECTIONS}
        means |= {"next": room.following[0], "turned_next": room.following[1]}
        self._run(self._kernel("order_mean"), (items,), means)

    def see(
        self,
        views: tuple[cl.Buffer, cl.Buffer],
        found: Scattered,
        bounds: Rectangle,
        frame: FrameBuffers,
        done: Callable[[float], None],
    ) -> float:
        """Add what all later orders scatter to the camera; returns device seconds.

        Parameters
        ----------
        views
            The structs of the camera, as of the even medium and of its own.
        bounds
            Pixels x0, y0, x1, y1 of the frame's buffers.
        """
        passes = [(self.even, views[0], found.numbers, 1.0)]
        if found.first is not None:
            passes.append((self.own, views[1], found.first, self.mean_cosine - 1.0))
        return sum(
            self.launcher.run_windows(
                self._pass(through, found.colours),
                bounds,
                decided(self.scene.march.steps),
                through.arguments
                | frame.arguments("places", "solid", "later")
                | {
                    "view": view,
                    "orders": self._struct,
                    "scattered": numbers,
                    "colour": (*(share * part for part in found.colour), 0.0),
                },
                done,
            )
            for through, view, numbers, share in passes
        )

    def _pass(self, through: Seen, colours: int) -> Kernel:
        headers, defines = pass_variant(through.media, colours, has_solids=bool(self.scene.solids))
        return self.launcher.kernels.kernel("order_pass", "order_pass.cl", headers, defines)
