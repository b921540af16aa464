"""What a renderer is asked for, checked before anything is rendered."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from operator import index
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import SceneError
from tfm_cl.maps.transmittance_map import TransmittanceMap
from tfm_cl.scene.scene import Scene

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress

Crop = tuple[int, int, int, int]


def checked_scene(scene: Any) -> Scene:
    """Return the scene; raises `SceneError` of anything else."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene = {scene!r:.60}: should be a Scene, as Scene.load returns")
    return scene


def checked_moment(scene: Any) -> Scene | Callable[[float], Scene]:
    """Return the scene, or what returns that of any moment, which is checked then."""
    return (lambda frames: checked_scene(scene(frames))) if callable(scene) else checked_scene(scene)


def checked_maps(maps: Any) -> Sequence[TransmittanceMap] | None:
    """Return the maps; raises `SceneError` of anything else."""
    if maps is None:
        return None
    if not isinstance(maps, list | tuple) or not all(isinstance(one, TransmittanceMap) for one in maps):
        raise SceneError(f"maps = {maps!r:.60}: should be what build_maps returned")
    return maps


def checked_aovs(aovs: Any) -> tuple[str, ...]:
    """Return names of layers, which `ImageSettings` knows; raises `SceneError` of anything else."""
    if isinstance(aovs, str) or not isinstance(aovs, Collection):
        raise SceneError(f"aovs = {aovs!r:.60}: should be a list of names of layers, as ['lights']")
    return tuple(aovs)


def checked_progress(progress: Any) -> Progress | None:
    """Return what is told of progress; raises `SceneError` of what cannot be called."""
    if progress is not None and not callable(progress):
        raise SceneError(f"progress = {progress!r:.60}: should be a function of a stage and a fraction")
    told: Progress | None = progress
    return told


def checked_method(method: str | None, scene: Scene) -> str:
    """Return the method asked for, else the scene's."""
    method = method or scene.march.method
    if method not in ("tfm", "dual"):
        raise SceneError(f"method '{method}' is unknown; known: tfm, dual")
    return method


def checked_crop(crop: Any, res: tuple[int, int]) -> Crop:
    """Return pixels x0, y0, x1, y1 of the frame; None are all."""
    width, height = res
    if crop is None:
        return 0, 0, width, height
    try:
        x0, y0, x1, y1 = (index(edge) for edge in crop)
    except (TypeError, ValueError):
        raise SceneError(f"crop = {crop!r:.60}: should be four whole numbers x0,y0,x1,y1, pixels") from None
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise SceneError(
            f"crop {x0},{y0},{x1},{y1} does not lie in the image of {width}×{height}; "
            "it is x0,y0,x1,y1 in pixels, end excluded"
        )
    return x0, y0, x1, y1
