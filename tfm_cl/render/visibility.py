"""What solids show and hide: the camera's G-buffer, and the lights' maps of distances (TFM section 4.1)."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.render.gbuffer import trace_gbuffer
from tfm_cl.render.lit_pixels import lit_pixels
from tfm_cl.render.regions import LitRegions
from tfm_cl.render.shadow_pyramid import shadow_bounds
from tfm_cl.render.tracing.threads import CHUNK, in_chunks
from tfm_cl.scene.lights.base import texel_positions

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence

    from tfm_cl.device.cache import Cache
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.lit_pixels import LitPixels
    from tfm_cl.render.raster import Raster
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene


class Sized(Protocol):
    """What is kept: arrays, and what holds some."""

    @property
    def nbytes(self) -> int:
        """Size."""


T = TypeVar("T", bound=Sized)

SHADOW_TEXELS = 2
"""Along a side of a shadow map, for each of a map that is small because its light is soft."""
BOUNDED_AT_ONCE = 1 << 20
"""Texels of shadow maps: some 5 milliseconds."""


class Visibility:
    """Traces the solids of scenes, and keeps what the next frame may ask for again.

    Kept are the tracer of the last solids, and G-buffers, shadow maps and lit pixels in the session's cache.

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

    def gbuffer(self, scene: Scene, raster: Raster) -> GBuffer | None:
        """Trace the camera's rays; None without solids."""
        tracer = self.tracer(scene)
        if tracer is None:
            return None
        key = None if raster.key is None else (scene.solids, scene.camera, raster.key)
        return self._keep("G-buffer", key, lambda: trace_gbuffer(tracer, scene, raster))

    def shadow_maps(
        self, scene: Scene, lights: Sequence[Light], sizes: Sequence[int]
    ) -> list[NDArray[np.float32]]:
        """Trace lights' rays: distances to the nearest solid, [size, size] each, infinite without one.

        Row by row of v, through the texels' centres. Maps that no earlier frame left are traced together;
        an empty list without solids.
        """
        tracer = self.tracer(scene)
        if tracer is None:
            return []

        def trace(places: list[int]) -> list[NDArray[np.float32]]:
            with self.timed():
                return _shadow_maps(tracer, [lights[i] for i in places], [sizes[i] for i in places])

        keys = [(scene.solids, light.map_key(), size) for light, size in zip(lights, sizes, strict=True)]
        return self._cache.get_many("shadow map", keys, trace, lambda distances: distances.nbytes)

    def lit_pixels(
        self,
        scene: Scene,
        raster: Raster,
        gbuffer: GBuffer | None,
        regions: LitRegions,
        touched: NDArray[np.int64],
        shaded: NDArray[np.bool_],
    ) -> LitPixels | None:
        """Trace what lights see of the solids that pixels show; None without solids.

        Parameters
        ----------
        gbuffer
            Of the scene and the raster.
        regions
            Of the lights.
        touched
            [lights, 4], the pixels x0, y0, x1, y1 of the frame that each may change.
        shaded
            [lights]: which of them solids may keep from what is seen.
        """
        tracer = self.tracer(scene)
        if tracer is None or gbuffer is None:
            return None
        rays = raster.key
        seen = scene.solids, scene.camera, rays, regions.key
        key = None if rays is None else (*seen, touched.tobytes(), shaded.tobytes())

        def trace() -> LitPixels:
            lists = raster.lists_of_buffers(touched, gbuffer.EDGE)
            return lit_pixels(tracer, gbuffer, regions, lists, len(touched), shaded)

        return self._keep("lit pixels", key, trace)

    def shadow_bounds(
        self, scene: Scene, lights: Sequence[Light], maps: Sequence[NDArray[np.float32]]
    ) -> list[NDArray[np.float32]]:
        """Bound lights' shadow maps (`tfm_cl.render.shadow_pyramid`), [bounds_size] each."""

        def make(places: list[int]) -> list[NDArray[np.float32]]:
            found: dict[int, NDArray[np.float32]] = {}
            with self.timed():
                for size in {len(maps[i]) for i in places}:
                    alike = [i for i in places if len(maps[i]) == size]
                    count = max(BOUNDED_AT_ONCE // size**2, 1)
                    for some in (alike[first : first + count] for first in range(0, len(alike), count)):
                        together = np.stack([maps[i] for i in some]) if len(some) > 1 else maps[some[0]][None]
                        found |= dict(zip(some, shadow_bounds(together), strict=True))
            return [found[i] for i in places]

        keys = [(scene.solids, light.map_key(), len(one)) for light, one in zip(lights, maps, strict=True)]
        return self._cache.get_many("bounds of a shadow map", keys, make, lambda bounds: bounds.nbytes)

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
        tracer = self.tracer(scene)
        if tracer is None:
            return None

        def make() -> NDArray[np.float32]:
            region = LitRegions.of_map(light)
            # What primitives are widened by is in no bounds.
            within = None if scene.primitives else scene.occupied_bounds
            if not tracer.may_shade(region, within=within).any():
                return np.full((size, size), region.reach[0], np.float32)
            distances = self.shadow_maps(scene, [light], [shadow_res(scene, light)])[0]
            with self.timed():
                return clip_of(distances, size)

        key = scene.solids, light.map_key(), scene.shadow.res, size
        return self._cache.get("clip", key, make, lambda clip: clip.nbytes)

    def _keep(self, kind: str, key: Hashable, make: Callable[[], T]) -> T:
        def timed() -> T:
            with self.timed():
                return make()

        return timed() if key is None else self._cache.get(kind, key, timed, lambda value: value.nbytes)


def shadow_res(scene: Scene, light: Light) -> int:
    """Return the texels along a side of a light's shadow map: of small maps a few for each of theirs."""
    most = light.most_texels
    return scene.shadow.res if most is None else min(scene.shadow.res, SHADOW_TEXELS * most)


def clip_of(distances: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Find beyond which distance nothing is lit near each of size × size rays; float32 [size, size].

    A ray's numbers are interpolated with its neighbours': what any sample between them may ask for counts,
    and one texel of the shadow map more.
    """
    res = len(distances)
    width = 3 * -(-res // size) + 2
    reach = width // 2
    centres = np.minimum((np.arange(size) + 0.5) * res / size, res - 1).astype(np.intp)
    rows = _largest(np.pad(distances, ((reach, reach), (0, 0)), mode="edge"), 2 * reach + 1)[centres]
    columns = _largest(np.pad(rows.T, ((reach, reach), (0, 0)), mode="edge"), 2 * reach + 1)[centres]
    return np.ascontiguousarray(columns.T)


def _largest(values: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """Find the largest of each row and the ``width`` - 1 after it, [n - width + 1, m]."""
    of = 1
    while 2 * of <= width:
        values = np.maximum(values[:-of], values[of:])
        of *= 2
    left = width - of
    return np.maximum(values[: len(values) - left], values[left:])


def solid_distances(tracer: Tracer, light: Light, positions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Trace a light's rays through map positions u, v [N, 2]: distances to the nearest solid, [N].

    A light from infinity is stopped before its rays begin too: the distance is 0 then.
    """
    origins, directions = light.rays(positions)
    distances = tracer.distances(origins, directions)
    if np.isinf(light.source_distance(origins[:1])).all():
        distances[tracer.occluded(origins, -directions, np.inf)] = 0
    return distances


def _shadow_maps(tracer: Tracer, lights: list[Light], sizes: list[int]) -> list[NDArray[np.float32]]:
    maps = [np.empty((size, size), np.float32) for size in sizes]
    # Of a large map a part is traced at a time, of small ones several.
    pieces = [
        (number, slice(first, min(first + CHUNK, size**2)))
        for number, size in enumerate(sizes)
        for first in range(0, size**2, CHUNK)
    ]
    longest = max((piece.stop - piece.start for _, piece in pieces), default=1)

    def trace(part: slice) -> None:
        for number, texels in pieces[part]:
            positions = texel_positions(sizes[number], texels)
            maps[number].ravel()[texels] = solid_distances(tracer, lights[number], positions)

    in_chunks(len(pieces), trace, CHUNK // longest)
    return maps
