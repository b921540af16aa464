"""What is decided of a map before its rays are marched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.structs.map import map_struct

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfm_cl.device.running import Running
    from tfm_cl.maps.bases.base import Functions
    from tfm_cl.maps.resolved import ResolvedMap

LARGEST_HALF = 4096.0
"""Numbers in half precision are stored in a unit that keeps the largest optical depth near this, far from
65504."""


class Making:
    """Functions of a basis, made when they are first asked for: the device is then at another map's pass.

    Parameters
    ----------
    make
        Makes them.
    nbytes
        Of what that needs, which is kept until then, at least as much as they take.
    """

    def __init__(self, make: Callable[[], Functions | None], nbytes: int = 0) -> None:
        self._make: Callable[[], Functions | None] | None = make
        self._functions: Functions | None = None
        self.nbytes = nbytes

    @property
    def functions(self) -> Functions | None:
        """Themselves; None where there are none."""
        if self._make is not None:
            self._functions = self._make()
            self._make = None
        return self._functions


@dataclass(frozen=True)
class MapPlan:
    """All that is decided before a map's rays are marched."""

    settings: ResolvedMap
    """Resolved."""
    field: NDArray[np.float32]
    """Ranges of the rays, [size, size, 4]; [1, 1, 4] of no meaning for the range ``box``."""
    made: Making
    """What makes the functions of the basis."""
    number_unit: float
    density_weighting: float
    """The α in use."""
    extinction: float
    """At density 1, that visibility is meant for."""
    clip: NDArray[np.float32] | None
    """[res, res] distances beyond which, for solids, a texel's ray lights nothing; None without solids."""

    @property
    def functions(self) -> Functions | None:
        """Of the basis; None where its kernel header accumulates in its own way."""
        return self.made.functions

    @property
    def modes(self) -> NDArray[np.float32]:
        """What the basis needs to evaluate its functions."""
        return np.zeros(0, np.float32) if self.functions is None else self.functions.modes

    @property
    def window(self) -> tuple[int, int, int, int]:
        """Texels x0, y0, x1, y1 outside of which no ray has a range; all for the range ``box``."""
        res, size = self.settings.res, len(self.field)
        if self.settings.range == "box":
            return 0, 0, res, res
        has = self.field[..., 1] > self.field[..., 0]
        ends = []
        for entries in (np.flatnonzero(has.any(axis=axis)) for axis in (0, 1)):
            if len(entries) == 0:
                return 0, 0, 0, 0
            # Ranges are interpolated between the middles of entries, and stay the same beyond the outermost;
            # the last is reached as a full step from the one before it, which is rounded.
            low = 0 if entries[0] == 0 else int((entries[0] - 0.5) * res / size)
            high = res if entries[-1] >= size - 2 else int(np.ceil((entries[-1] + 1.5) * res / size))
            ends.append((low, high))
        (x0, x1), (y0, y1) = ends
        return x0, y0, x1, y1

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
    probed: tuple[Running, ...] = ()
    """What looked at the light's rays for it now; nothing where the session knew them."""

    @property
    def seconds(self) -> float:
        """Device time of what was probed for it."""
        return sum(running.wait() for running in self.probed)
