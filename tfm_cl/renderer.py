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

from tfm_cl import coloured
from tfm_cl import params as parameters
from tfm_cl.bricks import build_bricks
from tfm_cl.device import choose_device
from tfm_cl.errors import SceneError
from tfm_cl.lights.area import spread
from tfm_cl.passes.launch import Launcher, Progress
from tfm_cl.passes.light_pass import LightPass
from tfm_cl.passes.planner import Planned, Planner
from tfm_cl.passes.view_pass import Frame, FrameBuffers, ViewPass
from tfm_cl.result import RenderResult, RenderStats
from tfm_cl.settings import MapSettings
from tfm_cl.transmittance_map import TransmittanceMap

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.bricks import BrickGrid, VoxelType
    from tfm_cl.lights import Light
    from tfm_cl.scene import Scene
    from tfm_cl.volume import Volume

Crop = tuple[int, int, int, int]

SINGLE_NUMBER = {
    "target": "optical-depth",
    "fit": "l2",
    "coeffs": 1,
    "storage": "f32",
    "lookup": "interpolate",
}
"""What a map of residuals is looked up with."""
NO_MAP = MapSettings(basis="dct", coeffs=1).resolved()
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
        Rays that a work-item carries, 1, 8 or 16; by default what suits the device.
    largest_buffer
        Bytes that one device buffer may have; by default the device's limit.
    work_group
        Work-items (x, y) of a work-group in maps and images; None leaves it to the driver.

    Raises
    ------
    NoDeviceError
        No device, or none of that name.
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
        self._grids: weakref.WeakKeyDictionary[Volume, dict[VoxelType, BrickGrid]] = (
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
        if scene.volume.colour is not None:
            return coloured.build_maps(self, scene, progress)
        progress = progress or _silent
        scene = _spread(scene.resolved())
        bricks = self._upload(scene)
        return [
            self._build(scene, light, plan, bricks, progress)
            for light, plan in zip(scene.lights, self._planner.plans(scene, bricks), strict=True)
        ]

    def _build(
        self, scene: Scene, light: Light, plan: Planned, bricks: BrickGrid, progress: Progress
    ) -> TransmittanceMap:
        params = self._params(scene, light, (0, 0, 1, 1), bricks, plan)
        buffers = self._light_pass.build(plan, light, params, bricks, progress)
        return TransmittanceMap(
            light=light,
            settings=plan.settings,
            requested=scene.map,
            volume=scene.volume,
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
        if scene.volume.colour is not None:
            return coloured.render(
                self, scene, maps=maps, method=method, crop=crop, aovs=aovs, progress=progress
            )
        progress = progress or _silent
        method = method or scene.march.method
        if method not in ("tfm", "dual"):
            raise SceneError(f"method '{method}' is unknown; known: tfm, dual")
        scene = scene.resolved(maps[0].requested if maps and method == "tfm" else None)
        crop = _checked_crop(crop, scene.camera.res)
        stats = RenderStats(self.device_name)
        compiled, started = self._launcher.kernels.seconds, time.perf_counter()

        points = _spread(scene)
        bricks = self._upload(points)
        plans: Sequence[Planned | TransmittanceMap | None] = [None] * len(points.lights)
        if method == "tfm" and maps is None:
            plans = self._planner.plans(points, bricks)
        elif method == "tfm" and maps is not None:
            _check_maps(points, maps)
            plans = maps
        frame = self._view_pass.allocate(crop)
        errors = self._view_pass.allocate(crop) if "map_error" in aovs else None
        seconds = {"light_pass": 0.0, "view_pass": 0.0}
        stats.samples = {"light_pass": 0}
        warnings: tuple[str, ...] = ()
        # A map at a time: those of an area light's points need not be there together.
        for index, (light, plan) in enumerate(zip(points.lights, plans, strict=True)):
            light_map = (
                plan if not isinstance(plan, Planned) else self._build(points, light, plan, bricks, progress)
            )
            if light_map is not None:
                if maps is None:
                    seconds["light_pass"] += light_map.buffers.seconds
                stats.samples["light_pass"] += light_map.buffers.samples
                stats.map_bytes += light_map.nbytes
                stats.map = light_map.settings
                warnings = warnings or _warnings(points, light_map)
            seconds["view_pass"] += self._add_light(points, index, crop, bricks, light_map, frame, progress)
            if errors is not None and light_map is not None:
                self._add_residual(points, index, crop, bricks, light_map, errors, progress)
        image, layers = _resolve(self._view_pass.read(frame))
        if errors is not None:
            layers["map_error"] = _resolve(self._view_pass.read(errors))[1]["light_transmittance"].mean(
                axis=-1
            )

        stats.seconds = {
            "compile": self._launcher.kernels.seconds - compiled,
            **seconds,
            "total": time.perf_counter() - started,
        }
        stats.samples["view_pass"] = int(layers["samples"].sum(dtype=np.float64))
        return RenderResult(image, layers, stats, scene, crop, warnings)

    def _upload(self, scene: Scene) -> BrickGrid:
        """Put the volume on the device, once for each volume and voxel type."""
        volume, voxels = scene.volume, scene.march.voxels
        grids = self._grids.setdefault(volume, {})
        if voxels not in grids:
            z, y, x = volume.shape
            what = f"the volume ({x}×{y}×{z} voxels)"
            grids[voxels] = build_bricks(self._launcher, volume.leaves, what, voxels)
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
        )
        return self._launcher.upload("the parameters", struct)

    def _add_light(
        self,
        scene: Scene,
        index: int,
        crop: Crop,
        bricks: BrickGrid,
        light_map: TransmittanceMap | None,
        frame: FrameBuffers,
        progress: Progress,
    ) -> float:
        """Add one light to the frame, from its map or by the dual march; returns device seconds."""
        return self._view_pass.add_light(
            scene,
            index,
            crop,
            self._params(scene, scene.lights[index], crop, bricks, light_map),
            bricks,
            NO_MAP if light_map is None else light_map.settings,
            None if light_map is None else light_map.buffers,
            frame,
            progress,
        )

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
        params = self._params(scene, scene.lights[index], crop, bricks, light_map)
        self._view_pass.add_light(
            scene, index, crop, params, bricks, settings, buffers, frame, progress, shows_residual=True
        )


def _spread(scene: Scene) -> Scene:
    """Return the scene with the points of its area lights for lights."""
    return scene.replace(lights=tuple(chain.from_iterable(map(spread, scene.lights))))


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


def _resolve(frame: Frame) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]]]:
    """Turn what the passes summed into the picture and its layers."""
    image = frame.radiance.copy()
    image[..., 3] = 1.0 - frame.transmittance[..., :3].mean(axis=-1)
    seen, opacity = frame.light_seen[..., :3], frame.light_seen[..., 3:]
    return image, {
        "depth": frame.transmittance[..., 3].copy(),
        "transmittance": frame.transmittance[..., :3].copy(),
        "light_transmittance": np.divide(seen, opacity, out=np.zeros_like(seen), where=opacity > 0),
        "samples": frame.samples.astype(np.float32),
    }


def _silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
