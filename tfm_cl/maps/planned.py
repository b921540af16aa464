"""What is decided of a map before its rays are marched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.map import map_struct

if TYPE_CHECKING:
    from tfm_cl.maps.bases.base import Functions
    from tfm_cl.maps.resolved import ResolvedMap

LARGEST_HALF = 4096.0
"""Numbers in half precision are stored in a unit that keeps the largest optical depth near this, far from
65504."""


@dataclass(frozen=True)
class MapPlan:
    """All that is decided before a map's rays are marched."""

    settings: ResolvedMap
    """Resolved."""
    field: NDArray[np.float32]
    """Ranges of the rays, [size, size, 4]; [1, 1, 4] of no meaning for the range ``box``."""
    functions: Functions | None
    """Of the basis; None where its kernel header accumulates in its own way."""
    number_unit: float
    density_weighting: float
    """The α in use."""
    extinction: float
    """At density 1, that visibility is meant for."""
    clip: NDArray[np.float32] | None
    """[res, res] distances beyond which, for solids, a texel's ray lights nothing; None without solids."""

    @property
    def modes(self) -> NDArray[np.float32]:
        """What the basis needs to evaluate its functions."""
        return np.zeros(0, np.float32) if self.functions is None else self.functions.modes

    def struct(self, settings: ResolvedMap | None = None) -> NDArray[Any]:
        """Return what kernels are told of the map; ``settings`` of one that is looked up in its place."""
        settings = settings or self.settings
        return map_struct(
            res=settings.res,
            steps=settings.steps,
            density_weighting=self.density_weighting,
            extinction=self.extinction,
            number_unit=self.number_unit,
            ranges=self.field,
        )


@dataclass(frozen=True)
class Planned(MapPlan):
    """A map's plan, and what it was made from."""

    deepest: float
    """Largest optical depth of the field along the rays of all lights, on a coarse map."""
    seconds: float
    """Device time of what was probed for it now; nothing where the session knew it."""
