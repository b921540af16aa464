"""Fire: tongues of flame that rise and taper, and the smoke above them.

1. Heat: a flame's envelope, wide at the foot and pointed at the top, leans and sways with height; turbulence
   that rises with the gas displaces its border, more the higher it is, and tears the tip into tongues.
2. Temperature: from 0 at that border to 1 within, hottest low in the core and colder towards the tips.
3. Density: soot, little of it in the flame, and smoke that forms above where the gas has cooled.
"""

import numpy as np
from noise import F32, Lattice, Points, curl_noise, fractal, smoothstep

SHAPE = (72, 120, 72)
"""Voxels (z, y, x); multiples of 3."""
VOXEL = 1 / 60
"""Edge length of a voxel, world units."""
ORIGIN = (-SHAPE[2] * VOXEL / 2, -SHAPE[1] * VOXEL / 2, -SHAPE[0] * VOXEL / 2)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0: the box is centred."""
SOLID = False
KELVIN = 2200.0
"""What a temperature of 1 is meant to be: ``temperature_scale``."""

FOOT, TOP = -0.95, 0.93
"""Heights where the flame begins and where the last of the smoke is gone."""


def density(z: F32, y: F32, x: F32) -> F32:
    """Soot and smoke 0 … 1 at a rectangular mesh of world coordinates, ``[z, y, x]``."""
    points = _mesh(z, y, x)
    height, (px, _, pz), rough = _turbulence(points)
    away = np.sqrt(px * px + pz * pz)
    width = 0.12 + 0.15 * height
    smoke = smoothstep(0.0, 0.8, 1 - away / width + 0.8 * rough)
    rising = smoothstep(0.6, 1.15, height) * (1 - smoothstep(1.2, TOP - FOOT, height))
    soot = 0.25 * _heat(height, away, rough)
    result: F32 = np.clip((0.7 * smoke * rising + soot) * _within(points), 0, 1)
    return result


def temperature(z: F32, y: F32, x: F32) -> F32:
    """Temperature 0 … 1, of `KELVIN`, likewise."""
    points = _mesh(z, y, x)
    height, (px, _, pz), rough = _turbulence(points)
    return _heat(height, np.sqrt(px * px + pz * pz), rough) * _within(points)


def _mesh(z: F32, y: F32, x: F32) -> Points:
    deep, high, wide = np.meshgrid(z, y, x, indexing="ij")
    return wide, high, deep


def _within(points: Points) -> F32:
    """1, falling to 0 before the box's sides."""
    return 1 - smoothstep(0.5, 0.575, np.maximum(np.abs(points[0]), np.abs(points[2])))


def _turbulence(points: Points) -> tuple[F32, Points, F32]:
    """Return heights above the foot, points carried back through the eddies, and noise there."""
    x, y, z = points
    height = np.maximum(y - np.float32(FOOT), 0)
    sway = 0.10 * height * height
    moved = (x - sway * np.sin(3.1 * height), y, z - sway * np.cos(2.3 * height))
    eddies = curl_noise(Lattice.seeded(31), Lattice.seeded(32), (moved[0] * 3, moved[1] * 2, moved[2] * 3))
    strength = 0.03 * smoothstep(0.05, 1.2, height)
    px, py, pz = (axis - strength * eddy for axis, eddy in zip(moved, eddies, strict=True))
    # Flames are drawn out upwards: turbulence is three times as long as it is wide.
    rough = fractal(Lattice.seeded(33), (px * 6, py * 2, pz * 6), 4, gain=0.55)
    return height, (px, py, pz), rough


def _heat(height: F32, away: F32, rough: F32) -> F32:
    """Heat 0 … 1 within the flame's envelope."""
    taper = np.clip(1 - height / 1.35, 0, 1)
    width = 0.34 * np.sqrt(taper) * smoothstep(-0.12, 0.35, height) + 1e-3
    torn = rough * (0.4 + 1.9 * height)
    inside = 1 - away / width + torn
    cooled = 1 - 0.45 * smoothstep(0.2, 1.5, height)
    started = smoothstep(0.0, 0.05, height) * smoothstep(0.0, 0.2, taper)
    heat: F32 = smoothstep(0.0, 0.55, inside) * cooled * started
    return heat
