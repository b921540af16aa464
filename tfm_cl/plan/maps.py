"""What is decided before a map is built: α, ranges, and the functions of the basis and their number."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from tfm_cl.device.ahead import keep_ahead
from tfm_cl.device.frame import world_from_device
from tfm_cl.errors import DeviceError
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.curves import Curves
from tfm_cl.maps.bases.given import functions_in, functions_text
from tfm_cl.maps.planned import LARGEST_HALF, Making, Planned
from tfm_cl.maps.probe import VISIBLE_DEPTH, LightProbe, Probe
from tfm_cl.maps.resolved import ResolvedMap, field_res, resolve

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.cache import Cache
    from tfm_cl.device.field import FieldOnDevice
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.running import Finding, Running
    from tfm_cl.maps.bases.base import Functions
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

AUTO_WEIGHTING = (1.0, 16.0)
"""Range of α times the extinction that density_weighting = auto chooses from."""
PROBE_RES = 64
"""Light rays along a side of the map that density_weighting = auto looks at."""

RANGE_STEPS = 128
"""Of a coarse ray, at least: what lies before a range's begin or between the coarse rays is lost to the
map."""
MOST_TOGETHER = 8192
"""Light rays of all lights and frames that functions for all of them are learnt from."""

AHEAD = 8
"""Lights whose rays the device is asked to look at before the host asks what it found of the first one's."""

Clip = Callable[["Light", int], np.ndarray | None]
Looked = dict[tuple[object, ...], "Finding[Probe]"]
T = TypeVar("T")


class Planner:
    """Looks at the light rays of a scene and plans its maps.

    Parameters
    ----------
    launcher
        The device.
    cache
        Of the session: what light rays were found to hold.
    """

    def __init__(self, launcher: Launcher, cache: Cache) -> None:
        self._launcher, self._cache = launcher, cache
        self._ahead: dict[int, Looked] = {}
        """What looks at the light rays of scenes whose turn is yet to come, by numbers of these."""
        self._prepared = 0

    def prepare(
        self, launcher: Launcher, scene: Scene, of_lights: Sequence[cl.Buffer], media: MediaOnDevice
    ) -> None:
        """Begin to look at the light rays of a scene without solids whose maps are planned later.

        Parameters
        ----------
        launcher
            Of the thread that asks, beside that which plans.
        scene, of_lights, media
            As of `plans`, which then need not wait for the device.
        """
        looked: Looked = {}
        for rays in self._rays(scene, of_lights, media, lambda _light, _size: None, launcher):
            for sizes, cut, steps in rays.looks:
                for number, size in enumerate(sizes):
                    looked[rays.look_key(number, size, cut, steps)] = rays.look(number, size, cut, steps)
        self._prepared += 1
        keep_ahead(self._ahead, self._prepared, looked)

    def forget_prepared(self) -> None:
        """Forget what was prepared, and not planned."""
        self._ahead.clear()

    def _taken(self, key: tuple[object, ...]) -> Finding[Probe] | None:
        """Return what looks at some rays already; None: nothing does."""
        for looked in [*self._ahead.values()]:
            if (found := looked.pop(key, None)) is not None:
                return found
        return None

    def plans(
        self, scene: Scene, of_lights: Sequence[cl.Buffer], media: MediaOnDevice, clip: Clip
    ) -> list[Planned]:
        """Plan one map for each light of a resolved scene and each field, light by light.

        Those of a field differ only in what depends on the light.

        Parameters
        ----------
        of_lights
            The struct of each light.
        clip
            Given a light and a size, the distances [size, size] beyond which solids leave nothing lit.
        """
        of_fields = [
            self._of_field(rays) for rays in self._rays(scene, of_lights, media, clip, self._launcher)
        ]
        return [plan for of_light in zip(*of_fields, strict=True) for plan in of_light]

    def curves(
        self, scene: Scene, of_lights: Sequence[cl.Buffer], media: MediaOnDevice, clip: Clip
    ) -> Iterator[tuple[ResolvedMap, list[Curves]]]:
        """Yield, for each field, what its maps are built by, α decided, and rays of each light.

        Arguments as of `plans`.
        """
        for rays in self._rays(scene, of_lights, media, clip, self._launcher):
            seen = _look(rays, rays.curves)
            yield seen.settings, [curves.found for curves in seen.made]

    def _rays(
        self,
        scene: Scene,
        of_lights: Sequence[cl.Buffer],
        media: MediaOnDevice,
        clip: Clip,
        launcher: Launcher,
    ) -> Iterator[_Rays]:
        for medium in media.of_fields:
            key = field_key(scene, media, medium.index)
            yield _Rays(launcher, self._cache, scene, of_lights, medium, clip, key, self._taken)

    def _of_field(self, rays: _Rays) -> list[Planned]:
        """Plan the maps of one field."""
        seen = _look(rays, rays.fitted)
        settings = seen.settings
        unit = 1.0
        if settings.storage == "f16" and not settings.is_weighted:
            unit = 2.0 ** max(0, np.ceil(np.log2(max(seen.deepest, 1e-30) / LARGEST_HALF)))
        plans = []
        for number, fitted in enumerate(seen.made):
            of_map = settings.of_light(rays.lights[number])
            plans.append(
                Planned(
                    settings=of_map,
                    field=fitted.field,
                    made=fitted.made,
                    number_unit=unit,
                    density_weighting=seen.alpha,
                    extinction=rays.medium.extinction,
                    clip=rays.clip(number, of_map.res),
                    deepest=seen.deepest,
                    probed=tuple(rays.probed[number]),
                )
            )
        return plans


