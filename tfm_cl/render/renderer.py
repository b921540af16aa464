"""The renderer: orders the passes on one device."""

from __future__ import annotations

import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.device.ahead import keep_ahead
from tfm_cl.device.cache import BUDGET, Cache
from tfm_cl.device.device import choose_device
from tfm_cl.device.frame import check_distances
from tfm_cl.device.kernel_cache import take_notes
from tfm_cl.device.launch import Launcher, Progress
from tfm_cl.device.margins import grown, light_margin
from tfm_cl.errors import DeviceError, SceneError, TfmError, TfmWarning
from tfm_cl.interrupts import cancelled_by, check_cancelled
from tfm_cl.maps.light_at_points import EMISSION, LightAtPoints
from tfm_cl.plan import emission, lattice, resolution
from tfm_cl.plan.accuracy import Choice, Chooser
from tfm_cl.plan.maps import functions_for_all
from tfm_cl.plan.orders import orders_of
from tfm_cl.plan.plan import Plan, plan, with_lookup
from tfm_cl.render import diagnosis
from tfm_cl.render.antialiasing import PLAIN, Antialiasing
from tfm_cl.render.checks import (
    Crop,
    checked_aovs,
    checked_crop,
    checked_maps,
    checked_method,
    checked_moment,
    checked_progress,
    checked_scene,
)
from tfm_cl.render.deep import DeepSettings
from tfm_cl.render.frame import Frame
from tfm_cl.render.maps import MapBuilder
from tfm_cl.render.media import Media
from tfm_cl.render.motion import Moments, Mover
from tfm_cl.render.result import RenderResult, RenderStats, members_of
from tfm_cl.render.visibility import Visibility
from tfm_cl.scene.background import check_surrounded
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.layers import GROUPS, LAYERS, Layers
from tfm_cl.scene.lights.base import names_of
from tfm_cl.scene.settings import MOTION_SAMPLES, ImageSettings

if TYPE_CHECKING:
    from tfm_cl.files.image_io.image import DeepSamples
    from tfm_cl.maps.bases.curves import Curves
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.buffers import Sums
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.scene import Scene


class _Asked(NamedTuple):
    """What is rendered."""

    scene: Scene
    """With the numbers that keep an error, where one is asked for."""
    error: float | None
    """That they have."""
    limited: Sequence[str]
    """What its resolution is too coarse for."""
    for_lattice: bool
    """Whether a lattice of light is asked for."""


@dataclass
class _Spent:
    """What a render takes, by the thread that asks for it: other renders may be under way meanwhile."""

    total: float = 0.0
    device: float = 0.0
    """Seconds of what was waited for: of all renders together those of all."""
    compiled: float = 0.0
    traced: float = 0.0
    made: Counter[str] = field(default_factory=Counter)


class _Prepared(NamedTuple):
    """What needs no device of a scene that is rendered next."""

    scene: Scene
    method: str
    planned: Plan
    points: Scene
    """With single, fitted lights."""


class _Wanted(NamedTuple):
    """What `Renderer.render` is asked for, checked."""

    scene: Scene
    maps: Sequence[TransmittanceMap] | None
    method: str | None
    crop: Crop | None
    image: ImageSettings
    deep: DeepSettings | None
    progress: Progress | None


