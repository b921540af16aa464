"""Sitting teddy bear that holds out a flower: solid, hard-edged, with holes and thin parts.

The difficult case for functions that approximate transmittance: density jumps from 0 to 1 between two
voxels and is constant for a long way after. The bear is an implicit surface, ellipsoids and round cones
joined by smooth unions; a voxel is 1 when its centre is inside.
"""

from functools import reduce

import numpy as np
from noise import F32, Points

SHAPE = (105, 144, 141)
"""Voxels (z, y, x); multiples of 3."""
VOXEL = 1 / 84
"""Edge length of a voxel, world units."""
ORIGIN = (-SHAPE[2] * VOXEL / 2, -VOXEL, -SHAPE[0] * VOXEL / 2)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0: the bear sits on y = 0, looking to +z."""
SOLID = True

Vector = tuple[float, float, float]


def density(z: F32, y: F32, x: F32) -> F32:
    """Density, 0 or 1, at the points of a rectangular mesh.

    Parameters
    ----------
    z, y, x
        World coordinates along each axis, (nz,), (ny,), (nx,).

    Returns
    -------
    F32
        (nz, ny, nx)
    """
    points = (x[None, None, :], y[None, :, None], z[:, None, None])
    inside = (_bear(points) < 0) & (points[1] > 0)
    return inside.astype(np.float32)


def _bear(points: Points) -> F32:
    """Signed distance, negative inside (near the surface; a bound elsewhere)."""
    x, y, z = points
    mirrored = (np.abs(x), y, z)

    torso = _ellipsoid(points, (0, 0.50, -0.06), (0.38, 0.50, 0.35))
    legs = _cone(mirrored, (0.20, 0.15, 0.10), (0.37, 0.15, 0.46), 0.17, 0.13)
    soles = _ellipsoid(mirrored, (0.39, 0.19, 0.54), (0.165, 0.19, 0.085))
    pads = _ellipsoid(mirrored, (0.40, 0.19, 0.655), (0.10, 0.12, 0.06))
    legs = _carve(_join(legs, soles, blend=0.05), pads, blend=0.02)
    tail = _ellipsoid(points, (0, 0.17, -0.42), (0.11, 0.11, 0.11))

    akimbo = _join(
        _cone(points, (-0.27, 0.76, -0.04), (-0.68, 0.60, 0.00), 0.12, 0.09),
        _cone(points, (-0.68, 0.60, 0.00), (-0.44, 0.31, 0.10), 0.09, 0.115),
        blend=0.03,
    )
    waving = _join(
        _cone(points, (0.27, 0.76, -0.04), (0.56, 0.74, 0.10), 0.12, 0.095),
        _cone(points, (0.56, 0.74, 0.10), (0.63, 1.00, 0.18), 0.095, 0.115),
        blend=0.03,
    )

    skull = _ellipsoid(points, (0, 1.20, 0.02), (0.40, 0.345, 0.34))
    muzzle = _ellipsoid(points, (0, 1.10, 0.31), (0.18, 0.135, 0.14))
    ears = _carve(
        _ellipsoid(mirrored, (0.31, 1.47, -0.01), (0.155, 0.155, 0.085)),
        _ellipsoid(mirrored, (0.31, 1.47, 0.10), (0.095, 0.095, 0.085)),
        blend=0.02,
    )
    sockets = _ellipsoid(mirrored, (0.155, 1.27, 0.335), (0.075, 0.085, 0.085))
    eyes = _ellipsoid(mirrored, (0.155, 1.27, 0.285), (0.042, 0.05, 0.045))
    nose = _ellipsoid(points, (0, 1.16, 0.435), (0.065, 0.045, 0.045))
    lips = _cone(points, (0, 1.10, 0.46), (0, 1.04, 0.455), 0.024, 0.024)
    smile = _cone(mirrored, (0, 1.04, 0.455), (0.10, 1.06, 0.42), 0.024, 0.024)
    head = _join(_join(skull, muzzle, blend=0.03), ears, blend=0.04)
    head = _carve(_carve(head, sockets, blend=0.01), np.minimum(lips, smile), blend=0.01)
    head = _union(head, eyes, nose)

    body = _join(torso, legs, blend=0.04)
    body = _join(body, tail, blend=0.03)
    body = _join(body, _union(akimbo, waving), blend=0.04)
    body = _join(body, head, blend=0.03)
    return _union(body, _bow_tie(mirrored), _flower(points))


def _bow_tie(mirrored: Points) -> F32:
    wings = _cone(mirrored, (0.05, 0.87, 0.255), (0.15, 0.875, 0.255), 0.025, 0.075)
    x, y, z = mirrored
    flat = np.abs(z - np.float32(0.255)) - np.float32(0.045)
    knot = _ellipsoid((x, y, z), (0, 0.87, 0.25), (0.05, 0.05, 0.075))
    return _union(np.maximum(wings, flat), knot)


def _flower(points: Points) -> F32:
    """Flower of six petals around a ball, on a thin stem through the paw."""
    centre = (0.66, 1.52, 0.26)
    stem = _union(
        _cone(points, (0.60, 0.84, 0.22), (0.64, 1.18, 0.28), 0.022, 0.022),
        _cone(points, (0.64, 1.18, 0.28), centre, 0.022, 0.022),
    )
    petals = []
    for across, up in ((1, 0), (0.5, 0.866), (-0.5, 0.866)):
        for side in (-1, 1):
            tip = (centre[0] + side * across * 0.11, centre[1] + side * up * 0.11, centre[2])
            root = (centre[0] + side * across * 0.05, centre[1] + side * up * 0.05, centre[2])
            petals.append(_cone(points, root, tip, 0.022, 0.05))
    disc = np.abs(points[2] - np.float32(centre[2])) - np.float32(0.03)
    ball = _ellipsoid(points, (centre[0], centre[1], centre[2] + 0.02), (0.055, 0.055, 0.05))
    return _union(stem, np.maximum(_union(*petals), disc), ball)


def _ellipsoid(points: Points, centre: Vector, radii: Vector) -> F32:
    """Distance to an ellipsoid, exact to first order at its surface: k (k - 1) / |∇k|."""
    scaled = [(p - np.float32(c)) / np.float32(r) for p, c, r in zip(points, centre, radii, strict=True)]
    steeper = [s / np.float32(r) for s, r in zip(scaled, radii, strict=True)]
    length = np.sqrt(scaled[0] * scaled[0] + scaled[1] * scaled[1] + scaled[2] * scaled[2])
    slope = np.sqrt(steeper[0] * steeper[0] + steeper[1] * steeper[1] + steeper[2] * steeper[2])
    distance: F32 = length * (length - 1) / np.maximum(slope, np.float32(1e-6))
    return distance


def _cone(points: Points, start: Vector, end: Vector, start_radius: float, end_radius: float) -> F32:
    """Distance to a segment less a radius that changes linearly along it: a capsule that tapers."""
    axis = [e - s for s, e in zip(start, end, strict=True)]
    offset = [p - np.float32(s) for p, s in zip(points, start, strict=True)]
    along = sum(o * np.float32(a) for o, a in zip(offset, axis, strict=True))
    share = np.clip(along / np.float32(sum(a * a for a in axis)), 0, 1)
    away = [o - share * np.float32(a) for o, a in zip(offset, axis, strict=True)]
    radius = np.float32(start_radius) + share * np.float32(end_radius - start_radius)
    distance: F32 = np.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]) - radius
    return distance


def _join(first: F32, second: F32, *, blend: float) -> F32:
    """Smooth union: a parabola rounds the crease over the distance ``blend``."""
    share = np.maximum(np.float32(blend) - np.abs(first - second), 0) / np.float32(blend)
    joined: F32 = np.minimum(first, second) - share * share * np.float32(blend / 4)
    return joined


def _carve(body: F32, tool: F32, *, blend: float) -> F32:
    """Smooth difference: ``body`` without ``tool``."""
    return -_join(-body, tool, blend=blend)


def _union(*parts: F32) -> F32:
    return reduce(np.minimum, parts)
