"""The clear sky: its radiance, the sun's irradiance, and what the ground reflects of both.

Hosek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance", ACM Transactions on Graphics 31(4),
2012, and "Adding a Solar-Radiance Function to the Hošek–Wilkie Skylight Model", IEEE CG&A 33(3), 2013. Their
numbers for linear Rec. 709 are in `tfm_cl.files.hosek_wilkie`. The Prague models that followed (2021, 2022)
need a hundred megabytes of numbers and more; the one library of them on PyPI, skylight, is under the GPL.

The models end at the horizon. The ground is ours: even and diffuse, it fades into the haze.

Directions are in the sky's own frame: +y is the zenith. What is asked for in float32 is worked out so: what a
camera sees, whose picture has no more. Columns that lie one after the other in memory are the fastest.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tfm_cl.files.hosek_wilkie import dataset
from tfm_cl.scene.lights.base import Directions, Floats

SUN_RADIUS = math.radians(0.5358 / 2)
"""Of the sun's disk, radians."""
ROWS = 90
"""Bands of elevation in which the sky is summed up, from zenith to horizon; the ground has as many."""
COLUMNS = 180
"""Parts of each band."""
FOLLOWING = 0.01
"""Keeps the exponent finite at the horizon, in eq. 8 of the paper."""
LOWEST = math.sin(math.radians(1))
"""Height of the lowest directions that the model is asked for: below, its root breaks off, as a dark line."""
HAZE = 0.02
"""Extinction of the air above the ground, for each unit of turbidity, per kilometre."""
HEIGHT = 1.0
"""Of the camera above the ground, kilometres, as far as haze goes."""
TINY = 1e-9
"""Avoids a division by 0 at the horizon."""


def direction_of(elevation: Floats | float, azimuth: Floats | float) -> Floats:
    """Return unit directions [..., 3] from angles in radians; azimuth 0 is +z, a quarter of a turn +x."""
    across = np.cos(elevation)
    parts = np.broadcast_arrays(across * np.sin(azimuth), np.sin(elevation), across * np.cos(azimuth))
    return np.stack(parts, axis=-1)


_EDGES = np.linspace(math.pi / 2, -math.pi / 2, 2 * ROWS + 1)

DIRECTIONS = direction_of(
    ((_EDGES[1:] + _EDGES[:-1]) / 2)[:, None], (np.arange(COLUMNS) + 0.5) / COLUMNS * 2 * math.pi
)
"""[2 ROWS, COLUMNS, 3], from the zenith to the nadir."""
SOLID_ANGLES = -np.diff(np.sin(_EDGES)) * 2 * math.pi / COLUMNS
"""[2 ROWS], steradians around each direction of a row."""


