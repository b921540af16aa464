"""Primitives on the device, and lists of those that each bin of texels or pixels may meet.

A camera or a light sees primitives in a way of its own: what is narrower than its texels is widened. Bins of
`BIN` texels along a side list what their rays may meet: counted, summed up and filled in, run by run, so that
their order is always the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.field import Met
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.declared import PRIMITIVE, SET, SOURCE
from tfm_cl.errors import DeviceMemoryError

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.scene.bodies.primitives import Primitives
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

BIN = 8
"""Texels along a side of bins: a multiple of every tile's."""
SMALLEST_BIN = 4
"""Of maps with fewer than `LEAST_BINS` such bins along a side."""
LEAST_BINS = 32
MOST_RUNS = 64
"""Runs of primitives that are listed side by side."""
LEAST_RUN = 256
"""Primitives of a run, if there are several."""
MOST_LISTED = 1 << 28
"""Entries of all lists together: where there are more, bins grow."""
BINS_OF_LIGHT = 128
"""Along each side, of lights whose rays are followed to points between texels."""


FUNCTIONS = {
    "seen": ("(set)->kind", "(source, set, eye, seen, ball)"),
    "crossing": ("PRIMITIVE_KIND(primitive)", "(primitive, ball, ray, crossing)"),
    "part": ("PRIMITIVE_KIND(primitive)", "(primitive, crossing, t)"),
    "tangent": ("PRIMITIVE_KIND(primitive)", "(primitive, crossing)"),
}
"""What the header of each kind of primitive has: by what the kind is told, and the arguments."""


def choice(by: str, cases: Iterable[tuple[int, str]]) -> str:
    """Return a C expression that is one of some, by a number; the last one for all others."""
    *first, last = [*cases] or [(0, "0")]
    return "(" + "".join(f"{by} == {number} ? {value} : " for number, value in first) + f"{last[1]})"


@dataclass(frozen=True)
class Eye:
    """Where rays come from, as kernels are told it."""

    headers: tuple[str, ...]
    defines: dict[str, int | str]
    arguments: dict[str, Any]
    size: tuple[int, int]
    """Texels along x and y."""
    origin: NDArray[np.float64]
    """From the device's."""
    footprint: tuple[float, float]
    """Width of a texel at the origin, and what it gains per unit of distance; 0: they stay as they are."""

    @classmethod
    def of_camera(cls, scene: Scene, view: cl.Buffer, per_pixel: int = 1) -> Eye:
        """Return the camera's, whose struct is on the device, with so many rays along a side of a pixel."""
        camera = scene.camera
        origin = np.subtract(camera.from_, world_from_device(scene)[:3, 3])
        width = camera.pixel_width / per_pixel
        return cls((), {"TFM_FROM_LIGHT": 0}, {"view": view}, camera.res, origin, (0.0, width))

    @classmethod
    def of_light(
        cls,
        light: Light,
        of_light: cl.Buffer,
        device_origin: NDArray[np.float64],
        res: int,
        *,
        widens: bool = True,
    ) -> Eye:
        """Return the one of a fitted light's map; its struct is on the device."""
        near, far = light.footprint(0.0) / res, light.footprint(1.0) / res
        return cls(
            light.headers,
            {"TFM_FROM_LIGHT": 1, "TFM_INVERSE_SQUARE": int(light.falloff == "inverse-square")},
            {"light": of_light},
            (res, res),
            light.frame().world_from_light[:3, 3] - device_origin,
            (near, far - near) if widens else (0.0, 0.0),
        )


@dataclass(frozen=True)
class Seen:
    """Primitives as an eye sees them."""

    primitives: cl.Buffer
    balls: cl.Buffer
    """float4 each: centre and radius of a ball around all that rays may meet of it."""


@dataclass(frozen=True)
class Listed:
    """Lists of primitives, and these as the eye sees them."""

    seen: Seen
    starts: cl.Buffer
    """int [bins + 1]: where each list begins; the last is where all end."""
    members: cl.Buffer
    bins: tuple[int, int, int, int]
    """Columns, rows, texels along a side of a bin as a power of two, 0."""
    longest: int
    """Primitives in the longest list."""
    total: int
    """Entries of all."""

    def met(self, arguments: dict[str, Any]) -> Met:
        """Add these lists to the other arguments of kernels whose rays have these bins."""
        return Met(arguments | self.arguments(), self.longest)

    def arguments(self) -> dict[str, Any]:
        """Return what kernels whose rays have these bins take."""
        return {
            "primitives": self.seen.primitives,
            "balls": self.seen.balls,
            "bin_starts": self.starts,
            "bin_members": self.members,
            "bins": self.bins,
        }


