"""The clear sky: its radiance, the sun's irradiance, and what the ground reflects of both.

Hosek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance", ACM Transactions on Graphics 31(4),
2012, and "Adding a Solar-Radiance Function to the Hošek–Wilkie Skylight Model", IEEE CG&A 33(3), 2013. Their
numbers for linear Rec. 709 are in `tfm_cl.files.hosek_wilkie`. The Prague models that followed (2021, 2022)
need a hundred megabytes of numbers and more; the one library of them on PyPI, skylight, is under the GPL.

The models end at the horizon. The ground is ours: even and diffuse, it fades into the haze.

Directions are in the sky's own frame: +y is the zenith.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tfm_cl.files.hosek_wilkie import dataset
from tfm_cl.scene.lights.base import Floats
from tfm_cl.scene.transform import turned

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

    def sky_radiance(self, directions: Floats) -> Floats:
        """Radiance [n, RGB] of the sky, without the sun, in unit directions [n, 3], y ≥ 0; eq. 8."""
        a, b, c, d, e, f, g, i, h = self._shape[:, None]
        up = np.maximum(directions[:, 1:2], LOWEST)
        cosine = np.clip(turned(directions, np.array([self.sun]).T), -1, 1)
        angle = np.arccos(cosine)
        halo = (1 + cosine**2) / (1 + h**2 - 2 * h * cosine) ** 1.5
        gradient = 1 + a * np.exp(b / (up + FOLLOWING))
        around = c + d * np.exp(e * angle) + f * cosine**2 + g * halo + i * np.sqrt(up)
        radiance: Floats = np.maximum(gradient * around * self._mean, 0)
        return radiance

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

    def around(self, directions: Floats) -> Floats:
        """Radiance [n, RGB] of sky and ground in unit directions [n, 3], without the sun.

        The ground lies `HEIGHT` below. The air before it, of which there is much near the horizon, is as
        bright as that in the mirrored direction, so that nothing breaks off there.
        """
        mirrored, down = directions.copy(), np.maximum(-directions[:, 1:2], TINY)
        mirrored[:, 1] = np.abs(mirrored[:, 1])
        sky = self.sky_radiance(mirrored)
        clear = np.where(directions[:, 1:2] < 0, np.exp(-HAZE * HEIGHT * self.turbidity / down), 0)
        mixed: Floats = (1 - clear) * sky + clear * self.ground_radiance
        return mixed

    def disk(self, directions: Floats, width: Floats) -> Floats:
        """Radiance [n, RGB] of the sun's disk, evenly bright, in unit directions [n, 3].

        Its edge is smoothed over ``width`` [n], an angle in radians; a disk that is smaller than that keeps
        its light. The ground hides it.
        """
        angle = 2 * np.arcsin(np.clip(np.linalg.norm(directions - self.sun, axis=1) / 2, 0, 1))
        edge = np.maximum(SUN_RADIUS, width / 2)
        covered = np.clip((edge - angle) / width + 0.5, 0, 1)
        covered *= np.clip(np.arcsin(np.clip(directions[:, 1], -1, 1)) / width + 0.5, 0, 1)
        radiance: Floats = (covered / (math.pi * (edge**2 + width**2 / 12)))[:, None] * self.sun_irradiance
        return radiance
