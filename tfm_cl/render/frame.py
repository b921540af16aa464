"""One frame: the camera, then for each batch of lights maps, what media scatter, and what solids reflect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.light import light_structs
from tfm_cl.device.structs.view import view_struct
from tfm_cl.maps.resolved import resolve
from tfm_cl.model import decided
from tfm_cl.render import buffers
from tfm_cl.render.batches import Batches
from tfm_cl.render.camera import see
from tfm_cl.render.culling import bounds_of_lights
from tfm_cl.render.scatter import scatter
from tfm_cl.render.surface import reflect
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.buffers import Sums
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.maps import MapBuilder
    from tfm_cl.render.result import RenderStats
    from tfm_cl.render.visibility import Visibility
    from tfm_cl.scene.scene import Scene

STEEPEST_DEPTH = 20.0
"""Optical depth over α beyond which few cosines cannot follow e^{-τ/α} (and at 87 float32 ends)."""
VISIBLE_DEPTH = 7.0
"""Optical depth beyond which light (less than 0.1 % of it) is not missed."""


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
    """

    launcher: Launcher
    visibility: Visibility
    maps: MapBuilder
    scene: Scene
    media: MediaOnDevice
    crop: Rectangle
    stats: RenderStats
    progress: Progress

    def render(
        self, method: str, maps: Sequence[TransmittanceMap] | None, *, with_errors: bool
    ) -> tuple[Sums, tuple[str, ...]]:
        """Sum all that the scene sends to the camera.

        Parameters
        ----------
        method
            ``tfm`` or ``dual``.
        maps
            From an earlier light pass; None where they are built.
        with_errors
            Whether to sum the maps' errors too.

        Returns
        -------
        The sums, and warnings.
        """
        launcher, scene, crop, stats = self.launcher, self.scene, self.crop, self.stats
        gbuffer = self.visibility.gbuffer(scene, crop)
        frame = buffers.allocate(launcher, crop, gbuffer)
        errors = buffers.allocate(launcher, crop, gbuffer) if with_errors else None
        view = launcher.upload("the view", view_struct(scene, self.media.fields, crop))
        fields = self.media.fields.count
        reads_maps = method == "tfm" and fields > 0
        is_dual = method == "dual" and fields > 0
        reads_given = method == "tfm" and maps is not None
        sources = self.maps.sources(scene, self.media, maps) if reads_maps or reads_given else None
        batches = Batches(
            launcher,
            scene,
            self.media,
            self.visibility,
            gbuffer,
            light_structs(scene, scene.lights),
            self._touched(gbuffer),
            crop,
            resolve(scene.map) if reads_maps else None,
            is_dual=is_dual,
        )
        steps, light_steps = decided(scene.march.steps), decided(scene.map.steps) if is_dual else 1
        seconds, camera_is_seen, warnings = 0.0, False, dict[str, None]()
        for variant, members in batches.groups():
            for indices in batches.cut(members):
                of_batch = self.maps.of(sources, indices, self.progress) if sources and reads_maps else []
                built = self.maps.built if maps is None else frozenset[int]()
                for light_map in of_batch:
                    stats.add_map(light_map, built=id(light_map) in built)
                    warnings |= dict.fromkeys(_warnings(light_map))
                batch = batches.batch(variant, indices, of_batch, whole=not camera_is_seen)
                stage = f"view pass, {batch.name}"
                done = _reporter(self.progress, stage)
                seconds += scatter(
                    launcher,
                    self.media,
                    view,
                    batch,
                    steps * light_steps,
                    frame,
                    done,
                    sees_camera=not camera_is_seen,
                )
                camera_is_seen = True
                if gbuffer is not None:
                    seconds += reflect(launcher, self.media, view, batch, light_steps, frame, done)
                if errors is not None and of_batch:
                    residuals = batches.residuals(batch, of_batch)
                    scatter(launcher, self.media, view, residuals, steps, errors, done)
        if not camera_is_seen:
            seconds += self._see(view, frame, has_solids=gbuffer is not None)
        stats.seconds["view_pass"] += seconds
        return buffers.read(launcher, frame, gbuffer, errors), (*warnings,)

    def _see(self, view: object, frame: buffers.FrameBuffers, *, has_solids: bool) -> float:
        steps = decided(self.scene.march.steps)
        return see(self.launcher, self.media, view, self.crop, steps, frame, has_solids=has_solids)

    def _touched(self, gbuffer: GBuffer | None) -> NDArray[np.int64]:
        """Pixels of the crop that each light may change, [lights, 4]."""
        scene, crop = self.scene, self.crop
        bounds = scene.occupied_bounds
        if gbuffer is not None and len(gbuffer.points):
            points = gbuffer.points
            bounds = around([bounds, np.stack([points.min(axis=0), points.max(axis=0)])])
        touched = bounds_of_lights(scene.lights, scene.camera, bounds)
        clipped: NDArray[np.int64] = np.clip(touched.reshape(-1, 2, 2), crop[:2], crop[2:]).reshape(-1, 4)
        return clipped


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
