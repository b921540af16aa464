"""The picture and its layers: scattering (TFM algorithm 1, section 4.2), surfaces, ambient light."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from tfm_cl.constants import OCTAVE_LEAST_THROUGH
from tfm_cl.device.margins import grown
from tfm_cl.errors import SceneError
from tfm_cl.maps.resolved import resolve
from tfm_cl.maps.transmittance_map import grain_of
from tfm_cl.model import decided
from tfm_cl.plan import emission
from tfm_cl.plan.orders import check, scatters_again
from tfm_cl.reference import geometry
from tfm_cl.reference.bodies import Matter
from tfm_cl.reference.emission import EmittedLight
from tfm_cl.reference.fitting import lights_of, margin_of, with_numbers
from tfm_cl.reference.geometry import FAR, Floats, Rays, intersection
from tfm_cl.reference.light import (
    Brought,
    arriving,
    light_depth,
    light_transmittance,
    marched_depths,
    nearest_distance,
)
from tfm_cl.reference.maps import build_map, density_weighting, map_optical_depth
from tfm_cl.reference.march import (
    Crossing,
    boxed_depth,
    crossing_of,
    emitted,
    homogeneous_depth,
    march,
    mean_distance,
    scattered,
    scattered_light,
    segments,
)
from tfm_cl.reference.orders import LaterOrders
from tfm_cl.reference.primitives import bounds_of
from tfm_cl.reference.solids import Obstacles, Shadows, Surfaces
from tfm_cl.scene.bodies.thin import thickness_of
from tfm_cl.scene.fields import fields_of
from tfm_cl.scene.lights.base import names_of

if TYPE_CHECKING:
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene

Method = Literal["tfm", "dual"]
Crop = tuple[int, int, int, int]
BY_EMISSION = "emission_light"
"""The layer of what media scatter and solids reflect of what media emit."""


def camera_rays(camera: Camera, crop: Crop | None = None) -> Rays:
    """Rays through the pixels' centres, row by row, the top one first."""
    return Rays(*camera.rays(crop))


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

    Parts of the picture are ``ambient``, ``light.NAME`` of each light and, where media emit light, light
    their surroundings by it, or scatter again and again, ``emission``, ``emission_light`` and ``orders``.

    Parameters
    ----------
    scene
        What to render. Lights of several parts are the sum of these. ``map.storage`` is not imitated.
    method
        Instead of ``scene.march.method``.
    crop
        Pixels x0, y0, x1, y1 (end excluded) of the frame.
    maps
        Whose ranges and functions are to be taken, see `MapModel`: those of all fields for each part of each
        light, light 1 field 1, light 1 field 2, … light 2 field 1, …; needed for all but ranges ``box`` and
        bases without light rays.
    shadows
        Of solids in the medium, see `Shadows`; on solids they are always exact.

    Raises
    ------
    SceneError
        A texture or mesh that cannot be used, a crop not inside the frame, light from infinity in a medium
        that is everywhere, or another number of maps.
    """
    check(scene)
    scene = with_numbers(scene)
    lights = lights_of(scene)
    names = zip(names_of(scene.lights), scene.lights, strict=True)
    layers_of_lights = [f"light.{name}" for name, light in names for _ in light.parts()]
    layers_of_lights += [BY_EMISSION] * len(emission.numbers_of(lights))
    depths: Sequence[Callable[[Floats], Floats]]
    if (method or scene.march.method) == "dual":
        weights = fields_of(scene).weights
        depths = [partial(marched_depths, scene, light, weights=weights) for light in lights]
        biases = [thickness_of(scene.primitives)] * len(lights)
    else:
        depths = _map_depths(scene, lights, maps)
        biases = _biases(scene, lights, maps)
    obstacles, matter = Obstacles(scene, shadows), Matter(scene, margin_of(scene))
    lit = [
        _Light(
            light,
            partial(arriving, light, nearest=nearest_distance(scene, light)),
            partial(light_transmittance, light=light, field_depths=field_depths),
            partial(light_depth, light=light, field_depths=field_depths),
            bias,
            layer,
        )
        for light, field_depths, bias, layer in zip(lights, depths, biases, layers_of_lights, strict=True)
    ]
    later = None
    if scatters_again(scene):
        later = LaterOrders(
            scene, [partial(_arrives, one, obstacles, scene) for one in lit], obstacles.tracer
        )
    at_samples, emitted_light = lit, None
    lattice = emission.lattice_of(scene).lattice if scene.emission_lights else None
    if lattice is not None:
        soft = set(emission.numbers_of(lights))
        at_samples = [one for i, one in enumerate(lit) if i not in soft]
        brought = [partial(_arrives, lit[i], obstacles, scene) for i in sorted(soft)]
        emitted_light = EmittedLight(scene.dark, lattice, brought)
    rays = camera_rays(scene.camera, crop)
    starts = range(0, len(rays.origins), geometry.CHUNK)
    chunks = [
        _trace(
            scene,
            matter,
            (lit, at_samples),
            obstacles,
            (later, emitted_light),
            rays.part(slice(first, first + geometry.CHUNK)),
        )
        for first in starts
    ]
    width, height = scene.camera.res if crop is None else (crop[2] - crop[0], crop[3] - crop[1])
    layers = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
    layers = {name: layer.reshape(height, width, *layer.shape[1:]) for name, layer in layers.items()}
    return layers.pop("image"), layers


class _Light(NamedTuple):
    """A single, fitted light, and what is asked of it at points ``[n, 3]``, each RGB."""

    light: Light
    arrives: Callable[[Floats], Floats]
    """Without bodies and solids."""
    transmittance: Callable[..., Floats]
    """What the bodies of a scene leave of it; the scene comes first."""
    depth: Callable[..., Floats]
    """The optical depth that is why; of other coefficients than the media's extinction, if any are given."""
    bias: float
    """World units, by which thin primitives are looked up nearer to it."""
    layer: str
    """What holds what it adds to the picture."""