@dataclass(frozen=True)
class ClearSky:
    """A sky of some clearness, with the sun somewhere above the horizon.

    Radiances are W / (m² sr nm), weighted over wavelengths as by luminance: 1 is 72,900 cd/m².
    """

    sun: tuple[float, float, float]
    """Unit direction to the sun, y ≥ 0."""
    turbidity: float
    """1 to 10."""
    albedo: tuple[float, float, float]
    """Of the ground, 0 to 1."""

    @cached_property
    def _shape(self) -> Floats:
        """Parameters A to I of the distribution, [9, RGB]."""
        return self._interpolated(dataset().shape).T

    @cached_property
    def _mean(self) -> Floats:
        """Mean radiance, [RGB]."""
        return self._interpolated(dataset().radiance[..., None])[:, 0]

    def _between(self, values: Floats) -> Floats:
        """Interpolate values linearly between turbidities, along the first axis."""
        low = min(int(self.turbidity), len(values) - 1) - 1
        part = self.turbidity - 1 - low
        mixed: Floats = (1 - part) * values[low] + part * values[low + 1]
        return mixed

    def _interpolated(self, values: Floats) -> Floats:
        """Interpolate control points [10, 2, 6, RGB, n]: a Bézier curve in the cube root of the elevation."""
        at, degree = np.cbrt(self._elevation / (math.pi / 2)), values.shape[2] - 1
        weights = [math.comb(degree, i) * at**i * (1 - at) ** (degree - i) for i in range(degree + 1)]
        black, white = np.einsum("k,akcn->acn", weights, self._between(values))
        albedo = np.asarray(self.albedo)[:, None]
        mixed: Floats = (1 - albedo) * black + albedo * white
        return mixed

    @property
    def _elevation(self) -> float:
        return math.asin(min(max(self.sun[1], 0.0), 1.0))

    @cached_property
    def sun_irradiance(self) -> Floats:
        """Of the sun's disk on a plane that faces it, behind the air, [RGB]."""
        pieces = self._between(dataset().sun)
        piece = min(int(np.cbrt(self._elevation / (math.pi / 2)) * len(pieces)), len(pieces) - 1)
        beyond = self._elevation - (piece / len(pieces)) ** 3 * math.pi / 2
        irradiance: Floats = np.maximum(pieces[piece] @ beyond ** np.arange(4), 0)
        return irradiance

    def sky_radiance(self, directions: Directions) -> Directions:
        """Radiance [n, RGB] of the sky, without the sun, in unit directions [n, 3], y ≥ 0; eq. 8."""
        up, half = np.maximum(directions[:, 1], LOWEST), self._half_chord(directions)
        cosine, angle, root = 1 - 2 * half * half, 2 * np.arcsin(half), np.sqrt(up)
        square, inverse = cosine * cosine, 1 / (up + FOLLOWING)
        radiance = np.empty_like(directions)
        # One colour after the other: each array is then one row of numbers.
        for colour, (a, b, c, d, e, f, g, i, h) in enumerate(self._shape.T.tolist()):
            away = (1 + h * h) - 2 * h * cosine
            halo = (1 + square) / (away * np.sqrt(away))
            around = c + d * np.exp(e * angle) + f * square + g * halo + i * root
            gradient = 1 + a * np.exp(b * inverse)
            radiance[:, colour] = np.maximum(gradient * around * float(self._mean[colour]), 0)
        return radiance

    def _half_chord(self, directions: Directions) -> Directions:
        """Half of the distances [n] of unit vectors from that to the sun, at most 1: exact near it, too."""
        x, y, z = (directions[:, axis] - self.sun[axis] for axis in range(3))
        half: Directions = np.minimum(0.5 * np.sqrt(x * x + y * y + z * z), 1)
        return half

    @cached_property
    def ground_radiance(self) -> Floats:
        """Radiance of the ground nearby, which reflects sun and sky evenly, [RGB]."""
        directions = DIRECTIONS[:ROWS]
        from_sky = self.sky_radiance(directions.reshape(-1, 3)).reshape(*directions.shape)
        falling = directions[..., 1] * SOLID_ANGLES[:ROWS, None]
        irradiance = np.einsum("yxc,yx->c", from_sky, falling) + self.sun[1] * self.sun_irradiance
        radiance: Floats = np.asarray(self.albedo) / math.pi * irradiance
        return radiance

    @cached_property
    def light(self) -> Floats:
        """Radiance of sky and ground times solid angle, without the sun, of `DIRECTIONS`: [..., RGB]."""
        radiance = self.around(DIRECTIONS.reshape(-1, 3)).reshape(DIRECTIONS.shape)
        light: Floats = radiance * SOLID_ANGLES[:, None, None]
        return light

    def around(self, directions: Directions) -> Directions:
        """Radiance [n, RGB] of sky and ground in unit directions [n, 3], without the sun.

        The ground lies `HEIGHT` below. The air before it, of which there is much near the horizon, is as
        bright as that in the mirrored direction, so that nothing breaks off there.
        """
        down = -directions[:, 1]
        mirrored = directions.copy(order="K")
        np.abs(down, out=mirrored[:, 1])
        seen = self.sky_radiance(mirrored)
        clear = np.where(down > 0, np.exp(-HAZE * HEIGHT * self.turbidity / np.maximum(down, TINY)), 0)
        for colour, ground in enumerate(self.ground_radiance.tolist()):
            seen[:, colour] += clear * (ground - seen[:, colour])
        return seen

    def disk(self, directions: Directions, width: Directions) -> Directions:
        """Radiance [n, RGB] of the sun's disk, evenly bright, in unit directions [n, 3].

        Its edge is smoothed over ``width`` [n], an angle in radians; a disk that is smaller than that keeps
        its light. The ground hides it.
        """
        radiance, half = np.zeros_like(directions), self._half_chord(directions)
        # An arc is longer than its chord: the disk covers nothing beyond.
        near = np.flatnonzero(2 * half < np.maximum(SUN_RADIUS, width / 2) + width / 2)
        angle, width = 2 * np.arcsin(half[near]), width[near]
        edge = np.maximum(SUN_RADIUS, width / 2)
        covered = np.clip((edge - angle) / width + 0.5, 0, 1)
        covered *= np.clip(np.arcsin(np.clip(directions[near, 1], -1, 1)) / width + 0.5, 0, 1)
        radiance[near] = (covered / (math.pi * (edge**2 + width**2 / 12)))[:, None] * self.sun_irradiance
        return radiance
