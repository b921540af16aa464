"""Inks in water: three drops that sink, roll up into rings and run into each other, each of a colour.

1. Ink: for each drop a head and the thread it draws down from the surface, of a rough border.
2. Velocity: in every head a ring vortex that sinks, and smaller ones askew around it; over all of it curl
   noise.
3. Transport: every point is traced back through that flow (semi-Lagrangian, midpoint rule) to where its ink
   came from.
4. Colour: inks mix as extinctions do. Each voxel has the mean of the inks' colours, weighted by how much
   there is of each.
"""

from functools import cache

import numpy as np
from flow import add_vortices, traced_back
from noise import F32, Lattice, Points, curl_noise, fractal, smoothstep
from numpy.typing import NDArray

SHAPE = (90, 132, 144)
"""Voxels (z, y, x); multiples of 3."""
VOXEL = 1 / 72
"""Edge length of a voxel, world units."""
ORIGIN = (-SHAPE[2] * VOXEL / 2, -SHAPE[1] * VOXEL / 2, -SHAPE[0] * VOXEL / 2)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0: the box is centred."""
SOLID = False

SURFACE = 0.88
"""Height from which the drops fell."""
COLOURS = np.array([[1.0, 0.22, 0.06], [0.12, 1.0, 0.30], [0.05, 0.28, 1.0]], dtype=np.float32)
"""Extinction of each ink in red, green and blue relative to its density: cyan, magenta and yellow."""
HEADS = np.array(
    [[-0.38, -0.26, 0.04, 0.30], [0.06, 0.08, -0.06, 0.32], [0.42, -0.34, 0.06, 0.27]], dtype=np.float32
)
"""Where each drop is: x, y, z, and its radius."""
THREAD = 0.075
"""Radius of what a drop draws behind it."""
STEPS = 8
"""Steps of a trace."""
EDDIES = ((2.4, 0.09), (5.5, 0.03), (11.0, 0.012))
"""Curl noise: frequency (per world unit) and speed."""


def density(z: F32, y: F32, x: F32) -> F32:
    """Density 0 … 1 of all inks at the points of a rectangular mesh, ``[z, y, x]``; world coordinates."""
    result: F32 = np.minimum(_inks(z, y, x).sum(axis=-1), 1)
    return result


def colour(z: F32, y: F32, x: F32) -> F32:
    """Extinction relative to the density in red, green and blue, ``[z, y, x, 3]``; 1 without ink."""
    inks = _inks(z, y, x)
    total = inks.sum(axis=-1, keepdims=True)
    # No matrix product, which machines sum up in different orders.
    weighted = sum(inks[..., i : i + 1] * ink for i, ink in enumerate(COLOURS))
    mixed: F32 = np.where(total > 0, weighted / np.maximum(total, np.float32(1e-6)), np.float32(1))
    return mixed


def _inks(z: F32, y: F32, x: F32) -> F32:
    """Density of each ink, ``[z, y, x, ink]``."""
    mesh = np.meshgrid(z, y, x, indexing="ij")
    everywhere = (mesh[2].ravel(), mesh[1].ravel(), mesh[0].ravel())
    # Tracing is dear: leave out what no ink reaches.
    near = np.flatnonzero(np.any([_reached(everywhere, head) for head in HEADS], axis=0))
    points = (everywhere[0][near], everywhere[1][near], everywhere[2][near])
    found = np.zeros((mesh[0].size, len(HEADS)), dtype=np.float32)
    if near.size:
        origin = traced_back(points, _velocity, STEPS)
        rough = fractal(Lattice.seeded(91), (origin[0] * 5, origin[1] * 5, origin[2] * 5), 3, gain=0.5)
        inks = np.stack([_ink(origin, head, rough) for head in HEADS], axis=-1)
        found[near] = inks * _inside(points)[:, None]
    return found.reshape(*mesh[0].shape, len(HEADS))


def _reached(points: Points, head: F32) -> NDArray[np.bool_]:
    """Tell where an ink may have come to: around its head and its thread."""
    x, y, z = points
    hx, hy, hz, radius = head
    aside = (x - hx) ** 2 + (z - hz) ** 2
    around = aside + (y - hy + 0.3 * radius) ** 2 < (1.9 * radius) ** 2
    reached: NDArray[np.bool_] = around | ((aside < 0.42**2) & (y > hy))
    return reached


def _ink(points: Points, head: F32, rough: F32) -> F32:
    """Density of one ink before the flow."""
    x, y, z = points
    hx, hy, hz, radius = head
    away = np.sqrt((x - hx) ** 2 + (y - hy) ** 2 + (z - hz) ** 2)
    ball = smoothstep(-0.05, 0.35, 1 - away / (0.85 * radius) + 0.3 * rough)
    aside = np.sqrt((x - hx) ** 2 + (z - hz) ** 2)
    up = np.clip((y - hy) / (np.float32(SURFACE) - hy), 0, 1)
    wide = THREAD * (0.55 + 0.9 * up)
    thread = smoothstep(0.0, 0.7, 1 - aside / wide + 0.4 * rough) * (y > hy) * (0.45 + 0.3 * up)
    ink: F32 = np.maximum(ball, thread).astype(np.float32)
    return ink


def _inside(points: Points) -> F32:
    """1, and 0 towards the box's sides: nothing is cut off."""
    half = [n * VOXEL / 2 for n in SHAPE[::-1]]
    edges = [
        smoothstep(0.02, 0.12, (h - np.abs(p)).astype(np.float32)) for p, h in zip(points, half, strict=True)
    ]
    faded: F32 = edges[0] * edges[1] * edges[2]
    return faded


@cache
def _vortices() -> F32:
    """Ring vortices: rows (centre x, y, z, radius, velocity x, y, z)."""
    rng = np.random.default_rng(9)
    rows = []
    for x, y, z, radius in HEADS:
        rows.append((x, y - 0.02, z, 1.7 * radius, 0.0, -1.8 * radius, 0.0))
        rows.append((x, y + 1.5 * radius, z, 0.9 * radius, 0.0, -0.8 * radius, 0.0))
        for _ in range(5):
            outward = rng.standard_normal(3) * (1, 0.5, 1)
            outward /= np.sqrt((outward * outward).sum())
            centre = np.array((x, y, z)) + 0.9 * radius * outward
            velocity = 0.9 * radius * (outward - np.array((0, 0.8, 0)))
            rows.append((*centre, 0.75 * radius, *velocity))
    return np.array(rows, dtype=np.float32)


def _velocity(points: Points) -> Points:
    x, y, z = points
    total = (np.zeros_like(x), np.zeros_like(x), np.zeros_like(x))
    for octave, (frequency, speed) in enumerate(EDDIES):
        scaled = (x * frequency, y * frequency, z * frequency)
        eddies = curl_noise(Lattice.seeded(101 + octave), Lattice.seeded(111 + octave), scaled)
        for axis, eddy in enumerate(eddies):
            total[axis][:] += np.float32(speed) * eddy
    add_vortices(total, points, _vortices())
    return total
