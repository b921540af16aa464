"""Particles: a plume of smoke, and a knot wound of spirals.

`smoke_plume` follows puffs from the foot of a plume up through a flow of three parts:

1. The mean rise of a buoyant plume: its width grows with height, its speed falls with the cube root of that.
2. Ring vortices that rise with it, up in the middle and down outside: they roll the smoke up into billows.
3. Curl noise of the plume's width and of a third of it, carried along: it frays what the rings have rolled.

A puff's radius grows with its way as the plume's width does, its opacity falls as it is diluted.

`spirals` winds strands of particles around a trefoil knot, each along its own helix whose width swells and
shrinks: cores that let no light through beside wisps and veils that hardly dim it.
"""

from dataclasses import dataclass

import numpy as np
from flow import ring_vortex
from noise import Lattice, Points, curl_noise, fractal
from numpy.typing import NDArray

F64 = NDArray[np.float64]

COUNT = 16_384
"""Of the plume in "Fourier Opacity Mapping", and of the knot."""

FOOT = -1.0
"""Height at which smoke comes out, world units; the plume's top is near 1."""
MOUTH, WIDENING = 0.06, 0.16
"""Radius of the plume at its foot, and by how much it grows with height."""
SPEED = 0.62
"""At the foot, world units a unit of time."""
DURATION, STEPS = 6.4, 96
"""Time for which the plume has been rising, and its steps."""
RING_EVERY = 0.85
"""Time between two vortices."""
BILLOWS = 4
"""Smaller vortices askew around each."""
EDDIES = ((0.9, 0.085), (2.7, 0.035))
"""Curl noise: frequency times the plume's width, and speed over the plume's."""


@dataclass(frozen=True)
class Particles:
    """A cache of particles, as `tfm_cl` reads it from an ``.npz``."""

    positions: F64
    """[n, 3]."""
    radius: F64
    """[n]"""
    opacity: F64
    """[n]: of a ray through the middle."""

    def arrays(self) -> dict[str, NDArray[np.float16]]:
        """Return what is stored."""
        return {
            "positions": self.positions.astype(np.float16),
            "radius": self.radius.astype(np.float16),
            "opacity": self.opacity.astype(np.float16),
        }


def smoke_plume(count: int = COUNT) -> Particles:
    """Return a plume that has been rising for a while, its foot at (0, -1, 0)."""
    rng = np.random.default_rng(16_384)
    born = np.sort(rng.uniform(0, DURATION, count))
    # Smoke comes in surges, a breath for each ring.
    born += 0.35 * RING_EVERY / (2 * np.pi) * np.sin(2 * np.pi * born / RING_EVERY)
    angle, out = rng.uniform(0, 2 * np.pi, count), MOUTH * np.sqrt(rng.uniform(0, 1, count))
    points = np.stack([out * np.cos(angle), np.full(count, FOOT), out * np.sin(angle)])
    rings = _rings(rng)
    step = DURATION / STEPS
    for number in range(STEPS):
        time = number * step
        alive = np.flatnonzero(born < time + step)
        # What is born in this step has only the rest of it.
        length = np.minimum(time + step - born[alive], step)
        here = points[:, alive]
        middle = here + 0.5 * length * _velocity(here, time, rings)
        points[:, alive] = here + length * _velocity(middle, time + step / 2, rings)
    age = DURATION - born
    height = np.maximum(points[1] - FOOT, 0.0)
    size = rng.uniform(0.75, 1.25, count)
    radius = (0.022 + 0.030 * height) * size
    opacity = 0.7 / (1 + 1.6 * height) * np.clip(age / 0.15, 0.15, 1) * np.clip((2.6 - height) / 1.1, 0.02, 1)
    return Particles(points.T, radius, opacity / size)


def _width(height: F64) -> F64:
    return MOUTH + WIDENING * np.maximum(height, 0)


def _speed(height: F64) -> F64:
    return SPEED * np.cbrt(MOUTH / _width(height))


def _rings(rng: np.random.Generator) -> F64:
    """Return vortices: rows of time, offset (x, y, z), radius, velocity (x, y, z).

    The time is that at which one leaves the foot; the others are in widths and speeds of the plume at its
    height, the offset from the axis.
    """
    rows = []
    for time in np.arange(-2 * RING_EVERY, DURATION, RING_EVERY):
        side, front = rng.uniform(-0.25, 0.25, 2)
        rows.append((time, side, 0, front, 1.6, 0.5 * side, 1.25, 0.5 * front))
        for _ in range(BILLOWS):
            outward = rng.standard_normal(3) * (1, 0.6, 1)
            outward /= np.sqrt((outward * outward).sum())
            velocity = 0.9 * (outward + np.array((0, 0.6, 0)))
            rows.append((time, *(0.85 * outward), rng.uniform(0.65, 0.9), *velocity))
    return np.array(rows)


