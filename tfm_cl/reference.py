"""The renderer once more, in float64 NumPy: the truth that the kernels are tested against.

Small enough to read in one sitting. Rays are arrays ``[rays, 3]`` in world space with unit directions,
distances and optical depths ``[rays]``; Python loops run over steps and lights only. An interval (begin,
end) is the part of a ray between two distances ≥ 0, (0, 0) where there is none. Optical depths are the
density's alone (TFM eq. 13); the medium's colour enters as exp(-σ_t τ) (eq. 14).

Source: Delalandre, Gautron, Marvie, François, "Transmittance Function Mapping", I3D 2011 (TFM).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.bases import BASES
from tfm_cl.bases.base import UNIFORM_SHARE, Functions
from tfm_cl.camera import Camera
from tfm_cl.errors import SceneError
from tfm_cl.lights import SpotLight
from tfm_cl.scene import Scene
from tfm_cl.settings import MapSettings
from tfm_cl.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.transmittance_map import TransmittanceMap

Floats = NDArray[np.float64]
Interval = tuple[Floats, Floats]
Method = Literal["tfm", "dual"]
Crop = tuple[int, int, int, int]

CHUNK = 1 << 13
"""Rays at a time: bounds the memory, and keeps the arrays in the cache."""
DARKEST = 1e-37
"""Smallest transmittance looked up in a map: near float32's smallest normal number."""
AUTO_RES = 64
"""Texels along a side of the map that ``density_weighting = "auto"`` looks at."""
TINY = 1e-100
"""Keeps points at the light from dividing by 0."""


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


def density(volume: Volume, points: Floats) -> Floats:
    """D at world-space ``points [..., 3]``: trilinear between voxel centres, 0 one voxel beyond them."""

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


def march_bounds(volume: Volume, origins: Floats, directions: Floats) -> Interval:
    """Interval of each ray inside the index-space box [-1, N], outside of which D = 0."""
    origin, direction = _to_index(volume, origins, 1), _to_index(volume, directions, 0)
    size = np.array(volume.shape[::-1])
    along = direction != 0
    to_low = np.divide(-1 - origin, direction, out=np.full(origin.shape, -np.inf), where=along)
    to_high = np.divide(size - origin, direction, out=np.full(origin.shape, np.inf), where=along)
    passes = (along | ((origin >= -1) & (origin <= size))).all(axis=-1)
    begin, end = np.minimum(to_low, to_high).max(axis=-1), np.maximum(to_low, to_high).min(axis=-1)
    return _interval(begin, np.where(passes, end, -np.inf))


def cone_interval(light: SpotLight, origins: Floats, directions: Floats) -> Interval:
    """Interval of each ray inside the light's solid cone; the end may be infinite."""
    matrix, slope = light.frame().world_from_light, np.tan(np.radians(light.cone))
    origin, direction = (origins - matrix[:3, 3]) @ matrix[:3, :3], directions @ matrix[:3, :3]
    # From the ray's point nearest to the apex the roots keep their digits however far the camera is.
    nearest = -(origin * direction).sum(axis=-1)
    origin = origin + nearest[:, None] * direction
    # Both nappes: z² slope² - x² - y² = a t² + 2 b t + c ≥ 0.
    metric = np.array([-1.0, -1.0, slope**2])
    a, b, c = (
        (one * other * metric).sum(axis=-1)
        for one, other in ((direction, direction), (origin, direction), (origin, origin))
    )
    discriminant = b * b - a * c
    root = -(b + np.copysign(np.sqrt(np.maximum(discriminant, 0)), b))
    # A ray parallel to the side (a = 0) has one of its roots at infinity.
    one = np.divide(root, a, out=np.copysign(np.inf, -b), where=a != 0)
    other = np.divide(c, root, out=np.zeros_like(c), where=root != 0)
    low, high = np.minimum(one, other), np.maximum(one, other)
    # a ≥ 0: the ray runs from one nappe into the other. a < 0: it crosses one nappe, if any.
    steep, forward = a >= 0, direction[:, 2] > 0
    height = origin[:, 2] - np.divide(b, a, out=np.zeros_like(b), where=a != 0) * direction[:, 2]
    begin = np.where(steep, np.where(forward, high, -np.inf), low)
    end = np.where(steep, np.where(forward, np.inf, low), high)
    missed = ~steep & ((discriminant <= 0) | (height <= 0))
    return _interval(begin + nearest, np.where(missed, -np.inf, end + nearest))


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


