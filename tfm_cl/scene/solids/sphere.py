"""The sphere; with a transform, any ellipsoid."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.files.mesh_io.triangles import DEFAULT_ALBEDO
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Vec3
from tfm_cl.scene.solids.base import Albedo, AnalyticSolid
from tfm_cl.scene.transform import dots, lengths_of


class SphereSolid(AnalyticSolid):
    """The sphere of ``radius`` around ``centre``; visible from outside and inside."""

    shape: Literal["sphere"] = "sphere"
    albedo: Albedo = Field(
        default=DEFAULT_ALBEDO, validate_default=True, description="diffuse reflectance, linear RGB, 0 to 1"
    )
    centre: Vec3 = Field(
        default=(0.0, 0.0, 0.0), validate_default=True, description="centre of the sphere, object units"
    )
    radius: float = Field(
        default=1.0, ge=1 / LARGEST_COORDINATE, le=LARGEST_COORDINATE, description="radius, object units"
    )

    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Roots of the quadratic without cancellation (Haines et al., Ray Tracing Gems, chapter 7)."""
        offset = origins - self.centre
        square = dots(directions, directions)
        half = dots(directions, offset)  # of the linear coefficient
        # The distance at which the ray passes the centre; this avoids a difference of large squares.
        passing = offset - (half / square)[:, None] * directions
        discriminant = self.radius**2 - dots(passing, passing)
        far = lengths_of(offset)
        constant = (far - self.radius) * (far + self.radius)
        root = np.sqrt(np.maximum(discriminant, 0) * square)
        larger = -half - np.copysign(root, half)  # the one of the two sums that does not cancel
        none = np.full(len(origins), np.inf)
        one = np.divide(constant, larger, out=none.copy(), where=larger != 0)
        other = larger / square
        one[~(one > 0)] = np.inf
        other[~(other > 0)] = np.inf
        return np.where(discriminant >= 0, np.minimum(one, other), none)

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.normals`: away from the centre."""
        outward: NDArray[np.float64] = (points - self.centre) / self.radius
        return outward

    def bounds(self) -> NDArray[np.float64]:
        """Exact for ellipsoids too: the extent along an axis is the length of the matrix's row."""
        matrix = self.world_from_object
        centre = matrix[:3, :3] @ self.centre + matrix[:3, 3]
        reach = self.radius * np.linalg.norm(matrix[:3, :3], axis=1)
        return np.stack([centre - reach, centre + reach])
