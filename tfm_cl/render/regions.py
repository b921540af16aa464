"""Where lights light anything: of each the part of a ball that lies in a cone, and what touches it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.scene.lights.charts import COARSEST, Perspective
from tfm_cl.scene.transform import turned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.lights import Light

Floats = NDArray[np.float64]

FADED = 2.0**-16
"""Part of a light's reach, at its end, that is left out: (1 - (d / reach)⁴)² is below 2⁻²⁸ there."""
AXES = np.eye(3)
CORNERS = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
"""Of a map, u and v."""


@dataclass(frozen=True)
class LitRegions:
    """The regions of single lights, one row each.

    Those of light from infinity are unbounded.
    """

    apex: Floats
    """[n, 3], position, world; 0 for light from infinity."""
    axis: Floats
    """[n, 3], unit: of the cone, or the direction of light from infinity."""
    angle: Floats
    """[n], half angle of the cone, radians; π for light in all directions."""
    reach: Floats
    """[n], world units, may be infinite; where the light `FADED`."""
    parallel: NDArray[np.bool_]
    """[n], whether the light comes from infinity."""

    @classmethod
    def of(cls, lights: Sequence[Light]) -> Self:
        """Return those of single, fitted lights."""
        cones = [light.lit_cone() for light in lights]
        frames = [
            light.frame().world_from_light if cone is None else cone.world_from_light
            for light, cone in zip(lights, cones, strict=True)
        ]
        matrices = np.stack(frames) if frames else np.zeros((0, 4, 4))
        parallel = np.array([cone is None for cone in cones], dtype=bool)
        slope = np.array([np.inf if cone is None else cone.slope for cone in cones])
        reach = np.array([np.inf if cone is None else cone.reach for cone in cones])
        return cls(
            np.where(parallel[:, None], 0, matrices[:, :3, 3]),
            matrices[:, :3, 2],
            np.where(np.isinf(slope), np.pi, np.arctan(slope)),
            (1 - FADED) * reach,
            parallel,
        )

    @classmethod
    def of_map(cls, light: Light) -> Self:
        """Return what all rays of a light's map cover, which is wider than its cone; one row."""
        region = cls.of([light])
        if light.headers[0] != Perspective.HEADER:
            return region.widened(np.full(1, np.pi))
        _, corners = light.rays(CORNERS)
        angles = np.arccos(np.clip(_along(corners, region.axis[0]), -1, 1))
        return region.widened(np.maximum(angles.max() - region.angle, 0))

    def __getitem__(self, rows: NDArray[np.integer] | Sequence[int]) -> Self:
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def widened(self, angle: Floats) -> Self:
        """Return them with half angles that are larger by ``angle`` [n], radians."""
        wider = np.minimum(self.angle + angle, np.pi)
        return type(self)(self.apex, self.axis, wider, self.reach, self.parallel)

    def with_texels(self, charts: NDArray[np.floating], sizes: NDArray[np.int64]) -> Self:
        """Return them with the texels around them, which filters of shadow maps look up too.

        Parameters
        ----------
        charts
            [n, 4], `tfm_cl.scene.lights.charts.Chart.window`.
        sizes
            [n], texels along a side of the lights' shadow maps.
        """
        texels = charts[:, :2].min(axis=1).astype(np.float64) * sizes
        angles = np.zeros(len(texels))  # of light from infinity, which has no chart
        np.divide(COARSEST * np.sqrt(2), texels, out=angles, where=texels > 0)
        return self.widened(angles)

    @property
    def key(self) -> tuple[bytes, ...]:
        """What they depend on."""
        return tuple(getattr(self, field.name).tobytes() for field in fields(self))

    def extent(self, direction: Floats) -> Floats:
        """Largest coordinate [n] along a unit direction [3], world: the support function of the regions."""
        away = np.arccos(np.clip(_along(self.axis, direction), -1, 1)) - self.angle
        along = np.cos(np.clip(away, 0, np.pi / 2))
        along[away >= np.pi / 2] = 0  # the apex is the farthest
        with np.errstate(invalid="ignore"):
            end = np.where(along > 0, self.reach * along, 0)
        return _along(self.apex, direction) + end

    def touch_plane(self, point: Floats, normal: Floats) -> NDArray[np.bool_]:
        """Tell which reach from one side of a plane (point and unit normal [3], world) to the other, [n]."""
        height = float(point @ normal)
        return (self.extent(normal) > height) & (-self.extent(-normal) < height)

    def sides(self, point: Floats, normal: Floats) -> Floats:
        """Return the sign of the lights' heights above a plane, [n]; 0 for those in it."""
        heights = _along(np.where(self.parallel[:, None], -self.axis, self.apex - point), normal)
        return np.sign(heights)

    @property
    def bounds(self) -> Floats:
        """[n, 2, 3], low and high corners; may be infinite."""
        high = np.stack([self.extent(axis) for axis in AXES], axis=-1)
        low = np.stack([-self.extent(-axis) for axis in AXES], axis=-1)
        return np.stack([low, high], axis=-2)

    def touch_boxes(self, boxes: Floats) -> NDArray[np.bool_]:
        """Tell which may touch the box in their row; those that do are among them.

        Parameters
        ----------
        boxes
            [..., n, 2, 3], low and high corners, world; [m, 1, 2, 3] are m boxes for all of them.

        Returns
        -------
        numpy.ndarray
            [..., n].
        """
        own, low, high = self.bounds, boxes[..., 0, :], boxes[..., 1, :]
        overlap = ((own[:, 0] <= high) & (own[:, 1] >= low)).all(axis=-1)
        nearest = np.linalg.norm(np.clip(self.apex, low, high) - self.apex, axis=-1)
        # The cone against the sphere around the box.
        away, radius = (low + high) / 2 - self.apex, np.linalg.norm(high - low, axis=-1) / 2
        distance = np.linalg.norm(away, axis=-1)
        outside = distance > radius
        safe = np.where(outside, distance, 1)
        cosine = (away * self.axis).sum(axis=-1) / safe
        widest = self.angle + np.arcsin(np.where(outside, radius / safe, 1))
        within = ~outside | (np.arccos(np.clip(cosine, -1, 1)) <= widest)
        touching: NDArray[np.bool_] = overlap & (nearest < self.reach) & within
        return touching


def _along(vectors: Floats, direction: Floats) -> Floats:
    """Coordinates [n] of vectors [n, 3] along a direction [3]."""
    return turned(vectors, direction[:, None])[:, 0]
