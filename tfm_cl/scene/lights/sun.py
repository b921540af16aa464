"""The sun: parallel light."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from tfm_cl.errors import SceneError
from tfm_cl.model import RGB, Vec3, check_different
from tfm_cl.scene.frames import facing
from tfm_cl.scene.lights.base import Arrival, Floats, Light, LightFrame, PartOfSky, fit_array
from tfm_cl.scene.transform import corners_of, turned

MARGIN = 1e-5
"""Margin of a sun's map, as a fraction of the bounds' diagonal: some hundred rounding errors of float32."""
BEFORE = 1e-3
"""Gap between the plane where a sun's distances begin and the first lit point, as a fraction of the diagonal
of all that is lit: it keeps distances > 0 in float32."""


class SunLight(Light):
    """Parallel light along from → to; its map is a perpendicular rectangle, fitted to the medium's bounds.

    ``from`` and ``to`` only define the direction. Distances are measured from a plane in front of everything
    that the light was `fitted` to.
    """

    HEADER: ClassVar[str] = "light/sun.h"

    type: Literal["sun"] = "sun"
    from_: Vec3 = Field(
        validation_alias="from",
        description="start of the direction, world units; how far away it is does not matter",
    )
    to: Vec3 = Field(description="end of the direction in which the light travels, world units")
    intensity: RGB = Field(
        default=(1.0, 1.0, 1.0),
        validate_default=True,
        description="RGB irradiance on a plane facing the light",
    )
    falloff: Literal["none"] = Field(default="none", description="none: a sun is equally bright everywhere")
    _corners: Floats | None = PrivateAttr(default=None)
    _all_corners: Floats | None = PrivateAttr(default=None)
    _part: PartOfSky = PrivateAttr(default=PartOfSky())

    @model_validator(mode="after")
    def _has_a_direction(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        return self

    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """Fit the map to the bounds' corners, and begin before these.

        Objects further upstream that cast shadows are not included: they may be so far away that distances
        would lose precision.
        """
        sun = self.model_copy()
        sun._corners = corners_of(bounds)  # noqa: SLF001 - of the same class
        sun._all_corners = None if everything is None else corners_of(everything)  # noqa: SLF001
        vars(sun).pop("_frame", None)
        return sun

    def fit(self) -> dict[str, Floats]:
        """As `Light.fit`: the corners, [8, 3], of what the map shows, and of all that is lit."""
        found = {"corners": self._corners, "all_corners": self._all_corners}
        return {name: corners for name, corners in found.items() if corners is not None}

    def with_fit(self, fit: Mapping[str, Floats]) -> Self:
        """As `Light.with_fit`."""
        sun = self.model_copy()
        sun._corners = fit_array(fit, "corners", (8, 3))  # noqa: SLF001 - of the same class
        sun._all_corners = fit_array(fit, "all_corners", (8, 3)) if "all_corners" in fit else None  # noqa: SLF001
        vars(sun).pop("_frame", None)
        return sun

    @classmethod
    def of_parts(
        cls,
        directions: Floats,
        irradiances: Floats,
        parts: Sequence[PartOfSky],
    ) -> tuple[Self, ...]:
        """Return the lights from parts of the sky.

        Parameters
        ----------
        directions
            [n, 3], to the parts.
        irradiances
            [n, RGB], on planes facing them.
        parts
            [n], what they are.
        """
        suns = []
        for direction, irradiance, part in zip(directions.tolist(), irradiances.tolist(), parts, strict=True):
            sun = cls(from_=tuple(direction), to=(0, 0, 0), intensity=tuple(irradiance))
            sun._part = part
            suns.append(sun)
        return tuple(suns)

    @property
    def spread(self) -> float:
        """As `Light.spread`."""
        return self._part.spread

    @property
    def most_texels(self) -> int | None:
        """As `Light.most_texels`."""
        return self._part.most_texels

    @property
    def is_at_points(self) -> bool:
        """As `Light.is_at_points`."""
        return self._part.is_at_points

    @property
    def asked_apart(self) -> float | None:
        """As `Light.asked_apart`."""
        return self._part.asked_apart

    @property
    def needs_fitting(self) -> bool:
        """Whether the light has not been `fitted` yet."""
        return self._corners is None

    def replace(self, **changes: Any) -> Self:
        """As `Model.replace`; the map stays fitted to the same bounds."""
        sun = super().replace(**changes)
        sun._corners, sun._all_corners = self._corners, self._all_corners  # noqa: SLF001 - of the same class
        sun._part = self._part  # noqa: SLF001
        return sun

    def frame(self) -> LightFrame:
        """As `Light.frame`.

        The origin is the centre of the plane where rays begin; shape = half width, half height of the map.
        """
        return self._frame

    @cached_property
    def _frame(self) -> LightFrame:
        """Kept: it is asked for some times in a frame."""
        if self._corners is None:
            raise SceneError("light: fit the sun's map to the medium first, with SunLight.fitted(bounds)")
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
        """Width of the map's longer side; the same at any distance."""
        del distance
        return 2 * max(self.frame().shape)

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """Parallel rays from the plane where distances begin."""
        frame = self.frame()
        axes, origin = frame.world_from_light[:3, :3], frame.world_from_light[:3, 3]
        origins = turned((2 * positions - 1) * frame.shape, axes[:, :2].T) + origin
        return origins, np.broadcast_to(axes[:, 2], origins.shape)

    def begins(self, points: Floats) -> Floats:
        """As `Light.begins`: points projected to the plane where distances begin."""
        matrix = self.frame().world_from_light
        distance = turned(points - matrix[:3, 3], matrix[:3, 2:3])[:, 0]
        start: Floats = points - distance[:, None] * matrix[:3, 2]
        return start

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """As `Light.arrival`; distances are < 0 upstream of the plane where they begin."""
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
