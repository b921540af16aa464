"""The transmittance along the light ray that ends where a pixel shows something: T(z), mapped and marched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import InputError
from tfm_cl.reference.bodies import body_interval
from tfm_cl.reference.fitting import map_bounds
from tfm_cl.scene.fields import fields_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.bodies.homogeneous import Homogeneous
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.viewer.renderer import ReadFrame

Floats = NDArray[np.float64]

POINTS = 384
"""Of a curve."""
STEPS_OF_DETAIL = 4
"""Steps of the march for each voxel."""
MOST_STEPS = 64
"""Of the march between two points of a curve."""
AROUND = 0.04
"""Part of the medium's length on the ray that is shown before and behind it."""
ENDLESS = 2.0
"""Distances of the point that are shown of what has no end."""
DARKEST = 1e-30
"""Texture of a light where it is black: what is left of its light is known all the same."""
DIGITS = 6
"""Of the numbers in a message: as many as float32 has."""
NEAR = 1e-3
"""Of a curve's length: what lies as near to a solid lies on its surface; so far from its light it begins."""
GREY = 1e-9
"""By how much the colours of a grey transmittance differ, at most."""


class Renderer(Protocol):
    """What is asked of `tfm_cl.render.renderer.Renderer`."""

    def maps_of(self, scene: Scene, light: int, part: int = 0) -> list[TransmittanceMap]:
        """Return the maps that pictures of a scene have of one light."""

    def tracer(self, scene: Scene) -> Tracer | None:
        """Return the solids of a scene, ready for rays."""


@dataclass(frozen=True, eq=False)
class Curve:
    """T(z) along a light ray."""

    light: int
    """Number of the light, from 0."""
    lines: tuple[str, ...]
    """What is shown, or why there is nothing."""
    point: tuple[float, float, float] | None = None
    """What the pixel shows, world; None where it shows nothing."""
    z_point: float | None = None
    """Its distance along the ray; None where no ray of the light ends there."""
    z: Floats | None = None
    """[n], distances, world units: from the light or, for light from infinity, from before everything."""
    of_map: Floats | None = None
    """[n, RGB], of the light's map, as the picture looks it up."""
    marched: Floats | None = None
    """[n, RGB], in fine steps in float64. In both, solids and what is homogeneous are exact."""

    def to_dict(self) -> dict[str, Any]:
        """Return the message to a page: colours one after the other, or one for all where they are equal."""
        point = None if self.point is None else list(self.point)
        message = {"type": "curve", "light": self.light, "point": point, "z_point": self.z_point}
        if self.z is None or self.of_map is None or self.marched is None:
            return message | {"z": [], "map": [], "marched": [], "lines": list(self.lines)}
        channels = 1 if np.ptp(self.marched, axis=1).max(initial=0.0) < GREY else 3
        found = {"map": self.of_map, "marched": self.marched}
        colours = {name: [_numbers(of[:, c]) for c in range(channels)] for name, of in found.items()}
        return message | {"z": _numbers(self.z), **colours, "lines": list(self.lines)}


