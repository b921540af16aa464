"""Puff after puff of smoke that rises, drifts in the wind, grows and rolls up: a sequence, with velocities.

Every few frames a puff leaves the ground. It is a unit ball that is moved and scaled:

1. Path: the puff slows down as it rises, and the wind carries it off, the more the higher it is.
2. Size: its radius grows with the height above the ground, and its density thins out in turn.
3. Flow: within the ball turns a ring vortex, `flow.ring_vortex`, up in the middle and down outside, slower
   the larger the ball. Smoke is carried along: a point's density is that of the place in the new puff that it
   has come from, traced back through the vortex (midpoint rule).
4. A new puff is a ball with a border that fractal noise displaces.

So the velocity of the smoke is known at every point: of the path, of the growth, and of the vortex, in world
units a second. Where puffs overlap, it is their mean by density.
"""

from typing import NamedTuple

import numpy as np
from flow import ring_vortex
from noise import F32, Lattice, Points, fractal, smoothstep

SHAPE = (56, 108, 72)
"""Voxels (z, y, x)."""
VOXEL = 1 / 28
"""Edge length of a voxel, world units."""
ORIGIN = (-0.85, -0.1, -1.0)
"""World position (x, y, z) of the low corner of voxel 0, 0, 0."""
FRAMES = 24
FPS = 24
"""Frames a second, of which the velocities are told."""

EVERY = 2.0
"""Frames from one puff to the next."""
EARLIER = 6
"""Puffs that have left before the first frame."""
HIGHEST, SLOWING = 3.9, 28.0
"""Height that puffs tend to, world units, and the frames within which they lose most of their speed."""
FIRST_RADIUS, GROWTH = 0.15, 0.17
"""Of a puff: its radius as it leaves, and by how much that grows a unit of height."""
WIND = 0.17
"""How far the wind carries a puff at the height of 1; as the square root of the cube of the height."""
FOOT = 0.12
"""Height of a puff's centre as it leaves."""
SWAY = 0.07
"""How far puffs leave the path, at the height of 1."""
TURNS = ((1.0, 0.0), (-0.6, 0.8), (0.2, -1.0), (0.5, 0.8), (-1.0, -0.2))
"""To which side (x, z) they do, one after the other."""
SPIN = 0.55
"""How far smoke in the middle of a puff rises in it while the puff doubles its radius, in radii."""
OCTAVES = 3
"""Of the noise at the border; finer ones fall between the voxels."""
STEPS = 6
"""Of a trace."""
FAINT = 1e-3
"""Weight of the velocity of a puff where it has no smoke: the flow around the smoke is known, too."""


class Puff(NamedTuple):
    """A puff in a frame."""

    number: int
    """From which its noise comes."""
    centre: tuple[float, float, float]
    """World position (x, y, z)."""
    radius: float
    strength: float
    """From 0 as it leaves to 1 when the next one does."""
    velocity: tuple[float, float, float]
    """Of the centre, world units a frame."""
    growth: float
    """Of the radius, world units a frame."""


def puffs(frame: float) -> list[Puff]:
    """Return the puffs that there are in a frame, the youngest first."""
    found = []
    newest = int(np.floor((frame - 1) / EVERY))
    for number in range(newest, -EARLIER - 1, -1):
        age = frame - 1 - EVERY * number
        left = np.exp(-age / SLOWING)
        height, rise = HIGHEST * (1 - left), HIGHEST * left / SLOWING
        carried = WIND * height * np.sqrt(height)
        blown = 1.5 * WIND * np.sqrt(height) * rise
        across, along = (SWAY * turn for turn in TURNS[number % len(TURNS)])
        radius = FIRST_RADIUS + GROWTH * height
        centre = (carried + across * height, height + FOOT, along * height)
        velocity = (blown + across * rise, rise, along * rise)
        found.append(Puff(number, centre, radius, min(age / EVERY, 1.0), velocity, GROWTH * rise))
    return found


def sample(frame: float) -> tuple[F32, F32]:
    """Return density [z, y, x], 0 … 1, and velocity [z, y, x, 3], world units a second, in all voxels."""
    z, y, x = (
        (low + (np.arange(count) + 0.5) * VOXEL).astype(np.float32)
        for low, count in zip(ORIGIN[::-1], SHAPE, strict=True)
    )
    density = np.zeros(SHAPE, np.float32)
    weights = np.zeros(SHAPE, np.float32)
    flow = np.zeros((*SHAPE, 3), np.float32)
    for puff in puffs(frame):
        offsets = [(axis - c) / puff.radius for axis, c in zip((x, y, z), puff.centre, strict=True)]
        squares = [offset * offset for offset in offsets]
        within = np.nonzero(squares[2][:, None, None] + squares[1][:, None] + squares[0] < 1)
        ball: Points = (offsets[0][within[2]], offsets[1][within[1]], offsets[2][within[0]])
        smoke = _smoke(puff, ball)
        density[within] += smoke
        weight = smoke + np.float32(FAINT)
        weights[within] += weight
        turning = ring_vortex(ball, np.array([0.0, SPIN * puff.growth, 0.0]))
        for axis in range(3):
            speed = puff.velocity[axis] + puff.growth * ball[axis] + turning[axis]
            flow[..., axis][within] += weight * speed
    flow *= FPS / np.maximum(weights, FAINT)[..., None]
    return np.clip(density, 0, 1), flow


def _smoke(puff: Puff, ball: Points) -> F32:
    """Density of a puff at points of the unit ball."""
    x, y, z = _origin(ball, SPIN * np.log(puff.radius / FIRST_RADIUS))
    rough = fractal(Lattice.seeded(300 + puff.number), (x * 2.2, y * 2.2, z * 2.2), OCTAVES, gain=0.6)
    inside = 1 - np.sqrt(x * x + y * y + z * z) / 0.75 + 0.55 * rough
    border = 1 - smoothstep(0.85, 1.0, np.sqrt(ball[0] ** 2 + ball[1] ** 2 + ball[2] ** 2))
    thinner = puff.strength * (FIRST_RADIUS / puff.radius) ** 1.4
    smoke: F32 = smoothstep(0.0, 0.6, inside) * border * np.float32(thinner)
    return smoke


def _origin(points: Points, way: float) -> Points:
    """Trace points of the unit ball back through the vortex; its middle has come a way of so many radii."""
    for _ in range(STEPS):
        middle = _back(points, points, 0.5 * way / STEPS)
        points = _back(points, middle, way / STEPS)
    return points


def _back(points: Points, where: Points, time: float) -> Points:
    speed = ring_vortex(where, np.array([0.0, 1.0, 0.0]))
    x, y, z = (p - np.float32(time) * s for p, s in zip(points, speed, strict=True))
    return x, y, z
