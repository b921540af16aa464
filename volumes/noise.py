"""Seeded lattice noise at arbitrary points: gradient (Perlin) noise, cellular (Worley) noise, curl noise.

All are pure functions of position and seed, and use only + - × / and square roots, which IEEE 754 rounds
the same way everywhere: the volumes come out alike on every machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Points = tuple[F32, F32, F32]
"""x, y and z of many points, three arrays of one shape."""

PERIOD = 256
"""Lattice cells after which the noise repeats; far more than a volume spans."""
GRADIENT_GAIN = np.float32(1.6)
"""Brings gradient noise from unit gradients, whose values rarely pass ±0.6, to about ±1."""


@dataclass(frozen=True)
class Lattice:
    """Random numbers on the integer lattice: a permutation hashes a cell to one of 256 vectors."""

    permutation: NDArray[np.int32]
    """(512,): a permutation of 0 … 255, twice, so that sums of two bytes need no wrapping."""
    gradients: F32
    """(3, 256): unit vectors, uniform on the sphere."""
    offsets: F32
    """(3, 256): points of the unit cube."""

    @classmethod
    def seeded(cls, seed: int) -> "Lattice":
        """Draw the tables from NumPy's generator."""
        rng = np.random.default_rng(seed)
        permutation = np.tile(rng.permutation(PERIOD), 2).astype(np.int32)
        vectors = rng.standard_normal((3, PERIOD))
        gradients = vectors / np.sqrt((vectors * vectors).sum(axis=0))
        return cls(permutation, gradients.astype(np.float32), rng.random((3, PERIOD), dtype=np.float32))


def gradient_noise(lattice: Lattice, points: Points) -> F32:
    """Perlin's gradient noise: one feature per unit length, mean 0, about ±1, two continuous derivatives."""
    cell, fraction = _split(points)
    fades = [f * f * f * (f * (f * 6 - 15) + 10) for f in fraction]
    total = np.zeros_like(points[0])
    for corner, index in _corners(lattice, cell, (0, 1)):
        value = sum(
            table[index] * (f - step)
            for table, f, step in zip(lattice.gradients, fraction, corner, strict=True)
        )
        for fade, step in zip(fades, corner, strict=True):
            value = value * (fade if step else 1 - fade)
        total += value
    return total * GRADIENT_GAIN


def noise_slope(lattice: Lattice, points: Points) -> Points:
    """Gradient of `gradient_noise` with respect to position, in closed form."""
    cell, fraction = _split(points)
    fades = [f * f * f * (f * (f * 6 - 15) + 10) for f in fraction]
    slopes = [f * f * (f * (f * 30 - 60) + 30) for f in fraction]
    total = (np.zeros_like(points[0]), np.zeros_like(points[0]), np.zeros_like(points[0]))
    for corner, index in _corners(lattice, cell, (0, 1)):
        weights = [fade if step else 1 - fade for fade, step in zip(fades, corner, strict=True)]
        changes = [slope if step else -slope for slope, step in zip(slopes, corner, strict=True)]
        gradient = [table[index] for table in lattice.gradients]
        dot = sum(g * (f - step) for g, f, step in zip(gradient, fraction, corner, strict=True))
        weight = weights[0] * weights[1] * weights[2]
        total[0][:] += weight * gradient[0] + changes[0] * weights[1] * weights[2] * dot
        total[1][:] += weight * gradient[1] + weights[0] * changes[1] * weights[2] * dot
        total[2][:] += weight * gradient[2] + weights[0] * weights[1] * changes[2] * dot
    x, y, z = (component * GRADIENT_GAIN for component in total)
    return x, y, z


def curl_noise(first: Lattice, second: Lattice, points: Points) -> Points:
    """Turbulent velocity ∇a × ∇b of two noises a, b: free of divergence, so it stirs and never piles up."""
    ax, ay, az = noise_slope(first, points)
    bx, by, bz = noise_slope(second, points)
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def cellular_noise(lattice: Lattice, points: Points) -> F32:
    """Worley's F1: distance to the nearest of a set of points scattered one to each unit cell."""
    cell, fraction = _split(points)
    nearest = np.full_like(points[0], 3)
    for corner, index in _corners(lattice, cell, (-1, 0, 1)):
        square = np.zeros_like(nearest)
        for axis, step in enumerate(corner):
            offset = lattice.offsets[axis][index] + (step - fraction[axis])
            square += offset * offset
        np.minimum(nearest, square, out=nearest)
    return np.sqrt(nearest)


def fractal(lattice: Lattice, points: Points, octaves: int, gain: float = 0.5) -> F32:
    """Sum of ``octaves`` gradient noises, each of twice the frequency and ``gain`` times the amplitude."""
    total = np.zeros_like(points[0])
    amplitude, frequency = 1.0, 1.0
    for octave in range(octaves):
        # The shift keeps the octaves' lattice points, where the noise is 0, from coinciding.
        x, y, z = (p * np.float32(frequency) + np.float32(17.3 * octave) for p in points)
        total += np.float32(amplitude) * gradient_noise(lattice, (x, y, z))
        amplitude *= gain
        frequency *= 2.0
    return total


def smoothstep(low: float, high: float, value: F32) -> F32:
    """0 below ``low``, 1 above ``high``, a cubic with flat ends between."""
    t: F32 = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _split(points: Points) -> tuple[list[NDArray[np.int32]], list[F32]]:
    """Lattice cell (wrapped) and position in the cell, by axis."""
    floors = [np.floor(p) for p in points]
    cells = [floor.astype(np.int32) & (PERIOD - 1) for floor in floors]
    return cells, [p - floor for p, floor in zip(points, floors, strict=True)]


def _corners(
    lattice: Lattice, cell: list[NDArray[np.int32]], steps: tuple[int, ...]
) -> Iterator[tuple[tuple[int, int, int], NDArray[np.int32]]]:
    """Yield each neighbour (x, y, z steps from the cell) and its index into the lattice's tables."""
    table, wrap = lattice.permutation, PERIOD - 1
    y_cells = {step: (cell[1] + step) & wrap for step in steps}
    z_cells = {step: (cell[2] + step) & wrap for step in steps}
    for i in steps:
        x_hash = table[(cell[0] + i) & wrap]
        for j in steps:
            xy_hash = table[x_hash + y_cells[j]]
            for k in steps:
                yield (i, j, k), table[xy_hash + z_cells[k]]
