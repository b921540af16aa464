"""Lights in batches: all of one kind that fit in memory share a launch.

Each block of pixels has a list of the lights that touch it (`tfm_cl.render.culling`), as in tiled shading
(Olsson, Assarsson, "Tiled Shading", JGT 2011): thousands of small lights cost what they cover.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import NUMBERS_UNIT, STORAGE_BITS
from tfm_cl.device import launch
from tfm_cl.device.primitives import BINS_OF_LIGHT, Eye
from tfm_cl.device.structs.light import light_structs
from tfm_cl.maps.light_pass import map_bytes, map_variant, numbers_size
from tfm_cl.maps.probe import light_defines
from tfm_cl.model import decided
from tfm_cl.render.raster import BLOCK
from tfm_cl.render.regions import LitRegions
from tfm_cl.render.shadow_pyramid import bounds_res, bounds_size, shadow_bounds
from tfm_cl.render.visibility import shadow_res
from tfm_cl.scene.bodies.thin import thickness_of
from tfm_cl.scene.settings import SHADOW_FILTERS

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.culling import Rectangle
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.raster import Raster
    from tfm_cl.render.visibility import Visibility
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

BATCH_BYTES = 256 << 20
"""Of maps, shadow maps, textures and lists of the lights of a launch."""
SMALLEST_SHADOW = 32
"""Texels along a side of a shadow map, unless the scene wants less."""
TEXELS_PER_PIXEL = 2
"""Of a shadow map along the larger side of the pixels that its light touches, where no map needs it finer."""
UNSHADOWED = np.full(1, np.inf, np.float32)
"""The shadow map, of one texel, of lights that no solid keeps from what is seen. It has no neighbours; what
follows is read and weighs nothing."""
UNSHADOWED_BOUNDS = shadow_bounds(UNSHADOWED.reshape(1, 1, 1)).ravel()
SINGLE_NUMBER = {
    "target": "optical-depth",
    "fit": "l2",
    "coeffs": 1,
    "storage": "f32",
    "lookup": "interpolate",
}
"""What a map of residuals is looked up with."""
RESIDUAL_HEADER = "basis/single.h"


@dataclass(frozen=True)
class LightVariant:
    """What kernels must know of the lights of a launch when they are compiled."""

    headers: tuple[str, ...]
    """Of the lights' kind and chart."""
    falloff: tuple[tuple[str, int | str], ...]
    is_textured: bool
    shares_samples: bool
    """They reach all of a camera ray, and are sampled in the world: one march serves them and the camera."""
    most_texels: int | None = None
    """Along a side of their maps: those of a launch have one size."""

    @classmethod
    def of(cls, light: Light, scene: Scene) -> LightVariant:
        """Return the one of a light."""
        shares = light.is_unbounded and (light.has_even_depth or scene.march.sampling == "world")
        falloff = tuple(light_defines(light).items())
        return cls(light.headers, falloff, light.is_textured, shares, light.most_texels)


@dataclass(frozen=True)
class Batch:
    """Lights of one variant, on the device."""

    of: LightVariant
    indices: list[int]
    settings: ResolvedMap | None
    """Of their maps; None where none are read."""
    shadow_filter: int
    """``TFM_SHADOW``: 0 without solids."""
    is_dual: bool
    arguments: dict[str, Any]
    blocks: dict[str, Any] = field(default_factory=dict)
    """Which block sees which."""
    most_in_a_block: int = 0
    window: Rectangle = (0, 0, 0, 0)
    """The pixels that any of them touches."""
    lit: cl.Buffer | None = None
    """uchar: which pixels of each light's rectangle show a solid that it lights; not read without solids."""
    shows_residual: bool = False

    def variant(self, media: MediaOnDevice) -> tuple[tuple[str, ...], dict[str, int | str]]:
        """Headers and macros of the kernels that shade by these lights."""
        headers: tuple[str, ...] = ()
        defines: dict[str, int | str] = {**dict(self.of.falloff), **media.defines}
        if self.settings is not None:
            header, of_map = map_variant(self.settings)
            headers, defines = (RESIDUAL_HEADER if self.shows_residual else header,), defines | of_map
        return (*media.headers, *headers, *self.of.headers), defines | media.channels(
            textured=self.of.is_textured
        ) | {
            "TFM_METHOD_DUAL": int(self.is_dual),
            "TFM_SHADOW": self.shadow_filter,
            "TFM_TEXTURE": int(self.of.is_textured),
            "TFM_SHOW_RESIDUAL": int(self.shows_residual),
        }

    def at_every_sample(self) -> Batch:
        """Return the same lights, which are on a lattice, to be looked up at the samples that see it.

        They have no edge that a sample of the camera's ray, taken for all of them, might miss.
        """
        return replace(self, of=replace(self.of, shares_samples=True))

    @property
    def name(self) -> str:
        """What progress calls it."""
        first, last = self.indices[0] + 1, self.indices[-1] + 1
        return f"light {first}" if first == last else f"lights {first} to {last}"


