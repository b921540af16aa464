"""Triangles in memory: the form of a mesh once it is read."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.files.mipmap import Mipmap
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
class Textures:
    """Images on triangles."""

    uv: NDArray[np.float64]
    """[T, 2], texture coordinates; v points upwards."""
    uv_of: NDArray[np.int32]
    """[F, 3], rows of ``uv`` at the corners of each triangle."""
    image_of: NDArray[np.int32]
    """[F], numbers of the images; -1 for none."""
    images: tuple[Mipmap, ...]


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
    normals: NDArray[np.float64] | None = None
    """[N, 3], unit, on either side, for smooth shading; 0 where there is none. None: all is flat."""
    normal_of: NDArray[np.int32] | None = None
    """[F, 3], rows of ``normals`` at the corners of each triangle."""
    textures: Textures | None = None
    """What the colours are multiplied with."""

    def painted(self, albedo: tuple[float, float, float]) -> "Triangles":
        """Return the same triangles in a single colour."""
        colours, colour_of = _one_colour(albedo)
        return replace(self, colours=colours, colour_of=colour_of, textures=None)

    def shaded(
        self, normals: NDArray[np.float64] | None, normal_of: NDArray[np.int32] | None = None
    ) -> "Triangles":
        """Return the same triangles with other normals [N, 3] at their corners [F, 3]; flat for None."""
        return replace(self, normals=normals, normal_of=normal_of)

    def kept(self, chosen: NDArray[np.bool_]) -> "Triangles":
        """Return some of the triangles [F]; nothing else changes."""
        textures = self.textures
        if textures is not None:
            textures = replace(textures, uv_of=textures.uv_of[chosen], image_of=textures.image_of[chosen])
        one_colour = len(self.colour_of) != len(self.faces)
        return replace(
            self,
            faces=self.faces[chosen],
            colour_of=self.colour_of if one_colour else self.colour_of[chosen],
            normal_of=None if self.normal_of is None else self.normal_of[chosen],
            textures=textures,
        )


def checked(
    name: str,
    vertices: Any,
    faces: Any,
    colours: NDArray[np.float32] | None = None,
    colour_of: NDArray[np.int32] | None = None,
    normals: NDArray[np.float64] | None = None,
    textures: Textures | None = None,
) -> Triangles:
    """Check arrays and drop triangles without area.

    Parameters
    ----------
    name
        What messages call it.
    vertices, faces
        [V, 3] and [F, 3].
    colours, colour_of, textures
        As of `Triangles`; one colour without.
    normals
        [V, 3], of any length, one for each vertex; None for flat triangles. What is no direction becomes 0.

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
        colours, colour_of = _one_colour(DEFAULT_ALBEDO)
    rows = np.ascontiguousarray(rows, np.int32)
    triangles = Triangles(points, rows, colours, colour_of, textures=textures)
    if normals is not None:
        triangles = triangles.shaded(unit_or_zero(normals), rows)
    return triangles if solid.all() else triangles.kept(solid)


def unit_or_zero(vectors: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Normalise vectors [N, 3]; those without a direction become 0."""
    vectors = np.asarray(vectors, np.float64)
    # By their largest number first, so that squares neither overflow nor vanish.
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    sound = np.isfinite(largest) & (largest > 0)
    unit = np.divide(vectors, largest, out=np.zeros(vectors.shape), where=sound)
    length = np.linalg.norm(unit, axis=1, keepdims=True)
    result: NDArray[np.float64] = np.divide(unit, length, out=np.zeros(vectors.shape), where=length > 0)
    return result


def _one_colour(albedo: tuple[float, float, float]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    return np.array([albedo], np.float32), np.zeros((1, 3), np.int32)


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
