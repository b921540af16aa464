"""Light from infinitely far away all around, which the camera can see as well."""

from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal, NoReturn, Self

import numpy as np
from pydantic import Field

from tfm_cl.errors import SceneError
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import count_or_auto, number_or_auto
from tfm_cl.scene.lights.base import Arrival, Directions, Floats, Light, LightFrame, PartOfSky

MOST_TEXELS = 256
"""Along a side of the map of a part, where nothing else is asked for."""


class Surroundings(Light):
    """Radiance from all directions, as the sum of suns in fixed directions, each with a map of its own."""

    WHOLE: ClassVar[float]
    """What arrives from all directions together where ``intensity`` is 1; roughly, where that varies."""

    falloff: Literal["none"] = Field(
        default="none", description="none: the surroundings are infinitely far away"
    )

    map_res: Annotated[int | Literal["auto"], count_or_auto(8192, least=16)] = Field(
        default="auto",
        description="texels along a side of the map of each part of the surroundings, at most: its light "
        "comes from a whole region, and finer shadows than that are not its own; auto: by the voxels, up to "
        f"{MOST_TEXELS}",
    )
    lookup: Literal["auto", "points", "samples"] = Field(
        default="auto",
        description="where media look its light up. points: at those of a lattice, in between it is linear; "
        "what is found there stays while the camera moves; samples: at every sample of the camera's rays; "
        "auto: points, where there are many parts and maps are left to auto",
    )
    points_apart: Annotated[float | Literal["auto"], number_or_auto(1e-6, LARGEST_COORDINATE)] = Field(
        default="auto",
        description="world units between these points, unless that makes them too many, or homogeneous "
        "bodies need them nearer; of several lights the least; auto: by voxels, and the light's share of all",
    )

    @property
    def part_texels(self) -> int:
        """`Light.most_texels` of each part."""
        return MOST_TEXELS if self.map_res == "auto" else self.map_res

    @property
    def asked_apart(self) -> float | None:
        """As `Light.asked_apart`."""
        return None if self.points_apart == "auto" else self.points_apart

    def part(self, spread: float) -> PartOfSky:
        """Return what a part of such a `Light.spread` is; the sun itself, without one, is as any sun."""
        if spread == 0:
            return PartOfSky(asked_apart=self.asked_apart)
        return PartOfSky(spread, self.part_texels, self.lookup == "points", self.asked_apart)

    @staticmethod
    def spread_of(count: int) -> float:
        """Return the `Light.spread` of each of ``count`` equal parts of the sphere: disks of that area."""
        return float(np.arccos(1 - 2 / max(count, 2)))

    @abstractmethod
    def radiance(self, directions: Directions, width: Directions) -> Directions:
        """Radiance [n, RGB] that is seen in unit directions [n, 3], world, where nothing is in the way.

        Of float32 it may be no more exact than that.

        Parameters
        ----------
        width
            [n], > 0: angle in radians across what is seen, of which this is the mean.

        Raises
        ------
        SceneError
            A file that cannot be used.
        """

    @classmethod
    def placed(cls, irradiance: float, direction: Floats, up: tuple[float, float, float]) -> dict[str, Any]:
        """Return keys of a scene file for about as much light, from a direction [3] if it has one."""
        del direction, up
        return {"intensity": round(irradiance / cls.WHOLE, 2)}

    @property
    def surrounds(self) -> bool:
        """As `Light.surrounds`."""
        return True

    @property
    def needs_fitting(self) -> bool:
        """Whether its parts must be fitted."""
        return True

    def frame(self) -> LightFrame:
        """Raise an error: only its parts have maps."""
        self._refuse()

    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """Return itself: only its parts have maps."""
        del bounds, everything
        return self

    def footprint(self, distance: float) -> float:
        """Raise an error: only its parts have maps."""
        del distance
        self._refuse()

    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """Raise an error: only its parts have rays."""
        del positions
        self._refuse()

    def begins(self, points: Floats) -> Floats:
        """Raise an error: only its parts have rays."""
        del points
        self._refuse()

    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """Raise an error: only its parts arrive from a single direction."""
        del points, nearest
        self._refuse()

    def source_distance(self, points: Floats) -> Floats:
        """Infinite."""
        return np.full(len(points), np.inf)

    def _refuse(self) -> NoReturn:
        raise SceneError(f"light: type '{self.type}' has no map of its own; use the maps of its parts()")