def curve_at(
    renderer: Renderer, read: ReadFrame, depth: NDArray[np.float32], x: float, y: float, light: int
) -> Curve:
    """Follow the light to what a pixel shows, and beyond.

    Of a light that is the sum of several, as one with a radius or a sky, it is the one that brings most to
    that point. Solids end both curves where they stand.

    Parameters
    ----------
    renderer
        That rendered the picture: the maps are there.
    read
        The picture's frame.
    depth
        [H, W], distances of what its pixels show: `tfm_cl.viewer.pictures.seen_depth`.
    x, y
        Place in the picture, from 0 to 1, from its upper left corner.
    light
        Number of the light, from 0.

    Raises
    ------
    InputError
        No such light, or a place outside the picture.
    SceneError, DeviceError
        As of `Renderer.maps_of`.
    """
    scene = read.scene
    if not 0 <= light < len(scene.lights):
        raise InputError(f"light {light}: the scene has {len(scene.lights)}, counted from 0")
    if not (0 <= x <= 1 and 0 <= y <= 1):
        raise InputError(f"pick {x:g}, {y:g}: a place in the picture is from 0 to 1, from its upper left")
    point = _point(scene.camera, read.file.image.crop, depth, x, y)
    if point is None:
        return Curve(light, ("nothing is seen there: the camera's ray meets no medium and no solid",))
    place = (float(point[0]), float(point[1]), float(point[2]))
    parts = scene.lights[light].parts()
    name = f"light {light + 1} ({scene.lights[light].type})"
    brought = [_brought(_fitted(scene, part), point) for part in parts]
    number = int(np.argmax(brought)) if brought else 0
    if not brought or brought[number] <= 0:
        return Curve(light, (f"{name} does not reach this point: it is outside its cone or reach",), place)
    ray = _Ray.through(_fitted(scene, parts[number]), point)
    maps = renderer.maps_of(scene, light, number)
    end = _lit_until(renderer.tracer(scene), ray)
    z = _distances(scene, ray, end)
    lit = (z <= end + NEAR * (z[-1] - z[0]))[:, None]
    of_map = _looked_up(scene, ray, z, maps) * lit
    marched = _marched(scene, ray, z) * lit
    lines = _told(name, number, len(parts), ray, z, of_map, marched, end)
    return Curve(light, lines, place, ray.distance, z, of_map, marched)


class _Ray(NamedTuple):
    """A light's ray."""

    light: Light
    """Single, and fitted."""
    origin: Floats
    direction: Floats
    distance: float
    """Of the point that it was sent through."""

    @classmethod
    def through(cls, light: Light, point: Floats) -> _Ray:
        arrival, origin = light.arrival(point[None]), light.begins(point[None])[0]
        direction, distance = arrival.direction[0], float(arrival.distance[0])
        if distance < 0:  # a solid that a sun meets before all media
            origin, distance = point + ENDLESS * distance * direction, -ENDLESS * distance
        return cls(light, origin, direction, distance)

    def at(self, distances: Floats) -> Floats:
        points: Floats = self.origin + distances[:, None] * self.direction
        return points


def _point(
    camera: Camera,
    crop: tuple[int, int, int, int] | None,
    depth: NDArray[np.float32],
    x: float,
    y: float,
) -> Floats | None:
    """World position of what a pixel shows."""
    height, width = depth.shape
    column, row = min(int(x * width), width - 1), min(int(y * height), height - 1)
    distance = float(depth[row, column])
    if not (np.isfinite(distance) and distance > 0):
        return None
    # Pictures of another size show the whole frame.
    x0, y0, x1, y1 = (0, 0, *camera.res)
    if crop is not None and (width, height) == (crop[2] - crop[0], crop[3] - crop[1]):
        x0, y0, x1, y1 = crop
    across = np.array([x0 + (column + 0.5) * (x1 - x0) / width])
    down = np.array([y0 + (row + 0.5) * (y1 - y0) / height])
    origins, directions = camera.rays_through(across, down)
    point: Floats = origins[0] + distance * directions[0]
    return point


def _fitted(scene: Scene, light: Light) -> Light:
    """Return a single light whose rays are known: those of a sun begin before everything."""
    if light.needs_fitting and np.isfinite(scene.bounds).all():
        return light.fitted(map_bounds(scene), scene.occupied_bounds)
    return light


def _brought(light: Light, point: Floats) -> float:
    """How much a single light brings to a point, were nothing in its way; as for a lamp where it is off."""
    if light.needs_fitting or not light.reaches(point[None])[0]:
        return 0.0
    arrival = light.arrival(point[None])
    colour = float(light.intensity_at(arrival.texture).max()) if any(light.intensity) else 1.0
    return float(arrival.strength[0]) * max(colour, DARKEST) if arrival.direction.any() else 0.0


