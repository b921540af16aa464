"""Flows of the samples: ring vortices, and where a flow has brought something from."""

from collections.abc import Callable

import numpy as np
from noise import F32, Points
from numpy.typing import NDArray


def traced_back(points: Points, velocity: Callable[[Points], Points], steps: int) -> Points:
    """Trace points back through a steady flow for one unit of time (midpoint rule)."""
    for _ in range(steps):
        middle = _back(points, velocity(points), 0.5 / steps)
        points = _back(points, velocity(middle), 1 / steps)
    return points


def _back(points: Points, velocity: Points, time: float) -> Points:
    x, y, z = (p - v * time for p, v in zip(points, velocity, strict=True))
    return x, y, z


def add_vortices(total: Points, points: Points, vortices: F32) -> None:
    """Add the velocity of ring vortices, rows (centre x, y, z, radius, velocity x, y, z), to a total."""
    x, y, z = points
    for cx, cy, cz, radius, *velocity in vortices:
        dx, dy, dz = (x - cx) / radius, (y - cy) / radius, (z - cz) / radius
        within = np.flatnonzero(dx * dx + dy * dy + dz * dz < 1)
        ring = ring_vortex((dx[within], dy[within], dz[within]), np.array(velocity))
        for axis, component in enumerate(ring):
            total[axis][within] += component


def ring_vortex(offset: Points, velocity: NDArray[np.floating]) -> Points:
    """Velocity of a vortex ring that fills the unit ball and is at rest on its surface.

    Stokes' stream function s² q² U / 2, with q = 1 - r² and s the distance from the axis e, gives the
    velocity U [(q² - 2 q s²) e + 2 q h (r - h e)] = U [q (q - 2 r²) e + 2 q h r], where h = e · r.

    Parameters
    ----------
    offset
        Points of the unit ball, from its centre.
    velocity
        (3,), at the centre: U e.
    """
    x, y, z = offset
    square = x * x + y * y + z * z
    q = 1 - square
    along = q * (q - 2 * square)
    across = 2 * q * (x * velocity[0] + y * velocity[1] + z * velocity[2])
    return (
        along * velocity[0] + across * x,
        along * velocity[1] + across * y,
        along * velocity[2] + across * z,
    )
