"""The renderer once more, in float64 NumPy: the truth that the kernels are tested against.

Small enough to read in one sitting. Rays are arrays ``[rays, 3]`` in world space with unit directions,
distances and optical depths ``[rays]``; Python loops run over steps and lights only. An interval (begin,
end) is the part of a ray between two distances ≥ 0, (0, 0) where there is none. Optical depths are the
density's alone (TFM eq. 13); the medium's colour enters as exp(-σ_t τ) (eq. 14). Solids are traced by
`tfm_cl.render.tracing.tracer`, which has tests of its own; what is done with its answers is done here again.

Source: Delalandre, Gautron, Marvie, François, "Transmittance Function Mapping", I3D 2011 (TFM).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import UNIFORM_SHARE, Functions
from tfm_cl.maps.resolved import ResolvedMap, resolve
from tfm_cl.model import decided
from tfm_cl.plan import resolution
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.bodies.volumes import Volumes
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.lights import Arrival, Light, SpotLight
from tfm_cl.scene.lights.base import texel_positions
from tfm_cl.scene.scene import Scene

if TYPE_CHECKING:
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.tracing.tracer import Tracer

Floats = NDArray[np.float64]
Interval = tuple[Floats, Floats]
Method = Literal["tfm", "dual"]
Crop = tuple[int, int, int, int]
Grids = Volume | Volumes
Shadows = Literal["exact", "map"]
"""Of solids in the medium: traced to every sample, or looked up in the scene's ``[shadow]`` map."""

CHUNK = 1 << 13
"""Rays at a time: bounds the memory, and keeps the arrays in the cache."""
DARKEST = 1e-37
"""Smallest transmittance looked up in a map: near float32's smallest normal number."""
AUTO_RES = 64
"""Texels along a side of the map that ``density_weighting = "auto"`` looks at."""
EDGE_MARGIN = 1e-3
"""Of a map's width: what passes it by further than this meets no medium (``kernels/map.h``)."""


class Rays(NamedTuple):
    """Origins and unit directions ``[rays, 3]``, world space."""

    origins: Floats
    directions: Floats

    def at(self, distance: Floats) -> Floats:
        """Points ``[rays, 3]`` at distances ``[rays]``."""
        return self.origins + distance[:, None] * self.directions

    def part(self, which: slice | NDArray[np.intp]) -> Rays:
        """Take some of the rays."""
        return Rays(self.origins[which], self.directions[which])


def density(volume: Grids, points: Floats) -> Floats:
    """D at world-space ``points [..., 3]``: of all volumes together, each `_density_of_one`."""
    total = np.zeros(points.shape[:-1])
    for part in volume.parts:
        total += _density_of_one(part, points)
    return total


def _density_of_one(volume: Volume, points: Floats) -> Floats:
    """Trilinear between voxel centres, 0 one voxel beyond them."""

    def neighbours(at: Floats, count: int) -> list[tuple[NDArray[np.intp], Floats]]:
        at = np.clip(at, -1, count)  # all further out is 0 as well
        low = np.floor(at).astype(np.intp)
        weighted = (low, low + 1 - at), (low + 1, at - low)
        return [
            (voxel.clip(0, count - 1), weight * (voxel == voxel.clip(0, count - 1)))
            for voxel, weight in weighted
        ]

    index = np.ascontiguousarray(np.moveaxis(_to_index(volume, points, 1), -1, 0))
    total = np.zeros(points.shape[:-1])
    for (x, in_x), (y, in_y), (z, in_z) in product(*map(neighbours, index, volume.shape[::-1])):
        total += in_x * in_y * in_z * volume.data[z, y, x]
    return volume.density_scale * total


def _to_index(volume: Volume, vectors: Floats, w: int) -> Floats:
    """Points (w = 1) or directions (w = 0) from world to index space."""
    matrix = np.linalg.inv(volume.world_from_index)
    index: Floats = vectors @ matrix[:3, :3].T + w * matrix[:3, 3]
    return index


