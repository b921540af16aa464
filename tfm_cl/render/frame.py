"""One frame: the camera, then for each batch of lights maps, what media scatter, and what solids reflect."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.cache import Same
from tfm_cl.device.field import Met
from tfm_cl.device.frame import world_from_device
from tfm_cl.device.margins import camera_margin, grown, light_margin
from tfm_cl.device.media import media_on_device
from tfm_cl.device.structs.light import light_structs
from tfm_cl.device.structs.view import view_struct
from tfm_cl.maps.resolved import resolve
from tfm_cl.model import decided
from tfm_cl.plan import emission, surroundings
from tfm_cl.plan.lattice import smooth_lights
from tfm_cl.plan.orders import (
    OnLattice,
    lattice_of,
    media_of,
    orders_of,
    scatters_again,
    sweeps_emission,
    swept_media,
)
from tfm_cl.render import buffers
from tfm_cl.render.batches import Batches, LightVariant
from tfm_cl.render.camera import see
from tfm_cl.render.culling import bounds_of_lights
from tfm_cl.render.deep import DeepBuffers, DeepPass, DeepSettings
from tfm_cl.render.emission import EmissionLattice
from tfm_cl.render.lattice import MOST_APART, Lattice
from tfm_cl.render.light_at import PointSums
from tfm_cl.render.orders import MOST_BYTES_OF_LIGHTS, Orders
from tfm_cl.render.raster import Crop
from tfm_cl.render.scatter import scatter
from tfm_cl.render.surface import reflect
from tfm_cl.render.surroundings import SurroundingsLattice
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Sequence

    import pyopencl as cl

    from tfm_cl.device.cache import Cache
    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.running import InTurn, Running
    from tfm_cl.files.image_io.image import DeepSamples
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.antialiasing import Antialiasing
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import Sums
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.lattice_points import Around, Arrived, LightsAtPoints, TowardsCamera
    from tfm_cl.render.maps import MapBuilder, Sources
    from tfm_cl.render.orders import LightAtPoints
    from tfm_cl.render.raster import Raster, Samples
    from tfm_cl.render.result import RenderStats
    from tfm_cl.render.visibility import Visibility
    from tfm_cl.scene.scene import Scene

T = TypeVar("T")

STEEPEST_DEPTH = 20.0
"""Optical depth over α beyond which few cosines cannot follow e^{-τ/α} (and at 87 float32 ends)."""
MOST_PIXELS = 1 << 14
"""Along a side of a picture for which shadow maps are made."""
VISIBLE_DEPTH = 7.0
"""Optical depth beyond which light (less than 0.1 % of it) is not missed."""


@dataclass
class _Work:
    """One frame under way."""

    scene: Scene
    media: MediaOnDevice
    raster: Raster
    view: cl.Buffer
    gbuffer: GBuffer | None
    frame: buffers.FrameBuffers
    errors: buffers.FrameBuffers | None
    without_lattice: buffers.FrameBuffers | None
    """For its lights, looked up at every sample."""
    sources: Sources | None
    layers: list[int] | None
    """Number, from 1, of the layer that each light belongs to; None where none are asked for.

    Of what media emit there are none: these lights come last."""
    builds: bool
    """Whether maps are built where they are not known."""
    batches: Batches
    reads_maps: bool
    light_steps: int
    """Of the dual march."""
    is_first: bool
    """Whether it is the frame itself, not more samples of its pixels."""
    passes: InTurn
    """Those that may not have ended."""
    seconds: float = 0.0
    """Of the others."""
    maps: list[tuple[TransmittanceMap, bool]] = field(default_factory=list)
    """Yet to be told of, and whether they were built for this frame: their passes may not have ended."""
    camera_is_seen: bool = False
    around_is_seen: bool = False
    """Whether light from all around is, with the camera's samples."""
    lattice_change: NDArray[np.float32] | None = None
    warnings: dict[str, None] = field(default_factory=dict)

    @cached_property
    def met(self) -> Met:
        """What is on the camera's rays; made when first asked for, when light passes are done with theirs."""
        return self.media.met_by_camera(self.scene, self.view, self.raster.per_pixel)


