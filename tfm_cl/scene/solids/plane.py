"""The infinite plane."""

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.model import Vec3
from tfm_cl.scene.solids.base import AnalyticSolid
from tfm_cl.scene.transform import turned


class PlaneSolid(AnalyticSolid):
    """The plane through ``point`` perpendicular to ``normal``; visible from both sides."""

    shape: Literal["plane"] = "plane"
    point: Vec3 = Field((0.0, 0.0, 0.0), description="a point on the plane")
    normal: Vec3 = Field((0.0, 1.0, 0.0), description="direction perpendicular to the plane, of any length")

    @model_validator(mode="after")
    def _has_a_normal(self) -> Self:
        if float(np.linalg.norm(self.normal)) < 1e-30:  # noqa: PLR2004 - its square is no number
            raise ValueError(f"normal = {list(self.normal)}: should not be zero")
        return self

    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.distances`; rays within the plane do not meet it."""
        normal = np.divide(self.normal, np.linalg.norm(self.normal))
        height = turned(self.point - origins, normal[:, None])[:, 0]
        slope = turned(directions, normal[:, None])[:, 0]
        found = height * slope > 0
        result: NDArray[np.float64] = np.divide(height, slope, out=np.full(len(origins), np.inf), where=found)
        return result

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.normals`: the same everywhere."""
        return np.broadcast_to(np.divide(self.normal, np.linalg.norm(self.normal)), points.shape)

    def bounds(self) -> None:
        """Return None: a plane is infinite."""
        return

    def world_plane(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a point on the plane and its unit normal, both [3], world."""
        matrix = self.world_from_object
        return matrix[:3, :3] @ self.point + matrix[:3, 3], self.world_normals(np.array([self.normal]))[0]
