"""Low pictures: what is rendered while a scene changes, of few pixels, and without a new map if it can be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfm_cl.viewer.pacing import LEAST_WIDTH, Pacer

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import ImageSettings, MapSettings, MarchSettings
    from tfm_cl.viewer.renderer import ReadFrame, Renderer, Result

LEAST_RES = 64
"""Texels along a side of a map."""
LEAST_SAMPLES = 4
"""Of a light that is many."""
COARSER = ((1, 1), (2, 1), (4, 1), (4, 4), (8, 8))
"""By how much fewer texels along a side of maps, and lights in the place of one that is many, there are."""
FIRST = 1
"""Of these, as long as nothing is measured."""
FEWER = 3
"""Of these, where pictures of few pixels take too long although their maps are there."""
TOO_LONG = 1.5
"""Times what a picture may take; then lights that are many are fewer."""
OF_MAPS = 0.6
"""Of the time of a picture, what its maps may take; with less than half of it they become finer."""
OF_STEPS = 0.5
"""Of the steps of a camera ray, where these are left to auto: pictures are off by .5 %, as few would see."""
WITHOUT_MAPS = frozenset({"intensity", "name"})
"""Keys of a light that change no map."""


@dataclass(frozen=True)
class _Settled:
    """Maps that are there: what they depend on, and their settings."""

    of: tuple[Any, ...]
    map: MapSettings
    march: MarchSettings
    fewer: int


class Draft:
    """Makes scenes of low pictures of one session.

    A camera that moves, and colours, leave the maps of the last full picture as they are, whatever the size
    of the picture. Where maps have to be made anew, they are coarser; then, and where even the smallest
    pictures take too long, lights that are many, as a sky, are fewer.

    Parameters
    ----------
    rate
        Pictures per second that are wanted.
    """

    def __init__(self, rate: float) -> None:
        self._wanted, self._pacer, self._coarser = 1 / rate, Pacer(rate), FIRST
        self._is_heavy = False
        """Whether the lights of full pictures are too many while it moves."""
        self._full: _Settled | None = None
        self._low: _Settled | None = None
        """Of the last full picture, and of the last low ones that had coarser maps."""

    def scene(self, read: ReadFrame) -> Scene:
        """Return what a low picture of a frame shows."""
        scene = read.planned.scene
        settled = self._of(read)
        march = scene.march if scene.march.steps != "auto" else settled.march
        if read.scene.march.steps == "auto" and march.steps != "auto":
            march = march.replace(steps=max(math.ceil(OF_STEPS * march.steps), 1))
        return scene.replace(
            camera=scene.camera.replace(res=self._pacer.size(scene.camera.res)),
            lights=[_fewer(light, settled.fewer) for light in scene.lights],
            map=settled.map,
            march=march,
        )

    def _of(self, read: ReadFrame) -> _Settled:
        of, full, low = depends_on(read.scene), self._full, self._low
        is_heavy = self._is_heavy and any(map(_is_many, read.scene.lights))
        if full is not None and full.of == of and not is_heavy:
            return full
        if low is not None and low.of == of and (low.fewer > 1 or not is_heavy):
            return low
        scene = read.planned.scene
        texels, fewer = COARSER[max(self._coarser, FEWER) if is_heavy else self._coarser]
        settings = scene.map.replace(max_error=None) if scene.map.max_error is not None else scene.map
        if settings.res != "auto":
            settings = settings.replace(res=max(settings.res // texels, min(settings.res, LEAST_RES)))
        self._low = _Settled(of, settings, scene.march, fewer)
        return self._low

    def rendered(self, read: ReadFrame, result: Result) -> None:
        """Note that the full picture is there, and with it its maps."""
        scene = result.scene
        self._full = _Settled(depends_on(read.scene), scene.map, scene.march, 1)

    def took(self, seconds: float, result: Result) -> None:
        """Note what a low picture took."""
        size, made = result.scene.camera.res, result.stats.made.get("map", 0)
        if not made:
            self._is_heavy |= size[0] <= LEAST_WIDTH and seconds > TOO_LONG * self._wanted
            self._pacer.took(seconds, size)
            return
        of_maps = max(seconds - result.stats.seconds["view_pass"], 0.0)
        if of_maps > OF_MAPS * self._wanted:
            self._coarser = min(self._coarser + 1, len(COARSER) - 1)
        elif of_maps < OF_MAPS / 2 * self._wanted:
            self._coarser = max(self._coarser - 1, 0)
        self._pacer.took(result.stats.seconds["view_pass"] / (1 - OF_MAPS), size)

    def forget(self) -> None:
        """Forget which maps there are: another renderer makes them anew."""
        self._full = self._low = None


def low_picture(
    scene: Scene, read: ReadFrame, renderer: Renderer, layers: tuple[str, ...], progress: Progress
) -> Result:
    """Render the scene of a low picture (`Draft.scene`) of a frame, with layers that have to be asked for."""
    image = read.file.image
    return renderer.render(
        scene,
        crop=scaled_crop(image, read.scene.camera.res, scene.camera.res),
        aovs=layers,
        background=image.background,
        progress=progress,
    )


def scaled_crop(image: ImageSettings, full: tuple[int, int], low: tuple[int, int]) -> Any:
    """Return the crop of a low picture, which shows all that of the full one does; None without one."""
    if image.crop is None:
        return None
    x0, y0, x1, y1 = image.crop
    (width, height), (of_width, of_height) = low, full
    return (
        x0 * width // of_width,
        y0 * height // of_height,
        -(-x1 * width // of_width),
        -(-y1 * height // of_height),
    )


def depends_on(scene: Scene) -> tuple[Any, ...]:
    """Return what a scene's maps depend on: neither the camera nor colours; equal where they stay."""
    media = [scene.medium_of(body) for body in scene.bodies]
    return (
        tuple(body.density_key for body in scene.marched),
        tuple((medium.sigma_t.tobytes(), medium.emits and medium) for medium in media),
        tuple(map(_place, scene.lights)),
        scene.solids,
        scene.shadow,
        scene.map,
        scene.march.voxels,
        scene.march.method,
    )


def _place(light: Light) -> tuple[Any, ...]:
    """Return all of a light but its colour."""
    kept = [name for name in type(light).model_fields if name not in WITHOUT_MAPS]
    return (type(light), *(getattr(light, name) for name in kept))


def _is_many(light: Light) -> bool:
    """Tell whether a light is the sum of more than a few."""
    return getattr(light, "samples", 0) > LEAST_SAMPLES and getattr(light, "radius", 1) > 0


def _fewer(light: Light, factor: int) -> Light:
    """Return a light that is many as fewer."""
    if factor == 1 or not _is_many(light):
        return light
    # What points would find is of no use to the next picture, and so few lights need none.
    few = {"samples": max(getattr(light, "samples", 0) // factor, LEAST_SAMPLES)}
    return light.replace(**few, **({"lookup": "samples"} if light.surrounds else {}))
