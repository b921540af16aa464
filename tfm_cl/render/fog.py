"""Homogeneous media: all lights of a scene in a few launches, without maps (TFM section 4).

Lights of one kind share a launch. Each block of pixels has a list of the lights that touch it
(`tfm_cl.render.culling`), as in tiled shading (Olsson, Assarsson, "Tiled Shading", JGT 2011): thousands of
small lights cost what they cover. Shadow maps are as fine as the pixels that a light touches.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device import launch
from tfm_cl.device import params as parameters
from tfm_cl.errors import SceneError
from tfm_cl.model import decided
from tfm_cl.render.culling import block_lists, bounds_of_lights
from tfm_cl.render.fog_pass import BLOCK, FogLights, FogPass, FogVariant
from tfm_cl.render.visibility import solid_distances
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.lights.base import texel_positions
from tfm_cl.scene.settings import SHADOW_FILTERS

if TYPE_CHECKING:
    from tfm_cl.device.launch import Launcher, Progress
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.result import RenderStats
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.render.view_pass import FrameBuffers, ViewPass
    from tfm_cl.render.visibility import GBuffer, Visibility
    from tfm_cl.scene.scene import Scene

BATCH_BYTES = 256 << 20
"""Of shadow maps, textures and lists of the lights of a launch."""
SMALLEST_SHADOW = 32
"""Texels along a side of a shadow map, unless the scene wants less."""
TEXELS_PER_PIXEL = 2
"""Of a shadow map along the larger side of the pixels that its light touches."""
RAYS = 1 << 18
"""Traced at a time: fewer calls for many small lights, and bounded memory."""


def check(scene: Scene) -> None:
    """Refuse what has no meaning in a medium without an end.

    Raises
    ------
    SceneError
        Light from infinity where the medium is everywhere.
    """
    if np.isfinite(scene.volume.bounds).all():
        return
    for index, light in enumerate(scene.lights):
        if light.needs_fitting:
            raise SceneError(
                f"light {index + 1} ({light.type}) comes from infinitely far away: nothing of it is left "
                'in a medium that is everywhere; use volume.shape = "box" or "sphere", or a spot or point'
            )


def add_lights(
    launcher: Launcher,
    view_pass: ViewPass,
    visibility: Visibility,
    scene: Scene,
    crop: Rectangle,
    gbuffer: GBuffer | None,
    frame: FrameBuffers,
    stats: RenderStats,
    progress: Progress,
) -> None:
    """Sum into ``frame`` all that a homogeneous volume, under single, fitted lights, sends to the camera.

    The seconds go to ``stats``.
    """
    lights, volume = scene.lights, scene.volume
    if not isinstance(volume, Homogeneous):
        raise SceneError("the density has to be the same everywhere; grids are marched")
    params = parameters.fill_homogeneous(scene, volume, crop)
    touched = bounds_of_lights(lights, scene.camera, _lit_bounds(volume, gbuffer))
    touched = np.clip(touched.reshape(-1, 2, 2), crop[:2], crop[2:]).reshape(-1, 4)
    params["lit_pixels"] = touched
    fog_pass = FogPass(launcher)
    groups: dict[FogVariant, list[int]] = {}
    for index, light in enumerate(lights):
        groups.setdefault(FogVariant.of(light), []).append(index)
    shadow_filter = 0 if gbuffer is None else SHADOW_FILTERS[scene.shadow.filter]
    compiled = {variant: variant.compiled(scene, volume, shadow_filter) for variant in groups}
    first = launcher.upload("the parameters", params[:1])
    stats.seconds["view_pass"] += fog_pass.see(next(iter(compiled.values())), crop, first, frame)
    batches = _Batches(scene, visibility, gbuffer, params, min(BATCH_BYTES, launcher.largest_buffer))
    shown = (touched[:, 0] < touched[:, 2]) & (touched[:, 1] < touched[:, 3])
    for variant, members in groups.items():
        seen = [index for index in members if shown[index]]
        for batch in batches.cut(seen):
            stage = "view pass, light" + (
                f" {batch[0] + 1}" if len(batch) == 1 else f"s {batch[0] + 1} to {batch[-1] + 1}"
            )
            window = _around(touched[batch])
            texels = batches.textures(batch)
            shadow = batches.shadows(batch)
            lit = batches.lit(batch)
            on_device = FogLights(
                params=launcher.upload("the parameters", params[batch]),
                shadow=launcher.upload("the shadow maps", shadow),
                texture=launcher.upload("the lights' textures", texels),
                lit=launcher.upload("the lit pixels", lit),
                blocks=block_lists(touched[batch], window, BLOCK),
                window=window,
            )
            stats.seconds["view_pass"] += fog_pass.add_lights(
                compiled[variant], decided(scene.march.steps), on_device, frame, stage, progress
            )
    if any(scene.ambient.radiance):
        stats.seconds["view_pass"] += view_pass.add_ambient(scene, first, frame)


class _Batches:
    """Cuts lights into batches that fit in memory, and fills in what a batch needs besides its parameters."""

    def __init__(
        self,
        scene: Scene,
        visibility: Visibility,
        gbuffer: GBuffer | None,
        params: NDArray[Any],
        most_bytes: int,
    ) -> None:
        self._scene, self._visibility, self._gbuffer, self._params = scene, visibility, gbuffer, params
        self._tracer: Tracer | None = None if gbuffer is None else visibility.tracer(scene)
        x0, y0, x1, y1 = params["lit_pixels"].astype(np.int64).T
        width, height = x1 - x0, y1 - y0
        wanted = TEXELS_PER_PIXEL * np.maximum(np.maximum(width, height), 1)
        sizes = np.maximum(2 ** np.ceil(np.log2(wanted)).astype(np.int64), SMALLEST_SHADOW)
        self._sizes = np.minimum(sizes, scene.shadow.res)
        self._areas = np.maximum(width, 0) * np.maximum(height, 0)
        blocks = (-(-x1 // BLOCK) - x0 // BLOCK) * (-(-y1 // BLOCK) - y0 // BLOCK)
        self._costs = params.itemsize + 16 * np.maximum(blocks, 0)
        if gbuffer is not None:
            self._costs += 4 * self._sizes**2 + self._areas
            numbers = gbuffer.shown.cumsum().reshape(gbuffer.shown.shape) - 1
            self._numbers: NDArray[np.int64] = numbers
            self._surfaces = gbuffer.solid[gbuffer.shown].astype(np.float64)
        self._most_bytes = most_bytes
        # However many lights meet in a block, a launch ends soon.
        per_light = launch.Windows.EDGE**2 * decided(scene.march.steps)
        self._most_lights = max(1, launch.MOST_SAMPLES // per_light)

    def cut(self, lights: Sequence[int]) -> Iterator[list[int]]:
        """Yield runs of lights that fit in memory together; at least one each."""
        batch: list[int] = []
        used, images = 0, set[int]()
        for index in lights:
            image = self._scene.lights[index].texture_image()
            cost = int(self._costs[index])
            if image is not None and id(image) not in images:
                cost += image.nbytes // 3 * 4
            if batch and (used + cost > self._most_bytes or len(batch) == self._most_lights):
                yield batch
                batch, used, images = [], 0, set()
            if image is not None:
                images.add(id(image))
            batch.append(index)
            used += cost
        if batch:
            yield batch

    def textures(self, batch: list[int]) -> NDArray[np.float32]:
        """Put the textures of a batch one after the other, [texels, 4]; each image once."""
        first, parts = 1, [np.zeros((1, 4), np.float32)]
        places: dict[int, int] = {}
        for index in batch:
            image = self._scene.lights[index].texture_image()
            if image is None:
                continue
            if id(image) not in places:
                places[id(image)] = first
                texels = np.zeros((image.shape[0] * image.shape[1], 4), np.float32)
                texels[:, :3] = image.reshape(-1, 3)
                parts.append(texels)
                first += len(texels)
            self._params["texture_size"][index] = image.shape[1::-1]
            self._params["first_texel"][index] = places[id(image)]
        return np.concatenate(parts)

    def shadows(self, batch: list[int]) -> NDArray[np.float32]:
        """Trace the shadow maps of a batch, one after the other; nothing without solids."""
        tracer = self._tracer
        if tracer is None:
            return np.zeros(1, np.float32)
        sizes = self._sizes[batch]
        ends = (sizes**2).cumsum()
        self._params["shadow_res"][batch] = sizes
        self._params["first_shadow"][batch] = ends - sizes**2
        maps = np.empty(int(ends[-1]), np.float32)

        def trace(places: NDArray[np.intp], rays: list[NDArray[np.float64]]) -> None:
            maps[places] = tracer.distances(*rays)

        waiting = _Waiting(trace)
        for index, size, end in zip(batch, sizes.tolist(), ends.tolist(), strict=True):
            light = self._scene.lights[index]
            place = np.arange(end - size**2, end)
            if size == self._scene.shadow.res:
                distances = self._visibility.distances(self._scene, light)  # which it may know already
                if distances is not None:
                    maps[place] = distances.ravel()
                continue
            with _timed(self._visibility):
                positions = texel_positions(size)
                if np.isinf(light.source_distance(light.rays(positions[:1])[0])).any():
                    maps[place] = solid_distances(tracer, light, positions)
                else:
                    waiting.add(place, *light.rays(positions))
        with _timed(self._visibility):
            waiting.trace()
        return maps

    def lit(self, batch: list[int]) -> NDArray[np.uint8]:
        """Trace which pixels of a batch's rectangles show a solid that the light sees."""
        tracer, gbuffer = self._tracer, self._gbuffer
        if tracer is None or gbuffer is None:
            return np.zeros(1, np.uint8)
        areas = self._areas[batch]
        ends = areas.cumsum()
        self._params["first_lit"][batch] = ends - areas
        lit = np.zeros(int(ends[-1]), np.uint8)

        def trace(places: NDArray[np.intp], rays: list[NDArray[np.float64]]) -> None:
            lit[places] = ~tracer.occluded(*rays)

        waiting = _Waiting(trace)
        with _timed(self._visibility):
            for index, begin in zip(batch, (ends - areas).tolist(), strict=True):
                pixels, rays = self._shadow_rays(tracer, gbuffer, index)
                if len(pixels):
                    waiting.add(begin + pixels, *rays)
            waiting.trace()
        return lit

    def _shadow_rays(
        self, tracer: Tracer, gbuffer: GBuffer, index: int
    ) -> tuple[NDArray[np.intp], tuple[NDArray[np.float64], ...]]:
        """Rays towards a light from what the pixels of its rectangle show, and which pixels these are."""
        light, rectangle = self._scene.lights[index], self._params["lit_pixels"][index]
        corner = self._params["crop"][index][:2]
        (x0, y0), (x1, y1) = rectangle[:2] - corner, rectangle[2:] - corner
        shown = gbuffer.shown[y0:y1, x0:x1]
        pixels = np.flatnonzero(shown)
        number = self._numbers[y0:y1, x0:x1][shown]
        points, surfaces = gbuffer.points[number], self._surfaces[number]
        directions = light.arrival(points).direction
        facing = light.reaches(points) & ((directions * surfaces[:, :3]).sum(axis=1) < 0)
        if not facing.any():
            return pixels[:0], ()
        at = tracer.lifted(points[facing], surfaces[facing, :3], surfaces[facing, 3])
        return pixels[facing], (at, -directions[facing], light.source_distance(at))


