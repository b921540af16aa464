"""Intersections of rays and triangles: Embree 4 finds the triangle, float64 the point on it.

Embree computes in float32. Its coordinates are relative to a centre and scaled to the meshes' size, and rays
start where they enter the sphere around the meshes. Neither a scene far from the world's origin nor a camera
far from the scene therefore loses precision. In robust mode no ray passes through an edge shared by
triangles; of rays aimed exactly at a vertex, a few in a thousand may pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tfm_cl.scene.solids.mesh import MeshSolid

BEYOND = 16.0
"""A distance beyond every triangle, in Embree's units, in which the meshes' sphere has a radius of at most
about 3."""

MARGIN = 1 + 2.0**-20
"""Relative margin of the sphere and the boxes around the meshes: triangles rounded to float32 stay inside."""

HALVINGS = 6
"""How often the triangles are halved into those that lie together, each with a box of its own."""


@dataclass(frozen=True)
class MeshHits:
    """Intersections of some of the rays with triangles."""

    rays: NDArray[np.intp]
    """[M], indices of the rays."""
    distances: NDArray[np.float64]
    """[M], distances, world units."""
    normals: NDArray[np.float64]
    """[M, 3], unit normals, on either side."""
    albedo: NDArray[np.float32]
    """[M, 3], linear albedo."""


class Meshes:
    """All the meshes of a scene in a single Embree tree."""

    def __init__(self, solids: list[MeshSolid], origin: NDArray[np.float64] | None) -> None:
        loaded = [solid.load() for solid in solids]
        counts = [len(part.vertices) for part in loaded]
        starts = np.cumsum([0, *counts])
        self._vertices = np.concatenate([solid.world_vertices() for solid in solids])
        self._faces = np.concatenate(
            [part.faces + np.int32(start) for part, start in zip(loaded, starts[:-1], strict=True)]
        )
        colour_starts = np.cumsum([0, *(len(part.colours) for part in loaded)])
        self._colours = np.concatenate([part.colours for part in loaded])
        self._colour_of = np.concatenate(
            [
                np.broadcast_to(part.colour_of, part.faces.shape) + np.int32(start)
                for part, start in zip(loaded, colour_starts[:-1], strict=True)
            ]
        )
        used = np.zeros(len(self._vertices), dtype=bool)
        used[self._faces] = True
        low, high = self._vertices[used].min(axis=0), self._vertices[used].max(axis=0)
        self._centre = (low + high) / 2
        self._radius = max(float(np.linalg.norm(high - low)) / 2, 1e-290) * MARGIN
        self._zero = self._centre if origin is None else origin
        self.size = self._radius + float(np.linalg.norm(self._centre - self._zero))
        """Largest distance of a vertex from Embree's origin, world units."""
        slack = (MARGIN - 1) * self.size
        self.boxes = np.add(_boxes(self._vertices[self._faces]), [[[-slack], [slack]]])
        """Low and high corners of boxes around all triangles, [up to 2^`HALVINGS`, 2, 3], world."""
        # A power of two, so that scaling is exact.
        self._scale = 2.0 ** -np.ceil(np.log2(self.size))
        local = ((self._vertices - self._zero) * self._scale).astype(np.float32)
        local[~used] = 0
        self._device = EmbreeDevice()
        self._scene = EmbreeScene(self._device, robust=True)
        self._geometry = TriangleMesh(self._scene, local, self._faces)
        # The first query builds the tree; later ones may come from several threads.
        self._scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))

    def nearest(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> MeshHits:
        """Find the first triangles along world rays (origins, directions [N, 3]), with float64 distances."""
        rays, starts, local, towards = self._local(origins, directions)
        found = self._scene.run(local, towards, query="INTERSECT", output=1, dists=BEYOND)
        hit = np.flatnonzero(found["primID"] >= 0)
        rays, triangles = rays[hit], found["primID"][hit]
        corners = self._vertices[self._faces[triangles]]
        origins, directions = origins[rays], directions[rays]
        edges = corners[:, 1:] - corners[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        reach = corners - origins[:, None]
        slope = np.einsum("ij,ij->i", normals, directions)
        height = np.einsum("ij,ij->i", normals, reach[:, 0])
        along = np.einsum("ijk,ik->ij", reach, directions)
        coarse = starts[hit] + found["tfar"][hit].astype(np.float64) / self._scale
        exact = np.divide(height, slope, out=coarse, where=slope != 0)
        # At a grazing angle the exact point on the plane may lie beside the triangle that Embree hit after
        # rounding.
        distances = np.clip(exact, np.maximum(along.min(axis=1), 0), np.maximum(along.max(axis=1), 0))
        u, v = found["u"][hit, None], found["v"][hit, None]
        colours = self._colours[self._colour_of[triangles]]
        # Differences, so that a colour that is the same at all corners stays exact.
        first = colours[:, 0]
        albedo = first + u * (colours[:, 1] - first) + v * (colours[:, 2] - first)
        return MeshHits(rays, distances, normals, np.clip(albedo, 0, 1))

    def distances(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Find where world rays end, in Embree's float32: indices [M] of rays that hit, distances [M]."""
        rays, starts, local, towards = self._local(origins, directions)
        found = self._scene.run(local, towards, query="DISTANCE", dists=BEYOND)
        hit = np.flatnonzero(found < BEYOND)
        return rays[hit], starts[hit] + found[hit] / self._scale

    def occluded(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        distances: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Tell which world rays meet a triangle before ``distances`` [N]."""
        rays, starts, local, towards = self._local(origins, directions)
        limits = np.minimum((distances[rays] - starts) * self._scale, BEYOND).astype(np.float32)
        found = self._scene.run(local, towards, query="OCCLUDED", dists=np.maximum(limits, 0))
        result = np.zeros(len(origins), dtype=bool)
        result[rays[(found >= 0) & (limits > 0)]] = True
        return result

    def _local(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float32], NDArray[np.float32]]:
        """Rays that meet the meshes' sphere [M], the distances [M], and Embree's rays from there [M, 3]."""
        offset = origins - self._centre
        middle = -np.einsum("ij,ij->i", offset, directions)
        passing = offset + middle[:, None] * directions
        near = np.einsum("ij,ij->i", passing, passing) <= self._radius**2
        rays = np.flatnonzero(near & (middle >= -self._radius))
        starts = np.maximum(middle[rays] - self._radius, 0)
        entry = origins[rays] - self._zero + starts[:, None] * directions[rays]
        local = (entry * self._scale).astype(np.float32)
        return rays, starts, local, directions[rays].astype(np.float32)


def _boxes(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Boxes [n, 2, 3] around groups of triangles [m, 3, 3], each group halved along its longest side."""
    groups = [corners]
    for _ in range(HALVINGS):
        groups = [half for group in groups for half in _halves(group)]
    return np.stack([[group.min(axis=(0, 1)), group.max(axis=(0, 1))] for group in groups])


def _halves(group: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    if len(group) == 1:
        return [group]
    middles = group.mean(axis=1)
    along = middles[:, np.ptp(middles, axis=0).argmax()]
    half = len(group) // 2
    order = np.argpartition(along, half)
    return [group[order[:half]], group[order[half:]]]