def march_bounds(
    volume: Grids, origins: Floats, directions: Floats, limit: Floats | float = np.inf
) -> Interval:
    """Interval of each ray, up to ``limit``, from the first to the last of the boxes that it meets.

    A volume's is the index-space box [-1, N], outside of which its D = 0. Between boxes D = 0 too, but steps
    are taken there.
    """
    boxes = [_box_bounds(part, origins, directions, limit) for part in volume.parts]
    met = [end > begin for begin, end in boxes]
    first = np.min([np.where(hit, begin, np.inf) for hit, (begin, _) in zip(met, boxes, strict=True)], axis=0)
    last = np.max([np.where(hit, end, -np.inf) for hit, (_, end) in zip(met, boxes, strict=True)], axis=0)
    return _interval(first, last)


def _box_bounds(volume: Volume, origins: Floats, directions: Floats, limit: Floats | float) -> Interval:
    origin, direction = _to_index(volume, origins, 1), _to_index(volume, directions, 0)
    size = np.array(volume.shape[::-1])
    along = direction != 0
    to_low = np.divide(-1 - origin, direction, out=np.full(origin.shape, -np.inf), where=along)
    to_high = np.divide(size - origin, direction, out=np.full(origin.shape, np.inf), where=along)
    passes = (along | ((origin >= -1) & (origin <= size))).all(axis=-1)
    begin, end = np.minimum(to_low, to_high).max(axis=-1), np.maximum(to_low, to_high).min(axis=-1)
    return _interval(begin, np.where(passes, np.minimum(end, limit), -np.inf))


def cone_interval(light: SpotLight, origins: Floats, directions: Floats) -> Interval:
    """Interval of each ray inside the light's solid cone; the end may be infinite."""
    return light.interval(origins, directions)


def _interval(begin: Floats, end: Floats) -> Interval:
    begin = np.maximum(begin, 0)
    hit = end > begin
    return np.where(hit, begin, 0), np.where(hit, end, 0)


def edges(
    begin: Floats, end: Floats, steps: int, w: Interval | None = None, max_stretch: float = 1.0
) -> tuple[Floats, Floats]:
    """Step boundaries ``[rays, steps + 1]`` and sample distances ``[rays, steps]``.

    Uniform in the projective space of a light with depths ``w`` ≥ 0 along its axis at the two ends (TFM
    section 4.2); uniform in the world without, or when the two are equal. Both are first raised to the
    larger one / ``max_stretch``, so that no step is longer than ``max_stretch`` mean ones; where neither
    is > 0 (both ends at the light) the steps are uniform in the world.
    """
    w_begin, w_end = w or (np.ones_like(begin), np.ones_like(begin))
    least = np.maximum(w_begin, w_end) / max_stretch
    w_begin, w_end = (np.where(least > 0, np.maximum(depth, least), 1)[:, None] for depth in (w_begin, w_end))

    def distance(s: Floats) -> Floats:
        return begin[:, None] + (end - begin)[:, None] * (s * w_begin / (s * w_begin + (1 - s) * w_end))

    return distance(np.arange(steps + 1) / steps), distance((np.arange(steps) + 0.5) / steps)


def _march(volume: Grids, rays: Rays, steps: tuple[Floats, Floats]) -> Iterator[tuple[Floats, ...]]:
    """Yield, step by step of `edges`, sample distance, optical depth of the step and of all before."""
    boundaries, samples = steps
    before = np.zeros(len(samples))
    for n in range(samples.shape[1]):
        depth = density(volume, rays.at(samples[:, n])) * (boundaries[:, n + 1] - boundaries[:, n])
        yield samples[:, n], depth, before
        before = before + depth


def _optical_depth(volume: Grids, rays: Rays, interval: Interval, steps: int | NDArray[np.intp]) -> Floats:
    """∫ D dt by the midpoint rule; the number of steps may differ from ray to ray."""
    begin, end = interval
    counts = np.broadcast_to(steps, begin.shape)
    length, tau = (end - begin) / np.maximum(counts, 1), np.zeros(begin.shape)
    most, together = counts.max(initial=0), 1 + CHUNK // (1 + tau.size)
    for first in range(0, most, together):  # few rays take many steps at once
        block = np.arange(first, min(first + together, most))
        t = begin[:, None] + (block + 0.5) * length[:, None]
        points = rays.origins[:, None] + t[:, :, None] * rays.directions[:, None]
        tau += length * np.where(block < counts[:, None], density(volume, points), 0).sum(axis=-1)
    return tau


def _light_rays(light: Light, points: Floats) -> tuple[Rays, Arrival]:
    """Rays from the light to points ``[rays, 3]``, and how it arrives there."""
    arrival = light.arrival(points)
    return Rays(light.begins(points), arrival.direction), arrival


