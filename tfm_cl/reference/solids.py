"""Solids: what camera rays meet, and what they keep the light from.

They are traced by `tfm_cl.render.tracing.tracer`, and the map of distances by `tfm_cl.render.visibility`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.cache import Cache
from tfm_cl.reference.fitting import fitted
from tfm_cl.reference.geometry import Floats, Rays, corners
from tfm_cl.render.regions import LitRegions
from tfm_cl.render.visibility import Visibility

if TYPE_CHECKING:
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

Shadows = Literal["exact", "map"]
"""Of solids in the medium: traced to every sample, or looked up in the scene's ``[shadow]`` map, where one is
needed."""


def solid_distances(scene: Scene, light: Light) -> NDArray[np.float32]:
    """Map of distances ``[y, x]`` from a light to the first solid, infinite without: ``shadow.res`` wide."""
    res = scene.shadow.res
    maps = Visibility(Cache()).shadow_maps(scene, [fitted(scene, light)], [res])
    return maps[0] if maps else np.full((res, res), np.inf, np.float32)


def clip(scene: Scene, light: Light, res: int) -> Floats:
    """Distances ``[res²]`` beyond which solids leave nothing lit near the texels' rays."""
    distances = Visibility(Cache()).clip(scene, fitted(scene, light), res)
    return np.full(res**2, np.inf) if distances is None else distances.astype(np.float64).ravel()


def solid_visibility(scene: Scene, light: Light, points: Floats, shadows: Shadows = "exact") -> Floats:
    """Part of the light, [0, 1], that solids let through to points ``[rays, 3]`` in the medium.

    ``map``: by the shadow map, as ``kernels/light/shadow.h``; see `Shadows`.
    """
    obstacles = Obstacles(scene, shadows)
    return obstacles.visibility(fitted(scene, light), points)


class Surfaces(NamedTuple):
    """What camera rays meet."""

    distance: Floats
    """``[rays]``, world units; infinite without."""
    normal: Floats
    """``[rays, 3]``, unit, for shading; 0 on holdouts."""
    albedo: Floats
    """``[rays, 3]``, as far as haze lets it be seen; 0 on holdouts."""
    starts: Floats
    """``[rays, 3]`` where shadow rays start, world."""
    holdout: NDArray[np.bool_]
    """``[rays]``, where the camera sees a hole."""

    def part(self, which: NDArray[np.intp]) -> Surfaces:
        """Take those of some of the rays."""
        return Surfaces(
            self.distance[which],
            self.normal[which],
            self.albedo[which],
            self.starts[which],
            self.holdout[which],
        )


class Obstacles:
    """The solids of a scene."""

    def __init__(self, scene: Scene, shadows: Shadows) -> None:
        self._scene, self._shadows = scene, shadows
        self._maps: dict[tuple[object, ...], NDArray[np.float32]] = {}
        self._tracer: Tracer | None = None
        if scene.solids:
            from tfm_cl.render.tracing.tracer import Tracer  # noqa: PLC0415 - most scenes have no solids

            self._tracer = Tracer(scene.solids)

    @property
    def tracer(self) -> Tracer | None:
        """Of the solids; None without any."""
        return self._tracer

    def surfaces(self, rays: Rays) -> Surfaces:
        """Of the nearest visible solids; distances are infinite without."""
        count = len(rays.origins)
        if self._tracer is None:
            none = np.zeros((count, 3))
            return Surfaces(np.full(count, np.inf), none, none, none, np.zeros(count, bool))
        hits = self._tracer.nearest(*rays, self._scene.camera.pixel_width)
        distance, normal, albedo, flat, raised = (
            values.astype(np.float64)
            for values in (hits.distance, hits.normal, hits.albedo, hits.flat, hits.raised)
        )
        met = np.isfinite(distance)
        points = rays.at(np.where(met, distance, 0)) + raised
        starts = self._tracer.lifted(points, flat, np.where(met, distance, 0))
        clear = self._scene.camera.seen_of(np.where(met, distance, 0))
        return Surfaces(distance, normal, albedo * clear[:, None], starts, hits.holdout)

    def visibility(self, light: Light, points: Floats) -> Floats:
        """As `solid_visibility`, of a fitted light."""
        if self._tracer is None:
            return np.ones(len(points))
        arrival = light.arrival(points)
        if self._shadows == "exact" or not self._has_map(light):
            lengths = light.source_distance(points)
            return (~self._tracer.occluded(points, -arrival.direction, lengths)).astype(np.float64)
        key = light.map_key()
        if key not in self._maps:
            self._maps[key] = solid_distances(self._scene, light)
        distances = self._maps[key]
        res = len(distances)
        if self._scene.shadow.filter == "nearest":
            at = np.clip(arrival.position * res - 0.5, 0, res - 1)
            x, y = np.ceil(at - 0.5).astype(np.intp).T
            nearest: Floats = (distances[y, x] >= arrival.distance).astype(np.float64)
            return nearest
        visible: Floats = np.zeros(len(points))
        for x, y, weight in corners(res, arrival.position):
            visible += weight[:, 0] * (distances[y, x] >= arrival.distance)
        return visible

    def _has_map(self, light: Light) -> bool:
        """Whether there may be shadows of the light in what the camera sees of the medium."""
        charts, sizes = np.array([light.frame().chart]), np.array([self._scene.shadow.res])
        region = LitRegions.of([light]).with_texels(charts, sizes)
        eye = np.asarray(self._scene.camera.from_)
        return self._tracer is not None and bool(self._tracer.may_shade(region, eye).any())

    def lights(self, light: Light, points: Floats, surfaces: Surfaces) -> Floats:
        """Cosine at which the light meets surfaces at ``points``; 0 where they do not see it."""
        direction = light.arrival(points).direction
        cosine = -(direction * surfaces.normal).sum(axis=-1)
        seen = np.flatnonzero((cosine > 0) & light.reaches(points))
        result = np.zeros(len(points))
        if self._tracer is not None and len(seen):
            at = surfaces.starts[seen]
            hidden = self._tracer.occluded(at, -direction[seen], light.source_distance(at))
            result[seen] = np.where(hidden, 0, cosine[seen])
        return result