class _Rays:
    """The light rays of a scene in one field: what they hold is found on the device, or was before.

    Parameters
    ----------
    of_lights, clip
        As of `Planner.plans`.
    key
        Holds all that the field's density depends on.
    taken
        Given what a look is known by, returns what has been begun ahead.

    Attributes
    ----------
    lights, medium
        Whose rays these are, and the field.
    settings
        Of the lights' maps, without α where that is left to the rays.
    cut
        Optical depth of the density at which a range ends.
    probed
        What looked at the rays of each light now; of what did so ahead, beside passes of other scenes, the
        time tells nothing.
    """

    def __init__(
        self,
        launcher: Launcher,
        cache: Cache,
        scene: Scene,
        of_lights: Sequence[cl.Buffer],
        medium: FieldOnDevice,
        clip: Clip,
        key: tuple[object, ...],
        taken: Callable[[tuple[object, ...]], Finding[Probe] | None],
    ) -> None:
        self._cache, self._probe, self._taken = cache, LightProbe(launcher), taken
        self.lights, self._of_lights, self.medium, self._clip, self._key = (
            scene.lights,
            of_lights,
            medium,
            clip,
            key,
        )
        self.settings = resolve(scene.map)
        self.cut = VISIBLE_DEPTH / medium.extinction if self.settings.range == "visible" else np.inf
        self._shadow_res = scene.shadow.res if scene.solids else 0
        self._samplings = launcher.in_turn(AHEAD)
        self.probed: list[list[Running]] = [[] for _ in scene.lights]
        self._of_others: list[Finding[Probe]] = []
        """Looks that were begun ahead."""

    @property
    def has_ranges(self) -> bool:
        """Whether maps know where each ray holds density."""
        return self.settings.range != "box"

    @property
    def is_enough(self) -> bool:
        """Whether one look at the rays is: ranges do not depend on α, and it may be of no use."""
        return self.has_ranges and not self.settings.is_weighted

    @property
    def looks(self) -> list[tuple[list[int], float, int]]:
        """One or two looks at the rays: along a side, of each light; where they end, and steps."""
        settings = self.settings
        coarse = [PROBE_RES] * len(self.lights), np.inf, settings.steps
        sizes = [field_res(settings.of_light(light).res) for light in self.lights]
        fine = sizes, self.cut, max(settings.steps, RANGE_STEPS)
        if self.is_enough:
            return [fine]
        return [coarse, fine] if self.has_ranges else [coarse]

    def clip(self, number: int, size: int) -> np.ndarray | None:
        """Return the distances [size, size] beyond which solids leave nothing of a light."""
        return self._clip(self.lights[number], size)

    def look_key(self, number: int, size: int, cut: float, steps: int) -> tuple[object, ...]:
        """All that a look at the rays of a light depends on."""
        return self._key, self.lights[number].map_key(), self._shadow_res, size, cut, steps

    def look(self, number: int, size: int, cut: float, steps: int) -> Finding[Probe]:
        """Begin to look at the rays of a light."""
        light, of_light, clip = self.lights[number], self._of_lights[number], self.clip(number, size)
        return self._probe.ranges(light, of_light, self.medium, size, cut, steps, clip)

    def probes(self, sizes: Sequence[int], cut: float, steps: int) -> Iterator[tuple[int, Probe]]:
        """Yield each light's number and rays: while the host is at them, the device is at those of others.

        Parameters
        ----------
        sizes
            Rays along a side, of each light.
        cut, steps
            As of `LightProbe.ranges`.
        """
        begun: deque[Finding[Probe]] = deque()
        for number in range(len(sizes)):
            for following in range(number + len(begun), min(number + AHEAD, len(sizes))):
                begun.append(self._begun(following, sizes[following], cut, steps))
            yield number, self._found(begun.popleft(), number, sizes[number], cut, steps)

    def _found(self, begun: Finding[Probe], number: int, size: int, cut: float, steps: int) -> Probe:
        """Read what was found; where that failed beside another frame, look once more."""
        try:
            return begun.found
        except DeviceError:
            if begun not in self._of_others:
                raise
        return self._begun(number, size, cut, steps).found

    def _begun(self, number: int, size: int, cut: float, steps: int) -> Finding[Probe]:
        key = self.look_key(number, size, cut, steps)

        def begin() -> Finding[Probe]:
            if (found := self._taken(key)) is not None:
                self._of_others.append(found)
                return found
            found = self.look(number, size, cut, steps)
            self.probed[number].append(found.running)
            return found

        return self._cache.get(
            "probe",
            key,
            begin,
            lambda found: found.nbytes,
            serves=lambda found: not found.running.has_failed,
        )

    def fitted(self, settings: ResolvedMap, number: int, probe: Probe) -> Fitted:
        """Find the ranges of a light's map, and the rays that the functions of its basis are made from."""
        light, of_map = self.lights[number], settings.of_light(self.lights[number])

        def fit() -> Fitted:
            if not of_map.learns:
                return Fitted(_field(of_map, probe), Making(lambda: functions_of(of_map, None)))
            curves = self.curves(settings, number, probe)
            made = Making(lambda: functions_of(of_map, curves.found), curves.nbytes)
            return Fitted(_field(of_map, probe), made, curves.running)

        if not of_map.learns:  # which takes longer than all else on the host
            return fit()
        return self._cache.get(
            "functions",
            (self._key, light.map_key(), self._shadow_res, of_map, self.cut, self.medium.extinction),
            fit,
            lambda made: made.nbytes,
            serves=lambda made: made.running is None or not made.running.has_failed,
        )

    def curves(self, settings: ResolvedMap, number: int, probe: Probe) -> Finding[Curves]:
        """Begin to sample the rays that functions are learnt from."""
        light, of_light, medium = self.lights[number], self._of_lights[number], self.medium
        ranges = None if settings.range == "box" else _field(settings, probe)
        found = self._probe.curves(light, of_light, medium, probe, ranges, medium.extinction)
        self.probed[number].append(found.running)
        self._samplings.add(found.running)
        return found


