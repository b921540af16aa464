"""Layers of a picture: one row each.

A layer is made of what the passes sum (`Seen`). A new one is a row here, and where it needs a sum that is not
there yet, a store in a pass. A group (`GROUPS`) stands for a layer of each light, or order of scattering.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Holds = Literal["light", "share", "direction", "number", "error"]
"""What a layer is to those who show it: radiance, colours from 0 to 1, unit vectors, numbers of any size, 0
where there is nothing, or errors, 0 where there are none."""


class Seen(Protocol):
    """What the passes made, [height, width, …], float32."""

    @property
    def transmittance(self) -> Array:
        """[…, 4]: of the media along the camera ray, RGB, and the opacity-weighted mean distance."""

    @property
    def radiance(self) -> Array:
        """[…, 4]: the picture."""

    @property
    def light_seen(self) -> Array:
        """[…, 4]: light that arrives times opacity, RGB, and the opacity, summed over lights."""

    @property
    def samples(self) -> NDArray[np.uint32]:
        """Densities read, and samples taken in closed form."""

    @property
    def solid(self) -> Array:
        """[…, 4]: unit normal of the solid that a pixel shows, world, and its distance; infinite without.

        Of a holdout only the distance.
        """

    @property
    def albedo(self) -> Array:
        """[…, 4]: its RGB, and 1 on holdouts, else 0."""

    @property
    def emission(self) -> Array:
        """[…, 4]: RGB of what the media emit, and 0."""

    @property
    def ambient(self) -> Array:
        """[…, 4]: RGB of ambient light that media scatter and solids reflect, and 0."""

    @property
    def later(self) -> Array:
        """[…, 4]: RGB of all orders of scattering after the first, and 0."""

    @property
    def emission_light(self) -> Array:
        """[…, 4]: RGB that media scatter and solids reflect of what media emit, the first order, and 0."""

    @property
    def lights(self) -> Array:
        """[lights, …, 4]: RGB that media scatter and solids reflect of each, the first order, and 0."""

    @property
    def up_to_orders(self) -> Array:
        """[orders - 1, …, 4]: as ``later``, of the orders up to each but the last, and 0."""

    @property
    def errors(self) -> Array:
        """[…, 4]: as ``light_seen``, with the maps' errors in the place of the light."""

    @property
    def lattice_change(self) -> Array:
        """[…, 3]: what the lattice of light adds to the picture that has it looked up at every sample."""


@dataclass(frozen=True)
class Layer:
    """One layer: what it holds, and how it is made."""

    channels: Literal[1, 3]
    meaning: str
    resolve: Callable[[Seen], Array]
    made: Literal["always", "solids", "emission", "emission_light", "orders", "asked"] = "always"
    """When: in every picture, where there are solids, media that emit light, media that light their
    surroundings, or later orders of scattering, or it is asked for, or only where it is asked for."""
    blurred: Literal["mean", "sum", "middle"] = "mean"
    """Over the time that a shutter is open: its mean or sum, or that of the moment in the middle, sharp."""
    holds: Holds = "light"
    """How it is shown."""


@dataclass(frozen=True)
class Group:
    """A layer for each light, or order: all are asked for together."""

    prefix: str
    """Before the light's name, or the order's number."""
    layer: Callable[[int], Layer]
    """Of a number, from 0."""


def _mean_by_opacity(sums: Array) -> Array:
    seen, opacity = sums[..., :3], sums[..., 3:]
    return np.divide(seen, opacity, out=np.zeros_like(seen), where=opacity > 0)


def _lattice_error(seen: Seen) -> Array:
    found, change = seen.radiance[..., :3].astype(np.float64), seen.lattice_change
    difference, largest = np.abs(change).sum(axis=-1), np.maximum(found, found - change).sum(axis=-1)
    error = np.zeros_like(seen.lattice_change[..., 0])
    np.divide(difference, largest, out=error, where=largest > 0, casting="same_kind")
    return error