class Renderer:
    """Compiles once, renders any number of scenes; a context manager.

    Any thread may use it and its maps: what several ask for at once is done in turn. To render at the same
    time, give each thread or process a renderer of its own. `cancel` may be called meanwhile from any thread;
    it ends what is being done, not what waits. `close` is final.

    Parameters
    ----------
    device
        Part of an OpenCL device's or platform's name, its number, or ``platform:device``, as
        `tfm_cl.device.device.choose_device` takes it; by default a GPU if there is one, else PoCL.
    build_options
        Further OpenCL compiler options.
    lanes
        Rays that a work-item carries, 1, 4, 8 or 16; by default what suits the device.
    largest_buffer
        Bytes that one device buffer may have; by default the device's limit.
    work_group
        Work-items (x, y) of a work-group in maps and images; None leaves it to the driver.
    cache_bytes
        Bytes of voxels, maps, shadow maps and G-buffers, at most, that are kept for the next frames.
    launch_seconds
        That the device works at a stretch, at most, as far as the renderer can foresee: `cancel` is heard in
        between. None: about a tenth of a second, at times more. Pictures are the same.

    Raises
    ------
    NoDeviceError
        No device, or none of that name.
    DeviceError
        Lanes that the device does not have; launches of no time.
    """

    def __init__(
        self,
        device: str | None = None,
        *,
        build_options: tuple[str, ...] = (),
        lanes: int | None = None,
        largest_buffer: int | None = None,
        work_group: tuple[int, int] | Literal["auto"] | None = "auto",
        cache_bytes: int = BUDGET,
        launch_seconds: float | None = None,
    ) -> None:
        self._launcher = Launcher(
            choose_device(device),
            build_options,
            lanes=lanes,
            largest_buffer=largest_buffer,
            work_group=work_group,
            launch_seconds=launch_seconds,
        )
        self._cache = Cache(cache_bytes)
        self._media = Media(self._launcher, self._cache)
        self._visibility = Visibility(self._cache)
        self._maps = MapBuilder(self._launcher, self._visibility, self._cache)
        self._choice: tuple[tuple[Scene, str, Crop], Choice] | None = None
        self._prepared: dict[int, _Prepared] = {}
        """By the ids of their scenes."""
        self._preparing = threading.Lock()
        self._beside = self._launcher.beside()
        """Of the thread that prepares."""
        self._is_closed = False

    @property
    def device_name(self) -> str:
        """Name of the OpenCL device."""
        return str(self._launcher.device.name).strip()

    @property
    def lanes(self) -> int:
        """Rays that a work-item carries."""
        return self._launcher.lanes

    @property
    def on_compiling(self) -> Callable[[str], None] | None:
        """Called before each program is compiled that is not kept from before, which may take seconds.

        With its name, as ``"light pass"``, in the thread that renders. None: nobody wants to know.
        """
        return self._launcher.kernels.on_compiling

    @on_compiling.setter
    def on_compiling(self, heard: Callable[[str], None] | None) -> None:
        self._launcher.kernels.on_compiling = heard

    def close(self) -> None:
        """Release the device's memory, when what is being done has ended; nothing can be rendered afterwards.

        Maps that are still held keep their own memory, and can be read. Closing again does nothing.
        """
        with self._launcher.turn:
            if self._is_closed:
                return
            self._is_closed = True
            self._cache.clear()
            self._choice = None
            with self._preparing:
                self._prepared.clear()
                self._media.clear()
                self._maps.clear()
                self._beside.release()
            self._visibility.clear()
            self._launcher.release()

    @contextmanager
    def _in_turn(self) -> Iterator[None]:
        """Begin when no other thread is at work; what was cancelled before has ended."""
        with self._launcher.turn:
            if self._is_closed:
                raise DeviceError("the renderer is closed: nothing can be rendered with it; make another")
            self._launcher.begin()
            try:
                with cancelled_by(self._launcher.check):
                    yield
            except BaseException:
                self._launcher.finish()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def build_maps(self, scene: Scene, progress: Progress | None = None) -> list[TransmittanceMap]:
        """Run the light pass.

        Returns
        -------
        list of TransmittanceMap
            One for each light, in order, and for a light with a radius one for each of its points; they serve
            until grids, light geometry or map settings change. Where grids have a colour in each voxel, or
            media differ in colour, there are up to three in the place of each, one for each field
            (`tfm_cl.scene.fields`). None without grids: what is homogeneous needs no map.

        Raises
        ------
        DeviceError
            Memory or compilation, or the renderer is closed.
        """
        return self._light_pass(checked_scene(scene), None, progress, kept=False)

    def _light_pass(
        self, scene: Scene, lights: Sequence[int] | None, progress: Progress | None, *, kept: bool
    ) -> list[TransmittanceMap]:
        """Return the maps of some single lights, by their numbers, or of all; ``kept``: of earlier frames."""
        progress = checked_progress(progress) or _silent
        with self._in_turn():
            scene = _single_lights(self._planned(scene, progress).scene)
            media = self._media.of(scene, None)
            if not media.fields.count:
                return []
            sources = self._maps.sources(scene, media, None)
            wanted = range(len(scene.lights)) if lights is None else lights
            maps = self._maps.of(sources, wanted, progress, kept=kept)
            for light_map in maps:
                light_map.buffers.running.wait()
            return maps

    def _planned(self, scene: Scene, progress: Progress) -> Plan:
        """Read the files of a scene, and plan its maps."""
        scene.read_files()
        if scene.map.max_error is not None:
            scene, _ = self._chosen(scene, "tfm", None, None, progress)
        return plan(scene, method="tfm")

    def functions_for(self, scenes: Iterable[Scene], progress: Progress | None = None) -> str | None:
        """Learn, from the light's rays in all of some scenes, functions of their basis that serve them all.

        Given as ``map.functions`` they are the same in all frames, which flicker less, and none has to learn.

        Parameters
        ----------
        scenes
            Frames, with all numbers of ``map`` given or left to ``"auto"``.
        progress
            As of `render`.

        Returns
        -------
        str or None
            For `MapSettings.functions`. None where nothing is learnt, or with a fit of which functions do not
            last.

        Raises
        ------
        DeviceError
            Memory or compilation, or the renderer is closed.
        """
        progress = checked_progress(progress) or _silent
        found: list[tuple[ResolvedMap, list[Curves]]] = []
        with self._in_turn():
            for scene in map(checked_scene, scenes):
                planned = self._planned(scene, progress)
                if planned.map is None or not (planned.map.learns and planned.map.lasts):
                    continue
                single = _single_lights(planned.scene)
                media = self._media.of(single, None)
                if media.fields.count:
                    found += self._maps.curves(single, media)
        return functions_for_all(found)

    def maps_of(
        self, scene: Scene, light: int, part: int = 0, progress: Progress | None = None
    ) -> list[TransmittanceMap]:
        """Return the maps that pictures of a scene have of one light; those of the last frames are there.

        Parameters
        ----------
        light
            Its number, from 0.
        part
            Of a light that is the sum of several, which of `Light.parts`.
        progress
            As of `render`.

        Returns
        -------
        list of TransmittanceMap
            One for each field, as of `build_maps`; none without grids or primitives.

        Raises
        ------
        SceneError
            No such light or part.
        DeviceError
            Memory or compilation, or the renderer is closed.
        """
        parts = [len(one.parts()) for one in checked_scene(scene).lights]
        if not (0 <= light < len(parts) and 0 <= part < parts[light]):
            raise SceneError(f"light {light}, part {part}: the scene's lights have {parts} parts, from 0")
        return self._light_pass(scene, [sum(parts[:light]) + part], progress, kept=True)

    def light_at(self, scene: Scene, points: ArrayLike, *, progress: Progress | None = None) -> LightAtPoints:
        """Look each light of a scene up at any points, through its map and past all solids.

        Parameters
        ----------
        scene
            Its bodies, lights and solids; what its camera and march are makes no difference.
        points
            World positions, shape (..., 3). Solids shade what has density and what is behind it; points in
            front of all density may be taken for lit.
        progress
            As of `render`.

        Returns
        -------
        LightAtPoints
            For each light, and last for what media emit where that lights others.

        Raises
        ------
        SceneError
            Points that are not finite triples, or two lights of one name.
        DeviceError
            Memory or compilation, or the renderer is closed.
        """
        scene, progress = checked_scene(scene), checked_progress(progress)
        world = np.asarray(points, dtype=np.float64)
        if world.shape[-1:] != (3,) or not np.isfinite(world).all():
            raise SceneError(f"points are finite positions of shape (..., 3); got the shape {world.shape}")
        with self._in_turn():
            return self._light_at(scene, world, progress or _silent)

    def tracer(self, scene: Scene) -> Tracer | None:
        """Return the solids of a scene, ready for rays; None without any.

        Raises
        ------
        SceneError
            A mesh file that cannot be used.
        DeviceError
            The renderer is closed.
        """
        with self._in_turn():
            scene.read_files()
            return self._visibility.tracer(scene)

    def _light_at(self, scene: Scene, world: NDArray[np.float64], progress: Progress) -> LightAtPoints:
        """As `light_at`, of points that are some."""
        names = names_of(scene.lights)
        scene = self._planned(scene, progress).scene
        groups = [number for number, light in enumerate(scene.lights) for _ in light.parts()]
        single = _single_lights(scene)
        if len(single.lights) > len(groups):
            groups += [len(names)] * (len(single.lights) - len(groups))
            names.append(EMISSION)
        frame = self._frame(single, None, (0, 0, 1, 1), RenderStats(self.device_name), progress)
        sums = frame.light_at(world.reshape(-1, 3), groups)
        found = np.zeros((2, len(names), *world.shape), np.float32)
        for number in range(len(names)):
            for of, values in zip(found, sums.of(number), strict=True):
                of[number] = values.reshape(world.shape)
        return LightAtPoints(tuple(names), *found)

    def _frame(
        self,
        scene: Scene,
        maps: Sequence[TransmittanceMap] | None,
        crop: Crop,
        stats: RenderStats,
        progress: Progress,
        antialiasing: Antialiasing = PLAIN,
    ) -> Frame:
        """Begin a frame of a scene whose lights are single."""
        media = self._media.of(scene, maps)
        return Frame(
            self._launcher,
            self._visibility,
            self._maps,
            scene,
            media,
            crop,
            stats,
            progress,
            self._cache,
            antialiasing,
        )

    def prepare(self, scene: Scene) -> bool:
        """Put the voxels of a scene that is rendered next on the device, while another thread renders.

        The rays of its lights are looked at there, too: the next frame of a sequence then begins with their
        maps. What cannot be, as it is too large to have
        beside those of other frames or fails, is left to `render`. Scenes are prepared one after the other,
        whatever threads ask.

        Returns
        -------
        bool
            Whether its voxels are there, and there is room for them beside those of another frame.
        """
        if scene.map.max_error is not None:
            return False
        with suppress(TfmError, MemoryError), self._preparing:
            if self._is_closed:
                return False
            scene.read_files()
            method = checked_method(None, scene)
            planned = plan(scene, method=method)
            prepared = _Prepared(scene, method, planned, _single_lights(planned.scene))
            is_there, media = self._media.prepare(self._beside, prepared.points)
            if media is not None and method == "tfm":
                self._maps.prepare(self._beside, prepared.points, media)
            keep_ahead(self._prepared, id(scene), prepared)
            return is_there
        return False

    def forget_unused(self) -> None:
        """Give back what the last two frames had no use for: of a sequence, they share little with others.

        A frame ends with each call.
        """
        with self._launcher.turn:
            self._cache.forget_unused()

    def cancel(self) -> None:
        """End what another thread is rendering.

        It raises `CancelledError` before its next launch, or between two parts of what the host does.
        """
        self._launcher.cancel()

    def render(
        self,
        scene: Scene,
        *,
        maps: Sequence[TransmittanceMap] | None = None,
        method: str | None = None,
        crop: Crop | None = None,
        aovs: Collection[str] = (),
        background: Any = 0.0,
        samples: int = 1,
        filter: str = "box",  # noqa: A002 - the key's name in scene files
        deep: float | None = None,
        deep_colour: bool = False,
        progress: Progress | None = None,
    ) -> RenderResult:
        """Render a scene.

        Parameters
        ----------
        scene
            What to render.
        maps
            From `build_maps`, of this scene or of one that differs only in camera, march, colours or
            phase function; built when left out.
        method
            ``tfm`` or ``dual`` instead of the scene's.
        crop
            Pixels x0, y0, x1, y1 (end excluded) to render; the whole frame when left out.
        aovs
            Layers that cost extra and are made only when named: ``lights`` (of each ``light.NAME``) and
            ``ambient``, which take memory, and ``map_error`` and ``lattice_error``, which take time.
        background
            RGB radiance behind media and solids, one number for grey, or ``"environment"``: see
            `RenderResult.over`.
        samples
            Of a pixel, at most: 1, 4, 16, 64 or 256. More than one are taken where neighbours differ, more
            than 4 where these differ.
        filter
            How pixels are made of them: ``box``, ``gaussian`` or ``blackman-harris``
            (`tfm_cl.scene.pixel_filters`).
        deep
            Tolerance of deep samples (`ImageSettings.deep_tolerance`), of one ray through each pixel's centre
            whatever ``samples``: `RenderResult.deep`. None: there are none.
        deep_colour
            Whether these have colours, which takes time.
        progress
            Called as ``progress(stage, fraction)``.

        Raises
        ------
        SceneError
            Unknown method, a crop outside the frame, maps of another scene, no colour as the background,
            ``"environment"`` where no light is one, no such samples or filter, layers of lights of one
            name or of more lights than there is room for, or colours of deep samples with octaves.
        DeviceError
            Memory or compilation, or the renderer is closed.
        CancelledError
            `cancel` was called meanwhile.

        Warns
        -----
        TfmWarning
            For each of the result's ``warnings``.
        """
        wanted = _checked(
            scene,
            maps=maps,
            method=method,
            crop=crop,
            aovs=aovs,
            background=background,
            samples=samples,
            filter=filter,
            deep=deep,
            deep_colour=deep_colour,
            progress=progress,
        )
        with self._in_turn():
            result = self._begin(wanted)()
        for line in result.warnings:
            warnings.warn(line, TfmWarning, stacklevel=2)
        return result

    def begin(self, scene: Scene, **asked: Any) -> Callable[[], RenderResult]:
        """Begin to render a scene: the device has its passes, and may not have ended them.

        Parameters
        ----------
        scene, **asked
            As of `render`.

        Returns
        -------
        What waits, and returns what `render` does; called once. Other scenes may be begun before, so that
        the device has work all the time; each takes memory until its result is asked for.

        Raises
        ------
        SceneError, DeviceError, CancelledError
            As of `render`, which what is returned raises too.
        """
        wanted = _checked(scene, **asked)
        with self._in_turn():
            end = self._begin(wanted)

        def result() -> RenderResult:
            with self._in_turn():
                found = end()
            for line in found.warnings:
                warnings.warn(line, TfmWarning, stacklevel=2)
            return found

        return result

    def render_blurred(
        self,
        scene: Scene | Callable[[float], Scene],
        shutter: tuple[float, float] = (-0.25, 0.25),
        *,
        motion_samples: int = MOTION_SAMPLES,
        method: str | None = None,
        crop: Crop | None = None,
        aovs: Collection[str] = (),
        background: Any = 0.0,
        samples: int = 1,
        filter: str = "box",  # noqa: A002 - the key's name in scene files
        progress: Progress | None = None,
    ) -> RenderResult:
        """Render the mean of sharp pictures over the time that a shutter is open.

        In each of them, what grids hold is moved by their velocities (`Volume.with_velocity`), as are points,
        curves and polygons that have some. What is the same as at the moment before is not made again; what
        is decided of maps and marches is decided once, for the middle.

        Parameters
        ----------
        scene
            A scene, in which only velocities move anything, or what returns that of any moment, given the
            frames that have passed: cameras, lights, solids and bodies may be elsewhere there.
        shutter
            When it opens and closes, in frames.
        motion_samples
            Moments between, evenly spread: the middles of as many equal parts.
        method, crop, aovs, background, samples, filter, progress
            As of `render`, of each picture.

        Returns
        -------
        RenderResult
            Layers are means too; but ``depth``, ``solid_distance`` and ``normal`` are those of the middle,
            which is one of an odd number of moments, and besides them of an even one; ``samples`` is the sum.
            ``scene`` is that of the middle.

        Raises
        ------
        SceneError
            As of `render`; a shutter or a number of moments out of range.
        VolumeError
            A velocity that cannot be read or used.
        DeviceError
            As of `render`.
        CancelledError
            `cancel` was called meanwhile.

        Warns
        -----
        TfmWarning
            For each of the result's ``warnings``, also where nothing moves.
        """
        moments, progress, aovs = checked_moment(scene), checked_progress(progress), checked_aovs(aovs)
        image = ImageSettings(background=background, samples=samples, filter=filter, aov=aovs)
        image = image.replace(shutter=shutter, motion_samples=motion_samples)
        with self._in_turn():
            result = self._blurred(moments, method, crop, aovs, image, progress or _silent)
        for line in result.warnings:
            warnings.warn(line, TfmWarning, stacklevel=2)
        return result

    def _blurred(
        self,
        scene: Scene | Callable[[float], Scene],
        method: str | None,
        crop: Crop | None,
        aovs: Collection[str],
        image: ImageSettings,
        progress: Progress,
    ) -> RenderResult:
        """Render the moments that an open shutter shows, and put them together."""
        mover = Mover(self._launcher, self._cache)
        moments = Moments(scene, image.shutter or (0.0, 0.0), image.motion_samples, mover.moved)
        middle = moments.middle
        if image.shows_environment:
            check_surrounded(middle.lights)
        asked = self._asked(middle, method, crop, None, progress)
        decided = asked.scene
        if asked.error is None:
            decided = plan(middle, method=checked_method(method, middle)).scene

        def render(moment: Scene, progress: Progress) -> RenderResult:
            result = self._begin_passes(
                moment.replace(map=decided.map, march=decided.march),
                maps=None,
                method=method,
                crop=crop,
                aovs=aovs,
                progress=progress,
                antialiasing=Antialiasing(image.samples, image.filter),
            )()
            return result.over(image.background) if image.has_background else result

        return self._told(moments.rendered(render, progress), asked)

    def _begin(self, wanted: _Wanted) -> Callable[[], RenderResult]:
        """Begin to render a scene as asked for; what is returned says what a user should know of it."""
        image = wanted.image
        asked = self._asked(wanted.scene, wanted.method, wanted.crop, wanted.maps, wanted.progress or _silent)
        end = self._begin_passes(
            asked.scene,
            maps=wanted.maps,
            method=wanted.method,
            crop=wanted.crop,
            aovs=image.aov,
            progress=wanted.progress,
            antialiasing=Antialiasing(image.samples, image.filter),
            deep=wanted.deep,
        )

        def result() -> RenderResult:
            found = end()
            return self._told(found.over(image.background) if image.has_background else found, asked)

        return result

    def _asked(
        self,
        scene: Scene,
        method: str | None,
        crop: Crop | None,
        maps: Sequence[TransmittanceMap] | None,
        progress: Progress,
    ) -> _Asked:
        """Read the files of a scene, and choose its numbers where an error is asked for."""
        scene.read_files()
        for_lattice = scene.map.lookup == "lattice" and checked_method(method, scene) == "tfm"
        if scene.map.max_error is None:
            return _Asked(scene, None, resolution.limited(scene), for_lattice)
        return _Asked(*self._chosen(scene, method, crop, maps, progress), (), for_lattice)

    def _told(self, result: RenderResult, asked: _Asked) -> RenderResult:
        """Return the result with all that a user should know."""
        result.stats.error_estimate = asked.error
        left_out = lattice.left_out(asked.scene) if asked.for_lattice else None
        result = replace(
            result, warnings=(*asked.limited, *result.warnings, *([left_out] if left_out else []))
        )
        if diagnosis.is_black(result.image):
            why = diagnosis.why_black(result, self._visibility)
            result = replace(result, warnings=(*result.warnings, why))
        elif why := diagnosis.why_unseen(result, self._visibility):
            result = replace(result, warnings=(*result.warnings, why))
        return result

    def _chosen(
        self,
        scene: Scene,
        method: str | None,
        crop: Crop | None,
        maps: Sequence[TransmittanceMap] | None,
        progress: Progress,
    ) -> tuple[Scene, float]:
        """Choose numbers for ``map.max_error``; returns the scene with them, and the error.

        The last choice is kept for the next frame of the same scene.
        """
        method, crop = checked_method(method, scene), checked_crop(crop, scene.camera.res)
        if maps and method == "tfm":
            built = maps[0].requested
            numbers: dict[str, Any] = {"res": built.res, "steps": built.steps, "coeffs": built.coeffs}
            if scene.map.lookup == "auto":
                numbers["lookup"] = built.lookup
            scene = scene.replace(map=scene.map.replace(**numbers))
        key = (scene, method, crop)
        kept, choice = self._choice or (None, None)
        if kept is None or choice is None or kept[0] is not scene or kept[1:] != key[1:]:

            def render(pilot: Scene, method: str, crop: Crop) -> RenderResult:
                of_pilot = maps if method == "tfm" else None
                return self._begin_passes(
                    pilot, maps=of_pilot, method=method, crop=crop, aovs=(), progress=None
                )()

            asked = with_lookup(scene) if method == "tfm" else scene
            choice = Chooser(render, asked, method, crop, progress).choice()
            self._choice = key, choice
        return choice.scene, choice.estimate

    def _begin_passes(
        self,
        scene: Scene,
        *,
        maps: Sequence[TransmittanceMap] | None,
        method: str | None,
        crop: Crop | None,
        aovs: Collection[str],
        progress: Progress | None,
        antialiasing: Antialiasing = PLAIN,
        deep: DeepSettings | None = None,
    ) -> Callable[[], RenderResult]:
        """Begin to render a scene, and ask nothing of the picture."""
        progress = progress or _silent
        method = checked_method(method, scene)
        maps = maps if method == "tfm" else None
        scene.read_files()
        spent = _Spent()
        with self._counted(spent):
            end = self._begin_frame(scene, maps, method, crop, aovs, progress, antialiasing, deep)

        def result() -> RenderResult:
            with self._counted(spent):
                found = end()
            stats = found.stats
            stats.made = dict(spent.made)
            host = max(spent.total - spent.device - spent.compiled - spent.traced, 0.0)
            stats.seconds |= {"compile": spent.compiled, "host": host, "total": spent.total}
            if scene.solids:
                stats.seconds["trace"] = spent.traced
            return found

        return result

    @contextmanager
    def _counted(self, spent: _Spent) -> Iterator[None]:
        """Add what is spent in here."""
        started, launched, traced = time.perf_counter(), self._launcher.seconds, self._visibility.seconds
        compiled, made = self._launcher.kernels.seconds, self._cache.made.copy()
        yield
        spent.device += self._launcher.seconds - launched
        spent.traced += self._visibility.seconds - traced
        spent.compiled += self._launcher.kernels.seconds - compiled
        spent.total += time.perf_counter() - started
        spent.made += self._cache.made - made

    def _begin_frame(
        self,
        scene: Scene,
        maps: Sequence[TransmittanceMap] | None,
        method: str,
        crop: Crop | None,
        aovs: Collection[str],
        progress: Progress,
        antialiasing: Antialiasing,
        deep: DeepSettings | None,
    ) -> Callable[[], RenderResult]:
        """As `_begin_passes`, without what it takes."""
        prepared = self._prepared.pop(id(scene), None)
        if maps or prepared is None or prepared.method != method:
            planned = plan(scene, method=method, maps=maps[0].requested if maps else None)
            points = _single_lights(planned.scene)
        else:
            planned, points = prepared.planned, prepared.points
        planned.log()
        scene = planned.scene
        crop = checked_crop(crop, scene.camera.res)
        stats = RenderStats(self.device_name)
        around = antialiasing.around(crop, scene.camera.res)
        frame = self._frame(points, maps, around, stats, progress, antialiasing)
        layers_of_lights = _layers_of_lights(scene, aovs)
        end = frame.begin(method, maps, aovs, crop, layers_of_lights, deep)
        return lambda: self._result(scene, points, crop, aovs, stats, *end())

    def _result(
        self,
        scene: Scene,
        points: Scene,
        crop: Crop,
        aovs: Collection[str],
        stats: RenderStats,
        sums: Sums,
        samples: DeepSamples | None,
        told: tuple[str, ...],
    ) -> RenderResult:
        """Make a picture of what the passes have summed; ``points``: the scene with single lights."""
        made_here = {
            "always": True,
            "solids": bool(scene.solids),
            "emission": scene.emits,
            "emission_light": bool(emission.numbers_of(points.lights)),
            "orders": orders_of(scene) > 1,
            "asked": False,
        }
        listed = [name for name, layer in LAYERS.items() if made_here[layer.made] or name in aovs]
        layers = Layers([*listed, *(name for name in GROUPS if name in aovs)], sums, members_of(scene, aovs))
        stats.samples["view_pass"] = int(sums.samples.sum(dtype=np.int64))
        told += take_notes()
        lit = any(row[:, 3].any() for row in diagnosis.rows_from_the_middle(sums.light_seen))
        notes = dict.fromkeys(note for grid in (*scene.grids, *scene.flames) for note in grid.notes)
        return RenderResult(
            sums.radiance,
            layers,
            stats,
            scene,
            crop,
            (*notes, *told),
            lit,
            _meets_medium(sums, emits=scene.emits),
            shows_through=sums.shows_through,
            deep=samples,
        )


