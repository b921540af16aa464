"""The renderer: orders the passes on one device."""

from __future__ import annotations

import time
import weakref
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl import params as parameters
from tfm_cl.bricks import build_bricks
from tfm_cl.device import choose_device
from tfm_cl.errors import SceneError
from tfm_cl.passes.launch import Launcher, Progress
from tfm_cl.passes.light_pass import LightPass
from tfm_cl.passes.view_pass import Frame, ViewPass
from tfm_cl.result import RenderResult, RenderStats
from tfm_cl.transmittance_map import TransmittanceMap

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.bricks import BrickGrid, VoxelType
    from tfm_cl.lights import Light
    from tfm_cl.scene import Scene
    from tfm_cl.volume import Volume

Crop = tuple[int, int, int, int]

AUTO_WEIGHTING = (1.0, 16.0)
"""Range of α times the extinction that density_weighting = auto chooses from."""

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
            One for each light, in order; they serve until volume, light geometry or map settings change.

        Raises
        ------
        DeviceError
            Memory or compilation.
        """
        progress = progress or _silent
        scene = scene.resolved()
        bricks = self._upload(scene)
        deepest = max(self._largest_optical_depth(scene, light, bricks) for light in scene.lights)
        weighting = _density_weighting(scene, deepest)
        maps = []
        for light in scene.lights:
            params = self._params(scene, light, (0, 0, 1, 1), weighting, bricks)
            buffers = self._light_pass.build(scene.map, light, params, bricks, progress)
            maps.append(
                TransmittanceMap(
                    light=light,
                    settings=scene.map,
                    volume=scene.volume,
                    density_weighting=weighting,
                    largest_optical_depth=deepest,
                    buffers=buffers,
                    params=params,
                    bricks=bricks,
                    light_pass=self._light_pass,
                )
            )
        return maps

    def render(
        self,
        scene: Scene,
        *,
        maps: list[TransmittanceMap] | None = None,
        method: str | None = None,
        crop: Crop | None = None,
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
        progress
            Called as ``progress(stage, fraction)``.

        Raises
        ------
        SceneError
            Unknown method, a crop outside the frame, or maps of another scene.
        DeviceError
            Memory or compilation.
        """
        progress = progress or _silent
        method = method or scene.march.method
        if method not in ("tfm", "dual"):
            raise SceneError(f"method '{method}' is unknown; known: tfm, dual")
        scene = scene.resolved(maps[0].settings if maps and method == "tfm" else None)
        crop = _checked_crop(crop, scene.camera.res)
        stats = RenderStats(self.device_name)
        compiled, started = self._launcher.kernels.seconds, time.perf_counter()

        bricks = self._upload(scene)
        if method == "dual":
            maps = None
        elif maps is None:
            maps = self.build_maps(scene, progress)
            stats.seconds["light_pass"] = sum(light_map.buffers.seconds for light_map in maps)
        else:
            _check_maps(scene, maps)
        warnings = _warnings(scene, maps)

        frame = self._view_pass.allocate(crop)
        view_seconds = 0.0
        for index, light in enumerate(scene.lights):
            weighting = maps[index].density_weighting if maps else 1.0
            params = self._params(scene, light, crop, weighting, bricks)
            view_seconds += self._view_pass.add_light(
                scene,
                index,
                method,
                crop,
                params,
                bricks,
                maps[index].buffers if maps else None,
                frame,
                progress,
            )
        image, aovs = _resolve(self._view_pass.read(frame))

        stats.seconds = {
            "compile": self._launcher.kernels.seconds - compiled,
            "light_pass": stats.seconds.get("light_pass", 0.0),
            "view_pass": view_seconds,
            "total": time.perf_counter() - started,
        }
        stats.samples = {
            "light_pass": sum(light_map.buffers.samples for light_map in maps or ()),
            "view_pass": int(aovs["samples"].sum(dtype=np.float64)),
        }
        stats.map_bytes = sum(light_map.nbytes for light_map in maps or ())
        stats.density_weighting = maps[0].density_weighting if maps else None
        return RenderResult(image, aovs, stats, scene, crop, warnings)

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
        self, scene: Scene, light: Light, crop: Crop, density_weighting: float, bricks: BrickGrid
    ) -> cl.Buffer:
        struct = parameters.fill(scene, light, crop=crop, density_weighting=density_weighting, bricks=bricks)
        return self._launcher.upload("the parameters", struct)

    def _largest_optical_depth(self, scene: Scene, light: Light, bricks: BrickGrid) -> float:
        params = self._params(scene, light, (0, 0, 1, 1), 1.0, bricks)
        return self._light_pass.largest_optical_depth(scene.map, light, params, bricks)


def _density_weighting(scene: Scene, deepest: float) -> float:
    """α of eq. 19: the scene's, or half the largest optical depth that its lights meet.

    The range is that of the most extinguished colour's optical depth; α itself weights the density.
    """
    setting = scene.map.density_weighting
    if setting != "auto":
        return setting
    sigma_t = float(scene.medium.sigma_t.max())
    if sigma_t <= 0:
        return 1.0
    return max(1.0, float(np.clip(sigma_t * deepest / 2, *AUTO_WEIGHTING)) / sigma_t)


def _check_maps(scene: Scene, maps: list[TransmittanceMap]) -> None:
    if len(maps) != len(scene.lights):
        raise SceneError(f"{len(maps)} maps for {len(scene.lights)} lights; build the maps again")
    for index, light_map in enumerate(maps):
        light_map.check_serves(scene, index)


def _warnings(scene: Scene, maps: list[TransmittanceMap] | None) -> tuple[str, ...]:
    """Tell where the map cannot hold a transmittance that is still visible: α is small for the units."""
    sigma_t = scene.medium.sigma_t
    if not maps or sigma_t.max() <= 0:
        return ()
    alpha, deepest = maps[0].density_weighting, maps[0].largest_optical_depth
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