def _biases(scene: Scene, lights: list[Light], maps: Sequence[TransmittanceMap] | None) -> list[float]:
    """Of lights with maps: the product's rule, see `TransmittanceMap.grain`."""
    own = thickness_of(scene.primitives)
    if own == 0:
        return [0.0] * len(lights)
    if maps:
        count = fields_of(scene).count
        return [own + maps[i * count].grain for i in range(len(lights))]
    settings, none = resolve(scene.map), np.zeros((1, 1, 4))
    return [own + grain_of(light, scene.marched, settings, none) for light in lights]


def _map_depths(
    scene: Scene, lights: list[Light], maps: Sequence[TransmittanceMap] | None
) -> list[Callable[[Floats], Floats]]:
    """Build each light's maps; return what looks its fields' optical depths ``[points, K]`` up in them."""
    fields = range(fields_of(scene).count)
    likes: Sequence[TransmittanceMap | None] = maps or [None] * (len(lights) * len(fields))
    if len(likes) != len(lights) * len(fields):
        raise SceneError(
            f"{len(likes)} maps to compare with, of {len(lights)} lights and {len(fields)} fields"
        )
    # α once for all lights and points; of maps to compare with it is theirs.
    scenes = [
        scene.replace(map=scene.map.replace(density_weighting=density_weighting(scene, field)))
        if maps is None
        else scene
        for field in fields
    ]

    def depths_of(light: Light, of_fields: Sequence[TransmittanceMap | None]) -> Callable[[Floats], Floats]:
        looked_up = [
            partial(
                map_optical_depth,
                scenes[field],
                light,
                build_map(scenes[field], light, like, field),
                like=like,
                field=field,
            )
            for field, like in zip(fields, of_fields, strict=True)
        ]

        def depths(points: Floats) -> Floats:
            found = np.zeros((len(points), len(looked_up)))
            for field, look_up in enumerate(looked_up):
                found[:, field] = look_up(points=points)
            return found

        return depths

    count = len(fields)
    return [depths_of(light, likes[i * count : (i + 1) * count]) for i, light in enumerate(lights)]


