"""Smoke plume: a rising column that widens, rolls up into billows and thins out.

1. Puffs: spheres strung on a meandering axis, each larger and farther from the next than the one below.
2. Velocity: in every puff a ring vortex, up in the middle and down outside, and smaller ones askew around
   it; over all of it curl noise that grows with height. Vortices and curl noise are free of divergence.
3. Transport: every point is traced back through that flow (semi-Lagrangian, midpoint rule) to where its
   smoke came from, which winds the puffs into mushrooms and draws their detail out to filaments.
4. Density at the origin of the trace: from 0 at the border of the puffs, which fractal noise displaces more
   the higher it is, over a ramp as soft as the column is wide, diluted with height.
"""

from functools import cache

import numpy as np
from flow import add_vortices, traced_back
from noise import F32, Lattice, Points, cellular_noise, curl_noise, fractal, smoothstep

SHAPE = (111, 174, 111)
"""Voxels (z, y, x); multiples of 3."""
VOXEL = 1 / 84
"""Edge length of a voxel, world units."""
ORIGIN = (-SHAPE[2] * VOXEL / 2, -SHAPE[1] * VOXEL / 2, -SHAPE[0] * VOXEL / 2)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0: the box is centred."""
SOLID = False

FOOT, TOP = -0.99, 0.98
"""Heights where the column begins and where the last of it is gone."""
LAST_PUFF = 1.48
"""No puff's centre is higher than this above the foot."""
STEPS = 8
"""Steps of a trace."""
EDDIES = ((2.6, 0.05), (6.5, 0.018))
"""Curl noise: frequency (per world unit) and speed."""


def density(z: F32, y: F32, x: F32) -> F32:
    """Density 0 … 1 at the points of a rectangular mesh.

    Parameters
    ----------
    z, y, x
        World coordinates along each axis, (nz,), (ny,), (nx,).

    Returns
    -------
    F32
        (nz, ny, nx)
    """
    result = np.zeros((len(z), len(y), len(x)), dtype=np.float32)
    # Tracing is dear: leave out what no smoke reaches, all but a cone above the foot.
    height = y - np.float32(FOOT)
    reach = 0.20 + 0.36 * height
    away = (z * z)[:, None, None] + x * x
    near = np.nonzero((away < (reach * reach)[:, None]) & (height > 0)[:, None])
    if near[0].size:
        result[near] = _density_at((x[near[2]], y[near[1]], z[near[0]]))
    return result


def _density_at(points: Points) -> F32:
    height = points[1] - np.float32(FOOT)
    x, y, z = traced_back(points, _velocity, STEPS)
    rough = fractal(Lattice.seeded(61), (x * 4, y * 4, z * 4), 5, gain=0.6)
    cells = cellular_noise(Lattice.seeded(62), (x * 9, y * 9, z * 9))
    breakup = 0.15 + 0.55 * smoothstep(0.0, 1.9, height)
    displacement = 0.35 * (cells * cells - 0.3) + breakup * rough
    depth = -(_puff_distance((x, y, z)) / _width(height) + displacement)
    dilution = 1 / (1 + 2.5 * height * height)
    ends = smoothstep(0.0, 0.06, height) * (1 - smoothstep(1.75, TOP - FOOT, height))
    smoke = smoothstep(0.0, 0.5, depth) * dilution * ends * (0.9 + 0.4 * rough)
    result: F32 = np.clip(smoke, 0, 1)
    return result


def _width(height: F32) -> F32:
    """Radius of a puff, by height above the foot: the column's opening angle is constant."""
    return 0.065 + 0.18 * height


@cache
def _puffs() -> F32:
    """Spheres of the column from the foot up: rows (x, y, z, radius)."""
    rows = []
    height, turn = 0.03, np.array([1.0, 0.0])
    next_turn = np.array([[-0.35, -0.94], [0.94, -0.35]])
    while height < LAST_PUFF:
        radius = float(_width(np.array(height)))
        sway = 0.09 * np.sqrt(height) * turn
        rows.append((sway[0], FOOT + height, sway[1], radius))
        height += 0.9 * radius
        turn = next_turn[:, 0] * turn[0] + next_turn[:, 1] * turn[1]
    return np.array(rows, dtype=np.float32)


@cache
def _vortices() -> F32:
    """Ring vortices: rows (centre x, y, z, radius, velocity x, y, z)."""
    rng = np.random.default_rng(5)
    rows = []
    for x, y, z, radius in _puffs():
        vigour = min(1.0, 0.4 + 1.5 * (y - FOOT))
        rows.append((x, y, z, 1.5 * radius, 0.0, 1.5 * vigour * radius, 0.0))
        for _ in range(4):
            outward = rng.standard_normal(3) * (1, 0.6, 1)
            outward /= np.sqrt((outward * outward).sum())
            centre = np.array((x, y, z)) + 0.9 * radius * outward
            velocity = 0.9 * vigour * radius * (outward + np.array((0, 0.7, 0)))
            rows.append((*centre, 0.75 * radius, *velocity))
    return np.array(rows, dtype=np.float32)


def _puff_distance(points: Points) -> F32:
    """Signed distance to the union of the puffs."""
    distance = np.full_like(points[0], np.inf)
    for *centre, radius in _puffs():
        dx, dy, dz = (p - c for p, c in zip(points, centre, strict=True))
        np.minimum(distance, np.sqrt(dx * dx + dy * dy + dz * dz) - radius, out=distance)
    return distance


def _velocity(points: Points) -> Points:
    x, y, z = points
    total = (np.zeros_like(x), np.zeros_like(x), np.zeros_like(x))
    # Scaling a solenoidal field with height lets in a little divergence, too little to see.
    growth = smoothstep(0.10, 1.4, y - np.float32(FOOT))
    for octave, (frequency, speed) in enumerate(EDDIES):
        scaled = (x * frequency, y * frequency, z * frequency)
        eddies = curl_noise(Lattice.seeded(71 + octave), Lattice.seeded(81 + octave), scaled)
        for axis, eddy in enumerate(eddies):
            total[axis][:] += speed * growth * eddy
    add_vortices(total, points, _vortices())
    return total
