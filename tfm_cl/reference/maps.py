"""Transmittance function maps of fields: made of a light's rays, and looked up at points."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import UNIFORM_SHARE, Functions
from tfm_cl.maps.resolved import ResolvedMap, resolve
from tfm_cl.model import decided
from tfm_cl.reference import geometry
from tfm_cl.reference.bodies import march_bounds, optical_depths, step_depths
from tfm_cl.reference.fitting import (
    fitted,
    light_rays,
    lights_of,
    map_rays,
    margin_of,
    texel_rays,
    with_numbers,
)
from tfm_cl.reference.geometry import Floats, Integers, Rays, edges
from tfm_cl.reference.primitives import meet
from tfm_cl.reference.solids import clip
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.fields import fields_of
from tfm_cl.scene.lights.base import texel_positions

if TYPE_CHECKING:
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.bodies import MarchedBody
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

DARKEST = 1e-37
"""Smallest transmittance looked up in a map: near float32's smallest normal number."""
AUTO_RES = 64
"""Texels along a side of the map that ``density_weighting = "auto"`` looks at."""
OWN_DEPTHS = 1 << 14
"""Steps of a range that are as good as its points."""
EDGE_MARGIN = 1e-3
"""Of a map's width: what passes it by further than this meets no medium (``kernels/map/lookup.h``)."""


class MapModel(NamedTuple):
    """All that the numbers of a field's map depend on besides scene and light.

    The ranges of the light rays and the functions of the basis may come from a `TransmittanceMap`; what the
    light pass and the look-up do with them is done here again.
    """

    settings: ResolvedMap
    functions: Functions
    field: Floats
    """The ranges ``[size, size, 4]``, not the field of densities."""
    extinction: float
    weights: Floats
    """``[bodies, 3, 1]`` of the field of densities, of all that is marched."""

    def of_light(self, light: Light) -> MapModel:
        """Return the model of a light's own map."""
        return self._replace(settings=self.settings.of_light(light))


def map_model(scene: Scene, like: TransmittanceMap | None = None, field: int | None = None) -> MapModel:
    """Take ranges and functions of a map, or, for bases that need no light rays, those of the scene.

    ``field``: which of the scene's; without, that of the map, or the first.
    """
    number = int(getattr(like, "field_index", 0)) if field is None else field
    fields = fields_of(scene)
    weights = fields.weights[:, :, number : number + 1]
    if like is not None:
        assert like.functions is not None  # noqa: S101 - a basis that is a sum of functions
        return MapModel(like.settings, like.functions, like.field.astype(float), like.extinction, weights)
    settings = resolve(with_numbers(scene).map)
    settings = settings.replace(density_weighting=density_weighting(scene, number))
    make = BASES[settings.basis].functions
    if make is None or BASES[settings.basis].learns(settings) or settings.range != "box":
        raise SceneError(f"the reference needs a map to compare with for basis '{settings.basis}'")
    extinction = float(fields.extinctions[number])
    return MapModel(settings, make(settings, None), np.zeros((1, 1, 4)), extinction, weights)


def density_weighting(scene: Scene, field: int = 0) -> float:
    """α of TFM eq. 19; ``"auto"``: half the largest optical depth seen by a light, between 1 and 16.

    Of the medium that is, in the colour that the field extinguishes most.
    """
    if scene.map.density_weighting != "auto":
        return float(scene.map.density_weighting)
    scene, fields = with_numbers(scene), fields_of(scene)
    sigma_t, deepest = float(fields.rgb_from_field[:, field].max()), 0.0
    weights = fields.weights[:, :, field : field + 1]
    for light in lights_of(scene):
        rays = texel_rays(light, AUTO_RES)
        begin, end = march_bounds(scene.marched, *rays, margin=margin_of(scene))
        if scene.solids:
            end = np.clip(clip(scene, light, AUTO_RES), begin, end)
        depths = optical_depths(scene.marched, weights, rays, (begin, end), decided(scene.map.steps))
        deepest = max(deepest, float(depths.max()))
    # α divides the density's optical depth, but the limits are meant for the medium's.
    return max(1.0, float(np.clip(sigma_t * deepest / 2, 1, 16)) / sigma_t) if sigma_t > 0 else 1.0


def bilinear(grid: Floats, positions: Floats) -> Floats:
    """Interpolate ``[size, size, numbers]`` between its entries' centres, at ``[points, 2]`` in [0, 1]²."""
    return sum(weight * grid[y, x] for x, y, weight in geometry.corners(len(grid), positions))  # type: ignore[return-value]


