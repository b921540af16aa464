"""Media whose extinction has a colour of its own in every voxel: three grey scenes, one for each channel.

The exponent of TFM eq. 11-14 serves colours that are the same everywhere. Where they vary in space, each
channel is projected by itself, so that a map has three times the numbers (TFM sections 5 and 6.1; Jansen,
Bavoil, "Fourier Opacity Mapping", I3D 2010, section 9): maps and picture are made of each channel as of a
grey scene, and joined.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.plan import resolution
from tfm_cl.render.result import RenderResult, RenderStats

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.renderer import Crop, Renderer
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings

CHANNELS = ("red", "green", "blue")
FAINTEST = np.float32(1e-30)
"""Opacity that stands for one that alpha, 1 - T, has rounded to 0."""


def grey_scenes(scene: Scene) -> tuple[Scene, ...]:
    """Split a scene into three, for red, green and blue, each of which is grey.

    Volume, medium and intensities of each are those of its channel; ``"auto"`` of resolution and steps is
    resolved first, for all three together.
    """
    scene = resolution.resolved(scene)
    medium = scene.medium
    return tuple(
        scene.replace(
            volume=volume,
            medium=medium.replace(sigma_s=medium.sigma_s[c], sigma_a=medium.sigma_a[c]),
            lights=tuple(light.replace(intensity=light.intensity[c]) for light in scene.lights),
        )
        for c, volume in enumerate(scene.grids[0].channels)
    )


def build_maps(renderer: Renderer, scene: Scene, progress: Progress | None = None) -> list[TransmittanceMap]:
    """Run the light pass of each channel.

    Returns
    -------
    list of TransmittanceMap
        Three for each light, or for each point of a light with a radius: light 1 red, green, blue, light 2
        red, green, blue, and so on. The volume of each is that of its channel.
    """
    of_channels = [
        renderer.build_maps(grey, _named(progress, name))
        for grey, name in zip(grey_scenes(scene), CHANNELS, strict=True)
    ]
    return list(chain.from_iterable(zip(*of_channels, strict=True)))


def render(
    render_grey: Callable[..., RenderResult],
    scene: Scene,
    *,
    maps: list[TransmittanceMap] | None = None,
    method: str | None = None,
    crop: Crop | None = None,
    aovs: Collection[str] = (),
    progress: Progress | None = None,
) -> RenderResult:
    """Render each channel, and join them; parameters and errors as of `Renderer.render`.

    Parameters
    ----------
    render_grey
        Renders a scene that is grey.
    maps
        From `build_maps`, in its order.
    """
    started = time.perf_counter()
    if (method or scene.march.method) != "tfm":
        maps = None
    scene = resolution.resolved(scene, maps[0].requested if maps else None)
    scenes = grey_scenes(scene)
    if maps is not None:
        _check_maps(scenes, maps)
    results = [
        render_grey(
            grey,
            maps=None if maps is None else maps[c :: len(CHANNELS)],
            method=method,
            crop=crop,
            aovs=aovs,
            progress=_named(progress, CHANNELS[c]),
        )
        for c, grey in enumerate(scenes)
    ]
    stats = _joined_stats([result.stats for result in results], scene.map)
    stats.seconds["total"] = time.perf_counter() - started
    warnings = tuple(dict.fromkeys(chain.from_iterable(result.warnings for result in results)))
    lit = any(result.lit for result in results)
    return RenderResult(
        _joined_image(results), _joined_layers(results), stats, scene, results[0].crop, warnings, lit
    )


def _check_maps(scenes: tuple[Scene, ...], maps: list[TransmittanceMap]) -> None:
    scenes = tuple(
        grey.replace(lights=tuple(chain.from_iterable(light.parts() for light in grey.lights)))
        for grey in scenes
    )
    lights = len(scenes[0].lights)
    if len(maps) != len(CHANNELS) * lights:
        raise SceneError(
            f"{len(maps)} maps for {lights} lights in a coloured volume, which take three each (points of "
            "area lights count); build the maps again"
        )
    for place, light_map in enumerate(maps):
        index, channel = divmod(place, len(CHANNELS))
        try:
            light_map.check_serves(scenes[channel], index)
        except SceneError as error:
            raise SceneError(f"{CHANNELS[channel]}: {error}") from None


def _joined_image(results: list[RenderResult]) -> NDArray[np.float32]:
    """Take each channel from its picture; alpha is 1 - the mean of T, the mean of theirs."""
    image = np.stack([result.image[..., c] for c, result in enumerate(results)], axis=-1)
    alpha = np.mean([result.image[..., 3] for result in results], axis=0)
    return np.dstack([image, alpha]).astype(np.float32)


def _joined_layers(results: list[RenderResult]) -> dict[str, NDArray[np.float32]]:
    opacities = np.stack([1 - result.aovs["transmittance"].mean(axis=-1) for result in results])
    layers = {}
    for name in results[0].aovs:
        parts = np.stack([result.aovs[name] for result in results])
        if parts.ndim > opacities.ndim:
            layer = np.stack([part[..., c] for c, part in enumerate(parts)], axis=-1)
        elif name == "depth":
            weights = np.where(parts > 0, np.maximum(opacities, FAINTEST), 0)
            weighted, total = (parts * weights).sum(axis=0), weights.sum(axis=0)
            layer = np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0)
        else:
            layer = parts.sum(axis=0) if name == "samples" else parts.mean(axis=0)
        layers[name] = layer.astype(np.float32)
    return layers


def _joined_stats(parts: list[RenderStats], requested: MapSettings) -> RenderStats:
    """Add up what the channels cost."""
    stats = RenderStats(parts[0].device, map_bytes=sum(part.map_bytes for part in parts))
    stats.seconds = {key: sum(part.seconds[key] for part in parts) for key in parts[0].seconds}
    stats.samples = {key: sum(part.samples[key] for part in parts) for key in parts[0].samples}
    settings = [part.map for part in parts if part.map is not None]
    if settings:
        # What the light's rays decided may differ: then only the request reproduces all three.
        differs = {
            name: getattr(requested, name)
            for name in type(settings[0]).model_fields
            if len({getattr(each, name) for each in settings}) > 1
        }
        stats.map = settings[0].model_copy(update=differs)
    return stats


def _named(progress: Progress | None, channel: str) -> Progress | None:
    if progress is None:
        return None
    return lambda stage, fraction: progress(f"{channel}, {stage}", fraction)
