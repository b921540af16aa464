"""Triangles in memory: the form of a mesh once it is read."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.limits import LARGEST_COORDINATE

DEFAULT_ALBEDO = (0.8, 0.8, 0.8)
"""Linear Rec. 709, of what nothing says more about."""

MAX_FACES = 50_000_000
"""Largest number of triangles of a mesh; Embree's tree then takes some 10 GB."""

MAX_CORNERS = 3 * MAX_FACES
"""Largest number of vertices of a mesh: three per triangle."""

CHUNK = 1 << 20
"""Number of triangles checked at a time."""

SLIVER = 1e-12
"""Sine of a triangle's angle below which its area is 0 within the precision of float64."""


@dataclass(frozen=True, eq=False, repr=False)
class Triangles:
    """Triangles in object space; none is degenerate."""

    vertices: NDArray[np.float64]
    """[V, 3], object units."""
    faces: NDArray[np.int32]
    """[F, 3], indices of rows of ``vertices``."""
    colours: NDArray[np.float32]
    """[C, 3], linear albedo, 0 to 1."""
    colour_of: NDArray[np.int32]
    """[F, 3], rows of ``colours`` at the corners of each triangle, or [1, 3] if all are the same."""

    def painted(self, albedo: tuple[float, float, float]) -> "Triangles":
        """Return the same triangles in a single colour."""
        return Triangles(
            self.vertices, self.faces, np.array([albedo], np.float32), np.zeros((1, 3), np.int32)
        )


def checked(
    name: str,
    vertices: Any,
    faces: Any,
    colours: NDArray[np.float32] | None = None,
    colour_of: NDArray[np.int32] | None = None,
) -> Triangles:
    """Check arrays and drop triangles without area.

    Raises
    ------
    SceneError
        If arrays have another shape, vertices are not finite or beyond 1e15, faces refer to vertices that do
        not exist, there are too many of either, or no triangle has an area.
    """
    points, rows = _array(name, "vertices", vertices), _array(name, "faces", faces)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":  # noqa: PLR2004
        raise SceneError(f"{name}: vertices should be numbers [V, 3]; got the shape {list(points.shape)}")
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.dtype.kind not in "iu":  # noqa: PLR2004 - corners
        raise SceneError(f"{name}: faces should be whole numbers [F, 3]; got the shape {list(rows.shape)}")
    if len(rows) > MAX_FACES or len(points) > MAX_CORNERS:
        raise SceneError(f"{name}: {len(rows):,} triangles; the limit is {MAX_FACES:,}")
    if len(rows) == 0:
        raise SceneError(f"{name}: holds no triangles")
    if rows.min() < 0 or rows.max() >= len(points):
        wrong = rows.min() if rows.min() < 0 else rows.max()
        raise SceneError(f"{name}: a triangle names vertex {wrong}; there are {len(points):,}, from 0")
    points = points.astype(np.float64)
    if not (np.abs(points) <= LARGEST_COORDINATE).all():  # NaN is not
        raise SceneError(f"{name}: a vertex is not finite, or beyond {LARGEST_COORDINATE:g}")
    solid = _with_area(points, rows)
    if not solid.any():
        raise SceneError(f"{name}: no triangle has an area")
    if colours is None or colour_of is None:
        colours, colour_of = np.array([DEFAULT_ALBEDO], np.float32), np.zeros((1, 3), np.int32)
    if not solid.all():
        rows, colour_of = rows[solid], colour_of[solid] if len(colour_of) == len(solid) else colour_of
    return Triangles(points, np.ascontiguousarray(rows, np.int32), colours, colour_of)


def _array(name: str, what: str, values: Any) -> NDArray[Any]:
    try:
        return np.asarray(values)
    except ValueError:
        raise SceneError(f"{name}: {what} should be an array; its rows differ in length") from None


def _with_area(points: NDArray[np.float64], rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which triangles have an area, [F]."""
    found = np.zeros(len(rows), dtype=bool)
    for start in range(0, len(rows), CHUNK):
        part = slice(start, start + CHUNK)
        first, second, third = (points[rows[part, corner]] for corner in range(3))
        one, other = second - first, third - first
        area = np.linalg.norm(np.cross(one, other), axis=1)
        lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        found[part] = area > SLIVER * lengths
    return found