class PrimitivesOnDevice:
    """All primitives of a scene.

    Parameters
    ----------
    scene
        With some.
    """

    def __init__(self, launcher: Launcher, scene: Scene) -> None:
        self._launcher, self._bodies = launcher, scene.primitives
        self.kinds = tuple(dict.fromkeys(type(body) for body in self._bodies))
        self.origin = world_from_device(scene)[:3, 3]
        sources = np.concatenate(
            [_sources(body, number, self.origin) for number, body in enumerate(self._bodies)]
        )
        self.count = len(sources)
        self._sources = launcher.upload("the primitives", sources)
        colours = _colours(self._bodies)
        self._colours = launcher.upload("the colours of primitives", colours)
        self._colour_stride = 3 if len(colours) > 1 else 0
        self.nbytes = sources.nbytes + colours.nbytes
        """Size on the device."""

    @property
    def headers(self) -> tuple[str, ...]:
        """Of the kinds of primitives."""
        return tuple(kind.HEADER for kind in self.kinds)

    @property
    def defines(self) -> dict[str, int | str]:
        """Macros that choose among the functions of the kinds' headers."""
        names = [PurePath(header).stem for header in self.headers]
        return {
            f"TFM_PRIMITIVE_{function.upper()}{arguments}": choice(
                by, ((number, f"{name}_{function}{arguments}") for number, name in enumerate(names))
            )
            for function, (by, arguments) in FUNCTIONS.items()
        }

    def sets(
        self, media: Sequence[int], weights: NDArray[np.float64], extinctions: Sequence[float]
    ) -> cl.Buffer:
        """Put on the device what the primitives of each body have in common.

        Parameters
        ----------
        media
            Number of each body's medium.
        weights
            [bodies, 3, 3]: what a density of 1 of each colour (last) adds to each amount.
        extinctions
            At density 1, that opacities of each are meant for.
        """
        structs = np.zeros(len(self._bodies), SET.dtype)
        for struct, body, medium, weight, extinction in zip(
            structs, self._bodies, media, weights, extinctions, strict=True
        ):
            struct["kind"], struct["profile"], struct["mass"] = (
                self.kinds.index(type(body)),
                body.profile_number,
                body.unit_mass,
            )
            struct["medium"], struct["extinction"] = medium, extinction
            struct["weights"] = weight.ravel()
        return self._launcher.upload("the kinds of primitives", structs)

    def seen(self, sets: cl.Buffer, eye: Eye) -> Seen:
        """Return the primitives as an eye sees them: eyes that widen nothing see the same."""
        launcher, count = self._launcher, self.count
        headers, defines = self._variant(eye)
        what = "the primitives as they are seen"
        seen = launcher.empty(what, PRIMITIVE.dtype.itemsize * count, reuse=True)
        balls = launcher.empty(what, 16 * count, reuse=True)
        launcher.run(
            launcher.kernels.kernel("see_primitives", "primitives.cl", headers, defines),
            (count,),
            {
                "sources": self._sources,
                "sets": sets,
                "colours": self._colours,
                "colour_stride": self._colour_stride,
                "origin": (*eye.origin.tolist(), 0.0),
                "footprint": eye.footprint,
                "seen": seen,
                "balls": balls,
                "count": count,
            },
        )
        return Seen(seen, balls)

    def listed_by_light(self, sets: cl.Buffer, light: Light, of_light: cl.Buffer, res: int) -> Listed:
        """List what the rays of a fitted light's map meet; its struct is on the device."""
        eye = Eye.of_light(light, of_light, self.origin, res)
        return self.listed(self.seen(sets, eye), eye)

    def listed(self, seen: Seen, eye: Eye, finest: int | None = None) -> Listed:
        """List what the rays of an eye may meet.

        Parameters
        ----------
        seen
            Of `seen`.
        finest
            Texels along a side of the smallest bins; by default as `BIN` and `LEAST_BINS` have it.

        Raises
        ------
        DeviceMemoryError
            Lists that the device cannot hold.
        """
        launcher, count = self._launcher, self.count
        headers, defines = self._variant(eye)
        kernel = launcher.kernels.kernel("list_primitives", "primitives.cl", headers, defines)
        runs = min(MOST_RUNS, -(-count // LEAST_RUN))
        run = -(-count // runs)
        edge = finest or _finest(eye.size)
        while True:
            columns, rows = (-(-texels // edge) for texels in eye.size)
            places = launcher.empty("the lengths of lists", 4 * runs * columns * rows, reuse=True)
            arguments = {
                **eye.arguments,
                "balls": seen.balls,
                "size": (*eye.size, 0, 0),
                "bins": (columns, rows, edge, run),
                "places": places,
                "bin_members": places,
                "count": count,
                "writes": 0,
            }
            launcher.run(kernel, (runs,), arguments)
            counts = launcher.download(places, (runs, columns * rows), np.int32)
            lengths = counts.sum(axis=0, dtype=np.int64)
            total = int(lengths.sum())
            if self._fit(total):
                break
            if columns * rows == 1:
                raise DeviceMemoryError(f"{count:,} primitives are more than a list of the device holds")
            edge *= 2
        starts = np.zeros(columns * rows + 1, np.int64)
        np.cumsum(lengths, out=starts[1:])
        begins = np.cumsum(counts, axis=0, dtype=np.int64) - counts + starts[:-1]
        launcher.write(places, begins.astype(np.int32))
        members = launcher.empty("the lists of primitives", 4 * max(total, 1), reuse=True)
        launcher.run(kernel, (runs,), arguments | {"bin_members": members, "writes": 1})
        where = launcher.upload("where lists begin", starts.astype(np.int32))
        bins = columns, rows, edge.bit_length() - 1, 0
        return Listed(seen, where, members, bins, int(lengths.max(initial=0)), total)

    def joined(self, seen: Seen, eyes: Sequence[Eye]) -> Joined:
        """List what the rays of several eyes may meet, in bins of one size, one eye after the other.

        Parameters
        ----------
        seen
            Of `seen`: alike for all eyes, which widen nothing and have as many texels.
        eyes
            At least one.

        Raises
        ------
        DeviceMemoryError
            Lists that the device cannot hold, whatever the size of bins.
        """
        finest = 1
        while True:
            lists = [self.listed(seen, eye, finest) for eye in eyes]
            edges = {1 << one.bins[2] for one in lists}
            if len(edges) > 1:
                finest = max(edges)
                continue
            total = sum(one.total for one in lists)
            if self._fit(total):
                return _joined(self._launcher, lists)
            if lists[0].bins[:2] == (1, 1):
                raise DeviceMemoryError(
                    f"{len(lists)} lights meet primitives in {total:,} lists' entries: render fewer at once"
                )
            finest = 2 * max(edges)

    def _fit(self, entries: int) -> bool:
        """Tell whether the device can hold so many entries of lists."""
        return 4 * entries <= min(self._launcher.largest_buffer, 4 * MOST_LISTED)

    def _variant(self, eye: Eye) -> tuple[tuple[str, ...], dict[str, int | str]]:
        """Return headers and macros of kernels that see with an eye."""
        return (*self.headers, *eye.headers), eye.defines | self.defines


@dataclass(frozen=True)
class Joined:
    """Lists of several eyes, all of which take primitives as they are."""

    listed: Listed
    first_bins: NDArray[np.int32]
    """Of each eye, the number of its first bin."""


def _joined(launcher: Launcher, lists: Sequence[Listed]) -> Joined:
    """Put the lists of eyes with the same bins one after the other."""
    first, bins = lists[0], lists[0].bins[0] * lists[0].bins[1]
    numbers = bins * np.arange(len(lists), dtype=np.int32)
    if len(lists) == 1:
        return Joined(first, numbers)
    ends = np.cumsum([0, *(one.total for one in lists)])
    members = launcher.empty("the lights' lists of primitives", 4 * max(int(ends[-1]), 1), reuse=True)
    starts = np.zeros(bins * len(lists) + 1, np.int32)
    for i, one in enumerate(lists):
        begins = launcher.download(one.starts, (bins + 1,), np.int32)
        starts[i * bins : (i + 1) * bins + 1] = begins + ends[i]
        if one.total:
            launcher.copy(one.members, members, 4 * one.total, first=0, to=4 * int(ends[i]))
    longest = max(one.longest for one in lists)
    where = launcher.upload("where the lights' lists begin", starts)
    return Joined(Listed(first.seen, where, members, first.bins, longest, int(ends[-1])), numbers)


def _finest(size: tuple[int, int]) -> int:
    edge = BIN
    while edge > SMALLEST_BIN and max(size) // edge < LEAST_BINS:
        edge //= 2
    return edge


def _sources(body: Primitives, number: int, origin: NDArray[np.float64]) -> NDArray[Any]:
    """Return the structs of a body's primitives."""
    structs = np.zeros(len(body.positions), SOURCE.dtype)
    body.fill_sources(structs, origin)
    structs["set"] = number
    return structs


def _colours(bodies: Sequence[Primitives]) -> NDArray[np.float32]:
    """Return the colours of all primitives, [n, 3], or that of all, [1, 3], where none has one of its own."""
    if all(body.colour is None for body in bodies):
        return np.ones((1, 3), np.float32)
    return np.concatenate(
        [
            np.ones((len(body.positions), 3), np.float32) if body.colour is None else body.colour
            for body in bodies
        ]
    )
