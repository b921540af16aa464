"""Lights with a position: rays from a point, and a map fitted to the medium."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from operator import lt
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr

from tfm_cl.errors import SceneError
from tfm_cl.model import Vec3
from tfm_cl.scene.lights.base import Floats, Light, LightFrame, Reach, fit_array
from tfm_cl.scene.lights.charts import CHARTS
from tfm_cl.scene.lights.fitting import Cone, View, fitted_view, whole_view
from tfm_cl.scene.transform import turned

NEAR = 0.1
"""Of a box's diagonal: nearer than this, what a light's falloff does from voxel to voxel is not smooth."""


UNEVEN = 1e-9
"""By how much the axes of a view may err."""


class PlacedLight(Light):
    """Light from a point; its map covers all that it reaches or, once `fitted`, the medium within reach."""

    from_: Vec3 = Field(validation_alias="from", description="position, world units")
    reach: Reach = Field(
        default=None,
        description="distance beyond which the light is dark, world units; it fades out smoothly towards it; "
        "default: unlimited",
    )
    _view: View | None = PrivateAttr(default=None)

    @abstractmethod
    def cone_of_light(self) -> Cone | None:
        """Return the cone that contains all the light; None for light in all directions."""

    def _shape(self) -> tuple[float, float, float]:
        """First three parameters in the kernels' ``light_shape``."""
        return 0.0, 0.0, 0.0

    @property
    def place(self) -> tuple[float, float, float]:
        """As `Light.place`."""
        return self.from_

    @property
    def view(self) -> View:
        """Orientation and chart of the map."""
        return whole_view(self.cone_of_light()) if self._view is None else self._view

    @property
    def headers(self) -> tuple[str, ...]:
        """As `Light.headers`."""
        return (self.view.chart.HEADER, self.HEADER)

    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """As `Light.fitted`."""
        del everything
        light = self.model_copy()
        reach = math.inf if self.reach is None else self.reach
        view = fitted_view(np.asarray(self.from_), bounds, self.cone_of_light(), reach)
        light._view = view  # noqa: SLF001 - of the same class
        return light

    def fit(self) -> dict[str, Floats]:
        """As `Light.fit`: the axes of its view, [3, 3], and the number and window of its chart."""
        axes, chart = self.view
        number = np.array(float(CHARTS.index(type(chart))))
        return {"axes": axes, "chart": number, "window": np.array([chart.low, chart.high])}

    def with_fit(self, fit: Mapping[str, Floats]) -> Self:
        """As `Light.with_fit`."""
        axes, number = fit_array(fit, "axes", (3, 3)), float(fit_array(fit, "chart", ()))
        low, high = fit_array(fit, "window", (2, 2)).tolist()
        if not np.allclose(axes.T @ axes, np.eye(3), atol=UNEVEN):
            raise SceneError("light.axes: should be three unit vectors across each other")
        if number not in range(len(CHARTS)) or not all(map(lt, low, high)):
            raise SceneError(f"light.chart: should be a window of one of the {len(CHARTS)} charts")
        light = self.model_copy()
        light._view = View(axes, CHARTS[int(number)](tuple(low), tuple(high)))  # noqa: SLF001 - of the same class
        return light

    def frame(self) -> LightFrame:
        """As `Light.frame`.

        The light is at the origin and the map's centre along z; the shape ends with 1 / reach, or 0 without.
        """
        axes, chart = self.view
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = axes, self.from_
        cone = self.cone_of_light()
        return LightFrame(
            matrix,
            (*self._shape(), 0.0 if self.reach is None else 1 / self.reach),
            chart.window,
            np.eye(3) if cone is None else cone.axes.T @ axes,
        )

    def nearest(self, bounds: Floats) -> float:
        """As `Light.nearest`."""
        position = np.asarray(self.from_)
        return float(np.linalg.norm(position - np.clip(position, bounds[0], bounds[1])))

    def is_smooth_in(self, bounds: Floats) -> bool:
        """As `Light.is_smooth_in`."""
        if self.nearest(bounds) < NEAR * np.linalg.norm(bounds[1] - bounds[0]):
            return False
        return self.reach is None and not self.is_textured

    def footprint(self, distance: float) -> float:
        """As `Light.footprint`."""
        return distance * self.view.chart.width

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """All rays start at the light."""
        axes, chart = self.view
        directions = turned(chart.directions(positions), axes.T)
        return np.broadcast_to(np.asarray(self.from_), directions.shape), directions

    def begins(self, points: Floats) -> Floats:
        """All rays start at the light."""
        return np.broadcast_to(np.asarray(self.from_), points.shape)

    def map_positions(self, offsets: Floats) -> Floats:
        """u, v [n, 2] in the map of points at offsets [n, 3] from the light, world axes."""
        axes, chart = self.view
        return chart.positions(turned(offsets, axes))

    def within_reach(self, distance: Floats) -> NDArray[np.bool_]:
        """Whether distances [n] are within the light's reach."""
        return distance < (math.inf if self.reach is None else self.reach)