class _Waiting:
    """Collects rays of many lights and traces them together."""

    def __init__(self, trace: Callable[[NDArray[np.intp], list[NDArray[np.float64]]], None]) -> None:
        self._trace = trace
        self._parts: list[tuple[NDArray[Any], ...]] = []
        self._count = 0

    def add(self, places: NDArray[np.intp], *rays: NDArray[np.float64]) -> None:
        """Take rays whose results go to ``places``."""
        self._parts.append((places, *rays))
        self._count += len(places)
        if self._count >= RAYS:
            self.trace()

    def trace(self) -> None:
        """Trace what was collected."""
        if self._parts:
            places, *rays = (np.concatenate(part) for part in zip(*self._parts, strict=True))
            self._parts, self._count = [], 0
            self._trace(places, rays)


@contextmanager
def _timed(visibility: Visibility) -> Iterator[None]:
    """Count the time inside as the tracer's."""
    started = time.perf_counter()
    yield
    visibility.seconds += time.perf_counter() - started


def _lit_bounds(volume: Homogeneous, gbuffer: GBuffer | None) -> NDArray[np.float64]:
    """World box, [2, 3], around all that may be seen lit."""
    if gbuffer is None or not len(gbuffer.points):
        return volume.bounds
    low, high = volume.bounds
    points = gbuffer.points
    return np.stack([np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))])


def _around(rectangles: NDArray[np.int64]) -> Rectangle:
    """Rectangle around all."""
    x0, y0 = rectangles[:, :2].min(axis=0).tolist()
    x1, y1 = rectangles[:, 2:].max(axis=0).tolist()
    return x0, y0, x1, y1