def _arrives(light: _Light, obstacles: Obstacles, scene: Scene, points: Floats) -> Brought:
    """Return what arrives of a light at points ``[n, 3]`` of a scene."""
    visible = light.arrives(points) * obstacles.visibility(light.light, points)[:, None]
    visible *= light.light.reaches(points)[:, None]
    transmittance = np.broadcast_to(light.transmittance(scene, points=points), visible.shape)
    depth_of = partial(light.depth, scene, points=points)
    direction = light.light.arrival(points).direction
    return Brought(visible, transmittance, direction, depth_of, light.light.spread)


def _trace(
    scene: Scene,
    matter: Matter,
    of_lights: tuple[list[_Light], list[_Light]],
    obstacles: Obstacles,
    on_lattices: tuple[LaterOrders | None, EmittedLight | None],
    rays: Rays,
) -> dict[str, Floats]:
    """All layers of some camera rays; ``of_lights``: all, and those that samples look up."""
    (lights, at_samples), (later, emitted_light) = of_lights, on_lattices
    surfaces = obstacles.surfaces(rays)
    crossing = crossing_of(matter, rays, surfaces.distance, scene.march.cutoff)
    seen = _seen(scene, matter, rays, crossing, lights)
    everywhere = np.asarray(scene.ambient.radiance)
    parts = {"ambient": everywhere * (seen.scattered + surfaces.albedo * seen.transmittance)}
    if scene.emits:
        parts["emission"] = seen.emitted
    parts |= {light.layer: np.zeros_like(seen.emitted) for light in lights}
    reached, weight = np.zeros_like(seen.emitted), np.zeros((len(seen.emitted), 1))
    for light in lights:
        parts[light.layer] += _reflected(scene, matter, light, obstacles, rays, crossing, surfaces, seen)
    dark, of_dark, dark_crossing = scene, matter, crossing
    if scene.flames and not scene.primitives:  # which the product's samples of lights do not meet
        dark = scene.dark
        of_dark = Matter(dark, margin_of(dark))
        dark_crossing = crossing_of(of_dark, rays, surfaces.distance, scene.march.cutoff)
    for light in at_samples:
        from_bodies, transmitted, opacity = _scattered(dark, of_dark, light, obstacles, rays, dark_crossing)
        parts[light.layer] += from_bodies
        reached += transmitted
        weight += opacity
    if emitted_light is not None:
        parts[BY_EMISSION] += _lit_by_emission(scene.dark, emitted_light, rays, surfaces.distance)
    if later is not None:
        parts["orders"] = _scattered_again(later, matter, rays, crossing, decided(scene.march.steps))
    radiance: Floats = np.sum([*parts.values()], axis=0)
    shows_solid = np.isfinite(surfaces.distance) & ~surfaces.holdout
    hazy = 1 - scene.camera.seen_of(np.where(shows_solid, surfaces.distance, 0))
    left = seen.transmittance.mean(axis=-1) * np.where(shows_solid, hazy, 1)
    return {
        "image": np.column_stack([radiance, 1 - left]),
        "depth": seen.depth,
        "transmittance": seen.transmittance,
        "light_transmittance": np.divide(reached, weight, out=np.zeros_like(reached), where=weight > 0),
        **parts,
    }


class _Seen(NamedTuple):
    """What the camera sees of the bodies, whatever the lights."""

    transmittance: Floats
    """``[rays, RGB]`` of whole rays, up to solids."""
    depth: Floats
    """``[rays]``: mean distance, weighted by the opacity, of which that of all colours counts."""
    scattered: Floats
    """``[rays, RGB]`` of the light that a medium in the same light from everywhere sends to the camera."""
    emitted: Floats
    """``[rays, RGB]``: what the bodies send to the camera by themselves."""


