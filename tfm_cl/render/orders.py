"""The later orders of scattering: light that is scattered again and again on a lattice.

Of what lights bring to a point (their reduced intensity), a part is scattered there; where that arrives it is
scattered once more:

    J₁(x) = Σ I T / 4π,    J_{k+1}(x) = ∫ L_k(x, ω) dω / 4π,    dL_k/ds = σ_t (ϖ J_k - L_k)

What media emit is L₀, dL₀/ds = j - σ_t L₀, and adds its mean to J₁. Of it the first order, too, is found on
the lattice, where it is not taken for lights (`tfm_cl.scene.emission_lights`).

Order k of the radiance that the camera sees has ϖ J_k as its source. The first order is found without the
lattice, at each sample of the camera's rays.

Where the phase function has a lobe, light at a point has the moments c_lm = ∫ L Y_lm dω in the place of J,
and the source towards ω is ϖ (Σ (χ_l - f) c_lm Y_lm(ω) + f L(ω)): see `tfm_cl.plan.lobes`. The part f goes
straight on. In the directions that are swept it is found at the rays' own places; of a light's own direction
e^-τ (f ϖ τ)^k / k! went straight on k times. The camera sees Σ χ_l c_lm Y_lm of all orders, and of what the
moments leave out what a small angle around the way of each light has of it.

For each of a few directions that are evenly spread, light is swept through the lattice plane by plane
(``kernels/order_sweep.cl``). This is the method of discrete ordinates (Chandrasekhar, "Radiative Transfer",
1950), by successive orders. Directions are turned from order to order where none goes straight on.

Solids end what is swept, and what they reflect of it, and of lights, is swept with the next order: see
`tfm_cl.render.walls`.

Several media make a point's extinction, what is scattered there, and the moments of its phase function, each
weighed by how much of light it scatters. Sources are then per world unit, over the extinction between the
points. How much of a light went straight on follows what each medium on its way leaves so: known of bodies of
constant density and of each field; of several media in one field (`tfm_cl.scene.fields`), of their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import MOST_DEGREE
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.launch import LOOK_UP
from tfm_cl.device.structs.declared import SWEEP
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.errors import SceneError
from tfm_cl.interrupts import cancellable, check_cancelled
from tfm_cl.model import decided
from tfm_cl.plan.deposits import deposited
from tfm_cl.plan.lobes import harmonics
from tfm_cl.plan.orders import (
    DIRECTIONS,
    beyond_of_media,
    is_endless,
    lobes,
    media_of,
    of_fields,
    orders_of,
    sweeps_emission,
    swept_media,
    ways_of,
)
from tfm_cl.render.lattice_points import TowardsCamera, points_structs, see_points
from tfm_cl.render.regions import LitRegions
from tfm_cl.render.rooms import hidden_of, rooms_of
from tfm_cl.render.walls import NO_PATCH, Met, Sweep, walls_of
from tfm_cl.scene.lights.colours import common_colour

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyopencl as cl

    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.program import Kernel
    from tfm_cl.plan.lobes import Floats, Lobe
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.rooms import Hidden, Ints
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.render.walls import Walls
    from tfm_cl.scene.scene import Scene

MOST_BYTES_OF_LIGHTS = 256 << 20
"""Of what lights bring to points, which is kept while the camera moves; more is found anew for each."""
MOST_BYTES_APART = 2 << 30
"""Of lattices that hold orders by themselves."""
RADIANCE_BYTES = 256 << 20
"""Of the radiances of the directions that are swept together."""
POINTS_AT_ONCE = 1 << 24
"""Points times directions that are swept together."""
OF_CUBE = 0.51
"""Of the distance between points: from one to the sides of its cube, and what coordinates are rounded by."""
WHAT = "the lattice of later orders"
"""What messages call it."""
RGB = 3

Variant = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""
ArgumentsOfBox = dict[str, Any]
"""Of kernels that look at a box of points."""
Both = tuple["cl.Buffer", "cl.Buffer"]
"""Numbers of points in rows along x, and along y."""


def media_variant(
    media: MediaOnDevice, colours: int, degree: int, mixed: int, *, emits: bool = False
) -> Variant:
    """Return those of the kernel that looks at the density.

    ``colours``: numbers that hold light; ``degree``: of the lobe, or 0; ``mixed``: media that are told apart,
    0 where all bodies are of one; ``emits``: whether what they emit is looked at.
    """
    return media.headers, media.defines | {
        "TFM_CHANNELS": channels_of(media),
        "TFM_ORDER_COLOURS": colours,
        "TFM_ORDER_DEGREE": degree,
        "TFM_ORDER_MEDIA": mixed,
        "TFM_ORDER_EMISSION": int(emits),
    }


def lights_variant(
    batch: Batch, media: MediaOnDevice, colours: int, degree: int, mixed: int, *, walls: bool = False
) -> Variant:
    """Return those of the kernels that look lights up, as `media_variant`; ``walls``: whether solids do."""
    headers, defines = batch.variant(media)
    defines |= media_variant(media, colours, degree, mixed)[1]
    return headers, defines | {"TFM_ORDER_WALLS": int(walls)}


def channels_of(media: MediaOnDevice) -> int:
    """Extinctions of a point: one where all colours have the same."""
    return media.channels(textured=False)["TFM_CHANNELS"]


def moments_variant(colours: int, degree: int, mixed: int) -> Variant:
    """Return those of the kernels that scatter what has a lobe of this degree."""
    return (), {
        "TFM_CHANNELS": 1,
        "TFM_ORDER_COLOURS": colours,
        "TFM_ORDER_DEGREE": degree,
        "TFM_ORDER_MEDIA": mixed,
    }


def points_variant() -> Variant:
    """Return those of the kernels that give points what no light brings there."""
    return (), {"TFM_CHANNELS": 1, "TFM_ORDER_COLOURS": 1}


def sweep_variant(channels: int, colours: int, degree: int, mixed: int, *, walls: bool = False) -> Variant:
    """Return those of the kernels that sweep light through the lattice; ``walls``: past solids."""
    return (), {
        "TFM_CHANNELS": channels,
        "TFM_ORDER_COLOURS": colours,
        "TFM_ORDER_LOBE": int(degree > 0),
        "TFM_ORDER_MEDIA": mixed,
        "TFM_ORDER_WALLS": int(walls),
    }


def pass_variant(media: MediaOnDevice, colours: int, mixed: int, *, has_solids: bool) -> Variant:
    """Return those of the camera's pass through what later orders scatter."""
    defines = media.defines | {
        "TFM_CHANNELS": channels_of(media),
        "TFM_SHADOW": int(has_solids),
        "TFM_LATTICE": 2,
        "TFM_ORDER_COLOURS": colours,
        "TFM_ORDER_MEDIA": mixed,
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


def sweeps_of(lattice: Lattice, ways: Floats, weights: Floats, pad: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the structs of directions ``[n, 3]`` that stand for solid angles ``[n]``.

    Those along y and z, whose planes have rows along x; those along x.
    """
    rows = rows_of(lattice.size, pad)
    found: tuple[list[Any], list[Any]] = [], []
    known = harmonics(ways, MOST_DEGREE)
    for number, direction in enumerate(ways):
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
        struct["harmonics"], struct["weighted"] = known[number], weights[number] * known[number]
        found[turned].append(struct)
    along_x, along_y = (np.array(some, SWEEP.dtype) for some in found)
    return along_x, along_y


def rays_of(sweeps: NDArray[Any], lanes: int) -> int:
    """Work-items that the rays of any of some directions take, in chunks of lanes, at most."""
    shifts = np.ceil(np.abs(sweeps["slope"]) * sweeps["planes"][:, None]).astype(np.int64) + 1
    chunks = -(-(sweeps["columns"] + 1 + shifts[:, 0]) // lanes)
    return int((chunks * (sweeps["rows"] + 1 + shifts[:, 1])).max(initial=0))


def reached_points(lattice: Lattice, regions: LitRegions) -> list[tuple[list[int], list[int]]]:
    """Return the points whose cubes lights may reach: the first along x, y, z, and how many."""
    bounds = (regions.bounds - lattice.origin) / lattice.spacing
    low, high = (np.clip(bounds[:, i] + side, -1, lattice.size) for i, side in enumerate((-OF_CUBE, OF_CUBE)))
    first = np.maximum(np.ceil(low).astype(int), 0)
    end = np.minimum(np.floor(high).astype(int) + 1, lattice.size)
    return list(zip(first.tolist(), np.maximum(end - first, 0).tolist(), strict=True))


class LightAtPoints(NamedTuple):
    """What a camera must know of a light at the points that it may reach."""

    arrived: cl.Buffer
    """As ``order_arrived`` finds it."""
    box: ArgumentsOfBox
    items: int
    spread: int
    nbytes: int


class Behind(NamedTuple):
    """Points behind solids that are next to some in the open."""

    known: cl.Buffer
    """As ``order_fill`` has it."""
    number: int


@dataclass(frozen=True)
class Scattered:
    """Light of all later orders, at the points of a lattice, whatever the camera.

    Attributes
    ----------
    numbers
        Of the points one after the other; the moments, in rows along x, where scattering has a lobe.
    beyond
        In that case, the tables of what the moments leave out.
    colour
        RGB that it is a multiple of, where a point has one number for three.
    up_to
        The same of the orders up to each but the last, from 1 on, where these are asked for.
    behind
        Points behind solids, which stand for those before them.
    """

    numbers: cl.Buffer
    beyond: cl.Buffer | None
    nbytes: int
    colours: int
    colour: tuple[float, float, float]
    up_to: tuple[Scattered, ...] = ()
    behind: Behind | None = None


EachLight = Callable[[Callable[[LightAtPoints], None]], None]
"""Calls what it is given with all lights, one after the other."""
Arrive = Callable[[Callable[["Batch"], None]], None]
"""Calls what it is given with batches of all lights, one after the other."""


class _Room(NamedTuple):
    """Memory that all orders use one after the other."""

    following: Both
    """Of what arrives at points next."""
    radiance: cl.Buffer
    """Of rays."""


class _Source(NamedTuple):
    """What is swept."""

    kernel: str
    arguments: tuple[dict[str, Any], dict[str, Any]]
    """In rows along x, and along y."""


class _Density(NamedTuple):
    """Of the points."""

    extinction: Both
    scattering: Both | None
    """Of several media, as ``order_media`` finds it."""
    shares: cl.Buffer | None
    """Likewise, as ``order_shares`` finds them where scattering has a lobe."""
    emission: _Source | None
    """What they emit, as far as it is swept; None where nothing is."""

    def scattered(self, orders: cl.Buffer, light: Both) -> _Source:
        """Return what is scattered of light, or into each direction; ``orders``: the lattice's struct."""
        along_x, along_y = (
            {"orders": orders, "extinction": extinction, "light": one}
            for extinction, one in zip(self.extinction, light, strict=True)
        )
        if self.scattering is not None:
            along_x["scattering"], along_y["scattering"] = self.scattering
        return _Source("order_sweep", (along_x, along_y))

    @property
    def of_points(self) -> dict[str, cl.Buffer]:
        """Arguments of kernels that scatter what has a lobe."""
        return {} if self.shares is None else {"shares": self.shares}


class _Ways(NamedTuple):
    """A lobe's directions of one kind of rows, and what is known of each."""

    sweeps: NDArray[Any]
    uploaded: cl.Buffer
    source: cl.Buffer
    radiance: cl.Buffer


def met_of(
    sweeps: Sequence[tuple[Sweep, Met]], size: tuple[int, int, int], lanes: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int, Met]:
    """Return what the rays of some directions meet as kernels know it.

    Returns
    -------
    Walls, four numbers each; where those of each direction and work-item begin, and the end; work-items of a
    direction; and the same walls in this order.
    """
    items, of_lanes = [], []
    for sweep, met in sweeps:
        (first, count), (low, rows) = (sweep.rays_along(number, size) for number in (0, 1))
        chunks = -(-count // lanes)
        chunk, lane = np.divmod(met.column - first, lanes)
        items.append((chunk + chunks * (met.row - low), chunks * rows))
        of_lanes.append(lane)
    most = max(count for _, count in items)
    item = np.concatenate([number * most + one for number, (one, _) in enumerate(items)])
    lane = np.concatenate(of_lanes)
    joined: list[NDArray[Any]] = [
        np.concatenate(values) for values in cancellable(zip(*(met for _, met in sweeps), strict=True))
    ]
    check_cancelled()
    by_way = np.lexsort((joined[Met._fields.index("part")], joined[Met._fields.index("plane")], item))
    check_cancelled()
    sorted_met = Met(*(values[by_way] for values in cancellable(joined)))
    check_cancelled()
    walls = np.empty((len(item), 4), np.int32)
    walls[:, 0], walls[:, 1], walls[:, 2] = sorted_met.plane, lane[by_way], sorted_met.departs
    walls[:, 3] = sorted_met.part.astype(np.float32).view(np.int32)
    starts = np.searchsorted(item[by_way], np.arange(most * len(sweeps) + 1)).astype(np.int32)
    return walls, starts, most, sorted_met


class _Surfaces:
    """Solids on the device, as rays of one set of directions meet them.

    Parameters
    ----------
    ways
        Directions ``[n, 3]``.
    reflected
        What all patches reflect.
    """

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        ways: Floats,
        met: Sequence[Met],
        patches: Patches,
    ) -> None:
        sweeps = [(Sweep.of(way), one) for way, one in zip(ways, met, strict=True)]
        # As `sweeps_of` has them: those along x come last.
        sweeps.sort(key=lambda one: one[0].axis == 0)
        walls, starts, items, known = met_of(sweeps, lattice.size, launcher.lanes)
        self.along = sum(sweep.axis != 0 for sweep, _ in sweeps)
        """Directions before those along x."""
        check_cancelled()
        arriving = np.flatnonzero(known.arrives != NO_PATCH)
        arriving = arriving[np.argsort(known.arrives[arriving], kind="stable")]
        of_patches = np.searchsorted(known.arrives[arriving], np.arange(patches.number + 1))
        upload, self._launcher = partial(launcher.upload, WHAT), launcher
        self._patches = patches
        self.arguments = {
            "walls": upload(walls),
            "wall_starts": upload(starts),
            "reflected": patches.reflected,
            "arriving": launcher.zeros(WHAT, 4 * RGB * len(walls)),
            "wall_items": items,
            "patches": patches.number,
            "wall_count": len(walls),
        }
        self._of_patches = {
            "starts": upload(of_patches.astype(np.int32)),
            "of_patches": upload(arriving.astype(np.int32)),
            "shares": upload(known.share[arriving].astype(np.float32)),
            "albedo": patches.albedo,
            "arriving": self.arguments["arriving"],
            "reflected": patches.reflected,
            "patches": patches.number,
            "count": len(walls),
        }

    def reflect(self, kernel: Kernel) -> float:
        """Replace what patches reflect by what they do of what arrived; returns device seconds."""
        return self._launcher.run(kernel, (self._patches.number,), self._of_patches)


class Patches(NamedTuple):
    """Patches of solids on the device."""

    number: int
    known: cl.Buffer
    """As ``order_walls`` has it."""
    albedo: cl.Buffer
    reflected: cl.Buffer


@dataclass
class Orders:
    """The later orders of a frame.

    Attributes
    ----------
    scene
        Of single, fitted lights.
    media
        On the device.
    met
        Arguments of kernels that meet these.
    struct
        Of the camera, which says how maps speak of media, too.
    """

    launcher: Launcher
    scene: Scene
    media: MediaOnDevice
    met: dict[str, Any]
    struct: NDArray[Any]
    lattice: Lattice
    cache: Cache
    """Of the session."""
    tracer: Tracer | None = None
    """Of solids."""
    apart: bool = False
    """Whether orders are asked for by themselves."""
    seconds: float = 0.0
    _up_to: list[cl.Buffer] = field(default_factory=list)
    _hidden: Hidden | None = None
    _behind: Behind | None = None

    @cached_property
    def lobes(self) -> list[Lobe]:
        """What is known of the phase function of each medium."""
        return lobes(self.scene)

    @property
    def lobe(self) -> Lobe:
        """The same, of all or of the first."""
        return self.lobes[0]

    @property
    def _mixed(self) -> int:
        """Media that are told apart; 0: there is but one."""
        return len(self.lobes) if len(self.lobes) > 1 else 0

    @cached_property
    def _view(self) -> cl.Buffer:
        return self.launcher.upload(WHAT, self.struct)

    @cached_property
    def _struct(self) -> cl.Buffer:
        return self.launcher.upload(WHAT, self._of_samples(self.lattice.samples))

    @cached_property
    def _of_middles(self) -> cl.Buffer:
        """The same, of points whose cubes are looked at in the middle only."""
        return self.launcher.upload(WHAT, self._of_samples(1))

    def _of_samples(self, samples: int) -> NDArray[Any]:
        structs = points_structs(self.lattice, self.scene, samples, len(self.lobes))
        for struct, medium, lobe in zip(structs, media_of(self.scene), self.lobes, strict=True):
            struct["albedo"], struct["straight"] = medium.albedo, lobe.straight
            degrees = slice(lobe.degree + 1)
            struct["bent"][degrees], struct["seen"][degrees] = lobe.bent, lobe.seen
        return structs

    @cached_property
    def _colour(self) -> NDArray[np.float64] | None:
        """The colour of all that is scattered, at most 1; None where lights or orders differ in theirs."""
        lights, albedo = self.scene.lights, media_of(self.scene)[0].albedo
        is_grey = not self._mixed and channels_of(self.media) == 1 and np.ptp(albedo) == 0
        is_grey = is_grey and self.tracer is None
        if not is_grey or any(light.is_textured for light in lights):
            return None
        emitted = [medium.emission for medium in swept_media(self.scene) if medium.emits]
        return common_colour([light.intensity for light in lights] + emitted)

    @property
    def _colours(self) -> int:
        return RGB if self._colour is None else 1

    @property
    def _known(self) -> dict[str, Any]:
        """Arguments of kernels that look at media."""
        return {**self.met, "view": self._view}

    @cached_property
    def _deposited(self) -> dict[str, Any]:
        """What primitives hold in the points' cubes, as an argument."""
        if not self.scene.primitives:
            return {}
        amounts = deposited(self.scene, self.lattice, self.media.defines["TFM_AMOUNTS"] == 1)
        return {"deposited": self.launcher.upload(WHAT, amounts.astype(np.float32))}

    def _of_way(self, shares: list[float]) -> dict[str, Any]:
        """Arguments that tell several media's part of what they scatter, in the place of extinction."""
        if not (self._mixed and self.lobe.degree):
            return {}
        media = media_of(self.scene)
        coefficients = [share * np.asarray(one.sigma_s) for share, one in zip(shares, media, strict=True)]
        matrix = np.zeros((3, 3))
        fields = self.media.fields
        matrix[:, : fields.count] = of_fields(self.scene, fields.rgb_from_field, fields.weights, coefficients)
        view = self.struct.copy()
        view["rgb_from_field"] = matrix.ravel()
        # Those of flames neither scatter nor extinguish.
        structs = medium_structs([one.dark for one in self.scene.media])
        for struct, coefficient in zip(structs, coefficients, strict=False):
            struct["sigma_t"] = coefficient
        upload = self.launcher.upload
        return {"way_view": upload(WHAT, view), "way_media": upload(WHAT, structs)}

    @cached_property
    def _straight(self) -> dict[str, Any]:
        """`_of_way`, of what goes straight on."""
        return self._of_way([lobe.straight for lobe in self.lobes])

    @cached_property
    def _ways(self) -> dict[int, tuple[Floats, Floats]]:
        """Directions that are swept of each order, with the solid angles that they stand for; 0: of emission.

        Where scattering has a lobe they are always the same.
        """
        return ways_of(self.scene)

    @cached_property
    def _walls(self) -> tuple[Patches, dict[int, _Surfaces]] | None:
        """Solids, as rays of each of the sets meet them."""
        if self.tracer is None:
            return None
        ways = tuple((order, *(one.tobytes() for one in known)) for order, known in self._ways.items())
        dark = None if self._hidden is None else self._hidden.points.tobytes()
        find = partial(walls_of, self.tracer, self.scene, self.lattice, self._ways, self._hidden)
        key = self.scene.solids, self.lattice, is_endless(self.scene), ways, dark
        found = self.cache.get("walls", key, find, _nbytes)
        if found is None:
            return None
        upload, count = partial(self.launcher.upload, WHAT), len(found.points)
        places = found.points - world_from_device(self.scene)[:3, 3]
        known = np.concatenate([places, found.normals, found.albedo], axis=1).astype(np.float32)
        albedo = known[:, -RGB:].T
        zeros = self.launcher.zeros(WHAT, 4 * RGB * count)
        patches = Patches(count, upload(known.T), upload(albedo), zeros)
        made: dict[int, _Surfaces] = {}
        for order, met in found.met.items():
            same = next((other for other in made if found.met[other] is met), None)
            made[order] = (
                _Surfaces(self.launcher, self.lattice, self._ways[order][0], met, patches)
                if same is None
                else made[same]
            )
        return patches, made

    def _met_by(self, order: int) -> _Surfaces | None:
        """Return the solids as rays of an order meet them, 0: of emission; None where they meet none."""
        return None if self._walls is None else self._walls[1][order]

    def _reflect(self, met: _Surfaces | None) -> None:
        if met is not None:
            self.seconds += met.reflect(self._kernel("order_reflect"))

    def scatter(self, arrive: Arrive, done: Callable[[float], None]) -> Scattered:
        """Find all later orders; ``done`` is called with the part that is done."""
        lattice, channels = self.lattice, channels_of(self.media)
        extinction, emission, scattering, shares = self._numbers(channels), None, None, None
        emits = sweeps_emission(self.scene)
        headers, defines = media_variant(
            self.media, self._colours, self.lobe.degree, self._mixed, emits=emits
        )
        of_density = self.launcher.kernels.kernel("order_media", "order_media.cl", headers, defines)
        known = self._known | self._deposited | {"orders": self._struct, "extinction": extinction[0]}
        if emits:
            emitted = self._numbers(self._colours)
            swept = self.launcher.upload("the media", medium_structs(swept_media(self.scene)))
            known |= {"media": swept, "emitted": emitted[0]}
        if self._mixed:
            has_lobe = self.lobe.degree > 0
            scattering = self._numbers(RGB * (1 + has_lobe))
            nbytes = 4 * RGB * self._mixed * self._rows[0].numbers if has_lobe else 4
            of_media, shares = (self.launcher.zeros(WHAT, nbytes) for _ in range(2))
            known |= {"scattering": scattering[0], "of_media": of_media}
        self._over_points(of_density, known, lattice.samples**3)
        self._hide(arrive, emitted[0] if emits else None)
        self._fill(extinction[0], channels)
        self._turn(extinction, channels)
        if emits:
            self._fill(emitted[0], self._colours)
            self._turn(emitted, self._colours)
            along_x, along_y = (
                {"extinction": one, "emitted": other} for one, other in zip(extinction, emitted, strict=True)
            )
            emission = _Source("order_emission", (along_x, along_y))
        if scattering is not None:
            self._fill(scattering[0], RGB * (1 + (self.lobe.degree > 0)))
            self._turn(scattering, RGB * (1 + (self.lobe.degree > 0)))
            if self.lobe.degree:
                self._fill(of_media, RGB * self._mixed)
                known = {"orders": self._struct, "of_media": of_media, "shares": shares}
                self._run(self._of_moments("order_shares"), self._items, RGB * self._mixed, known)
        density = _Density(extinction, scattering, shares, emission)
        colour = (1.0, 1.0, 1.0) if self._colour is None else tuple(self._colour.tolist())
        find = self._scatter_lobe if self.lobe.degree else self._scatter_evenly
        self._up_to.clear()
        total, nbytes = find(density, arrive, done)
        buffers, first = [*self._up_to, total], orders_of(self.scene) - len(self._up_to)
        found = [
            self._scattered(numbers, nbytes, colour, order) for order, numbers in enumerate(buffers, first)
        ]
        together = sum(one.nbytes for one in found)
        if self._behind is not None:
            found = [replace(one, behind=self._behind) for one in found]
            together += 8 * self._behind.number
        return replace(found[-1], up_to=tuple(found[:-1]), nbytes=together)

    def _hide(self, arrive: Arrive, emitted: cl.Buffer | None) -> None:
        """Find the points behind solids; ``emitted``: by the points, where media emit."""
        if self.tracer is None:
            return
        find = partial(rooms_of, self.tracer, self.lattice)
        rooms = self.cache.get("rooms", (self.scene.solids, self.lattice), find, _nbytes)
        if rooms is None:
            return
        light, _ = self._numbers(self._colours * self.lobe.harmonics)
        of_lights = {"orders": self._of_middles, "times": 0, "log_factorial": 0.0}
        of_lights |= {"light": light, **self._straight, **self._deposited}
        arrive(lambda batch: self._over_lights("order_lights", batch, of_lights, 1))
        glow = np.zeros(self.lattice.size) if emitted is None else self._of_colours(emitted)
        self._hidden = hidden_of(rooms, self._of_colours(light), glow, self.scene, self.lattice)
        if self._hidden is not None:
            known = np.stack([self._hidden.next_to, self._hidden.open], axis=1).astype(np.int32)
            self._behind = Behind(self.launcher.upload(WHAT, known), len(known))

    def _of_colours(self, numbers: cl.Buffer) -> Floats:
        """Return the sum of the colours of all points, ``[x, y, z]``."""
        x, y, z = self.lattice.size
        shape = (self._colours, z + 2, y + 2, x + 2 * self._pad)
        found = self.launcher.download(numbers, shape, np.float32).sum(axis=0, dtype=np.float64)
        inner: Floats = found[1:-1, 1:-1, self._pad : -self._pad].T
        return inner

    def _fill(
        self, numbers: cl.Buffer, count: int, behind: Behind | None = None, *, together: bool = False
    ) -> None:
        """Give points behind solids what those before them have; ``together``: of each point at one place."""
        behind = behind or self._behind
        if behind is None or not behind.number:
            return
        arguments: dict[str, Any] = {"orders": self._struct, "hidden": behind.known, "numbers": numbers}
        arguments |= {"count": count, "together": int(together)}
        self._run(self._of_points("order_fill"), behind.number, count, arguments)

    def _scattered(
        self, numbers: cl.Buffer, nbytes: int, colour: tuple[float, float, float], order: int
    ) -> Scattered:
        """Return what points hold of the orders up to one."""
        table = None
        if self.lobe.degree:
            of_lobe = beyond_of_media(self.scene, self.scene.spreads, order)
            table = self.launcher.upload(WHAT, of_lobe)
            nbytes += of_lobe.nbytes
        return Scattered(numbers, table, nbytes, self._colours, colour)

    def _keep(self, total: cl.Buffer, nbytes: int) -> None:
        """Keep what there is so far, where orders are asked for by themselves."""
        if not self.apart:
            return
        orders = orders_of(self.scene)
        if nbytes * orders > MOST_BYTES_APART:
            raise SceneError(
                f"image.aov: {orders} layers of orders need {nbytes * orders / 2**30:.1f} GiB of points, "
                f"more than {MOST_BYTES_APART / 2**30:g}; use fewer medium.orders, or leave out orders"
            )
        kept = self.launcher.empty(WHAT, nbytes, reuse=True)
        self.launcher.copy(total, kept, nbytes, first=0, to=0)
        self._up_to.append(kept)

    def _scatter_evenly(
        self, density: _Density, arrive: Arrive, done: Callable[[float], None]
    ) -> tuple[cl.Buffer, int]:
        light, nbytes = self._numbers(self._colours), 4 * self.lattice.points * self._colours
        total = self.launcher.zeros(WHAT, nbytes)
        room = _Room(
            self._numbers(self._colours), self.launcher.empty(WHAT, self._radiance_bytes, reuse=True)
        )
        if density.emission is not None:
            self._sweep(0, density.emission, room, light[0], total)
        self._keep(total, nbytes)
        arrive(lambda batch: self._add_lights(batch, light[0]))
        # What the last order needs is where light is scattered last but once.
        last = orders_of(self.scene) - 1
        for order in range(1, last + 1):
            self._fill(light[0], self._colours)
            self._turn(light, self._colours)
            source = density.scattered(self._struct, light)
            self._sweep(order, source, room, light[0], total)
            if order < last:
                self._keep(total, nbytes)
            done(order / last)
        for numbers in (*self._up_to, total):
            self._fill(numbers, self._colours, together=True)
            if is_endless(self.scene):
                self._end(numbers, self._colours)
        return total, nbytes

    def _end(self, scattered: cl.Buffer, count: int) -> None:
        """End the lattice in a medium that goes on."""
        known = {"orders": self._struct, "scattered": scattered, "count": count}
        self._run(self._of_points("order_end"), self._items, count, known)

    def _scatter_lobe(
        self, density: _Density, arrive: Arrive, done: Callable[[float], None]
    ) -> tuple[cl.Buffer, int]:
        count = self.lobe.harmonics * self._colours
        nbytes = 4 * count * self._rows[0].numbers
        light, total = (self.launcher.zeros(WHAT, nbytes) for _ in range(2))
        along_x, along_y = sweeps_of(self.lattice, *self._ways[0], self._pad)
        # All that arrives is summed in rows along x.
        ways = self._of_rows(np.concatenate([along_x, along_y]), 0), self._of_rows(along_y, 1)
        counts = len(along_x), len(along_y)
        scattered = density.scattered(self._struct, (ways[0].source, ways[1].source))
        if density.emission is not None:
            self._sweep_ways(ways, counts, density.emission)
            self._scatter_moments(ways, light, total, density, arrives=True, scatters=False)
            self.launcher.copy(total, light, nbytes, first=0, to=0)
        arrive(lambda batch: self._add_lights(batch, light))
        last = orders_of(self.scene) - 1
        most = max(lobe.times_straight(last) for lobe in self.lobes)
        for order in range(1, last + 1):
            self._scatter_moments(ways, light, total, density, arrives=order > 1, scatters=True)
            self._keep(total, nbytes)
            self._fill(ways[0].source, self._colours * len(ways[0].sweeps))
            self._cross(ways[0].source, ways[1].source, ways, of_x=True)
            self._sweep_ways(ways, counts, scattered)
            if order <= most:
                arrive(partial(self._add_lights, light=light, times=order))
            done(order / last)
        self._scatter_moments(ways, light, total, density, arrives=True, scatters=False)
        return total, nbytes

    def _of_rows(self, sweeps: NDArray[Any], turned: int) -> _Ways:
        nbytes = 4 * self._colours * len(sweeps) * self._rows[turned].numbers
        source, radiance = (self.launcher.zeros(WHAT, nbytes) for _ in range(2))
        return _Ways(sweeps, self.launcher.upload("the directions", sweeps), source, radiance)

    def _scatter_moments(
        self,
        ways: tuple[_Ways, _Ways],
        light: cl.Buffer,
        total: cl.Buffer,
        density: _Density,
        *,
        arrives: bool,
        scatters: bool,
    ) -> None:
        """Sum what arrives at points, and scatter it into all directions."""
        x, y, z = self.lattice.size
        count = len(ways[0].sweeps)
        known = density.of_points | {
            "orders": self._struct,
            "sweeps": ways[0].uploaded,
            "radiance": ways[0].radiance,
            "source": ways[0].source,
            "light": light,
            "total": total,
            "along": count - len(ways[1].sweeps),
            "count": count,
            "arrives": int(arrives),
            "scatters": int(scatters),
        }
        items = -(-x // self.launcher.lanes) * y * z
        self._run(self._of_moments("order_scatter"), items, count * self._colours, known)

    def _cross(
        self, numbers: cl.Buffer, crossed: cl.Buffer, ways: tuple[_Ways, _Ways], *, of_x: bool
    ) -> None:
        """Write what is known of the directions along x in the other kind of rows."""
        x, y, z = self.lattice.size
        inner, outer = (x, y) if of_x else (y, x)
        count = len(ways[1].sweeps)
        known = {
            "orders": self._struct,
            "numbers": numbers,
            "crossed": crossed,
            "of_x": int(of_x),
            "skip": self._colours * (len(ways[0].sweeps) - count),
            "count": self._colours * count,
        }
        items = (inner + 1) * -(-outer // self.launcher.lanes) * (z + 1)
        self._run(self._of_moments("order_cross"), items, self._colours * count, known)

    def _sweep_ways(self, ways: tuple[_Ways, _Ways], counts: tuple[int, int], source: _Source) -> None:
        """Let light go on in all directions.

        ``counts``: of the directions whose rows are along x, and along y.
        """
        kernel, met = self._kernel(source.kernel), self._met_by(0)
        bases = 0, counts[0]
        for some, count, rows, swept, base in zip(
            ways, counts, self._rows, source.arguments, bases, strict=True
        ):
            known = swept | {"sweeps": some.uploaded, "radiance": some.radiance, "size": rows.numbers}
            if met is not None:
                known |= met.arguments | {"wall_base": base}
            rays = rays_of(some.sweeps[:count], self.launcher.lanes)
            known |= {"rays": rays}
            self._run(kernel, rays * count, self._planes(some.sweeps[:count]), known)
        self._cross(ways[1].radiance, ways[0].radiance, ways, of_x=False)
        self._reflect(met)

    def _planes(self, sweeps: NDArray[Any]) -> int:
        """Return the samples that a ray of some directions takes as long as."""
        return int(sweeps["planes"].max(initial=1)) * self._colours

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

    def _over_points(
        self, kernel: Kernel, arguments: dict[str, Any], cost: int, items: int | None = None
    ) -> None:
        """Look lights or media up at all points, or of some work-items."""
        self._run(kernel, self._items if items is None else items, LOOK_UP * cost, arguments)

    def _add_lights(self, batch: Batch, light: cl.Buffer, times: int = 0) -> None:
        """Add what lights bring to points, after being scattered straight on so many times."""
        # In the middle of the cubes is enough of what is smoother than the lights themselves.
        points, samples = (self._of_middles, 1) if times else (self._struct, self.lattice.samples)
        of_lights = {
            "orders": points,
            "times": times,
            "log_factorial": math.lgamma(times + 1),
            **self._straight,
        }
        at_points = {"light": light, **self._deposited}
        self._over_lights("order_lights", batch, of_lights | at_points, samples**3)
        if self._walls is not None:
            self._light_walls(batch, self._walls[0], of_lights)

    def _light_walls(self, batch: Batch, patches: Patches, of_lights: dict[str, Any]) -> None:
        """Add what solids reflect of lights."""
        kernel, steps = self._of_lights("order_walls", batch)
        known = self._known | batch.arguments | of_lights
        known |= {"patches": patches.known, "reflected": patches.reflected, "count": patches.number}
        for number in range(len(batch.indices)):
            items = -(-patches.number // self.launcher.lanes)
            self._over_points(kernel, known | {"number": number}, steps, items)

    def _of_lights(self, name: str, batch: Batch) -> tuple[Kernel, int]:
        """Return a kernel that looks lights up, and the steps that each look-up takes."""
        headers, defines = lights_variant(
            batch, self.media, self._colours, self.lobe.degree, self._mixed, walls=self.tracer is not None
        )
        kernel = self.launcher.kernels.kernel(name, "order_lights.cl", headers, defines)
        return kernel, decided(self.scene.map.steps) if batch.is_dual else 1

    def _over_lights(self, name: str, batch: Batch, arguments: dict[str, Any], cost: int) -> None:
        kernel, steps = self._of_lights(name, batch)
        known = self._known | batch.arguments | arguments
        boxes = reached_points(self.lattice, LitRegions.of([self.scene.lights[i] for i in batch.indices]))
        for number, (low, (x, y, z)) in enumerate(boxes):
            of_light = {"number": number, "low": (*low, 0), "count": (x, y, z, 0)}
            self._over_points(kernel, known | of_light, cost * steps, -(-x // self.launcher.lanes) * y * z)

    def _kernel(self, name: str) -> Kernel:
        headers, defines = sweep_variant(
            channels_of(self.media),
            self._colours,
            self.lobe.degree,
            self._mixed,
            walls=self._walls is not None,
        )
        return self.launcher.kernels.kernel(name, "order_sweep.cl", headers, defines)

    def _of_points(self, name: str) -> Kernel:
        return self.launcher.kernels.kernel(name, "order_points.cl", *points_variant())

    def _of_moments(self, name: str) -> Kernel:
        headers, defines = moments_variant(self._colours, self.lobe.degree, self._mixed)
        return self.launcher.kernels.kernel(name, "order_moments.cl", headers, defines)

    def _run(self, kernel: Kernel, items: int, samples: int, arguments: dict[str, Any]) -> None:
        """Run a kernel over work-items; ``samples``: that each of a work-item's points takes as long as."""
        lanes = self.launcher.lanes
        self.seconds += self.launcher.run_items(kernel, items, samples * lanes, arguments)

    @property
    def _items(self) -> int:
        """Work-items that the points take."""
        return -(-self.lattice.points // self.launcher.lanes)

    def _turn(self, numbers: Both, count: int) -> None:
        """Write numbers in rows along x once more in rows along y."""
        along_x, along_y = numbers
        known = {"orders": self._struct, "numbers": along_x, "turned": along_y, "count": count}
        self._run(self._kernel("order_turn"), self._items, count, known)

    def _sweep(self, order: int, source: _Source, room: _Room, light: cl.Buffer, total: cl.Buffer) -> None:
        """Let what is swept in an order's directions arrive at all points, as light; add it to the total."""
        lanes, together, kernel = self.launcher.lanes, self._together, self._kernel(source.kernel)
        ways, met = self._ways[order][0], self._met_by(order)
        weights = np.full(len(ways), 1 / len(ways))
        for turned, sweeps in enumerate(sweeps_of(self.lattice, ways, weights, self._pad)):
            rows = self._rows[turned]
            x, y, z = (self.lattice.size[axis] for axis in rows.axes)
            for first in range(0, len(sweeps), together):
                some = sweeps[first : first + together]
                known = {
                    "sweeps": self.launcher.upload("the directions", some),
                    "radiance": room.radiance,
                    "size": rows.numbers,
                }
                rays = rays_of(some, lanes)
                of_points = source.arguments[turned] | {"rays": rays}
                if met is not None:
                    of_points |= met.arguments | {"wall_base": first + turned * met.along}
                self._run(kernel, rays * len(some), self._planes(some), known | of_points)
                adds = {"next": room.following[turned], "begins": int(first == 0), "count": len(some)}
                items, numbers = -(-x // lanes) * y * z, self._colours * len(some)
                self._run(self._kernel("order_gather"), items, numbers, known | adds)
            if not len(sweeps):
                self.launcher.clear(room.following[turned], 4 * self._colours * rows.numbers)
        means = {"orders": self._struct, "light": light, "total": total, "share": 1 / len(ways)}
        means |= {"next": room.following[0], "turned_next": room.following[1]}
        self._run(self._kernel("order_mean"), self._items, self._colours, means)
        self._reflect(met)

    def see(
        self,
        view: cl.Buffer,
        met: dict[str, Any],
        found: TowardsCamera,
        bounds: Rectangle,
        frame: FrameBuffers,
        done: Callable[[float], None],
    ) -> float:
        """Add what all later orders scatter to the camera; returns device seconds.

        Parameters
        ----------
        view
            The camera's struct, of the rays.
        met
            Arguments of kernels whose rays these are.
        bounds
            Pixels x0, y0, x1, y1 of the frame's buffers.
        """
        has_solids = bool(self.scene.solids)
        headers, defines = pass_variant(self.media, found.colours, self._mixed, has_solids=has_solids)
        defines |= frame.deep_defines
        kernel = self.launcher.kernels.kernel("order_pass", "order_pass.cl", headers, defines)
        known = met | {"view": view, "orders": self._struct}
        steps = decided(self.scene.march.steps)
        return see_points(self.launcher, kernel, known, found, bounds, steps, frame, done)

    @property
    def bytes_of_lights(self) -> int:
        """Return what `look_up` finds of all lights, in all."""
        boxes = reached_points(self.lattice, LitRegions.of(self.scene.lights))
        return sum(4 * self._numbers_of_light * self._room(count) for _, count in boxes)

    @property
    def _numbers_of_light(self) -> int:
        """Of a point: a direction, and of each colour two."""
        return 3 + 2 * self._colours

    def _room(self, count: Sequence[int]) -> int:
        """Lanes of all work-items of a box of points."""
        x, y, z = count
        return -(-x // self.launcher.lanes) * self.launcher.lanes * y * z

    def look_up(self, arrive: Arrive, use: Callable[[LightAtPoints], None]) -> None:
        """Find what a lobe's lights bring to points; ``use`` is called with each.

        It does not depend on the camera.
        """
        of_lights = {"orders": self._of_middles, **self._of_way([1.0] * len(self.lobes))}

        def of_batch(batch: Batch) -> None:
            kernel, steps = self._of_lights("order_arrived", batch)
            known = self._known | batch.arguments | of_lights
            lights = [self.scene.lights[i] for i in batch.indices]
            boxes = reached_points(self.lattice, LitRegions.of(lights))
            for number, (light, (low, count)) in enumerate(zip(lights, boxes, strict=True)):
                room = self._room(count)
                if not room:
                    continue
                nbytes, items = 4 * self._numbers_of_light * room, room // self.launcher.lanes
                box = {"room": room, "low": (*low, 0), "count": (*count, 0)}
                arrived = self.launcher.empty(WHAT, nbytes)
                self._over_points(kernel, known | box | {"number": number, "arrived": arrived}, steps, items)
                spread = self.scene.spreads.index(light.spread)
                use(LightAtPoints(arrived, box, items, spread, nbytes))

        arrive(of_batch)

    def towards_camera(self, found: Scattered, each_light: EachLight) -> TowardsCamera:
        """Find what points scatter to the camera, which the pass then takes for the same everywhere.

        Parameters
        ----------
        each_light
            What `look_up` found, where scattering has a lobe.
        """
        if found.beyond is None:
            return TowardsCamera(found.numbers, found.colours, found.colour)
        count = max(self._mixed, 1) * self._colours
        numbers = self.launcher.zeros(WHAT, 4 * self.lattice.points * count)
        kernel = self._of_moments("order_beyond")
        of_lights = {"view": self._view, "orders": self._struct, "beyond": found.beyond, "scattered": numbers}

        def add(light: LightAtPoints) -> None:
            of_light = of_lights | light.box | {"arrived": light.arrived, "spread": light.spread}
            self._run(kernel, light.items, count, of_light)

        each_light(add)
        known = {"view": self._view, "orders": self._struct, "total": found.numbers, "scattered": numbers}
        self._run(self._of_moments("order_view"), self._items, count * self.lobe.harmonics, known)
        self._fill(numbers, count, found.behind, together=True)
        if is_endless(self.scene):
            self._end(numbers, count)
        return TowardsCamera(numbers, count, found.colour)


def _nbytes(kept: Walls | Ints | None) -> int:
    return 0 if kept is None else kept.nbytes