def _ring_height(age: float) -> float:
    """Integrate a vortex's rise: of dh/dt = U (m / (m + w h))^(1/3), four thirds are a power of the width."""
    power = MOUTH ** (4 / 3) + 4 / 3 * WIDENING * 0.8 * SPEED * np.cbrt(MOUTH) * age
    return float((power**0.75 - MOUTH) / WIDENING)


def _velocity(points: F64, time: float, rings: F64) -> F64:
    """Of the smoke at points [3, n]; [3, n]."""
    height = points[1] - FOOT
    width, speed = _width(height), _speed(height)
    swayed = np.stack(_axis(height, time))
    x, z = points[0] - swayed[0], points[2] - swayed[1]
    inner = 0.8 / (1 + (0.2 * (x * x + z * z) / width**2) ** 2)
    total: F64 = speed * inner * np.stack([WIDENING * x / width, np.ones_like(x), WIDENING * z / width])
    for born, *row in rings:
        if born > time:
            continue
        middle = np.array(_ring_height(time - born))
        wide, fast = float(_width(middle)), float(_speed(middle))
        east, north = _axis(middle, time)
        centre = np.array((east, middle + FOOT, north)) + wide * np.array(row[:3])
        offset = (points - centre[:, None]) / (wide * row[3])
        within = np.flatnonzero((offset * offset).sum(axis=0) < 1)
        vigour = min(1.0, 0.35 + 2.0 * float(middle))
        total[:, within] += ring_vortex(tuple(offset[:, within]), vigour * fast * np.array(row[4:]))
    growth = np.clip(height / 0.5, 0.1, 1)
    for octave, (frequency, part) in enumerate(EDDIES):
        # Cells that widen with the plume: its logarithm is how many widths lie below.
        scale = frequency / width
        below = np.log(width / MOUTH) / WIDENING * frequency - 0.9 * time
        lattices = Lattice.seeded(171 + octave), Lattice.seeded(181 + octave)
        swirl = curl_noise(*lattices, _as_points(x * scale, below, z * scale))
        total += part * growth * speed * np.stack(swirl)
    return total


def _axis(height: F64, time: float) -> tuple[F64, F64]:
    """Return where the plume's axis is at a height: it sways as wind and flame do."""
    phase = 3.1 * height - 0.8 * time
    return 0.09 * height * np.sin(phase), 0.09 * height * np.cos(1.3 * phase + 1)


def _as_points(x: F64, y: F64, z: F64) -> Points:
    return x.astype(np.float32), y.astype(np.float32), z.astype(np.float32)


STRANDS = 3
"""Of the knot."""
TURNS = 9
"""Of each strand around the knot's axis."""


def spirals(count: int = COUNT) -> Particles:
    """Return a trefoil knot of spirals, some 2 across, centred at 0."""
    rng = np.random.default_rng(15)
    strand = rng.integers(0, STRANDS, count)
    along = 2 * np.pi * (np.arange(count) + rng.uniform(0, 1, count)) / count
    phase = TURNS * along + 2 * np.pi * strand / STRANDS
    # Each strand swells and shrinks in its own rhythm.
    swell = 0.5 + 0.5 * np.sin((2 + strand % 3) * along + 1.7 * strand)
    spread = rng.standard_normal((count, 3))
    is_veil = rng.uniform(0, 1, count) < 0.25  # noqa: PLR2004 - a quarter
    reach = np.where(is_veil, 0.14 * np.sqrt(rng.uniform(0, 1, count)), 0.05 + 0.15 * swell)
    loose = np.where(is_veil, 0.03, 0.002 + 0.024 * (1 - swell) ** 3)
    centre, side, up = _knot(along)
    points = centre + reach[:, None] * (np.cos(phase)[:, None] * side + np.sin(phase)[:, None] * up)
    points += loose[:, None] * spread
    wobble = fractal(Lattice.seeded(91), _as_points(*(2.2 * points.T)), 3).astype(np.float64)
    points += 0.05 * wobble[:, None] * (points - centre) / np.maximum(reach, 1e-3)[:, None]
    radius = np.where(is_veil, 0.06, 0.022 + 0.012 * (1 - swell)) * rng.uniform(0.8, 1.2, count)
    opacity = np.where(is_veil, 0.03, 0.12 + 0.28 * swell)
    return Particles(points, radius, opacity)


def _knot(along: F64) -> tuple[F64, F64, F64]:
    """Return a trefoil's points, and two directions across it, [n, 3] each."""

    def at(t: F64) -> F64:
        around = 2 + np.cos(3 * t)
        return np.stack([around * np.cos(2 * t), around * np.sin(2 * t), 1.15 * np.sin(3 * t)], axis=-1) / 3.4

    centre, step = at(along), 1e-4
    tangent = at(along + step) - at(along - step)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = np.cross(tangent, centre * (1, 1, 3))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    return centre, side, np.cross(side, tangent)
