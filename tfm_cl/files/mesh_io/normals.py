"""Normals for smooth shading, from the triangles themselves."""

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.mesh_io.triangles import Triangles, unit_or_zero

SAME_DIRECTION = 1e-9
"""Cosine by which rounding may take two normals apart: an angle of 180 degrees leaves no edge sharp."""


def smoothed(triangles: Triangles, angle: float) -> Triangles:
    """Return triangles that are shaded smoothly across edges of at most ``angle`` degrees.

    Around a vertex, triangles that such edges join share a normal: the mean of theirs, weighted by their
    angles at the vertex (Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets", 1998).
    Vertices at the same place are one. Neighbours of opposite winding are apart.
    """
    from scipy.sparse import coo_matrix  # noqa: PLC0415 - slow to import
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415 - slow to import

    faces = _welded(triangles.vertices)[triangles.faces]
    corners = triangles.vertices[triangles.faces]
    flat = unit_or_zero(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    one, other = _shared_edges(faces)
    cosine = np.einsum("ij,ij->i", flat[one // 3], flat[other // 3])
    soft = cosine >= np.cos(np.radians(angle)) - SAME_DIRECTION
    one, other = one[soft], other[soft]
    # The edge that begins at a corner ends at the next, and the neighbour's runs the other way.
    begin = np.concatenate([one, _following(one)])
    end = np.concatenate([_following(other), other])
    count = faces.size
    joined = coo_matrix((np.ones(len(begin), bool), (begin, end)), shape=(count, count))
    groups, group = connected_components(joined, directed=False)
    weighted = (flat[:, None] * _angles(corners)[..., None]).reshape(count, 3)
    sums = np.stack([np.bincount(group, weighted[:, axis], groups) for axis in range(3)], axis=1)
    return triangles.shaded(
        unit_or_zero(sums.astype(np.float64)), group.astype(np.int32).reshape(faces.shape)
    )


def _welded(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the place of each vertex, [V]."""
    order = np.lexsort(vertices.T)
    differs = np.ones(len(vertices), dtype=bool)
    differs[1:] = (vertices[order[1:]] != vertices[order[:-1]]).any(axis=1)
    place = np.empty(len(vertices), np.int64)
    place[order] = differs.cumsum() - 1
    return place


def _shared_edges(faces: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of corners whose edges, to the next corner, are the same and run in opposite directions."""
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    order = np.lexsort((begin > end, high, low))
    one, other = order[:-1], order[1:]
    same = (
        (low[one] == low[other]) & (high[one] == high[other]) & ((begin > end)[one] != (begin > end)[other])
    )
    return one[same], other[same]


def _following(corner: NDArray[np.intp]) -> NDArray[np.intp]:
    """Corner after each, in its triangle."""
    return corner - corner % 3 + (corner + 1) % 3


def _angles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles at the corners [F, 3, 3] of triangles, radians, [F, 3]."""
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(after, before), axis=2)
    angles: NDArray[np.float64] = np.arctan2(sine, np.einsum("ijk,ijk->ij", after, before))
    return angles