LAYERS = {
    "depth": Layer(
        1,
        "opacity-weighted mean distance from the camera, world units; 0 where there is no medium",
        lambda seen: seen.transmittance[..., 3].copy(),
        blurred="middle",
        holds="number",
    ),
    "transmittance": Layer(
        3,
        "RGB transmittance of the medium along the camera ray",
        lambda seen: seen.transmittance[..., :3].copy(),
        holds="share",
    ),
    "light_transmittance": Layer(
        3,
        "RGB mean over lights and ray of the light's transmittance, weighted by what the camera sees; 0 "
        "where nothing is lit",
        lambda seen: _mean_by_opacity(seen.light_seen),
        holds="share",
    ),
    "samples": Layer(
        1,
        "density samples taken for the pixel by the passes of the camera",
        lambda seen: seen.samples.astype(np.float32),
        blurred="sum",
        holds="number",
    ),
    "solid_distance": Layer(
        1,
        "distance from the camera to the solid that the pixel shows, the nearest of its samples, world "
        "units; 0 without, and on holdouts",
        lambda seen: np.where(
            np.isfinite(seen.solid[..., 3]) & (seen.albedo[..., 3] == 0), seen.solid[..., 3], np.float32(0)
        ),
        "solids",
        blurred="middle",
        holds="number",
    ),
    "normal": Layer(
        3,
        "unit normal that the solid is shaded with, world, on the camera's side; 0 without, and on holdouts",
        lambda seen: seen.solid[..., :3].copy(),
        "solids",
        blurred="middle",
        holds="direction",
    ),
    "albedo": Layer(
        3,
        "RGB albedo of that solid, with its textures; 0 without, and on holdouts",
        lambda seen: seen.albedo[..., :3].copy(),
        "solids",
        holds="share",
    ),
    "emission": Layer(
        3,
        "RGB radiance that the media emit towards the camera, part of the picture; 0 where none does",
        lambda seen: seen.emission[..., :3].copy(),
        "emission",
    ),
    "emission_light": Layer(
        3,
        "RGB radiance that media scatter and solids reflect of what media emit, part of the picture, but for "
        "later orders of scattering; 0 where that lights nothing",
        lambda seen: seen.emission_light[..., :3].copy(),
        "emission_light",
    ),
    "ambient": Layer(
        3,
        "RGB radiance of ambient light that media scatter and solids reflect, part of the picture",
        lambda seen: seen.ambient[..., :3].copy(),
        "asked",
    ),
    "orders": Layer(
        3,
        "RGB radiance of all orders of scattering after the first, part of the picture; of what media emit "
        "also of the first, where it is not taken for lights; 0 without",
        lambda seen: seen.later[..., :3].copy(),
        "orders",
    ),
    "map_error": Layer(
        1,
        "relative error of the light's transmittance in the map, mean over lights and ray, weighted by what "
        "the camera sees; 0 for the dual march",
        lambda seen: _mean_by_opacity(seen.errors).mean(axis=-1),
        "asked",
        holds="error",
    ),
    "lattice_error": Layer(
        1,
        "difference between the pixel and the same with light looked up at every sample of its ray, relative "
        "to the brighter of them; 0 where no light is on a lattice",
        _lattice_error,
        "asked",
        holds="error",
    ),
}
"""Name -> layer, in the order in which they are listed."""


def _of_light(number: int) -> Layer:
    return Layer(
        3,
        "RGB radiance that media scatter and solids reflect of the light, part of the picture, but for later "
        "orders of scattering",
        lambda seen: seen.lights[number, ..., :3].copy(),
        "asked",
    )


def _of_order(number: int) -> Layer:
    def resolve(seen: Seen) -> Array:
        ends = [np.zeros_like(seen.later[..., :3]), *seen.up_to_orders[..., :3], seen.later[..., :3]]
        if number + 1 >= len(ends):  # where nothing lights the points
            return np.zeros_like(ends[0])
        own: Array = ends[number + 1] - ends[number]
        if number == 0:
            own = seen.radiance[..., :3] - (ends[-1] - ends[1])
            own -= seen.emission[..., :3] + seen.ambient[..., :3]
        return own

    return Layer(
        3,
        f"RGB radiance of light that was scattered or reflected {number + 1} times, part of the picture",
        resolve,
        "asked",
    )


GROUPS = {"lights": Group("light.", _of_light), "orders": Group("orders.", _of_order)}
"""Name -> group; one that is a layer, too, is asked for with that."""
NAMES = tuple(dict.fromkeys((*LAYERS, *GROUPS)))
"""All that can be asked for."""
Members = Mapping[str, Sequence[str]]
"""Of groups that were asked for: names of lights, and numbers of orders."""


def members(name: str, of_groups: Members) -> list[str]:
    """Return the names of layers that one stands for, ``light.key`` for a light called ``key``."""
    own = [name] if name in LAYERS else []
    return own + [GROUPS[name].prefix + member for member in of_groups.get(name, ())]


def layer_of(name: str) -> Layer:
    """Return the layer of a name in a picture, which may be a group's member.

    Raises
    ------
    KeyError
        No layer is called so.
    """
    groups = [group for group in GROUPS.values() if name.startswith(group.prefix)]
    return groups[0].layer(0) if groups else LAYERS[name]


def _layers_of(name: str, of_groups: Members) -> dict[str, Layer]:
    own = [LAYERS[name]] if name in LAYERS else []
    layers = [*own, *(GROUPS[name].layer(number) for number in range(len(of_groups.get(name, ()))))]
    return dict(zip(members(name, of_groups), layers, strict=True))


class Layers(Mapping[str, Array]):
    """Layers of a picture by name, each made when it is first asked for.

    Parameters
    ----------
    names
        Of `NAMES`.
    seen
        What the passes made.
    of_groups
        Members of those groups that were asked for.
    """

    def __init__(self, names: Iterable[str], seen: Seen, of_groups: Members | None = None) -> None:
        self._seen, self._layers = seen, dict[str, Layer]()
        for name in names:
            self._layers |= _layers_of(name, of_groups or {})
        self._made: dict[str, Array | None] = dict.fromkeys(self._layers)

    def __getitem__(self, name: str) -> Array:
        """Return a layer, [H, W] or [H, W, 3]."""
        made = self._made[name]
        if made is None:
            made = self._made[name] = self._layers[name].resolve(self._seen)
        return made

    def __iter__(self) -> Iterator[str]:
        """Names, in their order."""
        return iter(self._made)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._made)