def _steps_of_camera(scene: Scene, matter: Matter, lights: list[_Light]) -> Callable[[Floats], Floats] | None:
    """Return the depth in whose projective space the camera's steps are even, or None: in the world.

    The product's rule: where there are but primitives, the steps of the only light serve if it reaches them
    all.
    """
    alone = len(matter.primitives) == len(matter.marched) > 0 and not matter.homogeneous
    if not alone or len(lights) != 1 or scene.march.sampling != "projective":
        return None
    light, box = lights[0].light, grown(bounds_of(matter.primitives), matter.margin)
    return light.projective_depth if light.reaches_all_of(box) else None


def _seen(scene: Scene, matter: Matter, rays: Rays, crossing: Crossing, lights: list[_Light]) -> _Seen:
    steps, count = decided(scene.march.steps), len(rays.origins)
    nothing, endless = np.zeros(count), np.full(count, FAR)
    depth = boxed_depth(matter, rays, crossing, nothing, endless, steps)
    depth += homogeneous_depth(matter, crossing, nothing, endless)
    transmittance = np.exp(-depth)
    distance, opacity = np.zeros(count), np.zeros(count)
    scatters, emits = np.zeros((count, 3)), np.zeros((count, 3))
    warp, parts = _steps_of_camera(scene, matter, lights), segments(crossing, crossing.medium, steps)
    through = np.ones((count, 3))
    for step in march(matter, rays, crossing, parts, through, warp, scene.march.max_stretch):
        distance[step.rays] += (step.opacity * step.mean).mean(axis=-1)
        opacity[step.rays] += step.opacity.mean(axis=-1)
        scatters[step.rays] += step.opacity * scattered(matter, step)
        emits[step.rays] += through[step.rays] * emitted(matter, step)
    albedo = matter.albedo
    if (albedo == albedo[0]).all():  # eq. 7
        scatters = albedo[0] * -np.expm1(-depth)
    if all((sigma == sigma[0]).all() for sigma in (matter.emission, matter.sigma_t)):
        sigma_t = np.where(matter.sigma_t[0] > 0, matter.sigma_t[0], 1)
        whole = matter.emission[0] / sigma_t * -np.expm1(-depth)
        emits = np.where(matter.sigma_t[0] > 0, whole, emits)
    if not matter.marched and len(matter.homogeneous) == 1:  # in closed form
        ((begin, end),) = crossing.inside
        extinction, length = matter.extinctions, (end - begin)[:, None]
        opacities = -np.expm1(-depth)
        distance = (opacities * (begin[:, None] + mean_distance(extinction, length))).sum(axis=-1)
        opacity = opacities.sum(axis=-1)
    mean = np.divide(distance, opacity, out=np.zeros_like(opacity), where=opacity > 0)
    return _Seen(transmittance, mean, scatters, emits)


def _scattered(
    scene: Scene, matter: Matter, light: _Light, obstacles: Obstacles, rays: Rays, crossing: Crossing
) -> tuple[Floats, Floats, Floats]:
    """Of one light: RGB that bodies scatter to the camera, and its transmittance RGB by opacity, and that."""
    settings, count = scene.march, len(rays.origins)
    radiance, reached, seen = (np.zeros((count, channels)) for channels in (3, 3, 1))
    begin, end = intersection(crossing.medium, light.light.interval(*rays))
    lit = np.flatnonzero(end > begin)
    rays, crossing, begin, end = rays.part(lit), crossing.part(lit), begin[lit], end[lit]
    through = np.ones((len(lit), 3))
    if settings.attenuation != "paper":
        # What lies between the camera and the cone is dark, but hides what is behind.
        nothing = np.zeros_like(begin)
        through = np.exp(
            -boxed_depth(matter, rays, crossing, nothing, begin, decided(settings.steps))
            - homogeneous_depth(matter, crossing, nothing, begin)
        )
    ray_depth = _depth_for_octaves(scene, matter, rays, crossing)
    warp = light.light.projective_depth if settings.sampling == "projective" else None
    parts = segments(crossing, (begin, end), decided(settings.steps))
    for step in march(matter, rays, crossing, parts, through, warp, settings.max_stretch):
        part, pixels = rays.part(step.rays), lit[step.rays]
        points = part.at(step.lit)
        arrival = light.light.arrival(points)
        ways = arrival.direction, -part.directions
        before = np.minimum(
            light.bias * step.thin, np.maximum(arrival.distance, 0)
        )  # what is thin does not shade itself
        transmitted = light.transmittance(scene, points=points - before[:, None] * arrival.direction)
        visible = obstacles.visibility(light.light, points)[:, None]
        found = scattered_light(matter, step, ways, transmitted, light.light.spread, ray_depth[step.rays])
        source = found * light.arrives(points)
        opacity = step.opacity.mean(axis=-1, keepdims=True)
        radiance[pixels] += step.opacity * source * visible
        reached[pixels] += opacity * transmitted * visible
        seen[pixels] += opacity
    return radiance, reached, seen


