"""How the later orders of scattering are found: ``medium.orders``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.plan.lobes import beyond, far_moments, lobes_of, quadrature
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfm_cl.plan.lobes import Lobe
    from tfm_cl.scene.bodies.homogeneous import Homogeneous
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

DIRECTIONS = 32
"""In which light goes through the lattice at each order."""
DIRECTIONS_OF_EMISSION = 128, 1024
"""Fewest and most before the first, where it is scattered evenly: from what is small it goes far."""
OF_SMALL_FLAMES = 0.5 * math.pi
"""Directions, times the square of the region's radius over a flame's: 1.5 % beside many more (measured)."""
DIRECTIONS_FROM_SOLIDS = 64
"""Of the first order, and before it, where there are solids: lights may shine on small parts of them."""
PAST_SOLIDS = 433
"""The turn of a lobe's directions where there are solids. As they are, a quarter of them by weight lies in
surfaces along the axes, which then reflect 4 % too little; so turned, these reflect all but 0.2 %, and no
direction is nearer to them than 2.8°. Of such turns one with which fog over a floor, and around a ball, is
within 2 and 3 % of what a path tracer has; with others within 4."""
VOXELS_APART = 2.0
"""Distance between points, in voxels, at most, as long as they are not too many."""
OF_SMALLEST_BODY = 1 / 48
"""The same, in parts of the shortest edge of a body of constant density."""
FEWEST_ACROSS = 4
"""Points along that edge, where as many as that would take too long."""
OF_BODIES = 4.0
"""How much more work than that of voxels is too long."""
WORK, WORK_OF_LOBE = 1 << 22, 1 << 21
"""Points times orders after the first, from which on points are further apart than voxels."""
MOST_POINTS = 1 << 22
"""Of a lattice: their distance grows with what is larger."""
MOST_BYTES = 3 << 29
"""Of a lattice where scattering has a lobe, if its light has three colours."""
MOST_PAD = 34
"""Numbers before and behind each row of points, for 16 lanes."""
FEWEST_SAMPLES = 4
"""Of the density along an edge of a point's cube, where it is no grid's."""
MOST_SAMPLES = 4
"""Of the density along an edge of a point's cube: where points are far apart, the rest is left to chance."""
SAMPLES = 1 << 26
"""Of all cubes together, from which on there are fewer in each."""
FREE_PATHS = 2.0
"""By which the lattice reaches beyond what bounds it in a medium that is everywhere, if that is near."""
LARGEST_REACH = 0.5
"""The same, at most, in parts of the longest edge of that."""
FARTHER = 1.05
"""Factor of the distance between points as long as they are too many."""
TINY = 1e-300
"""More than what scatters nothing."""
SAME = 1e-6
"""Of a distance: what is nearer counts as there."""
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


class Lattice(NamedTuple):
    """The points at which light is scattered again and again, in equal distances along the world's axes."""

    origin: tuple[float, float, float]
    """World, of the first point."""
    spacing: float
    """World units."""
    size: tuple[int, int, int]
    """Points along x, y, z."""
    samples: int
    """Of the density, along each edge of the cube around a point."""
    why: str

    @property
    def points(self) -> int:
        """Their number."""
        return math.prod(self.size)

    def positions(self, numbers: NDArray[np.integer]) -> NDArray[np.float64]:
        """World positions [n, 3] of points of these numbers, x first."""
        z, y, x = np.unravel_index(numbers, self.size[::-1])
        found: NDArray[np.float64] = np.asarray(self.origin) + self.spacing * np.stack([x, y, z], axis=1)
        return found


class OnLattice(NamedTuple):
    """Whether lights are looked up at such points, and at which."""

    lattice: Lattice | None
    why: str


