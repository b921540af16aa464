"""Primitives without a depth: a ray crosses each at one place, and leaves a part of its light there."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.constants import MOST_OPACITY
from tfm_cl.scene.bodies.primitives import (
    Primitives,
    Spread,
    counts_along,
    in_groups,
    mean_opacity,
    medium_of,
    numbers_of,
    rigid_scale,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]

TEXELS_ACROSS = 512
"""Texels, as they should be, across the bounds of what is thinner than that."""
TINY = float(np.finfo(np.float32).tiny)


class ThinPrimitives(Primitives):
    """What strands and polygons have in common; their densities are optical depths of one crossing.

    Attributes
    ----------
    corners
        float64 [n, corners, 3], of each primitive, world.
    """

    DENSITY_KEY: ClassVar[str] = "opacity"
    corners: Floats

    def _fill(
        self, corners: Floats, depths: Floats, colour: NDArray[np.float32] | None, medium: Medium | None
    ) -> None:
        """Keep what has been checked."""
        self.corners, self.densities, self._colour = corners, depths, colour
        self.positions = corners.mean(axis=1)
        self.radii = np.linalg.norm(corners - self.positions[:, None], axis=2).max(axis=1)
        self.medium = medium_of(medium, self.label)

    @abstractmethod
    def crossed(self, origin: Floats, direction: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """Tell which primitives a ray crosses, [n], and where, distances of those, for a unit direction."""

    def held(self, sigma_t: float) -> Floats:
        """As `Primitives.held`: their optical depths are those of a medium of any extinction."""
        return self.masses * mean_opacity(self.densities) / (sigma_t or 1.0)

    def spread(self, apart: float) -> Iterator[Spread]:
        """As `Primitives.spread`: the middles of even parts, of strands or of triangles."""
        edges = np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=1), axis=2).max(axis=1)
        power = self.corners.shape[1] - 1
        for count, numbers in in_groups(counts_along(edges, apart, power), power):
            weights = middles(count, power)
            places = np.einsum("pc,nci->npi", weights, self.corners[numbers])
            share = np.full(len(weights) * len(numbers), 1 / len(weights))
            yield Spread(places.reshape(-1, 3), share, numbers.repeat(len(weights)))

    @property
    @abstractmethod
    def thickness(self) -> float:
        """World units, of one, at least: what lies nearer along a ray of light is the same one."""

    @property
    def least_detail(self) -> float:
        """World units: twice the width of as many texels as `TEXELS_ACROSS`."""
        low, high = self.bounds
        return 2 * float((high - low).max()) / TEXELS_ACROSS

    @property
    def largest_density(self) -> Floats:
        """As if a ray met all of them, [3]."""
        largest: Floats = super().largest_density / max(self.longest_ray, TINY)
        return largest

    @property
    def opacity(self) -> float:
        """The largest of one crossing."""
        return float(-np.expm1(-self.densities.max()))

    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> Floats:
        """As `MarchedBody.depths_along`, in closed form."""
        met, distances = self.crossed(np.asarray(origin, np.float64), np.asarray(direction, np.float64))
        colour = np.ones((len(distances), 1)) if self.colour is None else self.colour[met].astype(np.float64)
        depths = np.zeros((len(edges) - 1, colour.shape[1]))
        step = np.searchsorted(edges, distances) - 1
        within = (step >= 0) & (step < len(depths))
        np.add.at(depths, step[within], (self.densities[met, None] * colour)[within])
        return depths

    def transformed(self, world_from_body: ArrayLike) -> Self:
        """As `Primitives.transformed`."""
        matrix = np.asarray(world_from_body, dtype=np.float64)
        scale = rigid_scale(matrix, self.label)
        velocity = None if self.velocity is None else self.velocity @ matrix[:3, :3].T
        corners = self.corners @ matrix[:3, :3].T + matrix[:3, 3]
        return self._moving(self._like(corners, self.densities, scale), velocity)

    def with_density(self, factor: float) -> Self:
        """As `Primitives.with_density`."""
        return self._moving(self._like(self.corners, self.densities * factor, 1.0), self.velocity)

    def moved(self, frames: float) -> Self:
        """As `Primitives.moved`."""
        if self.velocity is None:
            return self
        corners = self.corners + self._step(self.velocity, frames)
        return self._moving(self._like(corners, self.densities, 1.0), self.velocity)

    def _moving(self, other: Self, velocity: Floats | None) -> Self:
        """Let others move at this velocity [n, corners, 3], as long in a frame as these."""
        other.velocity, other.seconds_a_frame = velocity, self.seconds_a_frame
        return other

    def _like(self, corners: Floats, depths: Floats, scale: float) -> Self:
        """Return others, whose sizes are so many times as large."""
        del scale
        other = object.__new__(type(self))
        other.source, other.chosen = self.source, dict(self.chosen)
        other._fill(corners, depths, self._colour, self.medium)
        return other

    def __repr__(self) -> str:
        coloured = "" if self._colour is None else "coloured, "
        name = type(self).__name__
        return f"{name}({self.label}, {len(self.corners)} in all, {coloured}opacity up to {self.opacity:g})"


def middles(count: int, power: int) -> Floats:
    """Weights of the corners ``[parts, power + 1]`` of the middles of count^power even parts.

    Of a line (1), or of a triangle (2), whose parts are triangles.
    """
    if power == 1:
        along = (np.arange(count) + 0.5) / count
        return np.stack([1 - along, along], axis=1)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    upright, turned = i + j < count, i + j < count - 1
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / count
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / count
    return np.stack([1 - first - second, first, second], axis=1)


def depths_of(opacity: ArrayLike, count: int, label: str) -> Floats:
    """Check opacities, one for all or one each; returns optical depths [count].

    Raises
    ------
    VolumeError
        Numbers beyond 0 to 1, or too few.
    """
    taken = numbers_of(opacity, count, "opacity", label, most=1.0)
    depths: Floats = -np.log1p(-np.minimum(taken, MOST_OPACITY))
    return depths


def each_of(values: Any, strand: NDArray[np.int64] | None) -> Any:
    """Give what is said of each strand to each of its points, ``strand`` [points] being their numbers."""
    array = np.asarray(values)
    if strand is None or array.ndim == 0 or len(array) == len(strand) or len(array) != strand[-1] + 1:
        return array
    return array[strand]


def thickness_of(bodies: Sequence[Primitives]) -> float:
    """Return the largest thickness of any body's; 0 where none is of thin primitives."""
    return max((body.thickness for body in bodies if isinstance(body, ThinPrimitives)), default=0.0)
