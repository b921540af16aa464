"""Charts: how the rays of a light with a position are laid out on the square of its maps, u and v in [0, 1]².

A chart maps directions in light space, whose z axis points to the centre of the chart, to a plane, and a
window of that plane to the square. The kernel headers in ``kernels/light/chart`` do the same.

- `Perspective`: the plane z = 1. Suits narrow views; the solid angle of its texels shrinks as cos³ of the
  angle.
- `Hemisphere`: half an octahedron, a square that stands on a corner, rotated by 45°.
- `Octahedron`: all directions; the lower half (z < 0) is folded out into the corners of the square.

Engelhardt, Dachsbacher, "Octahedron Environment Maps", VMV 2008; Cigolle et al., "A Survey of Efficient
Representations for Independent Unit Vectors", JCGT 3(2), 2014.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BORDER = 1 / 32
"""Width of the border on every side of an octahedral map, as a fraction of the map's width.

The border repeats the rays from across the seam. Its width is a fraction and not a number of texels because
the transmittance map, the shadow map and the probes of a light differ in resolution but share u and v.
Bilinear look-ups reach half a texel beyond the octahedron, so they see no seam in maps of at least 16 texels
per side; filters that extend k texels further need 32 k + 16. In smaller maps, look-ups are clamped to the
centres of the outermost texels.
"""
MARGIN = 1 / 256
"""Margin of a chart's window around what it has to cover, as a fraction of its width: look-ups near the
boundary then find texels on both sides."""
OUTSIDE = -1.0
"""The u and v of directions that a chart does not cover."""
COARSEST = 27**0.25
"""Width of an octahedral map's texels at the centres of the faces, where they are widest, relative to those
at the corners."""
NARROWEST = 1e-30
"""Smallest width of a chart's window: its inverse must be a finite float32."""
TINY = 1e-100


@dataclass(frozen=True)
class Chart(ABC):
    """A mapping of directions to a plane, and the window of that plane that fills the square of a map."""

    low: tuple[float, float]
    high: tuple[float, float]

    HEADER: ClassVar[str]
    """Kernel header, relative to ``kernels/``."""

    @abstractmethod
    def plane(self, directions: Floats) -> Floats:
        """Positions [n, 2] in the plane of directions [n, 3] of any length; NaN for those not covered."""

    @abstractmethod
    def lifted(self, places: Floats) -> Floats:
        """Directions [n, 3], of any length, for positions [n, 2] in the plane."""

    @property
    @abstractmethod
    def width(self) -> float:
        """Width of the square at distance 1 if all its texels were as wide as the widest."""

    @property
    def window(self) -> tuple[float, float, float, float]:
        """Parameters for the kernels: u = window[0] x + window[2], v = window[1] y + window[3]."""
        scale = 1 / np.maximum(np.subtract(self.high, self.low), NARROWEST)
        offset = -scale * self.low
        return (*scale.tolist(), *offset.tolist())

    def positions(self, directions: Floats) -> Floats:
        """u, v [n, 2] of directions [n, 3] of any length; `OUTSIDE` for those not covered."""
        scale_u, scale_v, *offset = self.window
        position = self.plane(directions) * (scale_u, scale_v) + offset
        return np.where(np.isnan(position), OUTSIDE, position)

    def directions(self, positions: Floats) -> Floats:
        """Return unit directions [n, 3] for u, v [n, 2]."""
        directions = self.lifted(self.low + positions * np.subtract(self.high, self.low))
        unit: Floats = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return unit

    @property
    def key(self) -> tuple[object, ...]:
        """Values that identify the chart."""
        return self.HEADER, self.low, self.high