def _grids(scene: Scene) -> Grids:
    """Return the volumes of a scene that are marched."""
    if not isinstance(scene.volume, Volume | Volumes):
        raise SceneError("the reference marches grids, not a homogeneous volume")
    return scene.volume


def _fitted(scene: Scene, light: Light, like: TransmittanceMap | None = None) -> Light:
    """Return a light with a place for its map: its own, that of a map to compare with, or the scene's."""
    return light.fitted(_grids(scene).occupied_bounds) if like is None else like.light


def light_optical_depth(scene: Scene, light: Light, points: Floats) -> Floats:
    """March from the light's entry into the bounds to each point: the inner march of the dual method."""
    scene = resolution.resolved(scene)
    volume = _grids(scene)
    rays, arrival = _light_rays(_fitted(scene, light), points)
    k_in, k_out = march_bounds(volume, *rays)
    ends = np.clip(arrival.distance, k_in, k_out)
    return _optical_depth(volume, rays, (k_in, ends), decided(scene.map.steps))


def map_rays(light: Light, positions: Floats) -> Rays:
    """Rays of map positions ``[rays, 2]`` in [0, 1]², unit directions."""
    return Rays(*light.rays(positions))


def texel_rays(light: Light, res: int) -> Rays:
    """Rays through the texel centres of a map, in the order of `texel_positions`."""
    return map_rays(light, texel_positions(res))


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def density_weighting(scene: Scene) -> float:
    """α of TFM eq. 19; ``"auto"``: half the largest optical depth seen by a light, between 1 and 16."""
    if scene.map.density_weighting != "auto":
        return float(scene.map.density_weighting)
    scene = resolution.resolved(scene)
    volume = _grids(scene)
    sigma_t, deepest = float(scene.medium.sigma_t.max()), 0.0
    for light in _lights(scene):
        rays = texel_rays(light, AUTO_RES)
        begin, end = march_bounds(volume, *rays)
        if scene.solids:
            end = np.clip(_clip(scene, light, AUTO_RES), begin, end)
        deepest = max(deepest, _optical_depth(volume, rays, (begin, end), decided(scene.map.steps)).max())
    # α divides the density's optical depth, but the limits are meant for the medium's.
    return max(1.0, float(np.clip(sigma_t * deepest / 2, 1, 16)) / sigma_t) if sigma_t > 0 else 1.0


class MapModel(NamedTuple):
    """All that a map's numbers depend on besides scene and light.

    The ranges of the light rays and the functions of the basis may come from a `TransmittanceMap`; what the
    light pass and the look-up do with them is done here again.
    """

    settings: ResolvedMap
    functions: Functions
    field: Floats
    extinction: float


def map_model(scene: Scene, like: TransmittanceMap | None = None) -> MapModel:
    """Take ranges and functions of a map, or, for bases that need no light rays, those of the scene."""
    if like is not None:
        assert like.functions is not None  # noqa: S101 - a basis that is a sum of functions
        return MapModel(like.settings, like.functions, like.field.astype(float), like.extinction)
    settings = resolve(resolution.resolved(scene).map)
    settings = settings.replace(density_weighting=density_weighting(scene))
    make = BASES[settings.basis].functions
    if make is None or BASES[settings.basis].needs_curves or settings.range != "box":
        raise SceneError(f"the reference needs a map to compare with for basis '{settings.basis}'")
    seen = scene.medium.sigma_t[scene.medium.sigma_t > 0]
    return MapModel(settings, make(settings, None), np.zeros((1, 1, 4)), float(seen.min(initial=np.inf)))


def bilinear(grid: Floats, positions: Floats) -> Floats:
    """Interpolate ``[size, size, numbers]`` between its entries' centres, at ``[points, 2]`` in [0, 1]²."""
    return sum(weight * grid[y, x] for x, y, weight in _corners(len(grid), positions))  # type: ignore[return-value]


def _corners(size: int, positions: Floats) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Floats]]:
    at = np.clip(positions * size - 0.5, 0, size - 1)
    low = np.floor(at).astype(np.intp)
    (x0, y0), (x1, y1), (x, y) = low.T, np.minimum(low + 1, size - 1).T, (at - low).T[:, :, None]
    return [
        (x0, y0, (1 - x) * (1 - y)),
        (x1, y0, x * (1 - y)),
        (x0, y1, (1 - x) * y),
        (x1, y1, x * y),
    ]


