"""Fair-weather cumulus: a flat base where rising air reaches saturation, cauliflower turrets above.

1. Skeleton: a few large spheres on the base; on each grow smaller ones, on those smaller ones again.
   The cloud is their union, as a signed distance (negative inside).
2. Detail: the distance is displaced by cellular noise, whose cells are round bumps with sharp valleys
   between like those of a cauliflower, then by gradient noise that frays the border.
3. Base: density fades out over a thin, gently uneven layer.
4. Density: 0 at the border to 1 over a few voxels inside, times internal variation; it grows with height
   above the base as the liquid water of an adiabatic parcel does.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from noise import F32, Lattice, Points, cellular_noise, fractal, smoothstep
from numpy.typing import NDArray

SHAPE = (123, 105, 162)
"""Voxels (z, y, x); multiples of 3."""
VOXEL = 1 / 78
"""Edge length of a voxel, world units."""
ORIGIN = (-SHAPE[2] * VOXEL / 2, -SHAPE[1] * VOXEL / 2, -SHAPE[0] * VOXEL / 2)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0: the box is centred."""
SOLID = False

BASE = -0.58
"""Height of the condensation level."""
BAND = 0.16
"""Distances are exact up to this far outside the spheres; beyond they are `BAND`."""
TURRETS = (
    # x, y above the base, z, radius
    (-0.20, 0.40, 0.00, 0.38),
    (-0.12, 0.74, 0.00, 0.32),
    (-0.36, 0.60, 0.06, 0.25),
    (0.24, 0.34, -0.04, 0.33),
    (0.46, 0.50, 0.02, 0.25),
    (0.58, 0.22, 0.00, 0.28),
    (-0.60, 0.26, -0.04, 0.27),
    (0.80, 0.14, -0.06, 0.16),
    (0.06, 0.24, 0.34, 0.29),
    (-0.34, 0.20, 0.34, 0.24),
    (-0.18, 0.28, -0.34, 0.29),
    (0.34, 0.18, -0.36, 0.24),
)
TRIES = (26, 22)
"""Spheres tried on each sphere of the generation before."""
LOWEST = -0.25
"""Spheres grow sideways and up: the least vertical component of the direction they grow in."""


class Billow(NamedTuple):
    """One octave of the cauliflower."""

    frequency: float
    """Bumps per world unit."""
    height: float


BILLOWS = (Billow(6.5, 0.060), Billow(13.0, 0.030), Billow(24.0, 0.015))


def density(z: F32, y: F32, x: F32) -> F32:
    """Density 0 … 1 at the points of a rectangular mesh.

    Parameters
    ----------
    z, y, x
        Ascending world coordinates along each axis, (nz,), (ny,), (nx,).

    Returns
    -------
    F32
        (nz, ny, nx)
    """
    distance = _skeleton_distance(z, y, x)
    result = np.zeros_like(distance)
    near = np.nonzero(distance < BAND)
    result[near] = _density_at((x[near[2]], y[near[1]], z[near[0]]), distance[near])
    return result


def _density_at(points: Points, distance: F32) -> F32:
    """Density at points, given their distance to the skeleton."""
    x, y, z = points
    height = y - np.float32(BASE)
    # Turrets at the top are young and crisp; low parts have mixed with dry air and fray.
    fray = 0.030 - 0.016 * smoothstep(0.0, 0.35, height)
    ragged = fractal(Lattice.seeded(21), (x * 5, y * 5, z * 5), 4, gain=0.6)
    depth = -(distance + _billows(points) + fray * ragged)
    above = height + 0.015 * fractal(Lattice.seeded(22), (x * 3, y * 3, z * 3), 3)
    ramp = smoothstep(0.0, 0.055, depth) * smoothstep(0.0, 0.10, above)
    water = 0.55 + 0.45 * smoothstep(0.0, 0.7, height)
    variation = fractal(Lattice.seeded(23), (x * 7, y * 7, z * 7), 4, gain=0.6)
    result: F32 = np.clip(ramp * water * (0.85 + 0.30 * variation), 0, 1)
    return result


def _billows(points: Points) -> F32:
    """Displacement of the border (positive shrinks the cloud): bumps on bumps."""
    x, y, z = points
    coarse = (x * 4, y * 4, z * 4)
    x, y, z = (p + 0.05 * fractal(Lattice.seeded(30 + axis), coarse, 2) for axis, p in enumerate(points))
    total = np.zeros_like(x)
    for octave, (frequency, height) in enumerate(BILLOWS):
        cells = cellular_noise(Lattice.seeded(40 + octave), (x * frequency, y * frequency, z * frequency))
        total += height * (1.6 * cells * cells - 0.45)
    return total


@cache
def _skeleton() -> NDArray[np.float64]:
    """Grow the spheres: rows (x, y, z, radius)."""
    rng = np.random.default_rng(7)
    parents: NDArray[np.float64] = np.array(TURRETS) + np.array((0, BASE, 0, 0))
    spheres = parents
    for tries in TRIES:
        children = [child for parent in parents for child in _grow(rng, spheres, parent, tries)]
        parents = np.array(children)
        spheres = np.concatenate([spheres, parents])
    return spheres


def _grow(
    rng: np.random.Generator, spheres: NDArray[np.float64], parent: NDArray[np.float64], tries: int
) -> list[NDArray[np.float64]]:
    """Place smaller spheres on ``parent``, apart from each other and not deep inside ``spheres``."""
    grown: list[NDArray[np.float64]] = []
    for _ in range(tries):
        direction = rng.standard_normal(3)
        direction /= np.sqrt((direction * direction).sum())
        share = rng.random()
        radius = parent[3] * (0.34 + 0.24 * share * share)
        centre = parent[:3] + 0.9 * parent[3] * direction
        low = direction[1] < LOWEST or centre[1] < BASE - 0.3 * radius
        buried = _clearance(spheres, centre) < -0.55 * radius - 0.1 * parent[3]
        crowded = bool(grown) and _clearance(np.array(grown), centre) < -0.05 * radius
        if not (low or buried or crowded):
            grown.append(np.array([*centre, radius]))
    return grown


def _clearance(spheres: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Signed distance from a point to a union of spheres."""
    offset = spheres[:, :3] - point
    return float((np.sqrt((offset * offset).sum(axis=1)) - spheres[:, 3]).min())


def _skeleton_distance(z: F32, y: F32, x: F32) -> F32:
    """Signed distance to the skeleton on a mesh; each sphere touches only the box around it."""
    distance = np.full((len(z), len(y), len(x)), BAND, dtype=np.float32)
    for *centre, radius in _skeleton():
        reach = radius + BAND
        squares, boxes = [], []
        for axis, middle in zip((x, y, z), centre, strict=True):
            box = slice(*np.searchsorted(axis, (middle - reach, middle + reach)))
            offset = axis[box] - np.float32(middle)
            squares.append(offset * offset)
            boxes.append(box)
        square = squares[2][:, None, None] + squares[1][:, None] + squares[0]
        part = distance[boxes[2], boxes[1], boxes[0]]
        np.minimum(part, np.sqrt(square) - np.float32(radius), out=part)
    return distance