def _march(volume: Volume, rays: Rays, steps: tuple[Floats, Floats]) -> Iterator[tuple[Floats, ...]]:
    """Yield, step by step of `edges`, sample distance, optical depth of the step and of all before."""
    boundaries, samples = steps
    before = np.zeros(len(samples))
    for n in range(samples.shape[1]):
        depth = density(volume, rays.at(samples[:, n])) * (boundaries[:, n + 1] - boundaries[:, n])
        yield samples[:, n], depth, before
        before = before + depth


def _optical_depth(volume: Volume, rays: Rays, interval: Interval, steps: int | NDArray[np.intp]) -> Floats:
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


def _light_rays(light: SpotLight, points: Floats) -> tuple[Rays, Floats, Floats]:
    """Rays from the light to points ``[rays, 3]``, the distances, and the points in light space."""
    matrix = light.frame().world_from_light
    offset = points - matrix[:3, 3]
    distance = np.linalg.norm(offset, axis=-1)
    directions = offset / np.maximum(distance, TINY)[:, None]
    return Rays(np.broadcast_to(matrix[:3, 3], points.shape), directions), distance, offset @ matrix[:3, :3]


def light_optical_depth(scene: Scene, light: SpotLight, points: Floats) -> Floats:
    """March from the light's entry into the bounds to each point: the inner march of the dual method."""
    scene = scene.resolved()
    rays, distance, _ = _light_rays(light, points)
    k_in, k_out = march_bounds(scene.volume, *rays)
    return _optical_depth(scene.volume, rays, (k_in, np.clip(distance, k_in, k_out)), scene.map.steps)


def map_rays(light: SpotLight, positions: Floats) -> Rays:
    """Rays of map positions ``[rays, 2]`` in [0, 1]², unit directions."""
    matrix = light.frame().world_from_light
    x, y = ((2 * positions - 1) * np.tan(np.radians(light.cone))).T[:, :, None]
    directions = _unit(x * matrix[:3, 0] + y * matrix[:3, 1] + matrix[:3, 2])
    return Rays(np.broadcast_to(matrix[:3, 3], directions.shape), directions)


def texel_positions(res: int) -> Floats:
    """Texel centres of a map ``[res², 2]``; x runs fastest, and the first row is the lowest y."""
    at = (np.arange(res) + 0.5) / res
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)


def texel_rays(light: SpotLight, res: int) -> Rays:
    """Rays through the texel centres of a map, in the order of `texel_positions`."""
    return map_rays(light, texel_positions(res))


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def density_weighting(scene: Scene) -> float:
    """α of TFM eq. 19; ``"auto"``: half the largest optical depth seen by a light, between 1 and 16."""
    if scene.map.density_weighting != "auto":
        return float(scene.map.density_weighting)
    scene = scene.resolved()
    sigma_t, deepest = float(scene.medium.sigma_t.max()), 0.0
    for rays in (texel_rays(light, AUTO_RES) for light in _spots(scene)):
        bounds = march_bounds(scene.volume, *rays)
        deepest = max(deepest, _optical_depth(scene.volume, rays, bounds, scene.map.steps).max())
    # α divides the density's optical depth, but the limits are meant for the medium's.
    return max(1.0, float(np.clip(sigma_t * deepest / 2, 1, 16)) / sigma_t) if sigma_t > 0 else 1.0


class MapModel(NamedTuple):
    """All that a map's numbers depend on besides scene and light.

    The ranges of the light rays and the functions of the basis may come from a `TransmittanceMap`; what the
    light pass and the look-up do with them is done here again.
    """

    settings: MapSettings
    functions: Functions
    field: Floats
    extinction: float


def map_model(scene: Scene, like: TransmittanceMap | None = None) -> MapModel:
    """Take ranges and functions of a map, or, for bases that need no light rays, those of the scene."""
    if like is not None:
        assert like.functions is not None  # noqa: S101 - a basis that is a sum of functions
        return MapModel(like.settings, like.functions, like.field.astype(float), like.extinction)
    settings = scene.resolved().map.resolved()
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
    value, alpha = middle, float(settings.density_weighting)
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