def _steps_of_rays(model: MapModel, positions: Floats) -> Integers:
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
    steps: Integers = -(-settings.steps * level // 8)
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


def _in_steps(scene: Scene, model: MapModel) -> tuple[list[MarchedBody], Floats]:
    """Pick what is gathered step by step, and its weights."""
    if model.settings.deposits == "steps":
        return [*scene.marched], model.weights
    these = [i for i, body in enumerate(scene.marched) if not isinstance(body, Primitives)]
    return [scene.marched[i] for i in these], model.weights[these]


def _of_primitives(
    scene: Scene, model: MapModel, rays: Rays, begin: Floats, reach: Floats, end: Floats
) -> Floats:
    """Sum what primitives add to the numbers of rays at their own depths (FOM eq. 5-6), ``[rays, n]``.

    The functionals at a depth are those of one of so many steps that which one makes no difference.
    """
    rows = model.functions.analysis(OWN_DEPTHS)
    if model.settings.target == "optical-depth":
        rows = rows[::-1].cumsum(axis=0)[::-1]
    numbers = np.zeros((len(begin), rows.shape[1]))
    for body, weight in zip(scene.marched, model.weights, strict=True):
        if isinstance(body, Primitives):
            ray, distance, channels = meet(body, rays).whole()
            there = (distance >= begin[ray]) & (distance < reach[ray])
            ray, distance, channels = ray[there], distance[there], channels[there]
            v = (distance - begin[ray]) / (end - begin)[ray]
            held = channels @ weight[: channels.shape[-1]]
            np.add.at(numbers, ray, held * rows[(v * OWN_DEPTHS).astype(int)])
    return numbers


def build_map(
    scene: Scene, light: Light, like: TransmittanceMap | None = None, field: int | None = None
) -> Floats:
    """Numbers ``[y, x, n]`` of the texels' rays (TFM Alg. 2 as corrected; `kernels/map/projection.h`).

    Behind the step in which solids end what is lit, the transmittance stays as it is there. ``like`` and
    ``field`` as of `map_model`.
    """
    light = fitted(scene, light, like)
    model = map_model(scene, like, field).of_light(light)
    res, positions = model.settings.res, texel_positions(model.settings.res)
    numbers = np.zeros((res * res, model.settings.coeffs))
    counts = _steps_of_rays(model, positions)
    reach = clip(scene, light, res) if scene.solids else np.full(res * res, np.inf)
    for steps in np.unique(counts):
        these = np.flatnonzero(counts == steps)
        for part in np.array_split(these, 1 + len(these) // geometry.CHUNK):
            rays = map_rays(light, positions[part])
            begin, end = march_bounds(scene.marched, *rays, margin=margin_of(scene, like))
            if model.settings.range != "box":
                begin, end = bilinear(model.field, positions[part])[:, :2].T
            boundaries, samples = edges(begin, end, int(steps))
            marched, weights = _in_steps(scene, model)
            depth = step_depths(marched, weights, rays, boundaries, samples)[..., 0]
            lit = np.maximum(reach[part], boundaries[:, 0])  # the first step is always taken
            depth[boundaries[:, :-1] > lit[:, None]] = 0
            numbers[part] = _numbers(model, depth)
            if model.settings.deposits == "depth":
                numbers[part] += _of_primitives(scene, model, rays, begin, np.minimum(end, reach[part]), end)
            numbers[part[end <= begin]] = 0  # a ray that misses the medium stays clear
    if model.settings.target == "transmittance" and _has_one(model):
        numbers = np.eye(1, numbers.shape[1]) - numbers  # of f instead of 1 - f
    return numbers.reshape(res, res, -1)


def map_optical_depth(
    scene: Scene,
    light: Light,
    coefficients: Floats,
    points: Floats,
    like: TransmittanceMap | None = None,
    field: int | None = None,
) -> Floats:
    """Look the optical depth ``[points]`` up in a map, over the range of the point's own light ray."""
    if like is None:
        scene = scene.replace(map=scene.map.replace(coeffs=coefficients.shape[-1]))
    model = map_model(scene, like, field).of_light(light)
    rays, (_, distance, positions, *_) = light_rays(fitted(scene, light, like), points)
    begin, end = march_bounds(scene.marched, *rays, margin=margin_of(scene, like))
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
    if model.settings.between_texels == "reconstruct":
        for x, y, weight in geometry.corners(len(coefficients), positions):
            tau += weight[:, 0] * reconstructed(coefficients[y, x])
    else:
        tau += reconstructed(bilinear(coefficients, positions))
    hit &= (np.abs(positions - 0.5) < 0.5 + EDGE_MARGIN).all(axis=-1)
    return np.where(hit, tau + beyond, 0)