@dataclass(frozen=True)
class Perspective(Chart):
    """x / z and y / z: directions in front of the light."""

    HEADER: ClassVar[str] = "light/chart/perspective.h"

    def plane(self, directions: Floats) -> Floats:
        """As `Chart.plane`."""
        ahead = directions[:, 2:] > 0
        places: Floats = np.where(ahead, directions[:, :2] / np.where(ahead, directions[:, 2:], 1), np.nan)
        return places

    def lifted(self, places: Floats) -> Floats:
        """As `Chart.lifted`."""
        return np.column_stack([places, np.ones(len(places))])

    @property
    def width(self) -> float:
        """Width of the window: the texels on the axis are the widest."""
        return float(np.subtract(self.high, self.low).max())


@dataclass(frozen=True)
class Hemisphere(Chart):
    """The upper half of |x| + |y| + |z| = 1 seen along z, its square rotated by 45°."""

    HEADER: ClassVar[str] = "light/chart/hemisphere.h"

    @classmethod
    def around(cls, slope: float) -> "Hemisphere":
        """Cover the cone around z whose half angle has the tangent ``slope``, infinite for 90°."""
        # x / (|x| + |y| + z) + y / (…) is largest where x = y.
        half = 1 / (1 + math.sqrt(0.5) / slope)
        half *= 1 + 2 * MARGIN
        return cls((-half, -half), (half, half))

    def plane(self, directions: Floats) -> Floats:
        """As `Chart.plane`."""
        x, y, z = directions.T
        ahead = z >= 0
        size = np.where(ahead, np.maximum(np.abs(x) + np.abs(y) + z, TINY), np.nan)
        return np.column_stack([(x + y) / size, (x - y) / size])

    def lifted(self, places: Floats) -> Floats:
        """As `Chart.lifted`; positions beyond the square give directions below the horizon."""
        x, y = places.sum(axis=1) / 2, (places[:, 0] - places[:, 1]) / 2
        return np.column_stack([x, y, 1 - np.abs(x) - np.abs(y)])

    @property
    def width(self) -> float:
        """Width for the texels at the centres of the faces."""
        return COARSEST * float(np.subtract(self.high, self.low).max()) / math.sqrt(2)


@dataclass(frozen=True)
class Octahedron(Chart):
    """All directions, in the square [-1, 1]² with a border around it."""

    HEADER: ClassVar[str] = "light/chart/octahedron.h"

    @classmethod
    def whole(cls) -> "Octahedron":
        """Cover all directions."""
        half = 1 / (1 - 2 * BORDER)
        return cls((-half, -half), (half, half))

    def plane(self, directions: Floats) -> Floats:
        """As `Chart.plane`; the centre for a vector of length 0."""
        size = np.abs(directions).sum(axis=-1)
        x, y, _ = directions.T / np.maximum(size, TINY)
        return _folded(directions[:, 2] < 0, x, y)

    def lifted(self, places: Floats) -> Floats:
        """As `Chart.lifted`.

        Beyond a side the square continues as a copy of itself, rotated by 180° about the centre of that
        side, so that neighbouring positions have neighbouring directions.
        """
        x, y = places.T
        outside = np.abs(x) > 1
        x, y = np.where(outside, np.copysign(2, x) - x, x), np.where(outside, -y, y)
        outside = np.abs(y) > 1
        x, y = np.where(outside, -x, x), np.where(outside, np.copysign(2, y) - y, y)
        z = 1 - np.abs(x) - np.abs(y)
        return np.column_stack([_folded(z < 0, x, y), z])

    @property
    def width(self) -> float:
        """Width for the texels at the centres of the faces."""
        return COARSEST * float(np.subtract(self.high, self.low).max())


CHARTS: tuple[type[Chart], ...] = (Perspective, Hemisphere, Octahedron)
"""All of them, by their numbers in files."""


def _folded(lower: NDArray[np.bool_], x: Floats, y: Floats) -> Floats:
    """Exchange the corners (z < 0) with the projection of the lower half along z; its own inverse."""
    return np.column_stack(
        [
            np.where(lower, np.copysign(1 - np.abs(y), x), x),
            np.where(lower, np.copysign(1 - np.abs(x), y), y),
        ]
    )