def build_map(scene: Scene, light: SpotLight, like: TransmittanceMap | None = None) -> Floats:
    """Numbers ``[y, x, n]`` of the texels' rays (TFM Alg. 2 as corrected; `kernels/projection.h`)."""
    scene = scene.resolved()
    model = map_model(scene, like)
    res, positions = model.settings.res, texel_positions(model.settings.res)
    numbers = np.zeros((res * res, model.settings.coeffs))
    counts = _steps_of_rays(model, positions)
    for steps in np.unique(counts):
        these = np.flatnonzero(counts == steps)
        for part in np.array_split(these, 1 + len(these) // CHUNK):
            rays = map_rays(light, positions[part])
            begin, end = march_bounds(scene.volume, *rays)
            if model.settings.range != "box":
                begin, end = bilinear(model.field, positions[part])[:, :2].T
            marched = _march(scene.volume, rays, edges(begin, end, int(steps)))
            depth = np.stack([depth for _, depth, _ in marched], axis=1)
            numbers[part] = _numbers(model, depth)
            numbers[part[end <= begin]] = 0  # a ray that misses the medium stays clear
    if model.settings.target == "transmittance" and _has_one(model):
        numbers = np.eye(1, numbers.shape[1]) - numbers  # of f instead of 1 - f
    return numbers.reshape(res, res, -1)


def map_optical_depth(
    scene: Scene, light: SpotLight, coefficients: Floats, points: Floats, like: TransmittanceMap | None = None
) -> Floats:
    """Look the optical depth up in a map, over the range of the point's own light ray."""
    if like is None:
        scene = scene.replace(map=scene.map.replace(coeffs=coefficients.shape[-1]))
    model = map_model(scene, like)
    rays, distance, local = _light_rays(light, points)
    edge = np.maximum(local[:, 2:], TINY) * np.tan(np.radians(light.cone))
    positions = (np.clip(local[:, :2] / edge, -1, 1) + 1) / 2
    begin, end = march_bounds(scene.volume, *rays)
    beyond = np.zeros(len(points))
    if model.settings.range != "box":
        begin, end, slope = bilinear(model.field, positions)[:, :3].T
        beyond = np.maximum(distance - end, 0) * slope
    v = np.divide(distance - begin, end - begin, out=np.zeros_like(begin), where=end > begin)
    values = model.functions.values(np.clip(v, 0, 1))

    def reconstructed(numbers: Floats) -> Floats:
        series = (numbers * values).sum(axis=-1)
        if model.settings.target != "transmittance":
            positive: Floats = np.maximum(series, 0)
            return positive
        f = series if _has_one(model) else 1 - series
        depth: Floats = -float(model.settings.density_weighting) * np.log(np.clip(f, DARKEST, 1))
        return depth

    tau = np.zeros(len(points))
    if model.settings.lookup == "reconstruct":
        for x, y, weight in _corners(len(coefficients), positions):
            tau += weight[:, 0] * reconstructed(coefficients[y, x])
    else:
        tau += reconstructed(bilinear(coefficients, positions))
    return tau if model.settings.range == "box" else np.where(distance > begin, tau + beyond, 0)


def unshadowed(volume: Volume, light: SpotLight, points: Floats) -> Floats:
    """RGB that would arrive at points ``[rays, 3]`` inside the cone, were there no medium."""
    _, distance, local = _light_rays(light, points)
    gain = np.ones(len(points))
    if light.falloff == "inverse-square":
        gain /= np.maximum(distance, 1e-6 * np.linalg.norm(np.subtract(*volume.bounds))) ** 2
    if light.blend > 0:
        cone, angle = np.radians(light.cone), np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
        x = np.clip((cone - angle) / (cone * light.blend), 0, 1)
        gain *= x * x * (3 - 2 * x)
    return np.multiply.outer(gain, light.intensity)


def camera_rays(camera: Camera, crop: Crop | None = None) -> Rays:
    """Rays through the pixels' centres, row by row, the top one first."""
    width, height = camera.res
    x0, y0, x1, y1 = crop or (0, 0, width, height)
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise SceneError(f"crop = {[x0, y0, x1, y1]}: should be inside the {width}×{height} frame")
    pixel = 2 * np.tan(np.radians(camera.fov) / 2) / height
    at = (np.arange(x0, x1) + 0.5 - width / 2) * pixel, (height / 2 - np.arange(y0, y1) - 0.5) * pixel
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(*at))
    right, up, forward, position = camera.world_from_camera[:3].T
    directions = _unit(x * right + y * up + forward)
    return Rays(np.broadcast_to(position, directions.shape), directions)


def render(
    scene: Scene,
    method: Method | None = None,
    crop: Crop | None = None,
    maps: Sequence[TransmittanceMap] | None = None,
) -> Floats:
    """Render ``[height, width, RGBA]``, scene-linear and premultiplied; see `render_with_aovs`."""
    return render_with_aovs(scene, method, crop, maps)[0]


