"""The renderer: orders the passes on one device."""

from __future__ import annotations

import time
import weakref
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import chain
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device import params as parameters
from tfm_cl.device.bricks import build_bricks
from tfm_cl.device.device import choose_device
from tfm_cl.device.kernel_cache import take_notes
from tfm_cl.device.launch import Launcher, Progress
from tfm_cl.errors import SceneError
from tfm_cl.maps.light_pass import LightPass
from tfm_cl.maps.resolved import resolve
from tfm_cl.maps.transmittance_map import TransmittanceMap
from tfm_cl.plan import resolution
from tfm_cl.plan.accuracy import Choice, Chooser
from tfm_cl.plan.maps import Planned, Planner
from tfm_cl.render import coloured, diagnosis, fog
from tfm_cl.render.result import RenderResult, RenderStats
from tfm_cl.render.view_pass import Frame, FrameBuffers, LightInputs, ViewPass
from tfm_cl.render.visibility import OF_SOLIDS, GBuffer, Visibility, clip_of, nothing_seen
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.settings import SHADOW_FILTERS, MapSettings

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.bricks import BrickGrid, VoxelType
    from tfm_cl.scene.bodies.volume import Volume
    from tfm_cl.scene.bodies.volumes import Volumes
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

Crop = tuple[int, int, int, int]

SINGLE_NUMBER = {
    "target": "optical-depth",
    "fit": "l2",
    "coeffs": 1,
    "storage": "f32",
    "lookup": "interpolate",
}
"""What a map of residuals is looked up with."""
NO_MAP = resolve(MapSettings(basis="dct", coeffs=1))
"""What the dual march's kernel is compiled with: it reads no map."""

STEEPEST_DEPTH = 20.0
"""Optical depth over α beyond which few cosines cannot follow e^{-τ/α} (and at 87 float32 ends)."""
VISIBLE_DEPTH = 7.0
"""Optical depth beyond which light (less than 0.1 % of it) is not missed."""


