"""Lights of a scene: each with a place for its map, and the rays of these maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.device.margins import camera_margin, grown, light_margin
from tfm_cl.errors import SceneError
from tfm_cl.plan import emission, resolution
from tfm_cl.reference.geometry import Floats, Interval, Rays
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.lights.base import texel_positions

if TYPE_CHECKING:
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.lights import Arrival, Light, SpotLight
    from tfm_cl.scene.scene import Scene


def with_numbers(scene: Scene) -> Scene:
    """Return the scene without ``"auto"`` for steps and the maps' resolution."""
    return resolution.resolved(scene)


def map_bounds(scene: Scene) -> Floats:
    """World box ``[2, 3]`` that the lights' maps look at: of what is marched; of all where solids shadow."""
    if scene.solids or not scene.marched:
        return scene.occupied_bounds
    return around([body.occupied_bounds for body in scene.marched])


def fitted(scene: Scene, light: Light, like: TransmittanceMap | None = None) -> Light:
    """Return a light with a place for its map: its own, that of a map to compare with, or the scene's."""
    return light.fitted(grown(map_bounds(scene), _light_margin(scene))) if like is None else like.light


def margin_of(scene: Scene, like: TransmittanceMap | None = None) -> float:
    """Margin of the box around primitives, which holds what the product widens: `tfm_cl.device.margins`.

    Steps are laid out in that box, so the rule is the product's own.
    """
    if like is not None or not scene.primitives:
        return like.margin if like is not None else 0.0
    return max(light_margin(_fitted_to(scene, _light_margin(scene))), camera_margin(scene))


def _light_margin(scene: Scene) -> float:
    return light_margin(_fitted_to(scene, 0.0)) if scene.primitives else 0.0


def _fitted_to(scene: Scene, margin: float) -> Scene:
    """Fit all parts of the lights to what their maps look at and a margin."""
    box = grown(map_bounds(scene), margin)
    parts = [part.fitted(box) for light in scene.lights for part in light.parts()]
    parts += emission.lights_of(scene)
    return with_numbers(scene).replace(lights=parts)


def lights_of(scene: Scene) -> list[Light]:
    """Lights with maps of their own: parts of those that have several, fitted, and what media emit.

    Raises
    ------
    SceneError
        Light from infinity where a medium is everywhere.
    """
    endless = not np.isfinite(scene.bounds).all()
    for index, light in enumerate(scene.lights):
        if endless and light.needs_fitting:
            raise SceneError(
                f"light {index + 1} ({light.type}) comes from infinitely far away: nothing of it is left "
                'in a medium that is everywhere; use volume.shape = "box" or "sphere", or a spot or point'
            )
    parts = [fitted(scene, part) for light in scene.lights for part in light.parts()]
    return [*parts, *emission.lights_of(scene)]


def cone_interval(light: SpotLight, origins: Floats, directions: Floats) -> Interval:
    """Interval of each ray inside the light's solid cone; the end may be infinite."""
    return light.interval(origins, directions)


def light_rays(light: Light, points: Floats) -> tuple[Rays, Arrival]:
    """Rays from where a map's distances begin to points ``[rays, 3]``, and how the light arrives there."""
    arrival = light.arrival(points)
    return Rays(light.begins(points), arrival.direction), arrival


def map_rays(light: Light, positions: Floats) -> Rays:
    """Rays of map positions ``[rays, 2]`` in [0, 1]², unit directions."""
    return Rays(*light.rays(positions))


def texel_rays(light: Light, res: int) -> Rays:
    """Rays through the texel centres of a map, in the order of `texel_positions`."""
    return map_rays(light, texel_positions(res))