def _checked(
    scene: Scene,
    *,
    maps: Sequence[TransmittanceMap] | None = None,
    method: str | None = None,
    crop: Crop | None = None,
    aovs: Collection[str] = (),
    background: Any = 0.0,
    samples: int = 1,
    filter: str = "box",  # noqa: A002 - as of `Renderer.render`
    deep: float | None = None,
    deep_colour: bool = False,
    progress: Progress | None = None,
) -> _Wanted:
    """Check what `Renderer.render` is asked for, before anything is rendered."""
    scene, maps, progress = checked_scene(scene), checked_maps(maps), checked_progress(progress)
    aovs = checked_aovs(aovs)
    image = ImageSettings(background=background, samples=samples, filter=filter, aov=aovs)
    deep_settings = None
    if deep is not None:
        of_deep = image.replace(deep_tolerance=deep, deep_colour=deep_colour)
        deep_settings = DeepSettings.of(scene, of_deep.deep_tolerance, colour=of_deep.deep_colour)
    if image.shows_environment:
        check_surrounded(scene.lights)
    return _Wanted(scene, maps, method, crop, image, deep_settings, progress)


def _meets_medium(sums: Sums, *, emits: bool) -> bool:
    """Tell whether any ray meets media; at once where the rays in the middle do."""
    rows = diagnosis.rows_from_the_middle(sums.transmittance)
    return any((row[:, :3] < 1).any() for row in rows) or (emits and bool(sums.emission[..., :3].any()))


