"""How far primitives reach beyond their bounds where they are narrower than texels or pixels, and widened."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import LEAST_TEXELS
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene

GROWN = 1.25
"""Times what is found: a light that is fitted to larger bounds has wider texels."""


def light_margin(scene: Scene) -> float:
    """World units, beyond all primitives, in the maps of fitted lights; 0 where nothing is widened."""
    if not scene.primitives or not isinstance(scene.map.res, int):
        return 0.0
    bounds = _bounds(scene)
    widest = 0.0
    for light in scene.lights:
        far = _farthest(bounds, light.frame().world_from_light[:3, 3])
        texels = min(scene.map.res, light.most_texels or scene.map.res)
        widest = max(widest, light.footprint(far) / texels)
    return _beyond(scene, widest)


def camera_margin(scene: Scene) -> float:
    """World units, beyond all primitives, in the picture; 0 where nothing is widened."""
    if not scene.primitives:
        return 0.0
    return _beyond(
        scene, scene.camera.pixel_width * _farthest(_bounds(scene), np.asarray(scene.camera.from_))
    )


def grown(bounds: NDArray[np.float64], margin: float) -> NDArray[np.float64]:
    """World box, [2, 3], with a margin on all sides."""
    box: NDArray[np.float64] = bounds + np.array([[-margin], [margin]])
    return box


def _beyond(scene: Scene, texel: float) -> float:
    """How far the narrowest primitive grows; a power of two, which stays when a camera moves a little."""
    narrowest = min(body.narrowest for body in scene.primitives)
    beyond = GROWN * LEAST_TEXELS * texel - narrowest
    return 2.0 ** math.ceil(math.log2(beyond)) if beyond > 0 and math.isfinite(beyond) else 0.0


def _bounds(scene: Scene) -> NDArray[np.float64]:
    return around([body.bounds for body in scene.primitives])


def _farthest(bounds: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Distance to the farthest point of a box."""
    return float(np.linalg.norm(np.maximum(np.abs(bounds[0] - point), np.abs(bounds[1] - point))))
