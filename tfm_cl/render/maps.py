"""The maps of a frame: planned, built, or taken from an earlier light pass."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.frame import world_from_device
from tfm_cl.device.structs.light import light_structs
from tfm_cl.errors import SceneError
from tfm_cl.maps.held import Loaded, OnDevice
from tfm_cl.maps.light_pass import LightPass
from tfm_cl.maps.transmittance_map import TransmittanceMap
from tfm_cl.plan.maps import Planner, field_key

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import pyopencl as cl

    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.maps.bases.curves import Curves
    from tfm_cl.maps.light_pass import Numbers
    from tfm_cl.maps.planned import Planned
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.render.visibility import Visibility
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

SAME_CLIP = 1e-5
"""Of a distance along a light's ray: another processor traces it to within some roundings."""


class Sources:
    """Where the maps of a scene's lights come from: plans to build by, or maps that are there.

    Both are in the order of lights and, for each, of fields.
    """

    def __init__(
        self,
        scene: Scene,
        media: MediaOnDevice,
        of_lights: Sequence[cl.Buffer],
        plans: Sequence[Planned],
        maps: Sequence[TransmittanceMap],
    ) -> None:
        self.scene, self.media, self.of_lights, self.plans, self.maps = scene, media, of_lights, plans, maps


class _Rooms:
    """Room for the maps of a batch, those of one size in one buffer.

    None is allocated before the first of its size is asked for.
    """

    def __init__(self, light_pass: LightPass, plans: Sequence[Planned]) -> None:
        self._light_pass, self._counts = light_pass, Counter(plan.settings for plan in plans)
        self._rooms: dict[ResolvedMap, Iterator[Numbers]] = {}

    def next(self, settings: ResolvedMap) -> Numbers:
        """Return the next one for a map of such settings."""
        if settings not in self._rooms:
            self._rooms[settings] = iter(self._light_pass.room(settings, self._counts[settings]))
        return next(self._rooms[settings])