def serves_no_lattice(scene: Scene) -> str:
    """Return why lights are looked up at every sample of a scene; nothing where points may serve."""
    if scene.primitives:
        return "points, curves and polygons are finer than a lattice"
    if not np.isfinite(scene.bounds).all():
        return "a medium that is everywhere has no lattice"
    if scene.march.attenuation == "paper":
        return 'march.attenuation = "paper" knows samples only'
    return ""


def orders_of(scene: Scene) -> int:
    """Return how often light is scattered, at most."""
    return max(scene.medium_of(body).orders for body in scene.bodies)


def media_of(scene: Scene) -> tuple[Medium, ...]:
    """Return what scatters, each medium once, in the order in which kernels know them: flames come after."""
    return tuple(dict.fromkeys(scene.medium_of(body) for body in scene.bodies))


def lobes(scene: Scene) -> list[Lobe]:
    """Return what is known of the phase function of each of the `media_of` a scene."""
    return lobes_of([medium.phase for medium in media_of(scene)])


def swept_media(scene: Scene) -> tuple[Medium, ...]:
    """Return the media of a scene, flames too, with that emission only which is swept through the lattice.

    What is taken for lights (`medium.emission_lights`) arrives as any light does.
    """
    return tuple(medium.dark if medium.emission_lights else medium for medium in scene.media)


def sweeps_emission(scene: Scene) -> bool:
    """Tell whether light that media emit is swept through the lattice, and scattered there."""
    return any(any(medium.sigma_s) for medium in media_of(scene)) and any(
        medium.emits for medium in swept_media(scene)
    )


def scatters_again(scene: Scene) -> bool:
    """Tell whether there is a lattice, and light on it."""
    return orders_of(scene) > 1 and (scene.is_lit or sweeps_emission(scene))


def is_endless(scene: Scene) -> bool:
    """Tell whether any medium is everywhere."""
    return not np.isfinite(scene.bounds).all()


def check(scene: Scene) -> None:
    """Refuse what no lattice of later orders knows.

    Raises
    ------
    SceneError
        More than one order, and what is in its way.
    """
    orders = orders_of(scene)
    if orders > 1 and (why := next(_why_not(scene), "")):
        raise SceneError(f"medium.orders = {orders}: {why}; use medium.orders = 1")


def _why_not(scene: Scene) -> Iterator[str]:
    if octaves := max(medium.octaves for medium in media_of(scene)) - 1:
        yield f"another body has medium.octaves = {octaves + 1}, and both are multiple scattering"
    if scene.march.attenuation == "paper":
        yield 'march.attenuation = "paper" is for single scattering'
    if scene.map.max_error is not None:
        yield f"map.max_error = {scene.map.max_error:g} measures single scattering"


def region_of(scene: Scene) -> NDArray[np.float64]:
    """Return the world box [2, 3] in which light is scattered again.

    It is that of all bodies, and of flames that are swept. In a medium that is everywhere, it is that of the
    other bodies, the solids, and the spots' cones up to what they are aimed at, and somewhat more; beyond,
    light is extinguished only.
    """
    if not is_endless(scene):
        return around([scene.occupied_bounds, *_flames(scene)])
    endless = [body for body in scene.homogeneous if not np.isfinite(body.bounds).all()]
    boxes = [body.occupied_bounds for body in scene.bodies if np.isfinite(body.bounds).all()]
    boxes += _flames(scene)
    boxes += [box for solid in scene.solids if (box := solid.bounds()) is not None]
    boxes += [box for light in scene.lights for part in light.parts() if (box := _lit_by(part)) is not None]
    low, high = around(boxes)
    extinction = sum(body.density * float(scene.medium_of(body).sigma_t.mean()) for body in endless)
    longest = float((high - low).max())
    reach = FREE_PATHS / extinction if extinction > 0 else math.inf
    if longest > 0:
        reach = min(reach, LARGEST_REACH * longest)
    return np.stack([low - reach, high + reach])


def _flames(scene: Scene) -> list[NDArray[np.float64]]:
    """Return the world boxes [2, 3] around flames that are swept."""
    return [flame.occupied_bounds for flame in scene.flames if not scene.medium_of(flame).emission_lights]


