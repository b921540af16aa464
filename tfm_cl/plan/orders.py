"""How the later orders of scattering are found: ``medium.orders``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.plan.lobes import lobe_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfm_cl.plan.lobes import Lobe
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

DIRECTIONS = 32
"""In which light goes through the lattice at each order."""
VOXELS_APART = 2.0
"""Distance between points, in voxels, at most, as long as they are not too many."""
OF_SMALLEST_BODY = 1 / 48
"""The same, in parts of the shortest edge of a body of constant density."""
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
FARTHER = 1.05
"""Factor of the distance between points as long as they are too many."""
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


def orders_of(scene: Scene) -> int:
    """Return how often light is scattered, at most."""
    return max(scene.medium_of(body).orders for body in scene.bodies)


def medium_of(scene: Scene) -> Medium:
    """Return the medium of all bodies of a scene with more than one order."""
    return scene.medium_of(scene.bodies[0])


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
    if scene.primitives:
        yield "points, curves and polygons scatter once only"
    if len({scene.medium_of(body) for body in scene.bodies}) > 1:
        yield "bodies of several media scatter once only"
    if not np.isfinite(scene.bounds).all():
        yield "a medium that is everywhere scatters once only"
    if scene.march.attenuation == "paper":
        yield 'march.attenuation = "paper" is for single scattering'
    if scene.map.max_error is not None:
        yield f"map.max_error = {scene.map.max_error:g} measures single scattering"


def lattice_of(scene: Scene) -> Lattice:
    """Decide where the points lie."""
    low, high = scene.occupied_bounds
    extent = np.maximum(high - low, 0.0)
    finest = min((grid.detail for grid in scene.grids), default=math.inf)
    spacing, why = finest, "as far apart as voxels"
    lobe = lobe_of(medium_of(scene).phase)
    if scene.grids:
        work = math.prod(points_along(extent, finest)) * (orders_of(scene) - 1)
        apart = min(max((work / (WORK_OF_LOBE if lobe.degree else WORK)) ** (1 / 3), 1.0), VOXELS_APART)
        if apart > 1:
            spacing, why = apart * finest, f"{apart:.2g} voxels apart: every order takes its time"
    for body in scene.homogeneous:
        edge = float(np.subtract(*body.bounds[::-1]).min())
        if OF_SMALLEST_BODY * edge < spacing:
            spacing, why = OF_SMALLEST_BODY * edge, f"{1 / OF_SMALLEST_BODY:g} along the thinnest body"
    wanted = spacing
    while math.prod(points_along(extent, spacing)) > MOST_POINTS:
        spacing *= FARTHER
    if spacing > wanted:
        why = f"as near as {MOST_POINTS:,} points allow"
    wanted = spacing
    while lobe.degree and bytes_of(points_along(extent, spacing), lobe) > MOST_BYTES:
        spacing *= FARTHER
    if spacing > wanted:
        why = f"as near as {MOST_BYTES / 2**30:g} GiB allow, at {numbers_of(lobe)} numbers a point"
    size = points_along(extent, spacing)
    first = (low + high) / 2 - spacing * (np.array(size) - 1) / 2
    samples = max(math.ceil(spacing / finest - SAME), FEWEST_SAMPLES if scene.homogeneous else 1)
    samples = min(samples, MOST_SAMPLES)
    x, y, z = first.tolist()
    return Lattice((x, y, z), spacing, size, samples, why)


def numbers_of(lobe: Lobe) -> int:
    """Return how many numbers a point has of each colour, at most, where scattering has a lobe.

    Moments of lights, and of all orders; of each direction its radiance, and what is scattered, both twice of
    those along x, which are less than half.
    """
    return 2 * lobe.harmonics + 3 * DIRECTIONS


def bytes_of(size: tuple[int, int, int], lobe: Lobe) -> int:
    """Return the bytes that a lattice takes at most, where scattering has a lobe."""
    x, y, z = size
    padded = max((x + MOST_PAD) * (y + 2), (y + MOST_PAD) * (x + 2)) * (z + 2)
    return padded * numbers_of(lobe) * 3 * 4


def points_along(extent: NDArray[np.float64], spacing: float) -> tuple[int, int, int]:
    """Count the points of a lattice around a box along x, y, z."""
    # The cubes of the outermost points are empty.
    x, y, z = (math.ceil(edge / spacing + SAME) + 2 for edge in extent.tolist())
    return x, y, z


def directions(count: int, order: int) -> NDArray[np.float64]:
    """Return unit vectors [count, 3], evenly spread over the sphere, and turned from order to order.

    Source: Á. González, "Measurement of Areas on a Sphere Using Fibonacci and Latitude-Longitude Lattices",
    Mathematical Geosciences 42 (2010).
    """
    n = np.arange(count)
    z = 1 - (2 * n + 1) / count
    across, angle = np.sqrt(1 - z**2), GOLDEN_ANGLE * n
    spread = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
    turned, triangle = np.linalg.qr(np.random.default_rng(order).normal(size=(3, 3)))
    rotation: NDArray[np.float64] = spread @ (turned * np.sign(np.diag(triangle))).T
    return rotation