class Renderer:
    """Compiles once, renders any number of scenes; a context manager.

    Parameters
    ----------
    device
        Part of an OpenCL device's or platform's name; by default PoCL, else the first device.
    build_options
        Further OpenCL compiler options.
    lanes
        Rays that a work-item carries, 1, 4, 8 or 16; by default what suits the device.
    largest_buffer
        Bytes that one device buffer may have; by default the device's limit.
    work_group
        Work-items (x, y) of a work-group in maps and images; None leaves it to the driver.

    Raises
    ------
    NoDeviceError
        No device, or none of that name.
    DeviceError
        Lanes that the device does not have.
    """

    def __init__(
        self,
        device: str | None = None,
        *,
        build_options: tuple[str, ...] = (),
        lanes: int | None = None,
        largest_buffer: int | None = None,
        work_group: tuple[int, int] | Literal["auto"] | None = "auto",
    ) -> None:
        self._launcher = Launcher(
            choose_device(device),
            build_options,
            lanes=lanes,
            largest_buffer=largest_buffer,
            work_group=work_group,
        )
        self._light_pass = LightPass(self._launcher)
        self._planner = Planner(self._launcher)
        self._view_pass = ViewPass(self._launcher)
        self._visibility = Visibility()
        self._choice: tuple[tuple[Scene, str, Crop], Choice] | None = None
        self._grids: weakref.WeakKeyDictionary[Volume | Volumes, dict[VoxelType, BrickGrid]] = (
            weakref.WeakKeyDictionary()
        )

    @property
    def device_name(self) -> str:
        """Name of the OpenCL device."""
        return str(self._launcher.device.name).strip()

    @property
    def lanes(self) -> int:
        """Rays that a work-item carries."""
        return self._launcher.lanes

    def close(self) -> None:
        """Release the device's memory."""
        self._grids.clear()
        self._choice = None
        self._visibility.clear()
        self._launcher.release()

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
            until volume, light geometry or map settings change. For a coloured volume three in the place of
            each, for red, green and blue.

        Raises
        ------
        DeviceError
            Memory or compilation.
        """
        scene.read_files()
        progress = progress or _silent
        if scene.map.max_error is not None:
            scene, _ = self._chosen(scene, "tfm", None, None, progress)
        if scene.volume.colour is not None:
            return coloured.build_maps(self, scene, progress)
        scene = self._parts(resolution.resolved(scene))
        bricks = self._upload(scene)
        return [
            self._build(scene, light, plan, bricks, progress)
            for light, plan in zip(scene.lights, self._plans(scene, bricks), strict=True)
        ]

    def _parts(self, scene: Scene) -> Scene:
        """Return the scene with the lights, each with a map of its own, whose sum its lights are."""
        parameters.check_distances(scene)
        if isinstance(scene.volume, Homogeneous):
            fog.check(scene)
        scene = scene.replace(lights=tuple(chain.from_iterable(light.parts() for light in scene.lights)))
        # Without solids fog has no maps at all, and may have thousands of lights.
        fits = bool(scene.solids) or not isinstance(scene.volume, Homogeneous)
        bounds = scene.volume.occupied_bounds
        fitted = (light.fitted(bounds) if fits or light.needs_fitting else light for light in scene.lights)
        return scene.replace(lights=tuple(fitted))

    def _plans(self, scene: Scene, bricks: BrickGrid) -> list[Planned]:
        """Plan the maps of a scene of single lights."""

        def clip(light: Light, size: int) -> NDArray[np.float32] | None:
            distances = self._visibility.distances(scene, light)
            return None if distances is None else clip_of(distances, size)

        return self._planner.plans(scene, bricks, clip)

    def _build(
        self, scene: Scene, light: Light, plan: Planned, bricks: BrickGrid, progress: Progress
    ) -> TransmittanceMap:
        params = self._params(scene, light, (0, 0, 1, 1), bricks, plan)
        buffers = self._light_pass.build(plan, light, params, bricks, progress)
        return TransmittanceMap(
            light=light,
            settings=plan.settings,
            requested=scene.map,
            volume=_grids(scene),
            solids=scene.solids,
            shadow_res=scene.shadow.res,
            density_weighting=plan.density_weighting,
            largest_optical_depth=plan.deepest,
            extinction=plan.extinction,
            number_unit=plan.number_unit,
            functions=plan.functions,
            field=plan.field,
            buffers=replace(buffers, seconds=buffers.seconds + plan.seconds),
            params=params,
            bricks=bricks,
            light_pass=self._light_pass,
        )

    def render(
        self,
        scene: Scene,
        *,
        maps: list[TransmittanceMap] | None = None,
        method: str | None = None,
        crop: Crop | None = None,
        aovs: Collection[str] = (),
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
            Layers that cost extra and are made only when named: ``map_error``.
        progress
            Called as ``progress(stage, fraction)``.

        Raises
        ------
        SceneError
            Unknown method, a crop outside the frame, or maps of another scene.
        DeviceError
            Memory or compilation.
        """
        scene.read_files()
        estimate, limited = None, resolution.limited(scene)
        if scene.map.max_error is not None:
            scene, estimate = self._chosen(scene, method, crop, maps, progress or _silent)
            limited = ()
        result = self._render(scene, maps=maps, method=method, crop=crop, aovs=aovs, progress=progress)
        result.stats.error_estimate = estimate
        result = replace(result, warnings=(*limited, *result.warnings))
        if diagnosis.is_black(result.image):
            why = diagnosis.why_black(result, self._visibility)
            result = replace(result, warnings=(*result.warnings, why))
        return result

    def _chosen(
        self,
        scene: Scene,
        method: str | None,
        crop: Crop | None,
        maps: list[TransmittanceMap] | None,
        progress: Progress,
    ) -> tuple[Scene, float]:
        """Choose numbers for ``map.max_error``; returns the scene with them, and the error.

        The last choice is kept for the next frame of the same scene.
        """
        method, crop = _checked_method(method, scene), _checked_crop(crop, scene.camera.res)
        if maps and method == "tfm":
            built = maps[0].requested
            numbers = {"res": built.res, "steps": built.steps, "coeffs": built.coeffs}
            scene = scene.replace(map=scene.map.replace(**numbers))
        key = (scene, method, crop)
        kept, choice = self._choice or (None, None)
        if kept is None or choice is None or kept[0] is not scene or kept[1:] != key[1:]:

            def render(pilot: Scene, method: str, crop: Crop) -> RenderResult:
                of_pilot = maps if method == "tfm" else None
                return self._render(pilot, maps=of_pilot, method=method, crop=crop, aovs=(), progress=None)

            choice = Chooser(render, scene, method, crop, progress).choice()
            self._choice = key, choice
        return choice.scene, choice.estimate

    def _render(
        self,
        scene: Scene,
        *,
        maps: list[TransmittanceMap] | None,
        method: str | None,
        crop: Crop | None,
        aovs: Collection[str],
        progress: Progress | None,
    ) -> RenderResult:
        """Render a scene, and ask nothing of the picture."""
        if scene.volume.colour is not None:
            return coloured.render(
                self._render, scene, maps=maps, method=method, crop=crop, aovs=aovs, progress=progress
            )
        progress = progress or _silent
        method = _checked_method(method, scene)
        scene = resolution.resolved(scene, maps[0].requested if maps and method == "tfm" else None)
        crop = _checked_crop(crop, scene.camera.res)
        stats = RenderStats(self.device_name)
        compiled, started = self._launcher.kernels.seconds, time.perf_counter()
        traced = self._visibility.seconds

        points = self._parts(scene)
        gbuffer = self._visibility.gbuffer(points, crop)
        frame = self._view_pass.allocate(crop, gbuffer)
        errors = self._view_pass.allocate(crop, gbuffer) if "map_error" in aovs else None
        warnings: tuple[str, ...] = ()
        if isinstance(points.volume, Homogeneous):
            of_renderer = self._launcher, self._view_pass, self._visibility
            fog.add_lights(*of_renderer, points, crop, gbuffer, frame, stats, progress)
        else:
            warnings = self._add_lights(points, method, maps, crop, gbuffer, frame, errors, stats, progress)
        seen = self._view_pass.read(frame)
        image, layers = _resolve(seen, gbuffer)
        if errors is not None:
            error = _resolve(self._view_pass.read(errors), gbuffer)[1]["light_transmittance"]
            layers["map_error"] = error.mean(axis=-1)
        if gbuffer is not None:
            layers |= gbuffer.layers()
            stats.seconds["trace"] = self._visibility.seconds - traced
        elif of_solids := OF_SOLIDS.intersection(aovs):
            layers |= nothing_seen(crop, of_solids)

        stats.seconds |= {
            "compile": self._launcher.kernels.seconds - compiled,
            "total": time.perf_counter() - started,
        }
        stats.samples["view_pass"] = int(layers["samples"].sum(dtype=np.float64))
        warnings += take_notes()
        lit = any(row[:, 3].any() for row in seen.light_seen)
        notes = dict.fromkeys(note for volume in scene.volume.parts for note in volume.notes)
        return RenderResult(image, layers, stats, scene, crop, (*notes, *warnings), lit)

    def _add_lights(
        self,
        scene: Scene,
        method: str,
        maps: list[TransmittanceMap] | None,
        crop: Crop,
        gbuffer: GBuffer | None,
        frame: FrameBuffers,
        errors: FrameBuffers | None,
        stats: RenderStats,
        progress: Progress,
    ) -> tuple[str, ...]:
        """Sum all that a scene of single lights sends to the camera; returns warnings."""
        bricks = self._upload(scene)
        plans: Sequence[Planned | TransmittanceMap | None] = [None] * len(scene.lights)
        if method == "tfm" and maps is None:
            plans = self._plans(scene, bricks)
        elif method == "tfm" and maps is not None:
            _check_maps(scene, maps)
            plans = maps
        warnings: tuple[str, ...] = ()
        # A map at a time: those of an area light's points need not be there together.
        for index, (light, plan) in enumerate(zip(scene.lights, plans, strict=True)):
            light_map = (
                plan if not isinstance(plan, Planned) else self._build(scene, light, plan, bricks, progress)
            )
            if light_map is not None:
                stats.add_map(light_map, built=maps is None)
                warnings = warnings or _warnings(scene, light_map)
            stats.seconds["view_pass"] += self._add_light(
                scene, index, crop, bricks, light_map, gbuffer, frame, progress
            )
            if errors is not None and light_map is not None:
                self._add_residual(scene, index, crop, bricks, light_map, errors, progress)
        if any(scene.ambient.radiance):
            params = self._params(scene, scene.lights[0], crop, bricks, None)
            stats.seconds["view_pass"] += self._view_pass.add_ambient(scene, params, frame)
        return warnings

    def _upload(self, scene: Scene) -> BrickGrid:
        """Put the volume on the device, once for each volume and voxel type."""
        volume, voxels = _grids(scene), scene.march.voxels
        grids = self._grids.setdefault(volume, {})
        if voxels not in grids:
            what = "the volume ({})".format(
                ", ".join("{2}×{1}×{0} voxels".format(*part.shape) for part in volume.parts)
            )
            leaves = [part.leaves for part in volume.parts]
            grids[voxels] = build_bricks(self._launcher, leaves, what, voxels)
        return grids[voxels]

    def _params(
        self,
        scene: Scene,
        light: Light,
        crop: Crop,
        bricks: BrickGrid,
        plan: Planned | TransmittanceMap | None,
    ) -> cl.Buffer:
        struct = parameters.fill(
            scene,
            light,
            crop=crop,
            density_weighting=1.0 if plan is None else plan.density_weighting,
            bricks=bricks,
            field=None if plan is None else plan.field,
            number_unit=1.0 if plan is None else plan.number_unit,
            texture_size=(1, 1) if (image := light.texture_image()) is None else image.shape[1::-1],
        )
        return self._launcher.upload("the parameters", struct)

    def _inputs(self, scene: Scene, light: Light, light_map: TransmittanceMap | None) -> LightInputs:
        """Put on the device what the kernels that shade by a light read."""
        distances = self._visibility.distances(scene, light)
        image = light.texture_image()
        one = np.zeros(1, np.float32)
        texture = np.zeros((1, 1, 4), np.float32)
        if image is not None:
            texture = np.dstack([image, np.zeros(image.shape[:2], np.float32)])
        return LightInputs(
            settings=NO_MAP if light_map is None else light_map.settings,
            map=None if light_map is None else light_map.buffers,
            shadow=self._launcher.upload("the shadow map", one if distances is None else distances),
            texture=self._launcher.upload("the light's texture", texture),
            shadow_filter=0 if distances is None else SHADOW_FILTERS[scene.shadow.filter],
            is_textured=image is not None,
        )

    def _add_light(
        self,
        scene: Scene,
        index: int,
        crop: Crop,
        bricks: BrickGrid,
        light_map: TransmittanceMap | None,
        gbuffer: GBuffer | None,
        frame: FrameBuffers,
        progress: Progress,
    ) -> float:
        """Add one light to the frame, from its map or by the dual march; returns device seconds."""
        light = scene.lights[index]
        params = self._params(scene, light, crop, bricks, light_map)
        inputs = self._inputs(scene, light, light_map)
        seconds = self._view_pass.add_light(scene, index, crop, params, bricks, inputs, frame, progress)
        if gbuffer is not None:
            visible = self._visibility.lit(scene, light, gbuffer)
            seconds += self._view_pass.add_solids(
                scene, index, crop, params, bricks, inputs, visible, frame, progress
            )
        return seconds

    def _add_residual(
        self,
        scene: Scene,
        index: int,
        crop: Crop,
        bricks: BrickGrid,
        light_map: TransmittanceMap,
        frame: FrameBuffers,
        progress: Progress,
    ) -> None:
        """Add a map's residuals to a frame, in the place of the light's transmittance."""
        residual = np.append(light_map.residual, np.float32(0))  # two neighbours may be read at once
        buffers = replace(light_map.buffers, coefficients=self._launcher.upload("the residuals", residual))
        settings = light_map.settings.model_copy(update=SINGLE_NUMBER)
        light = scene.lights[index]
        params = self._params(scene, light, crop, bricks, light_map)
        inputs = replace(self._inputs(scene, light, light_map), settings=settings, map=buffers)
        self._view_pass.add_light(
            scene, index, crop, params, bricks, inputs, frame, progress, shows_residual=True
        )