def _lit_by(light: Light) -> NDArray[np.float64] | None:
    """Return the world box [2, 3] around a light and where it is aimed at; None of one from infinity."""
    if light.needs_fitting:
        return None
    from_ = np.asarray(getattr(light, "from_"))  # noqa: B009 - all that need no fitting have a place
    to, cone = getattr(light, "to", None), getattr(light, "cone", None)
    if to is None or cone is None:
        return np.stack([from_, from_])
    axis = np.subtract(to, from_)
    distance = float(np.linalg.norm(axis))
    # Of a disc: its extent along each axis of the world.
    across = distance * math.tan(math.radians(cone)) * np.sqrt(np.maximum(1 - (axis / distance) ** 2, 0))
    return np.stack([np.minimum(from_, to - across), np.maximum(from_, to + across)])


class _Work(NamedTuple):
    """What the orders take: points times orders after the first."""

    extent: NDArray[np.float64]
    """Edges of the lattice's box."""
    orders: int
    most: int

    def over(self, spacing: float) -> float:
        """Return how much more it is than it may be, as a factor."""
        return math.prod(points_along(self.extent, spacing)) * self.orders / self.most

    def farther(self, spacing: float, most: float, times: float = 1.0) -> float:
        """Return a distance of points that takes no more, so many times, if one up to ``most`` does."""
        while self.over(spacing) > times and spacing * FARTHER <= most:
            spacing *= FARTHER
        return spacing


def lattice_of(scene: Scene) -> Lattice:
    """Decide where the points lie."""
    low, high = region_of(scene)
    extent = np.maximum(high - low, 0.0)
    media, lobe = len(media_of(scene)), max(lobes(scene), key=lambda one: one.degree)
    work = _Work(extent, orders_of(scene) - 1, WORK_OF_LOBE if lobe.degree else WORK)
    wanted, why = _wanted(scene, work)
    spacing = wanted
    while math.prod(points_along(extent, spacing)) > MOST_POINTS:
        spacing *= FARTHER
    if spacing > wanted:
        why = f"as near as {MOST_POINTS:,} points allow"
    wanted = spacing
    while lobe.degree and bytes_of(points_along(extent, spacing), lobe, media) > MOST_BYTES:
        spacing *= FARTHER
    if spacing > wanted:
        why = f"as near as {MOST_BYTES / 2**30:g} GiB allow, at {numbers_of(lobe, media)} numbers a point"
    if is_endless(scene):
        box = " x ".join(f"{edge:.3g}" for edge in extent)
        why += f"; beyond a box of {box} what is everywhere scatters once only"
    size = points_along(extent, spacing)
    first = (low + high) / 2 - spacing * (np.array(size) - 1) / 2
    finest = min((grid.detail for grid in scene.grids), default=math.inf)
    samples = max(math.ceil(spacing / finest - SAME), FEWEST_SAMPLES if _bounded(scene) else 1)
    samples = min(samples, MOST_SAMPLES)
    while not scene.grids and samples > 1 and math.prod(size) * samples**3 > SAMPLES:
        samples -= 1
    x, y, z = first.tolist()
    return Lattice((x, y, z), spacing, size, samples, why)


def _bounded(scene: Scene) -> list[Homogeneous]:
    """Bodies of constant density that have an end."""
    return [body for body in scene.homogeneous if np.isfinite(body.bounds).all()]