def _depth_for_octaves(scene: Scene, matter: Matter, rays: Rays, crossing: Crossing) -> Floats:
    """Optical depth ``[rays, RGB]`` of whole rays, as far as octaves tell them apart."""
    nothing, endless = np.zeros(len(rays.origins)), np.full(len(rays.origins), FAR)
    depth = boxed_depth(matter, rays, crossing, nothing, endless, decided(scene.march.steps))
    depth += homogeneous_depth(matter, crossing, nothing, endless)
    deepest = -np.log(max(scene.march.cutoff, OCTAVE_LEAST_THROUGH))
    return np.asarray(np.minimum(depth, deepest), dtype=np.float64)


def _lit_by_emission(scene: Scene, light: EmittedLight, rays: Rays, limit: Floats) -> Floats:
    """RGB that bodies scatter to the camera, up to solids, of what media emit, ``[rays, 3]``."""
    matter, radiance = Matter(scene, margin_of(scene)), np.zeros((len(rays.origins), 3))
    crossing = crossing_of(matter, rays, limit, scene.march.cutoff)
    through, parts = np.ones_like(radiance), segments(crossing, crossing.medium, decided(scene.march.steps))
    for step in march(matter, rays, crossing, parts, through):
        points = rays.part(step.rays).at(step.distance)
        radiance[step.rays] += step.opacity * light.source(matter, step, points)
    return radiance


def _scattered_again(
    later: LaterOrders, matter: Matter, rays: Rays, crossing: Crossing, steps: int
) -> Floats:
    """RGB that all orders but the first scatter to the camera, ``[rays, 3]``."""
    radiance = np.zeros((len(rays.origins), 3))
    through, parts = np.ones_like(radiance), segments(crossing, crossing.medium, steps)
    for step in march(matter, rays, crossing, parts, through):
        points = rays.part(step.rays).at(step.distance)
        radiance[step.rays] += step.opacity * later.source(matter, step, points)
    return radiance


def _reflected(
    scene: Scene,
    matter: Matter,
    light: _Light,
    obstacles: Obstacles,
    rays: Rays,
    crossing: Crossing,
    surfaces: Surfaces,
    seen: _Seen,
) -> Floats:
    """RGB that solids reflect of one light to the camera, ``[rays, 3]``."""
    radiance = np.zeros((len(rays.origins), 3))
    shown = np.flatnonzero(np.isfinite(surfaces.distance))
    rays, crossing = rays.part(shown), crossing.part(shown)
    met = surfaces.part(shown)
    through = seen.transmittance[shown]
    if scene.march.attenuation == "paper":  # TFM's algorithm 1 dims only between the ends of the light's cone
        begin, end = intersection(crossing.medium, light.light.interval(*rays))
        through = np.exp(
            -boxed_depth(matter, rays, crossing, begin, end, decided(scene.march.steps))
            - homogeneous_depth(matter, crossing, begin, end)
        )
    points = rays.at(met.distance)
    cosine = obstacles.lights(light.light, points, met)
    arrives = cosine[:, None] * light.arrives(points) * light.transmittance(scene, points=points)
    radiance[shown] = met.albedo / np.pi * arrives * through
    return radiance