class _Around(NamedTuple):
    """Light from all around that belongs to one layer, at points."""

    lattice: SurroundingsLattice
    scattered: cl.Buffer
    """Towards the camera."""
    lights: list[int]
    layer: int | None


@dataclass
class _Shared:
    """What the frame leaves for more samples of its pixels."""

    touched: NDArray[np.int64]
    """Pixels that each light may change, [lights, 4]."""
    batches: Batches | None = None
    sources: Sources | None = None
    lattice: Lattice | None = None
    emitted: EmissionLattice | None = None
    around: list[_Around] | None = None
    orders: tuple[Orders, TowardsCamera, list[TowardsCamera]] | None = None
    deep: DeepBuffers | None = None


@dataclass(frozen=True)
class Frame:
    """Renders one scene of single, fitted lights.

    Attributes
    ----------
    scene
        Resolved.
    media
        Its media on the device.
    crop
        Pixels x0, y0, x1, y1.
    antialiasing
        How many rays pixels have, and how they are put together.
    """

    launcher: Launcher
    visibility: Visibility
    maps: MapBuilder
    scene: Scene
    media: MediaOnDevice
    crop: Rectangle
    stats: RenderStats
    progress: Progress
    cache: Cache
    antialiasing: Antialiasing

    def begin(
        self,
        method: str,
        maps: Sequence[TransmittanceMap] | None,
        asked: Collection[str],
        wanted: Rectangle,
        layers: list[int] | None = None,
        deep: DeepSettings | None = None,
    ) -> Callable[[], tuple[Sums, DeepSamples | None, tuple[str, ...]]]:
        """Begin to sum all that the scene sends to the camera.

        Parameters
        ----------
        method
            ``tfm`` or ``dual``.
        maps
            From an earlier light pass; None where they are built.
        asked
            Names of layers: those of errors are made only then.
        wanted
            Pixels x0, y0, x1, y1 of the crop that are returned.
        layers
            Number, from 1, of the layer that each light but those of emission belongs to: what ambient light
            and each of these add is then kept by itself.
        deep
            What deep samples are asked for; None: there are none.

        Returns
        -------
        What waits, and returns the sums, deep samples of one ray through each pixel's centre, and warnings.
        Other frames may be begun before it is called.
        """
        whole = Crop(self.crop)
        gbuffer = self.visibility.gbuffer(self.scene, whole)
        shared = _Shared(self._touched(gbuffer))
        first = self._work(whole, gbuffer, shared, method, maps, asked, layers)
        shared.batches, shared.sources = first.batches, first.sources
        if deep is not None:
            shared.deep = self._deep(first, wanted, deep)
        of_first = self._passes(first, shared)
        of_deep = None if shared.deep is None else shared.deep.start_read(self.launcher)

        def look(samples: Samples) -> Sums:
            gbuffer = self.visibility.gbuffer(self.scene, samples)
            work = self._work(samples, gbuffer, shared, method, maps, asked, layers)
            return self._passes(work, shared)()

        def end() -> tuple[Sums, DeepSamples | None, tuple[str, ...]]:
            sums = of_first()
            samples = None if of_deep is None else of_deep(sums.radiance, self._part(wanted))
            sums, refined = self.antialiasing.resolve(sums, self.crop, self.launcher.lanes, look)
            if wanted != self.crop:
                sums = sums.cut(*self._part(wanted))
            self.stats.refined_pixels += refined
            return sums, samples, (*first.warnings,)

        return end

    def light_at(self, points: NDArray[np.floating], groups: Sequence[int]) -> PointSums:
        """Sum what the lights bring to world points [n, 3].

        Parameters
        ----------
        groups
            Number of the group that each light belongs to.
        """
        raster = Crop(self.crop)
        gbuffer = self.visibility.gbuffer(self.scene, raster)
        # However few rays the camera has, shadow maps are as fine as they may be.
        whole = np.tile([0, 0, MOST_PIXELS, MOST_PIXELS], (len(self.scene.lights), 1))
        work = self._work(raster, gbuffer, _Shared(whole), "tfm", None, (), None)
        from_origin = (points - world_from_device(self.scene)[:3, 3]).astype(np.float32)
        found = PointSums(self.launcher, self.media, work.met, work.view, from_origin, groups)
        for variant, members in work.batches.groups(range(len(groups)), all_of_them=True):
            for indices in work.batches.cut(members):
                found.add(work.batches.at_points(variant, indices, self._maps_of(work, indices)))
        self._tell_of_maps(work)
        return found

    def _work(
        self,
        raster: Raster,
        gbuffer: GBuffer | None,
        shared: _Shared,
        method: str,
        maps: Sequence[TransmittanceMap] | None,
        asked: Collection[str],
        layers: list[int] | None,
    ) -> _Work:
        """Make ready for some rays."""
        launcher, scene = self.launcher, self.scene
        reads_maps = method == "tfm" and self.media.fields.count > 0
        is_dual = method == "dual" and self.media.fields.count > 0
        reads_given = method == "tfm" and maps is not None
        count = 0 if layers is None else 1 + max(layers, default=0)
        allocate = partial(buffers.allocate, launcher, raster, gbuffer, emits=scene.emits)
        return _Work(
            scene=scene,
            media=self.media,
            raster=raster,
            view=self._view(scene, self.media, raster),
            gbuffer=gbuffer,
            frame=allocate(
                layers=count,
                later=scatters_again(scene),
                up_to_orders=orders_of(scene) - 1 if self._has_orders_apart(asked) else 0,
                emission_light=bool(emission.numbers_of(scene.lights)),
            ),
            errors=allocate(clear=True) if "map_error" in asked else None,
            without_lattice=allocate() if "lattice_error" in asked else None,
            layers=layers,
            builds=maps is None,
            batches=shared.batches.on(raster, gbuffer)
            if shared.batches is not None
            else Batches(
                launcher,
                scene,
                self.media,
                self.visibility,
                gbuffer,
                self._structs(layers),
                shared.touched,
                raster,
                resolve(scene.map) if reads_maps else None,
                is_dual=is_dual,
            ),
            reads_maps=reads_maps,
            light_steps=decided(scene.map.steps) if is_dual else 1,
            is_first=not raster.is_listed,
            # Of one batch of lights, and the next: solids have a pass of their own.
            passes=launcher.in_turn(2 if gbuffer is None else 3),
            # Last: its look at the light's rays is waited for, and the light pass is to follow at once.
            sources=self.maps.sources(scene, self.media, maps)
            if (reads_maps or reads_given) and shared.sources is None
            else shared.sources,
        )

    def _structs(self, layers: list[int] | None) -> NDArray[Any]:
        """Return the lights' structs, with the layers that they belong to."""
        structs = light_structs(self.scene, self.scene.lights)
        if layers:
            structs["layer"][: len(layers)] = layers
        return structs

    def _view(self, scene: Scene, media: MediaOnDevice, raster: Raster) -> cl.Buffer:
        struct = view_struct(scene, media.fields, raster.bounds, is_listed=raster.is_listed)
        return self.launcher.upload("the view", struct)

    def _passes(self, work: _Work, shared: _Shared) -> Callable[[], Sums]:
        """Begin to sum what the scene sends along some rays; what is returned waits, and returns the sums."""
        scene = self.scene
        if work.is_first:
            shared.lattice = self._lattice(work) if work.reads_maps else None
            shared.emitted = self._emission_lattice(work)
        lattice = shared.lattice
        on_lattice: list[int] = []
        if lattice is not None:
            on_lattice = lattice.lights
            self._light_lattice(work, lattice)
        of_emission, at_points = emission.numbers_of(scene.lights), self._at_points(work)
        others = {*range(len(scene.lights))}.difference(on_lattice, of_emission, at_points)
        if at_points and shared.around is None:
            shared.around = self._around(work, at_points)
        self._scatter(work, sorted(others), work.frame, self._on_shared_samples(work, shared))
        if not work.camera_is_seen:
            work.passes.add(self._see(work, work.frame, has_solids=work.gbuffer is not None))
            work.camera_is_seen = True
        if at_points:
            self._light_from_all_around(work, shared, at_points)
        if of_emission:
            self._light_by_emission(work, shared.emitted, of_emission)
        if scatters_again(scene):
            self._scatter_again(work, shared)
        read = buffers.start_read(self.launcher, work.frame, work.gbuffer, work.errors, work.lattice_change)

        def ended() -> Sums:
            self._tell_of_maps(work)
            self.stats.seconds["view_pass"] += work.seconds + work.passes.wait()
            return read()

        return ended

    def _light_lattice(self, work: _Work, lattice: Lattice) -> None:
        """Look lights up on a lattice, and march the camera's rays through it."""
        steps, without = decided(self.scene.march.steps), work.without_lattice
        if without is not None:
            self._see(work, without, has_solids=False).wait()
        fills = not lattice.is_full
        looks_again = fills or work.errors is not None or without is not None
        for variant, members in work.batches.groups(lattice.lights) if looks_again else ():
            for indices in work.batches.cut(members):
                maps = self._maps_of(work, indices)
                batch = work.batches.batch(variant, indices, maps, whole=True)
                if fills:
                    lattice.add(batch)
                self._tell_of_maps(work)
                self._sum_errors(work, batch, maps)
                if without is not None:
                    self._add(work, batch.at_every_sample(), without)
        done = _reporter(self.progress, "view pass")
        work.seconds += lattice.see(work.view, work.raster.bounds, steps, work.frame, done)
        work.camera_is_seen = True
        if without is not None:
            so_far = (buffers.rgb_so_far(self.launcher, frame) for frame in (work.frame, without))
            with np.errstate(invalid="ignore"):  # any bits may lie where listed rays leave room
                work.lattice_change = np.subtract(*so_far)

    def _on_shared_samples(self, work: _Work, shared: _Shared) -> Around | None:
        """Return light from all around that lights which share the camera's samples may serve; None: none."""
        if shared.around is None or len(shared.around) > 1:
            return None
        if self.scene.homogeneous or work.without_lattice is not None:
            return None
        ((lattice, scattered, lights, layer),) = shared.around
        return lattice.on_shared_samples(scattered, len(lights), layer)

    def _scatter(
        self,
        work: _Work,
        lights: Sequence[int],
        frame: buffers.FrameBuffers,
        around: Around | None = None,
    ) -> None:
        """Look lights up at every sample of the camera's rays.

        ``around``: what these samples may serve, too; if they do, ``work.around_is_seen``.
        """
        launcher, media, view = self.launcher, self.media, work.view
        scatters, met = media, work.met
        if self.scene.flames and not self.scene.primitives and lights:
            # Flames only emit: the camera meets them once, and what is taken for lights need not read them.
            if not work.camera_is_seen:
                work.passes.add(self._see(work, frame, has_solids=work.gbuffer is not None))
                work.camera_is_seen = True
            scatters = self._dark
            met, frame = Met(scatters.arguments), frame.without_emission()
        octaves = max(medium.octaves for medium in self.scene.media)
        if work.layers is not None and octaves > 1 and lights and not work.camera_is_seen:
            # What octaves add to the layer of a light is known when the camera's rays are.
            work.passes.add(self._see(work, frame, has_solids=work.gbuffer is not None))
            work.camera_is_seen = True
        samples = decided(self.scene.march.steps) * work.light_steps
        serves_camera = self._one_light_reaches_all()
        for variant, members in work.batches.groups(lights):
            for indices in work.batches.cut(members):
                maps = self._maps_of(work, indices)
                serves = around if variant.shares_samples and not work.around_is_seen else None
                whole = serves is not None or not work.camera_is_seen
                batch = work.batches.batch(variant, indices, maps, whole=whole)
                work.around_is_seen |= serves is not None
                tell = _reporter(self.progress, f"view pass, {batch.name}")

                def done(part: float, tell: Callable[[float], None] = tell) -> None:
                    self._tell_of_maps(work)  # whose passes have ended, too
                    tell(part)

                work.passes.add(
                    scatter(
                        launcher,
                        scatters,
                        met,
                        view,
                        batch,
                        samples,
                        frame,
                        done,
                        sees_camera=not work.camera_is_seen,
                        serves_camera=serves_camera,
                        around=serves,
                    )
                )
                work.camera_is_seen = True
                if work.gbuffer is not None:
                    work.passes.add(
                        reflect(launcher, media, work.met, view, batch, work.light_steps, frame, done)
                    )
                self._sum_errors(work, batch, maps)

    @cached_property
    def _dark(self) -> MediaOnDevice:
        """Its media as if they emitted nothing: flames only emit, and would take most of the time."""
        return media_on_device(self.launcher, self.scene.dark, self.media.bricks)

    def _emission_lattice(self, work: _Work) -> EmissionLattice | None:
        """Return the lattice of what media emit and others scatter; None where all is found at samples."""
        if not emission.numbers_of(self.scene.lights):
            return None
        lattice, _ = emission.lattice_of(self.scene)
        if lattice is None:
            return None
        return EmissionLattice(self.launcher, self.scene.dark, self._dark, work.view, lattice)

    def _light_by_emission(self, work: _Work, lattice: EmissionLattice | None, lights: Sequence[int]) -> None:
        """Add what media scatter, and solids reflect, of what media emit."""
        frame, tell = work.frame.of_emission_light(), _reporter(self.progress, "view pass, emission")
        if lattice is None:
            self._scatter(work, lights, frame)
            return
        fills, reflects = work.is_first, work.gbuffer is not None
        for variant, members in work.batches.groups(lights) if fills or reflects else ():
            for indices in work.batches.cut(members):
                if fills:
                    lattice.add(self._arrived(work, lattice, {variant: [indices]}), variant, indices)
                if reflects:
                    batch = work.batches.batch(variant, indices, self._maps_of(work, indices), whole=False)
                    rays = self.launcher, self.media, work.met, work.view, batch, work.light_steps
                    work.passes.add(reflect(*rays, frame, tell))
        steps = decided(self.scene.march.steps)
        work.seconds += lattice.see(work.view, work.raster.bounds, steps, frame, tell)
        if fills:
            work.seconds += lattice.seconds

    def _at_points(self, work: _Work) -> list[int]:
        """Numbers of the lights from all around that are looked up at points."""
        lights = surroundings.numbers_of(self.scene.lights) if work.reads_maps else []
        lattice, why = self._points if lights else (None, "")
        if lattice is None and lights:
            work.warnings[f"light from all around is looked up at every sample: {why}"] = None
        return lights if lattice is not None else []

    @cached_property
    def _points(self) -> OnLattice:
        return surroundings.lattice_of(self.scene)

    def _light_from_all_around(self, work: _Work, shared: _Shared, lights: list[int]) -> None:
        """Add what media scatter, and solids reflect, of lights that are looked up at points."""
        tell, without = _reporter(self.progress, "view pass, surroundings"), work.without_lattice
        frame = work.frame.without_emission() if self.scene.emits else work.frame
        if without is not None:
            self._see(work, without, has_solids=work.gbuffer is not None).wait()
        alone = None if without is None else buffers.rgb_so_far(self.launcher, without)
        looks_again = any((work.gbuffer, work.errors, without))
        for variant, members in work.batches.groups(lights) if looks_again else ():
            for indices in work.batches.cut(members):
                maps = self._maps_of(work, indices)
                batch = work.batches.batch(variant, indices, maps, whole=False)
                if work.gbuffer is not None:
                    rays = self.launcher, self.media, work.met, work.view, batch, work.light_steps
                    work.passes.add(reflect(*rays, work.frame, tell))
                self._sum_errors(work, batch, maps)
                if without is not None:
                    self._add(work, batch, without)
        before = None if without is None else buffers.rgb_so_far(self.launcher, frame)
        steps, bounds = decided(self.scene.march.steps), work.raster.bounds
        for lattice, scattered, these, layer in () if work.around_is_seen else shared.around or ():
            work.seconds += lattice.see(work.view, scattered, len(these), bounds, steps, frame, tell, layer)
        if without is not None and before is not None and alone is not None:
            now, of_samples = (buffers.rgb_so_far(self.launcher, one) for one in (frame, without))
            with np.errstate(invalid="ignore"):  # any bits may lie where listed rays leave room
                change: NDArray[np.float32] = (now - before) - (of_samples - alone)
            work.lattice_change = change if work.lattice_change is None else work.lattice_change + change

    def _around(self, work: _Work, lights: list[int]) -> list[_Around]:
        """Find what arrives of such lights, and what is scattered of it; the former of an earlier frame."""
        found, _ = self._points
        assert found is not None  # noqa: S101 - lights are looked up there
        media = self._dark if self.scene.emits else self.media
        tracer = self.visibility.tracer(self.scene)
        lattice = SurroundingsLattice(
            self.launcher, self.scene.dark, media, work.view, found, lights=lights, tracer=tracer
        )
        batches = {
            variant: list(work.batches.cut(members))
            for variant, members in work.batches.groups(lights, all_of_them=True)
        }
        arrived = self._arrived(work, lattice, batches)
        groups: dict[int | None, list[int]] = {}
        for light in lights:
            groups.setdefault(None if work.layers is None else work.layers[light], []).append(light)
        kind = LightVariant.of(self.scene.lights[lights[0]], self.scene)
        made = [
            _Around(lattice, lattice.towards_camera(arrived, kind, of), of, layer)
            for layer, of in groups.items()
        ]
        work.seconds += lattice.seconds
        return made

    def _arrived(
        self, work: _Work, lattice: LightsAtPoints, batches: dict[LightVariant, list[list[int]]]
    ) -> Arrived:
        """Return what arrives of lights at points, in this or an earlier frame."""

        def make() -> Arrived:
            found = [
                work.batches.at_points(
                    variant, indices, self._maps_of(work, indices), shadowed=work.batches.shadowed_in_media
                )
                for variant, cut in batches.items()
                for indices in cut
            ]
            return lattice.arrived(found, work.light_steps)

        if not work.builds:  # maps that were given are known by nothing
            return make()
        scene, settings = work.scene, resolve(work.scene.map) if work.reads_maps else None
        numbers = sorted(light for cut in batches.values() for indices in cut for light in indices)
        lights = [scene.lights[number] for number in numbers]
        # By α, maps may depend on the ways of all lights.
        weighs = (
            settings is not None and settings.target == "transmittance" and settings.density_weighting is None
        )
        key = (
            lattice.lattice,
            lattice.channels,
            tuple(light.map_key() for light in lights),
            tuple(work.light_steps if settings is None else settings.of_light(light) for light in lights),
            tuple(light.map_key() for light in scene.lights) if weighs else (),
            tuple(body.density_key for body in scene.marched),
            tuple(body.with_medium(None) for body in scene.homogeneous),
            tuple(scene.medium_of(body).sigma_t.tobytes() for body in scene.bodies),
            scene.march.voxels,
            scene.solids,
            scene.shadow,
            world_from_device(scene).tobytes(),
        )
        return self.cache.get("light at points", key, make, lambda found: found.nbytes)

    def _scatter_again(self, work: _Work, shared: _Shared) -> None:
        """Add the later orders of scattering."""
        if shared.orders is None:
            shared.orders = self._orders(work)
        orders, towards_camera, up_to = shared.orders
        done = _reporter(self.progress, "view pass, later orders")
        met, bounds = work.met.arguments, work.raster.bounds
        work.seconds += orders.see(work.view, met, towards_camera, bounds, work.frame, done)
        for order, found in enumerate(up_to, 1):
            frame = work.frame.up_to_order(order)
            work.seconds += orders.see(work.view, met, found, bounds, frame, done)

    def _has_orders_apart(self, asked: Collection[str]) -> bool:
        return "orders" in asked and scatters_again(self.scene)

    def _orders(self, work: _Work) -> tuple[Orders, TowardsCamera, list[TowardsCamera]]:
        """Find the later orders of scattering on a lattice; those of the last frames are there."""
        struct = view_struct(
            self.scene, self.media.fields, work.raster.bounds, is_listed=work.raster.is_listed
        )
        orders = Orders(
            self.launcher,
            self.scene,
            self.media,
            work.met.arguments,
            struct,
            lattice_of(self.scene),
            self.cache,
            self.visibility.tracer(self.scene),
            apart=bool(work.frame.up_to_orders),
        )
        told: set[int] = set()

        def arrive(add: Callable[[Batch], None]) -> None:
            for variant, members in work.batches.groups(range(len(self.scene.lights)), all_of_them=True):
                for indices in work.batches.cut(members):
                    add(work.batches.at_points(variant, indices, self._maps_again(work, indices, told)))

        tell = _reporter(self.progress, "later orders")
        key = self._key_of_orders(work, orders)
        found = self._kept_by("orders", key, lambda: orders.scatter(arrive, tell), lambda one: one.nbytes)

        def look_up() -> list[LightAtPoints]:
            lights: list[LightAtPoints] = []
            orders.look_up(arrive, lights.append)
            return lights

        def each_light(use: Callable[[LightAtPoints], None]) -> None:
            if orders.bytes_of_lights > MOST_BYTES_OF_LIGHTS:
                orders.look_up(arrive, use)
            else:
                for light in self._kept_by("lights of orders", key, look_up, _nbytes):
                    use(light)

        towards_camera = orders.towards_camera(found, each_light)
        up_to = [orders.towards_camera(one, each_light) for one in found.up_to]
        self.stats.seconds["orders"] = orders.seconds
        return orders, towards_camera, up_to

    def _kept_by(
        self, kind: str, key: Hashable | None, make: Callable[[], T], nbytes: Callable[[T], int]
    ) -> T:
        """Return what this or an earlier frame made; without a key it is made."""
        return make() if key is None else self.cache.get(kind, key, make, nbytes)

    def _key_of_orders(self, work: _Work, orders: Orders) -> Hashable | None:
        """Return what the later orders depend on; None of maps that were given: nothing is known of these."""
        if not work.builds:
            return None
        scene, media = work.scene, media_of(work.scene)
        return (
            # Of what is emitted, that which is scattered.
            tuple(one.emission for one in swept_media(scene)) if sweeps_emission(scene) else (),
            tuple(flame.density_key for flame in scene.flames) if sweeps_emission(scene) else (),
            tuple((one.sigma_s, one.sigma_a, one.orders, one.phase, one.phase.content) for one in media),
            tuple(media.index(scene.medium_of(body)) for body in scene.bodies),
            orders.lattice,
            orders.apart,
            tuple(body.density_key for body in scene.marched),
            tuple(body.with_medium(None) for body in scene.homogeneous),
            light_structs(scene, scene.lights).tobytes(),
            tuple((light.map_key(), light.falloff, Same(light.texture_image())) for light in scene.lights),
            scene.map,
            work.reads_maps,
            scene.march.voxels,
            scene.solids,
            scene.shadow,
            world_from_device(scene).tobytes(),
        )

    def _maps_again(self, work: _Work, indices: list[int], told: set[int]) -> list[TransmittanceMap]:
        """Return the maps of some lights; those that the camera does not see are not counted before."""
        new = {light for light in indices if not work.batches.is_seen(light)}.difference(told)
        told |= new
        if not new and work.sources is not None:
            return self.maps.of(work.sources, indices, self.progress) if work.reads_maps else []
        return self._maps_of(work, indices)

    def _maps_of(self, work: _Work, indices: list[int]) -> list[TransmittanceMap]:
        """Build or find the maps of some lights; `_tell_of_maps` tells of them when they are built."""
        if work.sources is None or not work.reads_maps:
            return []
        self._tell_of_maps(work)
        maps = self.maps.of(work.sources, indices, self.progress)
        if not work.is_first:
            return maps
        built = self.maps.built if work.builds else frozenset[int]()
        work.maps += [(light_map, id(light_map) in built) for light_map in maps]
        return maps

    def _tell_of_maps(self, work: _Work) -> None:
        for light_map, is_built in work.maps:
            self.stats.add_map(light_map, built=is_built)
            work.warnings |= dict.fromkeys(_warnings(light_map))
        work.maps.clear()

    def _sum_errors(self, work: _Work, batch: Batch, maps: list[TransmittanceMap]) -> None:
        if work.errors is None or not maps:
            return
        self._add(work, work.batches.residuals(batch, maps), work.errors)

    def _add(self, work: _Work, batch: Batch, frame: buffers.FrameBuffers) -> None:
        """Add to a frame beside the picture's; what that takes is not counted."""
        steps, done = decided(self.scene.march.steps), _reporter(self.progress, f"view pass, {batch.name}")
        scatter(self.launcher, self.media, work.met, work.view, batch, steps, frame, done).wait()

    def _lattice(self, work: _Work) -> Lattice | None:
        """Return the lattice of the lights that are looked up there; None without any."""
        if self.scene.map.lookup != "lattice":
            return None
        lights = [light for light in smooth_lights(self.scene) if work.batches.is_seen(light)]
        if not lights:
            return None
        lattice = Lattice(self.launcher, self.cache, self.scene, self.media, work.view, lights, work.layers)
        if len(lattice.apart) > MOST_APART:
            why = f"a lattice holds layers of {MOST_APART} lights, and {len(lattice.apart)} are asked for"
        elif lattice.fits:
            return lattice
        else:
            needs = f"{lattice.nbytes / 2**20:,.0f} MiB in one buffer"
            why = f"a lattice needs {needs}, more than the device allows"
        message = f"light is looked up at every sample: {why}"
        work.warnings[message] = None
        return None

    def _see(self, work: _Work, frame: buffers.FrameBuffers, *, has_solids: bool) -> Running:
        steps = decided(self.scene.march.steps)
        return see(
            self.launcher,
            self.media,
            work.met,
            work.view,
            work.raster.bounds,
            steps,
            frame,
            has_solids=has_solids,
        )

    def _deep(self, work: _Work, wanted: Rectangle, settings: DeepSettings) -> DeepBuffers:
        """Make the deep samples of some pixels; passes then add their colours."""
        steps, has_solids = decided(self.scene.march.steps), work.gbuffer is not None
        rays = self.launcher, self.media, work.met, work.view, work.frame, work.raster.shape
        deep_pass = DeepPass(*rays, wanted, steps, has_solids)
        made, seconds = deep_pass.see(settings)
        if settings.colour:
            if self.scene.emits or any(self.scene.ambient.radiance):
                seconds += deep_pass.add_own(made)
            work.frame = replace(work.frame, deep=made.arguments)
        work.seconds += seconds
        return made

    def _part(self, wanted: Rectangle) -> tuple[slice, slice]:
        """Return rows and columns of the crop."""
        (x0, y0), (left, top, right, bottom) = self.crop[:2], wanted
        return slice(top - y0, bottom - y0), slice(left - x0, right - x0)

    def _one_light_reaches_all(self) -> bool:
        """Tell whether there are but primitives and one light, which reaches them all.

        Steps then hold exactly what lies in them, whichever they are.
        """
        scene = self.scene
        is_alone = len(scene.lights) == 1 and len(scene.primitives) == len(scene.bodies)
        return is_alone and scene.lights[0].reaches_all_of(self._bounds())

    def _bounds(self) -> NDArray[np.float64]:
        """World box [2, 3] around all that has density, as far as it is widened."""
        scene = self.scene
        return grown(scene.occupied_bounds, max(light_margin(scene), camera_margin(scene)))

    def _touched(self, gbuffer: GBuffer | None) -> NDArray[np.int64]:
        """Pixels of the crop that each light may change, [lights, 4]."""
        scene, crop, bounds = self.scene, self.crop, self._bounds()
        if gbuffer is not None and gbuffer.bounds is not None:
            bounds = around([bounds, gbuffer.bounds])
        touched = bounds_of_lights(scene.lights, scene.camera, bounds)
        clipped: NDArray[np.int64] = np.clip(touched.reshape(-1, 2, 2), crop[:2], crop[2:]).reshape(-1, 4)
        return clipped


def _nbytes(lights: Sequence[LightAtPoints]) -> int:
    return sum(light.nbytes for light in lights)


def _reporter(progress: Progress, stage: str) -> Callable[[float], None]:
    return lambda part: progress(stage, part)


def _warnings(light_map: TransmittanceMap) -> tuple[str, ...]:
    """Tell where the map cannot hold a transmittance that is still visible: α is small for the units."""
    extinctions = light_map.fields.rgb_from_field[:, light_map.field_index]
    if extinctions.max() <= 0 or light_map.settings.target != "transmittance":
        return ()
    alpha, deepest = light_map.density_weighting, light_map.largest_optical_depth
    lost = STEEPEST_DEPTH * alpha
    if deepest <= lost or extinctions[extinctions > 0].min() * lost >= VISIBLE_DEPTH:
        return ()
    message = (
        f"density_weighting = {alpha:g} cannot carry an optical depth of {deepest:.0f} of the density: with "
        "such small sigma_s and sigma_a shadows will be too dark; use --density-weighting auto"
    )
    return (message,)