def _wanted(scene: Scene, work: _Work) -> tuple[float, str]:
    """Return the distance of points that bodies ask for, and why."""
    spacing, why = math.inf, ""
    if scene.grids:
        spacing, why = min(grid.detail for grid in scene.grids), "as far apart as voxels"
        apart = min(max(work.over(spacing) ** (1 / 3), 1.0), VOXELS_APART)
        if apart > 1:
            spacing, why = apart * spacing, f"{apart:.2g} voxels apart: every order takes its time"
    edge = min((float((body.bounds[1] - body.bounds[0]).min()) for body in _bounded(scene)), default=math.inf)
    if OF_SMALLEST_BODY * edge < spacing:
        most = min(edge / FEWEST_ACROSS, spacing)
        spacing, why = OF_SMALLEST_BODY * edge, f"{1 / OF_SMALLEST_BODY:g} along the thinnest body"
        if work.over(spacing) > OF_BODIES:
            spacing = work.farther(spacing, most, OF_BODIES)
            why = f"{edge / spacing:.2g} along the thinnest body: every order takes its time"
    detail = min((body.detail for body in scene.primitives), default=math.inf)
    if detail < spacing:
        spacing, why = detail, "as near as points, curves and polygons have details"
        if work.over(spacing) > 1:
            spacing = work.farther(spacing, OF_SMALLEST_BODY * float(work.extent.max()))
            why = "as near as the time of every order allows"
    if is_endless(scene):
        widest = OF_SMALLEST_BODY * float(work.extent.max())
        if not math.isfinite(spacing):
            spacing, why = widest, f"{1 / OF_SMALLEST_BODY:g} along the longest edge"
        elif work.over(spacing) > 1:
            spacing = work.farther(spacing, max(spacing, widest))
            why = "as near as the time of every order allows"
    return spacing, why


def numbers_of(lobe: Lobe, media: int = 1) -> int:
    """Return how many numbers a point has of each colour, at most, where scattering has a lobe.

    Moments of lights, and of all orders; of each direction its radiance, and what is scattered, both twice of
    those along x, which are less than half; what each of several media scatters.
    """
    return 2 * lobe.harmonics + 3 * DIRECTIONS + (2 * media if media > 1 else 0)


def beyond_of_media(scene: Scene, spreads: Sequence[float], count: int | None = None) -> NDArray[np.float32]:
    """Return tables `beyond` ``[spreads, media, BEYOND_DEPTHS, BEYOND_ANGLES]``, of lights of these spreads.

    On the way of light all media together scatter it, by how much each of them does in the whole scene.
    ``count``: orders; all of the scene's where it is None.
    """
    media, count = media_of(scene), orders_of(scene) if count is None else count
    if len(media) == 1:
        phase, (lobe,) = media[0].phase, lobes(scene)
        return np.stack([beyond(phase, lobe, count, spread=spread)[None] for spread in spreads])
    low, high = region_of(scene)
    room, scatters = float(np.prod(high - low)), np.zeros(len(media))
    for body in scene.bodies:
        medium = scene.medium_of(body)
        scatters[media.index(medium)] += body.mass_in(room) * float(np.mean(medium.sigma_s))
    shares = scatters / max(float(scatters.sum()), TINY)
    moments = [far_moments(medium.phase) for medium in media]
    way = shares @ np.array(moments)
    known = list(zip(media, lobes(scene), strict=True))
    return np.array(
        [[beyond(medium.phase, lobe, count, way, spread) for medium, lobe in known] for spread in spreads]
    )