def render_with_aovs(
    scene: Scene,
    method: Method | None = None,
    crop: Crop | None = None,
    maps: Sequence[TransmittanceMap] | None = None,
) -> tuple[Floats, dict[str, Floats]]:
    """Render the image, and the layers ``depth``, ``transmittance`` and ``light_transmittance``.

    Parameters
    ----------
    scene
        What to render; all lights are spot lights. ``map.storage`` is not imitated.
    method
        Instead of ``scene.march.method``.
    crop
        Pixels x0, y0, x1, y1 (end excluded) of the frame.
    maps
        Whose ranges and functions are to be taken, see `MapModel`; needed for all but ranges ``box`` and
        bases without light rays.

    Raises
    ------
    SceneError
        The scene has another kind of light, or the crop is not inside the frame.
    """
    if scene.volume.colour is not None:
        raise SceneError("the reference renders a coloured volume channel by channel: coloured.grey_scenes")
    scene = scene.resolved()
    scene = scene.replace(map=scene.map.replace(density_weighting=density_weighting(scene)))
    likes: Sequence[TransmittanceMap | None] = maps or [None] * len(scene.lights)
    depths = [
        partial(light_optical_depth, scene, light)
        if (method or scene.march.method) == "dual"
        else partial(map_optical_depth, scene, light, build_map(scene, light, like), like=like)
        for light, like in zip(_spots(scene), likes, strict=True)
    ]
    rays = camera_rays(scene.camera, crop)
    starts = range(0, len(rays.origins), CHUNK)
    chunks = [_trace(scene, depths, rays.part(slice(first, first + CHUNK))) for first in starts]
    width, height = scene.camera.res if crop is None else (crop[2] - crop[0], crop[3] - crop[1])
    layers = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
    layers = {name: layer.reshape(height, width, *layer.shape[1:]) for name, layer in layers.items()}
    return layers.pop("image"), layers


def _spots(scene: Scene) -> list[SpotLight]:
    spots = []
    for light in scene.lights:
        if not isinstance(light, SpotLight):
            raise SceneError(f"the reference renders spot lights only; got a light of type '{light.type}'")
        spots.append(light)
    return spots


def _trace(scene: Scene, depths: list[partial[Floats]], rays: Rays) -> dict[str, Floats]:
    """All layers of some camera rays; ``depths`` give each light's optical depth at points."""
    volume, medium, march = scene.volume, scene.medium, scene.march
    albedo = np.divide(medium.sigma_s, medium.sigma_t, out=np.zeros(3), where=medium.sigma_t > 0)
    near, far = march_bounds(volume, *rays)
    radiance, reached, seen = (np.zeros((len(near), channels)) for channels in (3, 3, 1))

    def transmittance(tau: Floats) -> Floats:
        return np.exp(-np.multiply.outer(tau, medium.sigma_t))

    for light, light_depth in zip(_spots(scene), depths, strict=True):
        cone = cone_interval(light, *rays)
        begin, end = np.maximum(cone[0], near), np.minimum(cone[1], far)
        lit = np.flatnonzero(end > begin)
        part, begin, end = rays.part(lit), begin[lit], end[lit]
        # What lies between the camera and the cone is dark, but hides what is behind.
        share = (begin - near[lit]) / (far[lit] - near[lit])
        hidden = _optical_depth(
            volume, part, (near[lit], begin), np.ceil(march.steps * share).astype(np.intp)
        )
        w_begin, w_end = (_light_rays(light, part.at(t))[2][:, 2] for t in (begin, end))
        w = (w_begin, w_end) if march.sampling == "projective" else None
        for t, depth, before in _march(volume, part, edges(begin, end, march.steps, w, march.max_stretch)):
            points = part.at(t)
            mu = -(_light_rays(light, points)[0].directions * part.directions).sum(axis=-1)
            visible = transmittance(hidden + before) * (1 - transmittance(depth))
            light_transmittance = transmittance(light_depth(points))
            scattered = albedo * medium.phase.evaluate(mu)[:, None] * unshadowed(volume, light, points)
            radiance[lit] += visible * scattered * light_transmittance
            reached[lit] += visible.mean(axis=-1, keepdims=True) * light_transmittance
            seen[lit] += visible.mean(axis=-1, keepdims=True)

    total, distance = np.zeros(len(near)), np.zeros(len(near))
    for t, depth, before in _march(volume, rays, edges(near, far, march.steps)):
        distance += t * (transmittance(before) - transmittance(before + depth)).mean(axis=-1)
        total = before + depth
    alpha = 1 - transmittance(total).mean(axis=-1)
    return {
        "image": np.column_stack([radiance, alpha]),
        "depth": np.divide(distance, alpha, out=np.zeros_like(alpha), where=alpha > 0),
        "transmittance": transmittance(total),
        "light_transmittance": np.divide(reached, seen, out=np.zeros_like(reached), where=seen > 0),
    }
