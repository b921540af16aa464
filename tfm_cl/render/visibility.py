"""What solids show and hide: the camera's G-buffer, and the lights' maps of distances (TFM section 4.1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.render.shadow_pyramid import shadow_bounds
from tfm_cl.scene.lights.base import texel_positions

if TYPE_CHECKING:
    from tfm_cl.device.cache import Cache
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene


class Sized(Protocol):
    """What is kept: arrays, and what holds some."""

    @property
    def nbytes(self) -> int:
        """Size."""


T = TypeVar("T", bound=Sized)


@dataclass(frozen=True)
class GBuffer:
    """The solids that the pixels of a crop show, [height, width, …] (deferred shading)."""

    solid: NDArray[np.float32]
    """[h, w, 4]: unit normal (world, towards the camera) and distance, world units; infinite without."""
    albedo: NDArray[np.float32]
    """[h, w, 4]: RGB and 0."""
    points: NDArray[np.float64]
    """[hits, 3] where camera rays meet solids, world, row by row."""
    shown: NDArray[np.bool_]
    """[h, w]: which pixels these are."""

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        """Number of each pixel's point, where it has one."""
        numbers: NDArray[np.int64] = self.shown.cumsum().reshape(self.shown.shape) - 1
        return numbers

    @cached_property
    def _surfaces(self) -> NDArray[np.float64]:
        """Normals and distances of all points."""
        return self.solid[self.shown].astype(np.float64)

    def shadow_rays(
        self, tracer: Tracer, light: Light, rectangle: NDArray[np.int64]
    ) -> tuple[NDArray[np.intp], tuple[NDArray[np.float64], ...]]:
        """Rays towards a light from what the pixels of a rectangle show, and which pixels of it these are.

        Parameters
        ----------
        rectangle
            Low and high corner, [2, 2], pixels of the crop.
        """
        (x0, y0), (x1, y1) = rectangle
        shown = self.shown[y0:y1, x0:x1]
        pixels = np.flatnonzero(shown)
        number = self._numbers[y0:y1, x0:x1][shown]
        points, surfaces = self.points[number], self._surfaces[number]
        directions = light.arrival(points).direction
        facing = light.reaches(points) & ((directions * surfaces[:, :3]).sum(axis=1) < 0)
        if not facing.any():
            return pixels[:0], ()
        at = tracer.lifted(points[facing], surfaces[facing, :3], surfaces[facing, 3])
        return pixels[facing], (at, -directions[facing], light.source_distance(at))

    @property
    def nbytes(self) -> int:
        """Size."""
        return self.solid.nbytes + self.albedo.nbytes + self.points.nbytes + self.shown.nbytes