class MapBuilder:
    """Makes the maps of frames.

    Parameters
    ----------
    launcher
        The device.
    visibility
        What solids leave lit.
    cache
        Of the session: probes of light rays, and maps.
    """

    def __init__(self, launcher: Launcher, visibility: Visibility, cache: Cache) -> None:
        self._launcher, self._visibility, self._cache = launcher, visibility, cache
        self._planner, self._light_pass = Planner(launcher, cache), LightPass(launcher)
        self.built: set[int] = set()
        """Which of the maps that `of` returned last were built for it, by ``id``."""

    def sources(self, scene: Scene, media: MediaOnDevice, maps: Sequence[TransmittanceMap] | None) -> Sources:
        """Plan the maps of a resolved scene of single, fitted lights, or check those that are there.

        Raises
        ------
        SceneError
            Maps of another scene.
        """
        if maps is not None:
            self._check(scene, media, maps)
            here = [self._here(scene, media, place, light_map) for place, light_map in enumerate(maps)]
            return Sources(scene, media, (), (), here)

        def clip(light: Light, size: int) -> NDArray[np.float32] | None:
            return self._visibility.clip(scene, light, size)

        of_lights = _structs(self._launcher, scene)
        return Sources(scene, media, of_lights, self._planner.plans(scene, of_lights, media, clip), ())

    def prepare(self, beside: Launcher, scene: Scene, media: MediaOnDevice) -> None:
        """Begin to look at what `sources` will plan by, from another thread.

        Where solids end the light's rays that is left to it.

        Parameters
        ----------
        beside
            Of that thread.
        """
        if not scene.solids:
            self._planner.prepare(beside, scene, _structs(beside, scene), media)

    def clear(self) -> None:
        """Forget what was prepared."""
        self._planner.forget_prepared()

    def curves(self, scene: Scene, media: MediaOnDevice) -> Iterator[tuple[ResolvedMap, list[Curves]]]:
        """Yield what the maps of such a scene are built by, and rays that their basis may learn from."""
        of_lights = _structs(self._launcher, scene)
        return self._planner.curves(
            scene, of_lights, media, lambda light, size: self._visibility.clip(scene, light, size)
        )

    def of(
        self, sources: Sources, lights: Sequence[int], progress: Progress, *, kept: bool = True
    ) -> list[TransmittanceMap]:
        """Return the maps of some lights, in the order of lights and fields.

        The pass of the last one may not have ended.

        Parameters
        ----------
        kept
            Take those that the session has already, and keep the others.
        """
        count = sources.media.fields.count
        places = [count * light + field for light in lights for field in range(count)]
        if sources.maps or not places:
            return [sources.maps[place] for place in places]
        rooms = _Rooms(self._light_pass, [sources.plans[place] for place in places])

        self.built = set()
        passes = self._launcher.in_turn()

        def build(place: int) -> TransmittanceMap:
            number, field = divmod(place, count)
            plan = sources.plans[place]

            def meanwhile() -> None:
                """Learn the functions of the next map."""
                for following in sources.plans[place + 1 : place + 2]:
                    _ = following.functions

            room = rooms.next(plan.settings)
            built = self._build(sources, number, field, plan, room, progress, meanwhile)
            self.built.add(id(built))
            passes.add(built.buffers.running)
            return built

        if not kept:
            return [build(place) for place in places]
        found = [
            self._cache.get(
                "map",
                self._key(sources, place),
                partial(build, place),
                lambda built: built.kept_bytes,
                serves=lambda kept: not kept.buffers.running.has_failed,
            )
            for place in places
        ]
        return [
            _as_asked(one, sources.scene.map, sources.plans[place])
            for one, place in zip(found, places, strict=True)
        ]

    def _key(self, sources: Sources, place: int) -> tuple[object, ...]:
        """All that a map depends on."""
        scene, plan = sources.scene, sources.plans[place]
        number, field = divmod(place, sources.media.fields.count)
        return (
            field_key(scene, sources.media, field),
            scene.lights[number].map_key(),
            plan.settings.without_alpha,  # the same for a part of the sky, whichever others have
            plan.number_unit,
            plan.extinction,
            scene.shadow.res if scene.solids else 0,
        )

    def _build(
        self,
        sources: Sources,
        number: int,
        field: int,
        plan: Planned,
        room: Numbers,
        progress: Progress,
        meanwhile: Callable[[], None],
    ) -> TransmittanceMap:
        scene, light, medium = sources.scene, sources.scene.lights[number], sources.media.of_fields[field]
        of_light = sources.of_lights[number]
        buffers = self._light_pass.build(plan, light, of_light, medium, room, progress, meanwhile)
        return TransmittanceMap(
            light=light,
            plan=plan,
            requested=scene.map,
            bodies=scene.marched,
            fields=sources.media.fields,
            field_index=field,
            solids=scene.solids,
            shadow_res=scene.shadow.res,
            origin=world_from_device(scene)[:3, 3],
            held=OnDevice(replace(buffers, before=plan.seconds), of_light, medium, self._light_pass),
        )

    def _here(
        self, scene: Scene, media: MediaOnDevice, place: int, light_map: TransmittanceMap
    ) -> TransmittanceMap:
        """Return a map that serves as this builder has it: from a file or another device it comes here."""
        if isinstance(light_map.held, OnDevice) and light_map.held.light_pass is self._light_pass:
            return light_map
        number, field = divmod(place, media.fields.count)
        light, settings = scene.lights[number], light_map.settings
        if isinstance(light_map.held, Loaded) and not _same_clip(
            light_map.plan.clip, self._visibility.clip(scene, light, settings.res)
        ):
            raise SceneError(f"map {place + 1} was built for another set of solids; build the maps again")
        return replace(
            light_map,
            light=light,
            bodies=scene.marched,
            solids=scene.solids,
            origin=world_from_device(scene)[:3, 3],
            held=OnDevice(
                self._light_pass.held(settings, light_map.numbers),
                self._launcher.upload("the light", light_structs(scene, [light])),
                media.of_fields[field],
                self._light_pass,
            ),
        )

    def _check(self, scene: Scene, media: MediaOnDevice, maps: Sequence[TransmittanceMap]) -> None:
        count = media.fields.count
        if maps and count and scene.lights:
            self._check_one(scene, media, maps, 0)  # which says more than how many there are
        if len(maps) != count * len(scene.lights):
            each = ", none of which has maps without a grid" if count == 0 else ""
            if count > 1:
                each = f", each of which takes {count} in such a mixture of colours"
            raise SceneError(
                f"{len(maps)} maps for {len(scene.lights)} lights (points of area lights count){each}; "
                "build the maps again"
            )
        for place in range(1, len(maps)):
            self._check_one(scene, media, maps, place)

    def _check_one(
        self, scene: Scene, media: MediaOnDevice, maps: Sequence[TransmittanceMap], place: int
    ) -> None:
        number, field = divmod(place, media.fields.count)
        try:
            maps[place].check_serves(scene, scene.lights[number], media.fields, field)
        except SceneError as error:
            raise SceneError(f"map {place + 1} {error}") from None


def _structs(launcher: Launcher, scene: Scene) -> list[cl.Buffer]:
    """Put each light of a scene on the device."""
    structs = light_structs(scene, scene.lights)
    return [launcher.upload("the light", structs[i : i + 1]) for i in range(len(structs))]


def _as_asked(light_map: TransmittanceMap, asked: MapSettings, plan: Planned) -> TransmittanceMap:
    """Return a map of this or an earlier frame with what this one asks for, and its α."""
    known, alpha = light_map.plan, plan.density_weighting
    if light_map.requested is asked and known.density_weighting == alpha:
        return light_map
    known = replace(known, settings=plan.settings, density_weighting=alpha)
    return replace(light_map, requested=asked, plan=known)


def _same_clip(one: NDArray[np.float32] | None, other: NDArray[np.float32] | None) -> bool:
    """Tell whether solids end a light's rays at the same distances, as far as float32 tells."""
    if one is None or other is None:
        return one is other
    return bool(np.allclose(one, other, rtol=SAME_CLIP, atol=0))
