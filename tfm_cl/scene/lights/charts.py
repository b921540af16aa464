"""Charts: where the rays of a light with a place lie in the square of its maps, u and v in [0, 1]².

A chart maps directions of light space, whose z runs through the middle of what is mapped, to a plane, and a
window of the plane to the square. The kernels' headers do the same (``kernels/light/chart``).

- `Perspective`: the plane z = 1. Right for narrow views; its texels shrink as cos³ of the angle.
- `Hemisphere`: half an octahedron, a square that stands on its corner, turned by an eighth.
- `Octahedron`: all directions; the lower half (z < 0) is folded out into the square's corners.

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
"""Width of an octahedron's border on every side, in parts of the map.

It repeats the rays from across the seam. A fraction, not a texel, because transmittance map, shadow map and
probes of one light differ in resolution but share u, v. Bilinear look-ups reach half a texel beyond the
octahedron: they see no seam in maps of 16 texels or more, and filters of k more texels on every side none
from 32 k + 16 texels on. In smaller maps the look-up is clamped at the outermost texels' centres.
"""
MARGIN = 1 / 256
"""Of a window's width, around what has to lie in it: look-ups near its side find texels on both sides."""
OUTSIDE = -1.0
"""u and v of what no texel can show."""
COARSEST = 27**0.25
"""The octahedron's texels are widest in the middle of its faces, by this factor over those at its corners."""
NARROWEST = 1e-30
"""Width of a window, at least: its inverse is a float32."""
TINY = 1e-100


@dataclass(frozen=True)
class Chart(ABC):
    """A plane map of directions, and the window of it that the square shows."""

    low: tuple[float, float]
    high: tuple[float, float]

    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``."""

    @abstractmethod
    def plane(self, directions: Floats) -> Floats:
        """Places [n, 2] of directions [n, 3] of any length; NaN where there is none."""

    @abstractmethod
    def lifted(self, places: Floats) -> Floats:
        """Directions [n, 3], of any length, of places [n, 2]."""

    @property
    @abstractmethod
    def width(self) -> float:
        """Width of the square at distance 1 if all its texels were as wide as the widest."""

    @property
    def window(self) -> tuple[float, float, float, float]:
        """Return what kernels are told: u = window[0] x + window[2], v = window[1] y + window[3]."""
        scale = 1 / np.maximum(np.subtract(self.high, self.low), NARROWEST)
        offset = -scale * self.low
        return (*scale.tolist(), *offset.tolist())

    def positions(self, directions: Floats) -> Floats:
        """u, v [n, 2] of directions [n, 3] of any length; `OUTSIDE` for those that have none."""
        scale_u, scale_v, *offset = self.window
        position = self.plane(directions) * (scale_u, scale_v) + offset
        return np.where(np.isnan(position), OUTSIDE, position)

    def directions(self, positions: Floats) -> Floats:
        """Return unit directions [n, 3] of u, v [n, 2]."""
        directions = self.lifted(self.low + positions * np.subtract(self.high, self.low))
        unit: Floats = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return unit

    @property
    def key(self) -> tuple[object, ...]:
        """What tells charts apart."""
        return self.HEADER, self.low, self.high


@dataclass(frozen=True)
class Perspective(Chart):
    """x / z and y / z: everything before the light."""

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
        """The window's: texels on the axis are the widest."""
        return float(np.subtract(self.high, self.low).max())


@dataclass(frozen=True)
class Hemisphere(Chart):
    """The upper half of |x| + |y| + |z| = 1 seen along z, its square turned by an eighth."""

    HEADER: ClassVar[str] = "light/chart/hemisphere.h"

    @classmethod
    def around(cls, slope: float) -> "Hemisphere":
        """Show the cone around z of a half angle whose tangent is ``slope``, infinite for a right angle."""
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
        """As `Chart.lifted`; beyond the square, below the horizon."""
        x, y = places.sum(axis=1) / 2, (places[:, 0] - places[:, 1]) / 2
        return np.column_stack([x, y, 1 - np.abs(x) - np.abs(y)])

    @property
    def width(self) -> float:
        """Of texels in the middle of faces."""
        return COARSEST * float(np.subtract(self.high, self.low).max()) / math.sqrt(2)


@dataclass(frozen=True)
class Octahedron(Chart):
    """All directions, in the square [-1, 1]² with a border around it."""

    HEADER: ClassVar[str] = "light/chart/octahedron.h"

    @classmethod
    def whole(cls) -> "Octahedron":
        """Show all directions."""
        half = 1 / (1 - 2 * BORDER)
        return cls((-half, -half), (half, half))

    def plane(self, directions: Floats) -> Floats:
        """As `Chart.plane`; the middle for a direction of no length."""
        size = np.abs(directions).sum(axis=-1)
        x, y, _ = directions.T / np.maximum(size, TINY)
        return _folded(directions[:, 2] < 0, x, y)

    def lifted(self, places: Floats) -> Floats:
        """As `Chart.lifted`.

        Beyond a side the square goes on as its own half turn about the middle of that side, so that
        neighbours have neighbouring directions.
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
        """Of texels in the middle of faces."""
        return COARSEST * float(np.subtract(self.high, self.low).max())


def _folded(lower: NDArray[np.bool_], x: Floats, y: Floats) -> Floats:
    """Swap the corners (z < 0) and where the lower half would lie if it were seen from above."""
    return np.column_stack(
        [
            np.where(lower, np.copysign(1 - np.abs(y), x), x),
            np.where(lower, np.copysign(1 - np.abs(x), y), y),
        ]
    )