class Visibility:
    """Traces the solids of scenes, and keeps what the next frame may ask for again.

    Kept are the tracer of the last solids, and G-buffers and shadow maps in the session's cache.

    Parameters
    ----------
    cache
        Of the session.
    """

    def __init__(self, cache: Cache) -> None:
        self._solids: tuple[Any, ...] = ()
        self._tracer: Tracer | None = None
        self._cache = cache
        self.seconds = 0.0
        """Spent so far on reading and tracing solids."""

    def clear(self) -> None:
        """Forget everything."""
        self._solids, self._tracer = (), None

    def tracer(self, scene: Scene) -> Tracer | None:
        """Return the solids of a scene ready for rays; None without any.

        Raises
        ------
        SceneError
            A mesh file that cannot be used.
        """
        if not scene.solids:
            return None
        if self._tracer is None or self._solids != scene.solids:
            from tfm_cl.render.tracing.tracer import Tracer  # noqa: PLC0415 - most scenes have no solids

            self.clear()
            with self.timed():
                self._tracer, self._solids = Tracer(scene.solids), scene.solids
        return self._tracer

    def gbuffer(self, scene: Scene, crop: tuple[int, int, int, int]) -> GBuffer | None:
        """Trace the camera's rays through the pixels x0, y0, x1, y1; None without solids."""
        tracer = self.tracer(scene)
        if tracer is None:
            return None
        key = scene.solids, scene.camera, crop
        return self._keep("G-buffer", key, lambda: _gbuffer(tracer, scene, crop))

    def distances(self, scene: Scene, light: Light, res: int | None = None) -> NDArray[np.float32] | None:
        """Trace a light's rays: distances to the nearest solid, [res, res], infinite without one.

        Row by row of v, through the texels' centres. None without solids.

        Parameters
        ----------
        res
            By default the scene's ``shadow.res``.
        """
        tracer = self.tracer(scene)
        if tracer is None:
            return None
        res = res or scene.shadow.res
        key = scene.solids, light.map_key(), res
        return self._keep("shadow map", key, lambda: _distances(tracer, light, res))

    def bounds(self, scene: Scene, light: Light, res: int) -> NDArray[np.float32] | None:
        """Bound a light's distances (`shadow_bounds`); None without solids."""
        distances = self.distances(scene, light, res)
        if distances is None:
            return None
        key = scene.solids, light.map_key(), res
        return self._keep("bounds of a shadow map", key, lambda: shadow_bounds(distances[None]).ravel())

    @contextmanager
    def timed(self) -> Iterator[None]:
        """Count the time inside as the tracer's."""
        started = time.perf_counter()
        yield
        self.seconds += time.perf_counter() - started

    def clip(self, scene: Scene, light: Light, size: int) -> NDArray[np.float32] | None:
        """Find beyond which distance nothing is lit near each of size × size rays (`clip_of`).

        None without solids.
        """
        distances = self.distances(scene, light)
        if distances is None:
            return None
        key = scene.solids, light.map_key(), scene.shadow.res, size
        return self._keep("clip", key, lambda: clip_of(distances, size))

    def _keep(self, kind: str, key: Hashable, make: Callable[[], T]) -> T:
        def timed() -> T:
            with self.timed():
                return make()

        return self._cache.get(kind, key, timed, lambda value: value.nbytes)


def clip_of(distances: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Find beyond which distance nothing is lit near each of size × size rays; float32 [size, size].

    A ray's numbers are interpolated with its neighbours': what any sample between them may ask for counts,
    and one texel of the shadow map more.
    """
    from scipy import ndimage  # noqa: PLC0415 - most scenes have no solids

    res = len(distances)
    width = 3 * -(-res // size) + 2
    widest = ndimage.maximum_filter(distances, size=width + 1 - width % 2, mode="nearest")
    centres = np.minimum((np.arange(size) + 0.5) * res / size, res - 1).astype(np.intp)
    return np.ascontiguousarray(widest[np.ix_(centres, centres)])


def _gbuffer(tracer: Tracer, scene: Scene, crop: tuple[int, int, int, int]) -> GBuffer:
    shape = (crop[3] - crop[1], crop[2] - crop[0])
    origins, directions = scene.camera.rays(crop)
    hits = tracer.nearest(origins, directions)
    solid = np.concatenate([hits.normal, hits.distance[:, None]], axis=1).reshape(*shape, 4)
    albedo = np.concatenate([hits.albedo, np.zeros_like(hits.distance)[:, None]], axis=1).reshape(*shape, 4)
    met = np.isfinite(hits.distance)
    points = origins[met] + hits.distance[met, None] * directions[met]
    return GBuffer(solid, albedo, points, met.reshape(shape))


def solid_distances(tracer: Tracer, light: Light, positions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Trace a light's rays through map positions u, v [N, 2]: distances to the nearest solid, [N].

    A light from infinity is stopped before its rays begin too: the distance is 0 then.
    """
    origins, directions = light.rays(positions)
    distances = tracer.distances(origins, directions)
    upstream = light.source_distance(origins)
    if np.isinf(upstream).any():
        distances[tracer.occluded(origins, -directions, upstream)] = 0
    return distances


def _distances(tracer: Tracer, light: Light, res: int) -> NDArray[np.float32]:
    return solid_distances(tracer, light, texel_positions(res)).reshape(res, res)
