"""What the passes sum for the pixels of a crop, on the device and on the host."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.device.launch import Launcher, Output
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.raster import Raster

SUMS: dict[str, tuple[type[np.generic], int]] = {
    "radiance": (np.float32, 4),
    "light_seen": (np.float32, 4),
    "transmittance": (np.float32, 4),
    "samples": (np.uint32, 1),
}
"""Name, as kernels take it -> type and numbers per pixel."""
EMISSION: dict[str, tuple[type[np.generic], int]] = {"emission": (np.float32, 4)}
"""Likewise, where media emit light."""
SEVERAL = ("added", "of_orders_up_to")
"""Of `Sums`: several of each pixel."""
MOST_LAYER_BYTES = 4 << 30
"""Of the layers of lights together."""


@dataclass(frozen=True)
class FrameBuffers:
    """Buffers of one crop, by the names that kernels have for them."""

    sums: dict[str, Output]
    places: cl.Buffer
    """float2: where rays pass through the frame, if they are listed."""
    solid: cl.Buffer
    """float4: normal and distance of the solid that a pixel shows; of no meaning without solids."""
    albedo: cl.Buffer
    """float4: its RGB albedo, and 1 on holdouts."""
    later: Output | None = None
    """float4: RGB of the later orders of scattering, where there are any."""
    up_to_orders: tuple[Output, ...] = ()
    """As ``later``, of the orders up to each but the last, where these are asked for."""
    emission_light: Output | None = None
    """float4: RGB that media scatter and solids reflect of what media emit, where that lights anything."""
    deep: dict[str, cl.Buffer] = field(default_factory=dict)
    """Deep samples to which passes add colours: arguments of kernels; none where that is not asked for."""

    def arguments(self, *names: str) -> dict[str, cl.Buffer]:
        """Return kernel arguments, by name."""
        known = {name: output.buffer for name, output in self.sums.items()}
        known |= {"places": self.places, "solid": self.solid, "albedo": self.albedo}
        if self.later is not None:
            known["later"] = self.later.buffer
        return {name: known[name] for name in names}

    def stored(self) -> dict[str, cl.Buffer]:
        """Return those of kernels that store a frame."""
        return self.arguments(*self.sums) | self.deep

    @property
    def layers(self) -> dict[str, cl.Buffer]:
        """Where kernels put what each light adds; none where that is not asked for."""
        return self.arguments("added") if "added" in self.sums else {}

    @property
    def defines(self) -> dict[str, int | str]:
        """What kernels must know of it when they are compiled."""
        return ({"TFM_LIGHT_LAYERS": 1} if self.layers else {}) | self.deep_defines

    @property
    def deep_defines(self) -> dict[str, int | str]:
        """Likewise, of deep samples alone."""
        return {"TFM_DEEP_COLOURS": 1} if self.deep else {}

    def without_emission(self) -> FrameBuffers:
        """Return the same for kernels whose media emit nothing."""
        return replace(self, sums={name: sum_ for name, sum_ in self.sums.items() if name not in EMISSION})

    def up_to_order(self, number: int) -> FrameBuffers:
        """Return the same for kernels that add orders up to one, from 1 on: by themselves."""
        return replace(self, later=self.up_to_orders[number - 1], deep={})

    def of_emission_light(self) -> FrameBuffers:
        """Return the same for kernels that add light of what media emit: by itself, whichever they add."""
        own = self.emission_light
        assert own is not None  # noqa: S101 - there is such light
        sums = {name: sum_ for name, sum_ in self.sums.items() if name != "added"}
        return replace(self, sums=sums | {"radiance": own}, later=own)


@dataclass(frozen=True)
class Sums:
    """`FrameBuffers` on the host, and what the pixels show of solids: `tfm_cl.scene.layers.Seen`."""

    radiance: NDArray[np.float32]
    light_seen: NDArray[np.float32]
    transmittance: NDArray[np.float32]
    samples: NDArray[np.uint32]
    emitted: NDArray[np.float32] | None
    of_solids: NDArray[np.float32] | None
    of_albedo: NDArray[np.float32] | None
    of_errors: NDArray[np.float32] | None
    of_lattice: NDArray[np.float32] | None
    added: NDArray[np.float32] | None
    of_orders: NDArray[np.float32] | None
    of_emission_light: NDArray[np.float32] | None = None
    of_orders_up_to: NDArray[np.float32] | None = None
    """[orders - 1, h, w, 4]."""
    shows_through: NDArray[np.float32] | None = None
    """[h, w, 3], of what lies behind everything; None: the transmittance where no solid is shown."""

    @property
    def solid(self) -> NDArray[np.float32]:
        """Normal and distance; infinite without."""
        if self.of_solids is not None:
            return self.of_solids
        nowhere = np.zeros_like(self.radiance)
        nowhere[..., 3] = np.inf
        return nowhere

    @property
    def albedo(self) -> NDArray[np.float32]:
        """RGB, and 1 on holdouts, else 0."""
        return np.zeros_like(self.radiance) if self.of_albedo is None else self.of_albedo

    @property
    def emission(self) -> NDArray[np.float32]:
        """RGB, and 0."""
        return np.zeros_like(self.radiance) if self.emitted is None else self.emitted

    @property
    def ambient(self) -> NDArray[np.float32]:
        """RGB, and 0."""
        return np.zeros_like(self.radiance) if self.added is None else self.added[0]

    @property
    def later(self) -> NDArray[np.float32]:
        """RGB, and 0."""
        return np.zeros_like(self.radiance) if self.of_orders is None else self.of_orders

    @property
    def emission_light(self) -> NDArray[np.float32]:
        """RGB, and 0."""
        return np.zeros_like(self.radiance) if self.of_emission_light is None else self.of_emission_light

    @property
    def lights(self) -> NDArray[np.float32]:
        """Of each light RGB, and 0."""
        return np.zeros((0, *self.radiance.shape), np.float32) if self.added is None else self.added[1:]

    @property
    def up_to_orders(self) -> NDArray[np.float32]:
        """Of the orders up to each but the last RGB, and 0."""
        none = np.zeros((0, *self.radiance.shape), np.float32)
        return none if self.of_orders_up_to is None else self.of_orders_up_to

    @property
    def errors(self) -> NDArray[np.float32]:
        """As ``light_seen``."""
        return np.zeros_like(self.radiance) if self.of_errors is None else self.of_errors

    @property
    def lattice_change(self) -> NDArray[np.float32]:
        """RGB that light on a lattice adds to the picture that has it looked up at every sample."""
        return np.zeros_like(self.radiance[..., :3]) if self.of_lattice is None else self.of_lattice

    def cut(self, rows: slice, columns: slice) -> Sums:
        """Return those of a part of the pixels."""
        return self._each(lambda array: array[rows, columns])

    def at(self, index: NDArray[np.intp]) -> Sums:
        """Return those of pixels by their numbers, row by row; they have the numbers' shape."""
        return self._each(lambda array: array.reshape(-1, *array.shape[2:])[index])

    def _each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Sums:
        held = {one.name: getattr(self, one.name) for one in fields(self)}
        changed = {
            name: change(array) for name, array in held.items() if array is not None and name not in SEVERAL
        }
        for name in SEVERAL:
            if held[name] is not None:
                changed[name] = np.moveaxis(change(np.moveaxis(held[name], 0, 2)), 2, 0)
        return replace(self, **changed)