def _distances(scene: Scene, ray: _Ray, end: float) -> Floats:
    """Choose where a ray is followed: what has density on it, the point, and what keeps the light off."""
    met = [body.interval(ray.origin, ray.direction) for body in scene.marched]
    for body in scene.homogeneous:
        enters, leaves = _interval(body, ray)
        is_endless = not np.isfinite(body.bounds).all()
        met.append((enters, ENDLESS * ray.distance if is_endless else leaves))
    met = [(low, high) for low, high in met if low < high]
    reach = getattr(ray.light, "reach", None) or np.inf
    low = min([ray.distance, *(low for low, _ in met), *[end] * (end > 0)]) if met else 0.0
    high = max([ray.distance, *(high for _, high in met)])
    margin = AROUND * (high - low)
    # A lamp itself is on no ray of its map.
    first = NEAR * high if np.isfinite(ray.light.source_distance(ray.origin[None])[0]) else 0.0
    even = np.linspace(max(low - margin, first), min(high + margin, reach), POINTS - 1)
    return np.sort(np.append(even, ray.distance))


def _looked_up(scene: Scene, ray: _Ray, z: Floats, maps: Sequence[TransmittanceMap]) -> Floats:
    """RGB that media leave of the light at distances, [n, 3]: of fields as a light's maps have them."""
    points, found = ray.at(z), _through_homogeneous(scene, ray, z)
    for light_map, extinction in zip(maps, fields_of(scene).rgb_from_field.T, strict=True):
        found *= light_map.evaluate(points, extinction)
    return found


def _marched(scene: Scene, ray: _Ray, z: Floats) -> Floats:
    """RGB that media leave of the light at distances, [n, 3]."""
    fields = fields_of(scene)
    depths = np.zeros((len(z), fields.count))
    if scene.marched:
        ends = np.concatenate([[0.0], z])
        steps = _steps(scene, z)
        edges = np.interp(np.arange(steps * len(z) + 1) / steps, np.arange(len(ends)), ends)
        along = fields.depths_along(scene.marched, ray.origin, ray.direction, edges)
        depths = np.cumsum(along, axis=0)[steps - 1 :: steps]
    return np.exp(-depths @ fields.rgb_from_field.T) * _through_homogeneous(scene, ray, z)


def _through_homogeneous(scene: Scene, ray: _Ray, z: Floats) -> Floats:
    """RGB that bodies of constant density leave of the light at distances, [n, 3]."""
    depth = np.zeros((len(z), 3))
    for body in scene.homogeneous:
        enters, leaves = _interval(body, ray)
        depth += np.outer(np.clip(z, enters, leaves) - enters, body.density * scene.medium_of(body).sigma_t)
    return np.exp(-depth)


def _interval(body: Homogeneous, ray: _Ray) -> tuple[float, float]:
    """Where a ray enters and leaves a body of constant density."""
    enters, leaves = body_interval(body, ray.origin[None], ray.direction[None])
    return float(enters[0]), float(leaves[0])


def _steps(scene: Scene, z: Floats) -> int:
    """Count the steps between two points; what primitives hold there is known in closed form."""
    detail = min((grid.detail for grid in scene.grids), default=np.inf)
    return int(np.clip(np.ceil(STEPS_OF_DETAIL * np.diff(z).max() / detail), 1, MOST_STEPS))


def _lit_until(tracer: Tracer | None, ray: _Ray) -> float:
    """Distance of the first solid on a ray; infinite without, and < 0 where one stands before it begins."""
    if tracer is None:
        return np.inf
    if np.isinf(ray.light.source_distance(ray.origin[None])[0]):
        before = tracer.occluded(ray.origin, -ray.direction, np.inf)[0]
        if before:
            return -np.inf
    return float(tracer.distances(ray.origin, ray.direction)[0])


def _told(
    name: str, number: int, count: int, ray: _Ray, z: Floats, of_map: Floats, marched: Floats, end: float
) -> tuple[str, ...]:
    """Say what is shown, for people."""
    part = f", part {number + 1} of {count}, which brings most to this point" if count > 1 else ""
    there = int(np.searchsorted(z, ray.distance))
    lines = [
        f"{name}{part}",
        f"at this point T = {marched[there].mean():.3f} marched, {of_map[there].mean():.3f} in the map",
    ]
    if end <= z[-1]:
        lines.append(f"a solid ends the light at z = {end:.4g}" if end > 0 else "a solid keeps all light off")
    return tuple(lines)


def _numbers(values: Floats) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]