def _layers_of_lights(scene: Scene, asked: Collection[str]) -> list[int] | None:
    """Return the number, from 1, of the layer of each single light; None where none are asked for.

    What media emit has a layer of its own.
    """
    if "lights" in asked:
        return [number for number, light in enumerate(scene.lights, 1) for _ in light.parts()]
    # One for all keeps the lights out of the ambient light's.
    apart = "ambient" in asked or ("orders" in asked and any(scene.ambient.radiance))
    return [1 for light in scene.lights for _ in light.parts()] if apart else None


def _single_lights(scene: Scene) -> Scene:
    """Return the scene with the lights, each with maps of its own, whose sum its lights are; fitted.

    Raises
    ------
    SceneError
        What float32 cannot place; light from infinity where a medium is everywhere.
    """
    check_distances(scene)
    if not np.isfinite(scene.bounds).all():
        for index, light in enumerate(scene.lights):
            if light.needs_fitting:
                raise SceneError(
                    f"light {index + 1} ({light.type}) comes from infinitely far away: nothing of it is left "
                    'in a medium that is everywhere; use volume.shape = "box" or "sphere", or a spot or point'
                )
    lights = list(chain.from_iterable(light.parts() for light in scene.lights))
    lights += emission.lights_of(scene)
    # Maps show where what is marched has density; what shadows solids cast is asked for in all media. Bodies
    # of constant density need neither, and may have thousands of lights.
    bounds = occupied = scene.occupied_bounds
    if scene.marched and not scene.solids:
        bounds = around([body.occupied_bounds for body in scene.marched])
    fits = bool(scene.solids or scene.marched)

    def placed(light: Light, box: NDArray[np.float64], inside: NDArray[np.float64]) -> Light:
        check_cancelled()
        return light.fitted(box, inside) if fits or light.needs_fitting else light

    def fitted(margin: float) -> Scene:
        box, inside = grown(bounds, margin), grown(occupied, margin)
        return scene.replace(lights=[placed(light, box, inside) for light in lights])

    found = fitted(0.0)
    margin = light_margin(found)
    return fitted(margin) if margin else found


def _silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
