"""Light at a point, were there no solids: what arrives, and what the bodies on its way leave of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from tfm_cl.model import decided
from tfm_cl.plan.orders import media_of, of_fields
from tfm_cl.reference.bodies import body_interval, march_bounds, optical_depths
from tfm_cl.reference.fitting import fitted, light_rays, margin_of, with_numbers
from tfm_cl.scene.fields import fields_of

if TYPE_CHECKING:
    from tfm_cl.reference.geometry import Floats
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

NEAREST = 1e-6
"""Of the size of all that has density: the distance below which inverse-square falloff stops growing."""
SMALLEST_SIZE = 1e-6
"""World units, of that size."""


Coefficients = Mapping["Medium", "Floats"]
"""RGB of each medium at density 1, per world unit."""


class Brought(NamedTuple):
    """What arrives of a light at points ``[n, 3]``."""

    radiance: Floats
    """RGB, after solids, but not bodies."""
    transmittance: Floats
    """RGB, of the bodies."""
    direction: Floats
    """In which it goes."""
    depth_of: Callable[[Coefficients], Floats]
    """RGB optical depth of other coefficients in the place of the media's extinction."""
    spread: float
    """As of `Light.spread`."""


class Bounded(Protocol):
    """A body, bodies, or a scene."""

    @property
    def bounds(self) -> Floats:
        """World box, [2, 3]."""

    @property
    def occupied_bounds(self) -> Floats:
        """World box around what has density, [2, 3]."""


# --- what is on the way ----------------------------------------------------------------------------------


def light_optical_depth(scene: Scene, light: Light, points: Floats, field: int = 0) -> Floats:
    """Optical depth ``[points]`` of a field, marched from the light: the inner march of the dual method."""
    weights = fields_of(scene).weights[:, :, field : field + 1]
    return marched_depths(with_numbers(scene), fitted(scene, light), points, weights)[:, 0]


def marched_depths(scene: Scene, light: Light, points: Floats, weights: Floats) -> Floats:
    """March the fields' optical depths ``[points, K]`` from where a fitted light enters boxes."""
    rays, arrival = light_rays(light, points)
    k_in, k_out = march_bounds(scene.marched, *rays, margin=margin_of(scene))
    ends = np.clip(arrival.distance, k_in, k_out)
    return optical_depths(scene.marched, weights, rays, (k_in, ends), decided(scene.map.steps))


def light_ways(scene: Scene, light: Light, points: Floats) -> Floats:
    """How far light has travelled inside each homogeneous body to points, ``[points, bodies]``.

    Followed from the points upstream: to the light, or without end to a sun.
    """
    upstream, limit = -light.arrival(points).direction, light.source_distance(points)
    ways = np.zeros((len(points), len(scene.homogeneous)))
    for i, body in enumerate(scene.homogeneous):
        begin, end = body_interval(body, points, upstream, limit)
        ways[:, i] = end - begin
    return ways


def light_transmittance(
    scene: Scene, light: Light, points: Floats, field_depths: Callable[[Floats], Floats]
) -> Floats:
    """RGB that all bodies leave of a fitted light at points ``[points, 3]``: exp(-(A τ + Σ σ_t D way)).

    ``field_depths`` gives τ, the fields' optical depths ``[points, K]`` between the light and points.
    """
    transmittance: Floats = np.exp(-light_depth(scene, None, light, points, field_depths))
    return transmittance


def light_depth(
    scene: Scene,
    coefficients: Coefficients | None,
    light: Light,
    points: Floats,
    field_depths: Callable[[Floats], Floats],
) -> Floats:
    """RGB optical depth of all bodies between a fitted light and points ``[points, 3]``.

    Parameters
    ----------
    coefficients
        In the place of the media's extinctions; of fields of several media they are those of their mean.
    """
    fields = fields_of(scene)
    matrix = fields.rgb_from_field
    if coefficients is not None and scene.marched:
        found = [coefficients[medium] for medium in media_of(scene)]
        matrix = of_fields(scene, matrix, fields.weights, found)
    depth = field_depths(points) @ matrix.T
    ways = light_ways(scene, light, points)
    for body, way in zip(scene.homogeneous, ways.T, strict=True):
        medium = scene.medium_of(body)
        sigma = medium.sigma_t if coefficients is None else coefficients[medium]
        depth += body.density * np.outer(way, sigma)
    return depth


# --- what arrives ----------------------------------------------------------------------------------------


def unshadowed(volume: Bounded, light: Light, points: Floats) -> Floats:
    """RGB that would arrive at points ``[rays, 3]`` that the light reaches, were there no medium.

    ``volume``: a body, bodies, or a scene, with an end.
    """
    size = float(np.linalg.norm(np.subtract(*volume.bounds)))
    return arriving(light.fitted(volume.occupied_bounds), points, NEAREST * size)


def arriving(light: Light, points: Floats, nearest: float) -> Floats:
    """Return the same for a fitted light, whose falloff stops growing at a distance: `nearest_distance`."""
    arrival = light.arrival(points, nearest)
    return arrival.strength[:, None] * light.intensity_at(arrival.texture)


def nearest_distance(scene: Scene, light: Light) -> float:
    """Distance below which inverse-square falloff stops growing; from the camera's in endless media."""
    low, high = scene.bounds
    if not np.isfinite([low, high]).all():
        low, high = np.asarray(scene.camera.from_), np.asarray(getattr(light, "from_", scene.camera.from_))
    return NEAREST * max(float(np.linalg.norm(high - low)), SMALLEST_SIZE)