def allocate(
    launcher: Launcher,
    raster: Raster,
    gbuffer: GBuffer | None,
    *,
    emits: bool,
    clear: bool = False,
    layers: int = 0,
    later: bool = False,
    up_to_orders: int = 0,
    emission_light: bool = False,
) -> FrameBuffers:
    """Make buffers for the rays of a frame, with the solids that they show.

    Parameters
    ----------
    emits
        Whether media emit light.
    clear
        Fill them with zeros; else the first pass over them stores what others add to.
    layers
        That hold what ambient light and each light add; 0 where that is not asked for.
    later
        Whether later orders of scattering are added.
    up_to_orders
        How many orders are the last of those that are also added by themselves.
    emission_light
        Whether what media emit lights anything.

    Raises
    ------
    SceneError
        More layers than there is room for.
    """
    shape, none = raster.shape, np.zeros(4, np.float32)
    sums = {
        name: launcher.output("the image", (*shape, count) if count > 1 else shape, kind)
        for name, (kind, count) in (SUMS | EMISSION if emits else SUMS).items()
    }
    zero = [*sums.values()] if clear else []
    if layers:
        sums["added"] = _layers(launcher, (layers, *shape, 4))
        zero.append(sums["added"])
    of_orders, of_emission = (
        launcher.output("the image", (*shape, 4), np.float32) if wanted else None
        for wanted in (later, emission_light)
    )
    up_to = tuple(launcher.output("the image", (*shape, 4), np.float32) for _ in range(up_to_orders))
    zero += [output for output in (of_orders, of_emission, *up_to) if output is not None]
    for output in zero:
        launcher.clear(output.buffer, output.nbytes)
    return FrameBuffers(
        sums,
        later=of_orders,
        up_to_orders=up_to,
        emission_light=of_emission,
        places=launcher.upload("where rays pass", raster.places),
        solid=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.solid),
        albedo=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.albedo),
    )