def _look(rays: _Rays, make: Callable[[ResolvedMap, int, Probe], T]) -> _Seen[T]:
    """Look at the rays of all lights in one field, decide on α, and make something of each light's rays.

    Parameters
    ----------
    make
        Is given the settings that a map's functions depend on, a light's number, and its rays.
    """
    settings, (first, *second) = rays.settings, rays.looks
    deepest, probes, made = 0.0, [], []
    for number, probe in rays.probes(*first):
        deepest = max(deepest, float(probe.optical_depth.max()))
        if rays.is_enough:
            made.append(make(settings.without_alpha, number, probe))
        else:
            probes.append((number, probe))
    alpha = density_weighting(settings.density_weighting, rays.medium.strongest, deepest)
    settings = settings.replace(density_weighting=alpha)
    if not rays.is_enough:
        again = rays.probes(*second[0]) if second else probes
        made = [make(settings.without_alpha, *one) for one in again]
    return _Seen(settings, made, alpha, deepest)


class _Seen(NamedTuple, Generic[T]):
    """What the rays of all lights were found to hold of a field."""

    settings: ResolvedMap
    """With α."""
    made: Sequence[T]
    """Of each light's rays."""
    alpha: float
    deepest: float
    """Largest optical depth of the density along any of them."""


@dataclass(frozen=True)
class Fitted:
    """What of a map's plan follows from the light's rays."""

    field: np.ndarray
    """Ranges of the rays, as in `Planned`."""
    made: Making
    """What makes the functions of the basis."""
    running: Running | None = None
    """What samples the rays that these are made from; None without any."""

    @property
    def nbytes(self) -> int:
        """Size."""
        return self.field.nbytes + self.made.nbytes


