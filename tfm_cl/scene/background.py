"""What the camera sees behind media and solids of the lights that surround them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.interrupts import check_cancelled
from tfm_cl.scene.lights.surroundings import Surroundings

if TYPE_CHECKING:
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights.base import Light

BLOCK = 1 << 14
"""Pixels that are looked up at once, at least a row: what is known of them fits a core's cache."""


def surroundings_of(lights: Iterable[Light]) -> list[Surroundings]:
    """Return the lights that come from all around."""
    return [light for light in lights if isinstance(light, Surroundings)]


def check_surrounded(lights: Iterable[Light]) -> None:
    """Raise `SceneError` where an environment is to be the background, and none of the lights is one."""
    if not surroundings_of(lights):
        raise SceneError(
            "image.background = 'environment': no light of the scene has the type environment or sky; add "
            "one, or give a colour"
        )


def radiance_behind(
    lights: Iterable[Light], camera: Camera, crop: tuple[int, int, int, int] | None = None
) -> NDArray[np.float32]:
    """Return what a camera sees of the surroundings where nothing is in the way: [H, W, RGB].

    They add up. Each pixel has the mean over about its solid angle.

    Parameters
    ----------
    crop
        Pixels x0, y0, x1, y1 (end excluded); the whole frame when left out.

    Raises
    ------
    SceneError
        An image that cannot be used.
    CancelledError
        The picture that it is for was cancelled.
    """
    surroundings = surroundings_of(lights)
    x0, y0, x1, y1 = crop or (0, 0, *camera.res)
    seen = np.zeros((y1 - y0, x1 - x0, 3), np.float32)
    rows = max(1, BLOCK // (x1 - x0))
    for top in range(y0, y1, rows):
        check_cancelled()
        bottom = min(top + rows, y1)
        directions, cosines = camera.directions((x0, top, x1, bottom))
        # Pixels are squares on a plane: their solid angle falls as the cosine's third power.
        width = camera.pixel_width * cosines * np.sqrt(cosines)
        for light in surroundings:
            seen[top - y0 : bottom - y0] += light.radiance(directions, width).reshape(bottom - top, -1, 3)
    return seen