def _layers(launcher: Launcher, shape: tuple[int, int, int, int]) -> Output:
    count, height, width, _ = shape
    nbytes = 4 * math.prod(shape)
    if nbytes > MOST_LAYER_BYTES:
        raise SceneError(
            f"image.aov: {count} layers of lights need {nbytes / 2**30:.1f} GiB at {width}×{height} pixels, "
            f"more than {MOST_LAYER_BYTES / 2**30:g}; render parts of it (image.crop), or fewer lights"
        )
    return launcher.output("the layers of lights", shape, np.float32)


def rgb_so_far(launcher: Launcher, frame: FrameBuffers) -> NDArray[np.float32]:
    """Copy the RGB that a frame has, [h, w, 3], to which passes may add afterwards."""
    radiance = frame.sums["radiance"]
    return launcher.download(radiance.buffer, radiance.shape, radiance.dtype)[..., :3]


def start_read(
    launcher: Launcher,
    frame: FrameBuffers,
    gbuffer: GBuffer | None,
    errors: FrameBuffers | None,
    of_lattice: NDArray[np.float32] | None = None,
) -> Callable[[], Sums]:
    """Let the host have the sums when the passes that were started have ended.

    Returns what waits for these, and returns the sums; the frame's buffers are then of no more use.
    """
    sums = {name: launcher.start_read(output) for name, output in frame.sums.items()}
    of_errors = None if errors is None else errors.sums["light_seen"]
    others = [
        None if output is None else launcher.start_read(output)
        for output in (frame.later, frame.emission_light, of_errors)
    ]
    up_to = [launcher.start_read(output) for output in frame.up_to_orders]

    def read() -> Sums:
        of_sums = {name: wait() for name, wait in sums.items()}
        of_orders, of_emission_light, of_light_seen = (None if wait is None else wait() for wait in others)
        # Where listed rays leave room, no pass stores anything, and any bits may lie there.
        with np.errstate(invalid="ignore"):
            for part in (of_emission_light, of_orders):
                if part is not None:
                    of_sums["radiance"] += part
        return Sums(
            **{name: of_sums[name] for name in SUMS},
            emitted=of_sums.get("emission"),
            of_solids=None if gbuffer is None else gbuffer.solid,
            of_albedo=None if gbuffer is None else gbuffer.albedo,
            of_errors=of_light_seen,
            of_lattice=of_lattice,
            added=of_sums.get("added"),
            of_orders=of_orders,
            of_emission_light=of_emission_light,
            of_orders_up_to=np.stack([wait() for wait in up_to]) if up_to else None,
        )

    return read