def of_fields(
    scene: Scene,
    rgb_from_field: NDArray[np.float64],
    weights: NDArray[np.float64],
    coefficients: Sequence[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return what a density of 1 of each field has of a coefficient in the place of extinction.

    Exact where all bodies of a field are of one medium; else that of their mean.

    Parameters
    ----------
    rgb_from_field, weights
        As of `scene.fields.Fields`.
    coefficients
        RGB, of each of the `media_of` the scene at density 1, per world unit.

    Returns
    -------
    float64 [3, K], as ``rgb_from_field``.
    """
    media = media_of(scene)
    shares, masses = [], []
    for body in scene.marched:
        medium = scene.medium_of(body)
        coefficient = np.asarray(coefficients[media.index(medium)])
        sigma_t = medium.sigma_t
        shares.append(np.divide(coefficient, sigma_t, out=np.zeros(3), where=sigma_t > 0))
        masses.append(body.mass_in(math.inf))
    # What each body adds to each field, in all.
    held = np.array(masses)[:, None] * weights.sum(axis=1)
    total = held.sum(axis=0)
    mean = np.array(shares).T @ np.divide(held, total, out=np.zeros_like(held), where=total > 0)
    found: NDArray[np.float64] = rgb_from_field * mean
    return found


def bytes_of(size: tuple[int, int, int], lobe: Lobe, media: int = 1) -> int:
    """Return the bytes that a lattice takes at most, where scattering has a lobe."""
    x, y, z = size
    padded = max((x + MOST_PAD) * (y + 2), (y + MOST_PAD) * (x + 2)) * (z + 2)
    return padded * numbers_of(lobe, media) * 3 * 4


def points_along(extent: NDArray[np.float64], spacing: float) -> tuple[int, int, int]:
    """Count the points of a lattice around a box along x, y, z."""
    # The cubes of the outermost points are empty.
    x, y, z = (math.ceil(edge / spacing + SAME) + 2 for edge in extent.tolist())
    return x, y, z


def ways_of(scene: Scene) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the directions ``[n, 3]`` in which light of each order is swept, and their solid angles ``[n]``.

    Of order 0 what media emit, where that is swept. Where scattering has a lobe there is but one set, of
    order 0, which serves all.
    """
    has_solids = bool(scene.solids)
    if lobes(scene)[0].degree:
        ways, weights = quadrature()
        return {0: (_turned(ways, PAST_SOLIDS) if has_solids else ways, weights)}
    orders = range(0 if sweeps_emission(scene) else 1, orders_of(scene))
    found = {order: directions_of(order, has_solids=has_solids) for order in orders}
    if 0 in found and not has_solids:
        found[0] = directions(emission_directions(scene), order=0)
    return {order: (ways, np.full(len(ways), 4 * math.pi / len(ways))) for order, ways in found.items()}


def directions_of(order: int, *, has_solids: bool) -> NDArray[np.float64]:
    """Return the directions in which light of an order is swept evenly, unit vectors [n, 3]; 0: emission.

    Where there are solids, rays are traced for all directions, so there are two sets of them.
    """
    if has_solids:
        return directions(DIRECTIONS, order=1) if order > 1 else directions(DIRECTIONS_FROM_SOLIDS, order=0)
    return directions(DIRECTIONS if order else DIRECTIONS_OF_EMISSION[0], order)


def emission_directions(scene: Scene) -> int:
    """Return in how many directions emission is swept: the more, the smaller the smallest flame is.

    At a distance, what is swept in neighbouring directions leaves gaps where a flame is narrower than these.
    """
    few, many = DIRECTIONS_OF_EMISSION
    low, high = region_of(scene)
    least = scene.smallest_emission or math.inf
    wanted = OF_SMALL_FLAMES * (float(np.linalg.norm(high - low)) / 2 / least) ** 2
    return min(max(math.ceil(wanted), few), many)


def directions(count: int, order: int) -> NDArray[np.float64]:
    """Return unit vectors [count, 3], evenly spread over the sphere, and turned from order to order.

    Source: Á. González, "Measurement of Areas on a Sphere Using Fibonacci and Latitude-Longitude Lattices",
    Mathematical Geosciences 42 (2010).
    """
    n = np.arange(count)
    z = 1 - (2 * n + 1) / count
    across, angle = np.sqrt(1 - z**2), GOLDEN_ANGLE * n
    spread = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
    return _turned(spread, order)


def _turned(ways: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """Turn unit vectors [n, 3] at random, for the same number always in the same way."""
    turned, triangle = np.linalg.qr(np.random.default_rng(number).normal(size=(3, 3)))
    rotation: NDArray[np.float64] = ways @ (turned * np.sign(np.diag(triangle))).T
    return rotation
