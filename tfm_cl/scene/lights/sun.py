"""The sun: parallel light."""

from collections.abc import Sequence
from itertools import product
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from tfm_cl.errors import SceneError
from tfm_cl.model import RGB, Vec3, check_different
from tfm_cl.scene.frames import facing
from tfm_cl.scene.lights.base import Arrival, Floats, Light, LightFrame
from tfm_cl.scene.transform import turned

MARGIN = 1e-5
"""Of the bounds' diagonal, around what the map covers: some hundred roundings of float32."""
BEFORE = 1e-3
"""Of the diagonal of all that is to be lit, before the first of it: distances are > 0 in float32."""


class SunLight(Light):
    """Parallel light along from → to; its map is a rectangle across, fitted to the medium's bounds.

    ``from`` and ``to`` give the direction only. Distances begin on a plane before all that the light was
    `fitted` to.
    """

    HEADER: ClassVar[str] = "light/sun.h"

    type: Literal["sun"] = "sun"
    from_: Vec3 = Field(alias="from", description="the light travels from here to to, from any distance")
    to: Vec3 = Field(description="point that gives the direction, world units")
    intensity: RGB = Field((1.0, 1.0, 1.0), description="RGB irradiance on a plane that faces the light")
    falloff: Literal["none"] = Field("none", description="none: a sun is equally bright everywhere")
    _corners: Floats | None = PrivateAttr(default=None)
    _all_corners: Floats | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _has_a_direction(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        return self

    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """Fit the map to the bounds' corners, and begin before these.

        What casts shadows further upstream has no part in it: it may lie so far away that distances would
        lose their digits.
        """
        sun = self.model_copy()
        sun._corners = _corners_of(bounds)  # noqa: SLF001 - of the same class
        sun._all_corners = None if everything is None else _corners_of(everything)  # noqa: SLF001
        return sun

    @property
    def needs_fitting(self) -> bool:
        """Whether there are no bounds yet."""
        return self._corners is None

    def replace(self, **changes: Any) -> Self:
        """As `Model.replace`; what the map was fitted to stays."""
        sun = super().replace(**changes)
        sun._corners, sun._all_corners = self._corners, self._all_corners  # noqa: SLF001 - of the same class
        return sun

    def frame(self) -> LightFrame:
        """Origin in the middle of where the rays begin; shape = half width, half height of the map."""
        if self._corners is None:
            raise SceneError("light: a sun's map is fitted to the medium first, SunLight.fitted(bounds)")
        axes = facing(self.from_, self.to)
        corners = self._corners @ axes[:3, :3]
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        nearest = low[2] if self._all_corners is None else (self._all_corners @ axes[:3, 2]).min()
        middle[2] = min(low[2], nearest) - BEFORE * size
        axes[:3, 3] = axes[:3, :3] @ middle
        half_width, half_height = (high - low)[:2] / 2 + MARGIN * size
        return LightFrame(axes, (float(half_width), float(half_height)))

    def footprint(self, distance: float) -> float:
        """Width of the map's longer side, everywhere."""
        del distance
        return 2 * max(self.frame().shape)

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """Parallel, from the plane where distances begin."""
        frame = self.frame()
        axes, origin = frame.world_from_light[:3, :3], frame.world_from_light[:3, 3]
        origins = turned((2 * positions - 1) * frame.shape, axes[:, :2].T) + origin
        return origins, np.broadcast_to(axes[:, 2], origins.shape)

    def begins(self, points: Floats) -> Floats:
        """On the plane, against the direction."""
        matrix = self.frame().world_from_light
        distance = turned(points - matrix[:3, 3], matrix[:3, 2:3])[:, 0]
        start: Floats = points - distance[:, None] * matrix[:3, 2]
        return start

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """Distances are < 0 upstream of the plane where they begin."""
        frame = self.frame()
        axes, origin = frame.world_from_light[:3, :3], frame.world_from_light[:3, 3]
        local = turned(points - origin, axes)
        position = (local[:, :2] / frame.shape + 1) / 2
        return Arrival(
            np.broadcast_to(axes[:, 2], points.shape),
            local[:, 2],
            position,
            self.falloff_at(local[:, 2], nearest),
            position,
        )

    def source_distance(self, points: Floats) -> Floats:
        """Infinite."""
        return np.full(len(points), np.inf)


def _corners_of(bounds: Floats | Sequence[Sequence[float]]) -> Floats:
    """Corners of a box, [2, 3] to [8, 3]."""
    return np.array(list(product(*np.asarray(bounds, dtype=np.float64).T)))