class Batches:
    """Cuts the lights of a scene into batches that fit in memory, and puts these on the device.

    Parameters
    ----------
    scene
        Of single, fitted lights.
    media
        Its media.
    structs
        [lights] of the kernels' ``Light``; what says where a light's data are is filled in here.
    touched
        [lights, 4], the pixels x0, y0, x1, y1 of the frame that each may change.
    raster
        The camera's rays.
    settings
        Of the lights' maps, resolved; None where none are read.
    is_dual
        Whether light is marched instead.
    """

    def __init__(
        self,
        launcher: Launcher,
        scene: Scene,
        media: MediaOnDevice,
        visibility: Visibility,
        gbuffer: GBuffer | None,
        structs: NDArray[Any],
        touched: NDArray[np.int64],
        raster: Raster,
        settings: ResolvedMap | None,
        *,
        is_dual: bool,
    ) -> None:
        self._launcher, self._scene, self._media = launcher, scene, media
        self._visibility, self._gbuffer, self._structs, self._raster = visibility, gbuffer, structs, raster
        self._settings, self._is_dual, self._touched = settings, is_dual, touched
        x0, y0, x1, y1 = touched.T
        width, height = x1 - x0, y1 - y0
        self._areas = np.maximum(width, 0) * np.maximum(height, 0)
        sizes = np.array([shadow_res(scene, light) for light in scene.lights], dtype=np.int64)
        if settings is None and not is_dual:
            wanted = TEXELS_PER_PIXEL * np.maximum(np.maximum(width, height), 1)
            fine = np.maximum(2 ** np.ceil(np.log2(wanted)).astype(np.int64), SMALLEST_SHADOW)
            sizes = np.minimum(fine, sizes)
        self._sizes = sizes
        self._map_bytes = np.zeros(len(touched), dtype=np.int64)
        if settings is not None:
            of_maps = [map_bytes(settings.of_light(light)) for light in scene.lights]
            self._map_bytes += media.fields.count * np.array(of_maps, dtype=np.int64)
        self._regions: LitRegions | None = None
        self._is_shadowed = self._shades_points = np.zeros(len(touched), dtype=bool)
        self.shadowed_in_media = self._is_shadowed
        """[lights]: those that solids keep from what has density."""
        if (tracer := visibility.tracer(scene)) is not None:
            self._regions = LitRegions.of(scene.lights)
            looked_up = self._regions.with_texels(structs["chart"], sizes)
            self._is_shadowed = tracer.may_shade(looked_up, np.asarray(scene.camera.from_))
            self._shades_points = tracer.may_shade(looked_up)
            self.shadowed_in_media = tracer.may_shade(looked_up, within=scene.occupied_bounds)
        self._variants: dict[int, LightVariant] = {}
        self._of_last: dict[tuple[tuple[int, ...], bytes], dict[str, cl.Buffer]] = {}
        """Shadow maps and textures on the device of the lights asked for last: other rays may ask again."""
        self._costs = self._costs_on(raster)
        # However many lights meet in a block, a launch ends soon.
        steps = decided(scene.march.steps) * (decided(scene.map.steps) if is_dual else 1)
        self._most_lights = max(1, launch.MOST_SAMPLES // (launch.Windows.EDGE**2 * steps))

    def on(self, raster: Raster, gbuffer: GBuffer | None) -> Batches:
        """Return the same for other rays of the camera, and what they see of solids."""
        other = copy(self)
        other._look_at(raster, gbuffer)  # noqa: SLF001 - of this class
        return other

    def _look_at(self, raster: Raster, gbuffer: GBuffer | None) -> None:
        self._raster, self._gbuffer = raster, gbuffer
        self._costs = self._costs_on(raster)

    def _costs_on(self, raster: Raster) -> NDArray[np.int64]:
        """Bytes that each light takes."""
        x0, y0, x1, y1 = raster.spans(self._touched).T
        blocks = (-(-x1 // BLOCK) - x0 // BLOCK) * (-(-y1 // BLOCK) - y0 // BLOCK)
        costs = self._structs.itemsize + 16 * np.maximum(blocks, 0) + self._map_bytes
        if self._gbuffer is not None:
            of_shadows = 4 * (self._sizes**2 + bounds_size(self._sizes))
            areas = np.maximum(x1 - x0, 0) * np.maximum(y1 - y0, 0)
            costs = costs + np.where(self._is_shadowed, of_shadows, 0) + areas
        return np.asarray(costs)

    def is_seen(self, light: int) -> bool:
        """Whether a light may change any pixel."""
        return bool(self._areas[light] > 0)

    def groups(
        self, lights: Collection[int], *, all_of_them: bool = False
    ) -> Iterator[tuple[LightVariant, list[int]]]:
        """Yield lights by variant, those seen or all; first those that share the camera's samples."""
        found: dict[LightVariant, list[int]] = {}
        for index in lights:
            if all_of_them or self.is_seen(index):
                if index not in self._variants:
                    self._variants[index] = LightVariant.of(self._scene.lights[index], self._scene)
                found.setdefault(self._variants[index], []).append(index)
        yield from sorted(found.items(), key=lambda item: not item[0].shares_samples)

    def cut(self, lights: Sequence[int]) -> Iterator[list[int]]:
        """Yield runs of lights that fit in memory together; at least one each."""
        most_bytes = min(BATCH_BYTES, self._launcher.largest_buffer)
        batch: list[int] = []
        used, images = 0, set[int]()
        for index in lights:
            image = self._scene.lights[index].texture_image()
            cost = int(self._costs[index])
            if image is not None and id(image) not in images:
                cost += image.nbytes // 3 * 4
            if batch and (used + cost > most_bytes or len(batch) == self._most_lights):
                yield batch
                batch, used, images = [], 0, set()
            if image is not None:
                images.add(id(image))
            batch.append(index)
            used += cost
        if batch:
            yield batch

    def batch(
        self, variant: LightVariant, indices: list[int], maps: Sequence[TransmittanceMap], *, whole: bool
    ) -> Batch:
        """Put some lights on the device.

        Parameters
        ----------
        maps
            Theirs, in the order of lights and fields; empty where none are read.
        whole
            Whether all rays are to be looked at, whatever the lights touch.
        """
        upload, rectangles = self._launcher.upload, self._touched[indices]
        window = self._raster.bounds if whole else self._raster.window(rectangles)
        lit = self._lit(indices)
        lists = self._raster.lists(rectangles, window)
        return replace(
            self.at_points(variant, indices, maps, shadowed=self._is_shadowed),
            blocks={
                "starts": upload("the lists of lights", lists.starts),
                "touching": upload(
                    "the lists of lights", lists.lights if len(lists.lights) else np.zeros(1, np.int32)
                ),
                "blocks": (*lists.first, lists.columns, BLOCK),
            },
            most_in_a_block=max(1, int(np.diff(lists.starts).max(initial=1))),
            window=window,
            lit=upload("the lit pixels", lit),
        )

    def at_points(
        self,
        variant: LightVariant,
        indices: list[int],
        maps: Sequence[TransmittanceMap],
        *,
        shadowed: NDArray[np.bool_] | None = None,
    ) -> Batch:
        """Put some lights on the device, to be looked up at any points, whatever pixels they touch.

        Parameters
        ----------
        maps
            As of `batch`.
        shadowed
            [lights]: those that solids keep from points that count; by default from any.
        """
        upload = self._launcher.upload
        on_device = self._shadows_and_textures(indices, self._shades_points if shadowed is None else shadowed)
        self._structs["first_map"][indices] = self._media.fields.count * np.arange(len(indices))
        lists_of_lights = self._primitives(indices)
        self._structs["bias"][indices] = self._biases(indices, maps)
        lights = [self._scene.lights[index] for index in indices]
        return Batch(
            of=variant,
            indices=indices,
            settings=None if self._settings is None else self._settings.of_light(lights[0]),
            shadow_filter=0 if self._gbuffer is None else SHADOW_FILTERS[self._scene.shadow.filter],
            is_dual=self._is_dual,
            arguments={
                "lights": upload("the lights", self._structs[indices]),
                **on_device,
                **(self._maps(maps) if maps else {}),
                **lists_of_lights,
            },
        )

    def residuals(self, batch: Batch, maps: Sequence[TransmittanceMap]) -> Batch:
        """Return a batch whose maps hold their residuals, to be seen instead of the light's transmittance."""
        settings = maps[0].settings.replace(**SINGLE_NUMBER)
        size = numbers_size(settings) * NUMBERS_UNIT
        numbers = np.zeros((len(maps), size), np.float32)
        structs = []
        for i, light_map in enumerate(maps):
            numbers[i, : settings.res**2] = light_map.residual.ravel()
            structs.append(light_map.plan.struct(settings))
            structs[-1]["first_number"] = i * numbers_size(settings)
        arguments = batch.arguments | self._host_of(maps, np.stack(structs))
        arguments["numbers"] = self._launcher.upload("the residuals", numbers)
        return replace(batch, settings=settings, arguments=arguments, shows_residual=True)

    def _maps(self, maps: Sequence[TransmittanceMap]) -> dict[str, Any]:
        """Arguments of kernels that read some maps."""
        structs = np.stack([light_map.plan.struct() for light_map in maps])
        rooms = [light_map.buffers.numbers for light_map in maps]
        buffer = rooms[0].buffer
        structs["first_number"] = [room.first for room in rooms]
        if any(room.buffer is not buffer for room in rooms):
            settings = maps[0].settings
            nbytes = map_bytes(settings)
            buffer = self._launcher.empty("the maps", nbytes * len(maps), reuse=True)
            unit = NUMBERS_UNIT * STORAGE_BITS[settings.storage] // 8
            for i, room in enumerate(rooms):
                self._launcher.copy(room.buffer, buffer, nbytes, first=room.first * unit, to=i * nbytes)
            structs["first_number"] = numbers_size(settings) * np.arange(len(maps))
        return self._host_of(maps, structs) | {"numbers": buffer}

    def _host_of(self, maps: Sequence[TransmittanceMap], structs: NDArray[Any]) -> dict[str, Any]:
        """Put together what is small of some maps."""
        parts = {
            "limit": [light_map.buffers.limits for light_map in maps],
            "range": [light_map.field.reshape(-1, 4) for light_map in maps],
            "mode": [light_map.plan.modes.ravel() for light_map in maps],
        }
        for name, arrays in parts.items():
            structs[f"first_{name}"] = np.cumsum([0, *map(len, arrays[:-1])])
        joined = self._launcher.joined
        return {
            "maps": self._launcher.upload("the maps' parameters", structs),
            "limits": joined("the coefficients' limits", parts["limit"]),
            "ranges": joined("the ranges of the rays", parts["range"]),
            "modes": joined("the basis's functions", parts["mode"]),
        }

    def _primitives(self, batch: list[int]) -> dict[str, Any]:
        """List the primitives that each light's rays meet, where they are followed to any point."""
        media = self._media
        if not self._is_dual or media.primitives is None or media.sets is None:
            return {}
        launcher, lights = self._launcher, [self._scene.lights[index] for index in batch]
        eyes = []
        for light in lights:
            of_light = launcher.upload("the light", light_structs(self._scene, [light]))
            eyes.append(Eye.of_light(light, of_light, media.primitives.origin, BINS_OF_LIGHT, widens=False))
        seen = media.primitives.seen(media.sets, eyes[0])
        joined = media.primitives.joined(seen, eyes)
        self._structs["first_bin"][batch] = joined.first_bins
        return {
            f"light_{name.removeprefix('bin_')}": value for name, value in joined.listed.arguments().items()
        }

    def _biases(self, batch: list[int], maps: Sequence[TransmittanceMap]) -> list[float]:
        """By how much thin primitives are looked up nearer to each light: they do not shade themselves."""
        own, fields = thickness_of(self._scene.primitives), self._media.fields.count
        if own == 0.0 or not maps:
            return [own] * len(batch)
        return [own + maps[fields * i].grain for i in range(len(batch))]

    def _shadows_and_textures(self, batch: list[int], shadowed: NDArray[np.bool_]) -> dict[str, cl.Buffer]:
        """Put the shadow maps and the textures of a batch on the device."""
        key = (*batch,), shadowed[batch].tobytes()
        if key not in self._of_last:
            self._of_last.clear()
            self._of_last[key] = {
                "shadow": self._launcher.upload("the shadow maps", self._shadows(batch, shadowed)),
                "texture": self._launcher.upload("the lights' textures", self._textures(batch)),
            }
        return self._of_last[key]

    def _textures(self, batch: list[int]) -> NDArray[np.float32]:
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
            self._structs["texture_size"][index] = image.shape[1::-1]
            self._structs["first_texel"][index] = places[id(image)]
        return np.concatenate(parts)

    def _shadows(self, batch: list[int], shadowed: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Put the shadow maps of a batch one after the other, and then their bounds.

        Before them come those of all other lights.
        """
        # A batch of the same lights before may have had other ones shadowed.
        self._structs["shadow_res"][batch] = 1
        self._structs["first_shadow"][batch] = 0
        cast = [index for index in batch if shadowed[index]]
        sizes = self._sizes[cast]
        ends, bounds_ends = 1 + (sizes**2).cumsum(), bounds_size(sizes).cumsum()
        first_bounds = 2 + int((sizes**2).sum())
        self._structs["shadow_res"][cast] = sizes
        self._structs["first_shadow"][cast] = ends - sizes**2
        self._structs["shadow_bounds_res"][batch] = bounds_res(1)
        self._structs["shadow_bounds_res"][cast] = bounds_res(sizes)
        self._structs["first_shadow_bounds"][batch] = first_bounds
        self._structs["first_shadow_bounds"][cast] = (
            first_bounds + len(UNSHADOWED_BOUNDS) + bounds_ends - bounds_size(sizes)
        )
        lights = [self._scene.lights[index] for index in cast]
        maps = self._visibility.shadow_maps(self._scene, lights, sizes.tolist())
        bounds = self._visibility.shadow_bounds(self._scene, lights, maps)
        distances = [UNSHADOWED, *(one.ravel() for one in maps), UNSHADOWED]
        return np.concatenate([*distances, UNSHADOWED_BOUNDS, *bounds])

    def _lit(self, batch: list[int]) -> NDArray[np.uint8]:
        """Find which pixels show a solid that the batch's lights see; nothing without solids."""
        if self._regions is None:
            return np.zeros(1, np.uint8)
        corner = np.tile(self._raster.bounds[:2], 2)
        found = self._visibility.lit_pixels(
            self._scene,
            self._raster,
            self._gbuffer,
            self._regions[batch],
            self._touched[batch],
            self._is_shadowed[batch],
        )
        if found is None:
            return np.zeros(1, np.uint8)
        self._structs["lit_pixels"][batch] = found.rectangles + corner
        self._structs["first_lit"][batch] = found.first
        return found.lit