def field_key(scene: Scene, media: MediaOnDevice, field: int) -> tuple[object, ...]:
    """All that one field's density depends on, and where the device has it; with the solids among it."""
    return (
        tuple(body.density_key for body in scene.marched),
        media.fields.weights[:, :, field].tobytes(),
        world_from_device(scene).tobytes(),
        scene.march.voxels,
        scene.solids,
        media.of_fields[field].margin,  # rays are looked at within these bounds
    )


def functions_of(settings: ResolvedMap, curves: Curves | None) -> Functions | None:
    """Make the functions of a basis, if it has any: those that were given, or of some light rays."""
    basis = BASES[settings.basis]
    if settings.functions and basis.recalled is not None:
        return basis.recalled(settings, functions_in(settings.functions))
    make = basis.functions
    return None if make is None else make(settings, curves)


def functions_for_all(found: Sequence[tuple[ResolvedMap, Sequence[Curves]]]) -> str | None:
    """Learn functions that serve all maps of some fields, lights and frames; None where there are no rays.

    Parameters
    ----------
    found
        For each field and frame, what its maps are built by, whose basis learns what lasts, and rays of each
        light; the basis is that of the first.
    """
    if not found:
        return None
    alphas = [settings.density_weighting or 1.0 for settings, _ in found]
    settings = found[0][0].replace(density_weighting=max(alphas))
    rays = Curves.together([one for _, of_lights in found for one in of_lights], MOST_TOGETHER)
    functions = functions_of(settings, rays)
    if functions is None or not len(rays.optical_depth):
        return None
    return functions_text(functions.modes)


def _field(settings: ResolvedMap, probe: Probe) -> np.ndarray:
    if settings.range == "box":
        return np.zeros((1, 1, 4), np.float32)
    return probe.global_field() if settings.range == "global" else probe.field


def density_weighting(asked: float | None, sigma_t: float, deepest: float) -> float:
    """Return α of eq. 19: that asked for, or half the largest optical depth that the lights meet.

    Parameters
    ----------
    asked
        None: to be decided.
    sigma_t
        Largest extinction at density 1: the range is meant for the most extinguished colour's optical
        depth; α itself weights the density, and for tiny extinctions follows its large depth.
    deepest
        Optical depth of the density.
    """
    if asked is not None:
        return asked
    if sigma_t <= 0:
        return 1.0
    weighting = float(np.clip(sigma_t * deepest / 2, *AUTO_WEIGHTING))
    return max(1.0, weighting / sigma_t)
