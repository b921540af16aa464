"""The device's frame: the world moved so that float32 keeps its digits where the scene is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene

FARTHEST = 3e4
"""Sizes of the media between them and the camera or a light, at which float32 errs by about a hundredth of
the picture; ten times as far, the picture is another one."""
SMALLEST_SIZE = 1e-6
"""World units, of what a millionth is the distance at which inverse-square falloff stops growing."""


def world_from_device(scene: Scene) -> NDArray[np.float64]:
    """4×4: the device's origin is the middle of the media, or the camera where they have none."""
    bounds = scene.finite_bounds
    matrix = np.eye(4)
    matrix[:3, 3] = scene.camera.from_ if bounds is None else bounds.mean(axis=0)
    return matrix


def check_distances(scene: Scene) -> None:
    """Refuse what float32 could not place exactly enough; a sun may be anywhere.

    Raises
    ------
    SceneError
        The camera, or a light that arrives, is more than `FARTHEST` sizes of the media away from them.
    """
    bounds, lights = scene.finite_bounds, scene.lights
    if bounds is None:
        return
    middle, size = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0]))
    places = np.array([scene.camera.from_, *(getattr(light, "from_", middle) for light in lights)])
    distances = np.linalg.norm(places - middle, axis=1)
    for i in np.flatnonzero(distances > FARTHEST * size).tolist():
        name, instead = "camera.from", "come nearer, with a larger fov"
        if i > 0:
            cone = lights[i - 1].lit_cone()
            if cone is None or cone.reach < distances[i] - size:
                continue  # its place does not matter, or nothing of it arrives
            name, instead = f"light {i - 1}: light.from", "come nearer, or use a light of the type sun"
        raise SceneError(
            f"{name} = {places[i].tolist()}: is {distances[i]:g} world units from the medium, whose size is "
            f"{size:.3g}; float32 on the device places things up to {FARTHEST:g} sizes away: {instead}"
        )
