"""What solids show and hide: the camera's G-buffer, and the lights' maps of distances (TFM section 4.1)."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.lights.base import texel_positions

if TYPE_CHECKING:
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

T = TypeVar("T")

KEPT_BYTES = 256 << 20
"""Of G-buffers and shadow maps kept for the next frame."""


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

    def layers(self) -> dict[str, NDArray[np.float32]]:
        """Return what it shows as layers of the picture."""
        return {
            "solid_distance": np.where(self.shown, self.solid[..., 3], np.float32(0)),
            "normal": self.solid[..., :3].copy(),
            "albedo": self.albedo[..., :3].copy(),
        }

    @property
    def nbytes(self) -> int:
        """Size."""
        return self.solid.nbytes + self.albedo.nbytes + self.points.nbytes + self.shown.nbytes


OF_SOLIDS = frozenset({"solid_distance", "normal", "albedo"})
"""Layers of `GBuffer.layers`."""


def nothing_seen(crop: tuple[int, int, int, int], names: Collection[str]) -> dict[str, NDArray[np.float32]]:
    """Return layers of a G-buffer without solids."""
    shape = (crop[3] - crop[1], crop[2] - crop[0])
    return {name: np.zeros(shape if name == "solid_distance" else (*shape, 3), np.float32) for name in names}


class Visibility:
    """Traces the solids of scenes, and keeps what the next frame may ask for again.

    Kept are the tracer of the last solids, and G-buffers and shadow maps up to `KEPT_BYTES`.
    """

    def __init__(self) -> None:
        self._solids: tuple[Any, ...] = ()
        self._tracer: Tracer | None = None
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self.seconds = 0.0
        """Spent so far on reading and tracing solids."""

    def clear(self) -> None:
        """Forget everything."""
        self._solids, self._tracer = (), None
        self._kept.clear()

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
            with self._timed():
                self._tracer, self._solids = Tracer(scene.solids), scene.solids
        return self._tracer

    def gbuffer(self, scene: Scene, crop: tuple[int, int, int, int]) -> GBuffer | None:
        """Trace the camera's rays through the pixels x0, y0, x1, y1; None without solids."""
        tracer = self.tracer(scene)
        if tracer is None:
            return None
        return self._keep((scene.camera, crop), lambda: _gbuffer(tracer, scene, crop))

    def distances(self, scene: Scene, light: Light) -> NDArray[np.float32] | None:
        """Trace a light's rays: distances to the nearest solid, [res, res], infinite without one.

        Row by row of v, through the texels' centres. None without solids.
        """
        tracer = self.tracer(scene)
        if tracer is None:
            return None
        res = scene.shadow.res
        return self._keep((light.map_key(), res), lambda: _distances(tracer, light, res))

    def lit(self, scene: Scene, light: Light, gbuffer: GBuffer) -> NDArray[np.float32]:
        """Trace shadow rays: 1 where no solid stops the light on its way to what a pixel shows, [h, w]."""
        tracer = self.tracer(scene)
        visible = np.zeros(gbuffer.shown.shape, np.float32)
        if tracer is None or not len(gbuffer.points):
            return visible
        points = gbuffer.points
        surfaces = gbuffer.solid[gbuffer.shown].astype(np.float64)
        normals = surfaces[:, :3]
        directions = light.arrival(points).direction
        facing = (light.reaches(points) & ((directions * normals).sum(axis=1) < 0)).nonzero()[0]
        reached = np.zeros(len(points), np.float32)
        if len(facing):
            at = tracer.lifted(points[facing], normals[facing], surfaces[facing, 3])
            with self._timed():
                hidden = tracer.occluded(at, -directions[facing], light.source_distance(at))
            reached[facing] = ~hidden
        visible[gbuffer.shown] = reached
        return visible

    @contextmanager
    def _timed(self) -> Iterator[None]:
        started = time.perf_counter()
        yield
        self.seconds += time.perf_counter() - started

    def _keep(self, key: Hashable, make: Callable[[], T]) -> T:
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            with self._timed():
                self._kept[key] = make()
            while len(self._kept) > 1 and sum(kept.nbytes for kept in self._kept.values()) > KEPT_BYTES:
                self._kept.popitem(last=False)
        kept: T = self._kept[key]
        return kept


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
