"""What is decided before a map is built: α, ranges, and the functions of the basis and their number."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.device.frame import world_from_device
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

Clip = Callable[["Light", int], np.ndarray | None]


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
        self._probe = LightProbe(launcher)

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
            self._of_field(scene, of_lights, medium, clip, field_key(scene, media, medium.index))
            for medium in media.of_fields
        ]
        return [plan for of_light in zip(*of_fields, strict=True) for plan in of_light]

    def curves(
        self, scene: Scene, of_lights: Sequence[cl.Buffer], media: MediaOnDevice, clip: Clip
    ) -> Iterator[tuple[ResolvedMap, list[Curves]]]:
        """Yield, for each field, what its maps are built by, α decided, and rays of each light.

        Arguments as of `plans`.
        """
        for medium in media.of_fields:
            key = field_key(scene, media, medium.index)
            seen = self._seen(scene, of_lights, medium, clip, key)
            rays = [
                self._curves(seen.settings, light, of_light, medium, probe, _field(seen.settings, probe))
                for light, of_light, probe in zip(scene.lights, of_lights, seen.probes, strict=True)
            ]
            yield seen.settings, rays

    def _of_field(
        self,
        scene: Scene,
        of_lights: Sequence[cl.Buffer],
        medium: FieldOnDevice,
        clip: Clip,
        key: tuple[object, ...],
    ) -> list[Planned]:
        """Plan the maps of one field, of which ``key`` holds all that its density depends on."""
        seen = self._seen(scene, of_lights, medium, clip, key)
        settings, extinction, alpha = seen.settings, medium.extinction, seen.alpha
        unit = 1.0
        if settings.storage == "f16" and settings.target != "transmittance":
            unit = 2.0 ** max(0, np.ceil(np.log2(max(seen.deepest, 1e-30) / LARGEST_HALF)))
        plans = []
        for number, (light, of_light, probe) in enumerate(
            zip(scene.lights, of_lights, seen.probes, strict=True)
        ):
            of_map = settings.of_light(light)
            fit = partial(self._fit, of_map, light, of_light, medium, probe)
            before = self._launcher.seconds
            if settings.learns:  # which takes longer than all else on the host
                fitted = self._cache.get(
                    "functions",
                    (key, light.map_key(), seen.shadow_res, of_map, seen.cut, extinction),
                    fit,
                    lambda made: made.nbytes,
                )
            else:
                fitted = fit()
            spent = seen.spent[number] + self._launcher.seconds - before
            plans.append(
                Planned(
                    settings=of_map,
                    field=fitted.field,
                    made=fitted.made,
                    number_unit=unit,
                    density_weighting=alpha,
                    extinction=extinction,
                    clip=clip(light, of_map.res),
                    deepest=seen.deepest,
                    seconds=float(spent),
                )
            )
        return plans

    def _seen(
        self,
        scene: Scene,
        of_lights: Sequence[cl.Buffer],
        medium: FieldOnDevice,
        clip: Clip,
        key: tuple[object, ...],
    ) -> _Seen:
        """Look at the rays of all lights in one field."""
        settings, extinction = resolve(scene.map), medium.extinction
        lights = list(zip(scene.lights, of_lights, strict=True))
        shadow_res = scene.shadow.res if scene.solids else 0
        spent = np.zeros(len(lights))

        def probed(number: int, size: int, cut: float, steps: int) -> Probe:
            light, of_light = lights[number]
            before = self._launcher.seconds
            probe = self._cache.get(
                "probe",
                (key, light.map_key(), shadow_res, size, cut, steps),
                lambda: self._probe.ranges(light, of_light, medium, size, cut, steps, clip(light, size)),
                lambda probe: probe.nbytes,
            )
            spent[number] += self._launcher.seconds - before
            return probe

        has_ranges = settings.range != "box"
        cut = VISIBLE_DEPTH / extinction if settings.range == "visible" else np.inf
        fine_steps = max(settings.steps, RANGE_STEPS)

        def fine(number: int) -> tuple[int, float, int]:
            return field_res(settings.of_light(scene.lights[number]).res), cut, fine_steps

        # The ranges do not depend on α, and where it is of no use one look at the rays is enough.
        is_enough = has_ranges and settings.target != "transmittance"
        coarse = PROBE_RES, np.inf, settings.steps
        probes = [probed(number, *(fine(number) if is_enough else coarse)) for number in range(len(lights))]
        deepest = max((float(probe.optical_depth.max()) for probe in probes), default=0.0)
        alpha = density_weighting(settings.density_weighting, medium.strongest, deepest)
        settings = settings.replace(density_weighting=alpha)
        if has_ranges and not is_enough:
            probes = [probed(number, *fine(number)) for number in range(len(lights))]
        return _Seen(settings, probes, alpha, deepest, shadow_res, cut, spent)

    def _fit(
        self, settings: ResolvedMap, light: Light, of_light: cl.Buffer, medium: FieldOnDevice, probe: Probe
    ) -> Fitted:
        """Find the ranges of a map, and the rays that the functions of its basis are made from."""
        field = _field(settings, probe)
        curves = self._curves(settings, light, of_light, medium, probe, field) if settings.learns else None
        nbytes = 0 if curves is None else curves.optical_depth.nbytes
        return Fitted(field, Making(partial(functions_of, settings, curves), nbytes))

    def _curves(
        self,
        settings: ResolvedMap,
        light: Light,
        of_light: cl.Buffer,
        medium: FieldOnDevice,
        probe: Probe,
        field: np.ndarray,
    ) -> Curves:
        """Sample the rays that functions are learnt from."""
        ranges = None if settings.range == "box" else field
        return self._probe.curves(light, of_light, medium, probe, ranges, medium.extinction)


class _Seen(NamedTuple):
    """What the rays of all lights were found to hold of a field."""

    settings: ResolvedMap
    """With α."""
    probes: Sequence[Probe]
    """Of each light."""
    alpha: float
    deepest: float
    """Largest optical depth of the density along any of them."""
    shadow_res: int
    cut: float
    """Optical depth of the density at which a range ends."""
    spent: np.ndarray
    """Device time, of each light."""


@dataclass(frozen=True)
class Fitted:
    """What of a map's plan follows from the light's rays."""

    field: np.ndarray
    """Ranges of the rays, as in `Planned`."""
    made: Making
    """What makes the functions of the basis."""

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
    return probe.global_field() if settings.range == "global" else probe.field()


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