def _grids(scene: Scene) -> Volume | Volumes:
    if isinstance(scene.volume, Homogeneous):
        raise SceneError("a homogeneous volume has no map: its transmittance is known in closed form")
    return scene.volume


def _check_maps(scene: Scene, maps: list[TransmittanceMap]) -> None:
    if len(maps) != len(scene.lights):
        raise SceneError(
            f"{len(maps)} maps for {len(scene.lights)} lights (points of area lights count); "
            "build the maps again"
        )
    for index, light_map in enumerate(maps):
        light_map.check_serves(scene, index)


def _warnings(scene: Scene, light_map: TransmittanceMap) -> tuple[str, ...]:
    """Tell where the map cannot hold a transmittance that is still visible: α is small for the units."""
    sigma_t = scene.medium.sigma_t
    if sigma_t.max() <= 0 or light_map.settings.target != "transmittance":
        return ()
    alpha, deepest = light_map.density_weighting, light_map.largest_optical_depth
    lost = STEEPEST_DEPTH * alpha
    if deepest <= lost or sigma_t[sigma_t > 0].min() * lost >= VISIBLE_DEPTH:
        return ()
    message = (
        f"density_weighting = {alpha:g} cannot carry an optical depth of {deepest:.0f} of the density: with "
        "such small sigma_s and sigma_a shadows will be too dark; use --density-weighting auto"
    )
    return (message,)