def _steps_of_rays(model: MapModel, positions: Floats) -> NDArray[np.intp]:
    """Count the steps of each ray: eighths, by the root of its block's range over the longest one."""
    settings = model.settings
    if settings.range == "box":
        return np.full(len(positions), settings.steps)
    block = (np.floor(positions * settings.res / 4) + 0.5) * 4 / settings.res
    begin, end = bilinear(model.field, block)[:, :2].T
    longest = (model.field[..., 1] - model.field[..., 0]).max()
    level = np.ceil(8 * np.sqrt(np.clip((end - begin) / longest, 0, 1)) - 1e-6)
    least = -(-16 * settings.coeffs // settings.steps)  # two steps a number
    level = np.clip(np.maximum(level, least), 1, 8).astype(int)
    steps: NDArray[np.intp] = -(-settings.steps * level // 8)
    return steps


def _has_one(model: MapModel) -> bool:
    return bool(np.allclose(model.functions.values(np.array([0.3, 0.8]))[:, 0], 1))


def _numbers(model: MapModel, depth: Floats) -> Floats:
    """Numbers of rays from the optical depths of their steps ``[rays, steps]``."""
    settings, steps = model.settings, depth.shape[1]
    after = np.cumsum(depth, axis=1)
    middle = after - depth / 2
    value, alpha = middle, decided(settings.density_weighting)
    if settings.target == "transmittance":
        value = -np.expm1(-middle / alpha)
    if settings.fit == "l2":
        return (depth if settings.target == "extinction" else value) @ model.functions.analysis(steps)
    rate = 2 * model.extinction
    lost = -np.expm1(-rate * depth)
    if settings.target == "transmittance":
        rate = max(rate - 2 / alpha, 0)
    weight = np.exp(-rate * (after - depth)) * lost
    total = weight.sum(axis=1, keepdims=True)
    weight = np.where(total > 0, (1 - UNIFORM_SHARE) * weight / np.where(total > 0, total, 1), 0)
    weight = weight + UNIFORM_SHARE / steps
    values = model.functions.values((np.arange(steps) + 0.5) / steps)
    gram = np.einsum("rk,ki,kj->rij", weight, values, values)
    gram += 1e-6 * gram.trace(axis1=1, axis2=2)[:, None, None] / values.shape[1] * np.eye(values.shape[1])
    solved: Floats = np.linalg.solve(gram, ((weight * value) @ values)[:, :, None])[:, :, 0]
    return solved


def solid_distances(scene: Scene, light: Light) -> NDArray[np.float32]:
    """Map of distances ``[y, x]`` from a light to the first solid, infinite without: ``shadow.res`` wide."""
    from tfm_cl.render.visibility import Visibility  # noqa: PLC0415 - it builds on this module

    distances = Visibility().distances(scene, _fitted(scene, light))
    res = scene.shadow.res
    return np.full((res, res), np.inf, np.float32) if distances is None else distances


def _clip(scene: Scene, light: Light, res: int) -> Floats:
    """Distances ``[res²]`` beyond which solids leave nothing lit near the texels' rays."""
    from tfm_cl.render.visibility import clip_of  # noqa: PLC0415 - it builds on this module

    return clip_of(solid_distances(scene, light), res).astype(np.float64).ravel()


def build_map(scene: Scene, light: Light, like: TransmittanceMap | None = None) -> Floats:
    """Numbers ``[y, x, n]`` of the texels' rays (TFM Alg. 2 as corrected; `kernels/projection.h`).

    Behind the step in which solids end what is lit, the transmittance stays as it is there.
    """
    scene = resolution.resolved(scene)
    model, light = map_model(scene, like), _fitted(scene, light, like)
    volume = _grids(scene)
    res, positions = model.settings.res, texel_positions(model.settings.res)
    numbers = np.zeros((res * res, model.settings.coeffs))
    counts = _steps_of_rays(model, positions)
    clip = _clip(scene, light, res) if scene.solids else np.full(res * res, np.inf)
    for steps in np.unique(counts):
        these = np.flatnonzero(counts == steps)
        for part in np.array_split(these, 1 + len(these) // CHUNK):
            rays = map_rays(light, positions[part])
            begin, end = march_bounds(volume, *rays)
            if model.settings.range != "box":
                begin, end = bilinear(model.field, positions[part])[:, :2].T
            boundaries, samples = edges(begin, end, int(steps))
            marched = _march(volume, rays, (boundaries, samples))
            depth = np.stack([depth for _, depth, _ in marched], axis=1)
            reach = np.maximum(clip[part], boundaries[:, 0])  # the first step is always taken
            depth[boundaries[:, :-1] > reach[:, None]] = 0
            numbers[part] = _numbers(model, depth)
            numbers[part[end <= begin]] = 0  # a ray that misses the medium stays clear
    if model.settings.target == "transmittance" and _has_one(model):
        numbers = np.eye(1, numbers.shape[1]) - numbers  # of f instead of 1 - f
    return numbers.reshape(res, res, -1)


def map_optical_depth(
    scene: Scene, light: Light, coefficients: Floats, points: Floats, like: TransmittanceMap | None = None
) -> Floats:
    """Look the optical depth up in a map, over the range of the point's own light ray."""
    if like is None:
        scene = scene.replace(map=scene.map.replace(coeffs=coefficients.shape[-1]))
    model = map_model(scene, like)
    rays, (_, distance, positions, *_) = _light_rays(_fitted(scene, light, like), points)
    begin, end = march_bounds(_grids(scene), *rays)
    hit, beyond = end > begin, np.zeros(len(points))
    if model.settings.range != "box":
        begin, end, slope, last = bilinear(model.field, positions).T
        beyond = np.maximum(np.minimum(distance, last) - end, 0) * slope
        hit = distance > begin
    v = np.divide(distance - begin, end - begin, out=np.zeros_like(begin), where=end > begin)
    values = model.functions.values(np.clip(v, 0, 1))

    def reconstructed(numbers: Floats) -> Floats:
        series = (numbers * values).sum(axis=-1)
        if model.settings.target != "transmittance":
            positive: Floats = np.maximum(series, 0)
            return positive
        f = series if _has_one(model) else 1 - series
        depth: Floats = -decided(model.settings.density_weighting) * np.log(np.clip(f, DARKEST, 1))
        return depth

    tau = np.zeros(len(points))
    if model.settings.lookup == "reconstruct":
        for x, y, weight in _corners(len(coefficients), positions):
            tau += weight[:, 0] * reconstructed(coefficients[y, x])
    else:
        tau += reconstructed(bilinear(coefficients, positions))
    hit &= (np.abs(positions - 0.5) < 0.5 + EDGE_MARGIN).all(axis=-1)
    return np.where(hit, tau + beyond, 0)


def unshadowed(volume: Grids, light: Light, points: Floats) -> Floats:
    """RGB that would arrive at points ``[rays, 3]`` that the light reaches, were there no medium."""
    nearest = 1e-6 * float(np.linalg.norm(np.subtract(*volume.bounds)))
    light = light.fitted(volume.occupied_bounds)
    arrival = light.arrival(points, nearest)
    return arrival.strength[:, None] * light.intensity_at(arrival.texture)


def camera_rays(camera: Camera, crop: Crop | None = None) -> Rays:
    """Rays through the pixels' centres, row by row, the top one first."""
    return Rays(*camera.rays(crop))


def solid_visibility(scene: Scene, light: Light, points: Floats, shadows: Shadows = "exact") -> Floats:
    """Part of the light, [0, 1], that solids let through to points ``[rays, 3]`` in the medium.

    ``map``: by the shadow map, as ``kernels/shadow.h``; see `Shadows`.
    """
    obstacles = _Obstacles(scene, shadows)
    return obstacles.visibility(_fitted(scene, light), points)


class _Surfaces(NamedTuple):
    """What camera rays meet: distances ``[rays]``, normals and albedo ``[rays, 3]``."""

    distance: Floats
    normal: Floats
    albedo: Floats


class _Obstacles:
    """The solids of a scene."""

    def __init__(self, scene: Scene, shadows: Shadows) -> None:
        self._scene, self._shadows = scene, shadows
        self._maps: dict[tuple[object, ...], NDArray[np.float32]] = {}
        self._tracer: Tracer | None = None
        if scene.solids:
            from tfm_cl.render.tracing.tracer import Tracer  # noqa: PLC0415 - most scenes have no solids

            self._tracer = Tracer(scene.solids)

    def surfaces(self, rays: Rays) -> _Surfaces:
        """Of the nearest solids; distances are infinite without."""
        count = len(rays.origins)
        if self._tracer is None:
            return _Surfaces(np.full(count, np.inf), np.zeros((count, 3)), np.zeros((count, 3)))
        hits = self._tracer.nearest(*rays)
        return _Surfaces(*(values.astype(np.float64) for values in (hits.distance, hits.normal, hits.albedo)))

    def visibility(self, light: Light, points: Floats) -> Floats:
        """As `solid_visibility`."""
        if self._tracer is None:
            return np.ones(len(points))
        arrival = light.arrival(points)
        if self._shadows == "exact":
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
        for x, y, weight in _corners(res, arrival.position):
            visible += weight[:, 0] * (distances[y, x] >= arrival.distance)
        return visible

    def lights(self, light: Light, points: Floats, surfaces: _Surfaces) -> Floats:
        """Cosine at which the light meets surfaces at ``points``; 0 where they do not see it."""
        direction = light.arrival(points).direction
        cosine = -(direction * surfaces.normal).sum(axis=-1)
        seen = np.flatnonzero((cosine > 0) & light.reaches(points))
        result = np.zeros(len(points))
        if self._tracer is not None and len(seen):
            at = self._tracer.lifted(points[seen], surfaces.normal[seen], surfaces.distance[seen])
            hidden = self._tracer.occluded(at, -direction[seen], light.source_distance(at))
            result[seen] = np.where(hidden, 0, cosine[seen])
        return result


def render(
    scene: Scene,
    method: Method | None = None,
    crop: Crop | None = None,
    maps: Sequence[TransmittanceMap] | None = None,
    shadows: Shadows = "exact",
) -> Floats:
    """Render ``[height, width, RGBA]``, scene-linear and premultiplied; see `render_with_aovs`."""
    return render_with_aovs(scene, method, crop, maps, shadows)[0]


def render_with_aovs(
    scene: Scene,
    method: Method | None = None,
    crop: Crop | None = None,
    maps: Sequence[TransmittanceMap] | None = None,
    shadows: Shadows = "exact",
) -> tuple[Floats, dict[str, Floats]]:
    """Render the image, and the layers ``depth``, ``transmittance`` and ``light_transmittance``.

    Parameters
    ----------
    scene
        What to render. Lights of several parts are the sum of these. ``map.storage`` is not imitated.
    method
        Instead of ``scene.march.method``.
    crop
        Pixels x0, y0, x1, y1 (end excluded) of the frame.
    maps
        Whose ranges and functions are to be taken, see `MapModel`, one for each part of each light; needed
        for all but ranges ``box`` and bases without light rays.
    shadows
        Of solids in the medium, see `Shadows`; on solids they are always exact.

    Raises
    ------
    SceneError
        A homogeneous volume, a texture or mesh that cannot be used, or a crop not inside the frame.
    """
    if scene.volume.colour is not None:
        raise SceneError("the reference renders a coloured volume channel by channel: coloured.grey_scenes")
    _grids(scene)
    scene = resolution.resolved(scene)
    scene = scene.replace(map=scene.map.replace(density_weighting=density_weighting(scene)))
    obstacles = _Obstacles(scene, shadows)
    lights = _lights(scene)
    likes: Sequence[TransmittanceMap | None] = maps or [None] * len(lights)
    depths = [
        partial(light_optical_depth, scene, light)
        if (method or scene.march.method) == "dual"
        else partial(map_optical_depth, scene, light, build_map(scene, light, like), like=like)
        for light, like in zip(lights, likes, strict=True)
    ]
    rays = camera_rays(scene.camera, crop)
    starts = range(0, len(rays.origins), CHUNK)
    chunks = [
        _trace(scene, lights, depths, obstacles, rays.part(slice(first, first + CHUNK))) for first in starts
    ]
    width, height = scene.camera.res if crop is None else (crop[2] - crop[0], crop[3] - crop[1])
    layers = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
    layers = {name: layer.reshape(height, width, *layer.shape[1:]) for name, layer in layers.items()}
    return layers.pop("image"), layers


def _lights(scene: Scene) -> list[Light]:
    """Lights with one map each: the parts of those that have several, fitted to the scene."""
    return [_fitted(scene, part) for light in scene.lights for part in light.parts()]


def _trace(
    scene: Scene,
    lights: list[Light],
    depths: list[partial[Floats]],
    obstacles: _Obstacles,
    rays: Rays,
) -> dict[str, Floats]:
    """All layers of some camera rays; ``depths`` give each light's optical depth at points."""
    volume, medium, march = _grids(scene), scene.medium, scene.march
    albedo = np.divide(medium.sigma_s, medium.sigma_t, out=np.zeros(3), where=medium.sigma_t > 0)
    surfaces = obstacles.surfaces(rays)
    near, far = march_bounds(volume, *rays, limit=surfaces.distance)
    radiance, reached, seen = (np.zeros((len(near), channels)) for channels in (3, 3, 1))

    def transmittance(tau: Floats) -> Floats:
        return np.exp(-np.multiply.outer(tau, medium.sigma_t))

    total, distance = np.zeros(len(near)), np.zeros(len(near))
    for t, depth, before in _march(volume, rays, edges(near, far, decided(march.steps))):
        distance += t * (transmittance(before) - transmittance(before + depth)).mean(axis=-1)
        total = before + depth
    opacity = 1 - transmittance(total).mean(axis=-1)

    shown = np.flatnonzero(np.isfinite(surfaces.distance))
    met = _Surfaces(*(values[shown] for values in surfaces))
    met_at = rays.part(shown).at(met.distance)

    for light, light_depth in zip(lights, depths, strict=True):
        reached_from, reached_to = light.interval(*rays)
        begin, end = np.maximum(reached_from, near), np.minimum(reached_to, far)
        through = transmittance(total)
        if march.attenuation == "paper":  # TFM's algorithm 1 dims only between the ends of the light's cone
            share = np.divide(end - begin, far - near, out=np.zeros_like(near), where=end > begin)
            ends = np.where(end > begin, [begin, end], 0)
            steps = np.ceil(march.steps * share).astype(np.intp)
            through = transmittance(_optical_depth(volume, rays, (ends[0], ends[1]), steps))

        cosine = obstacles.lights(light, met_at, met)
        arriving = cosine[:, None] * unshadowed(volume, light, met_at) * transmittance(light_depth(met_at))
        radiance[shown] += met.albedo / np.pi * arriving * through[shown]

        lit = np.flatnonzero(end > begin)
        part, begin, end = rays.part(lit), begin[lit], end[lit]
        hidden = np.zeros(len(lit))
        if march.attenuation != "paper":
            # What lies between the camera and the cone is dark, but hides what is behind.
            share = (begin - near[lit]) / (far[lit] - near[lit])
            steps = np.ceil(march.steps * share).astype(np.intp)
            hidden = _optical_depth(volume, part, (near[lit], begin), steps)
        w_begin, w_end = (light.projective_depth(part.at(t)) for t in (begin, end))
        w = (w_begin, w_end) if march.sampling == "projective" else None
        for t, depth, before in _march(
            volume, part, edges(begin, end, decided(march.steps), w, march.max_stretch)
        ):
            points = part.at(t)
            mu = -(light.arrival(points).direction * part.directions).sum(axis=-1)
            visible = transmittance(hidden + before) * (1 - transmittance(depth))
            light_transmittance = transmittance(light_depth(points))
            light_transmittance *= obstacles.visibility(light, points)[:, None]
            phase = np.asarray(medium.phase.evaluate(mu))[:, None]
            scattered = albedo * phase * unshadowed(volume, light, points)
            radiance[lit] += visible * scattered * light_transmittance
            reached[lit] += visible.mean(axis=-1, keepdims=True) * light_transmittance
            seen[lit] += visible.mean(axis=-1, keepdims=True)

    everywhere = np.asarray(scene.ambient.radiance)
    radiance += everywhere * (albedo * (1 - transmittance(total)) + surfaces.albedo * transmittance(total))
    return {
        "image": np.column_stack([radiance, np.where(np.isfinite(surfaces.distance), 1, opacity)]),
        "depth": np.divide(distance, opacity, out=np.zeros_like(opacity), where=opacity > 0),
        "transmittance": transmittance(total),
        "light_transmittance": np.divide(reached, seen, out=np.zeros_like(reached), where=seen > 0),
    }