def _checked_method(method: str | None, scene: Scene) -> str:
    method = method or scene.march.method
    if method not in ("tfm", "dual"):
        raise SceneError(f"method '{method}' is unknown; known: tfm, dual")
    return method


def _checked_crop(crop: Crop | None, res: tuple[int, int]) -> Crop:
    width, height = res
    if crop is None:
        return 0, 0, width, height
    x0, y0, x1, y1 = crop
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise SceneError(
            f"crop {x0},{y0},{x1},{y1} does not lie in the image of {width}×{height}; "
            "it is x0,y0,x1,y1 in pixels, end excluded"
        )
    return x0, y0, x1, y1


def _resolve(
    frame: Frame, gbuffer: GBuffer | None
) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]]]:
    """Turn what the passes summed into the picture and its layers."""
    image = frame.radiance.copy()
    image[..., 3] = 1.0 - frame.transmittance[..., :3].mean(axis=-1)
    if gbuffer is not None:
        image[gbuffer.shown, 3] = 1.0
    seen, opacity = frame.light_seen[..., :3], frame.light_seen[..., 3:]
    return image, {
        "depth": frame.transmittance[..., 3].copy(),
        "transmittance": frame.transmittance[..., :3].copy(),
        "light_transmittance": np.divide(seen, opacity, out=np.zeros_like(seen), where=opacity > 0),
        "samples": frame.samples.astype(np.float32),
    }


def _silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
