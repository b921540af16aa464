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

from tfm_cl.files.mesh_io.triangles import unit_or_zero
from tfm_cl.render.tracing.textures import footprints, sampled
from tfm_cl.scene.transform import dots, lengths_of

if TYPE_CHECKING:
    from tfm_cl.files.mesh_io.triangles import Triangles
    from tfm_cl.files.mipmap import Mipmap
    from tfm_cl.scene.solids.mesh import MeshSolid

BEYOND = 16.0
"""A distance beyond every triangle, in Embree's units, in which the meshes' sphere has a radius of at most
about 3."""

MARGIN = 1 + 2.0**-20
"""Relative margin of the sphere and the boxes around the meshes: triangles rounded to float32 stay inside."""

LEANING = 0.5
"""Cosine between the normals of a triangle and of a corner below which its shadow rays start on itself."""

HALVINGS = 6
"""How often the triangles are halved into those that lie together, each with a box of its own."""


@dataclass(frozen=True)
class MeshHits:
    """Intersections of some of the rays with triangles."""

    rays: NDArray[np.intp]
    """[M], indices of the rays."""
    distances: NDArray[np.float64]
    """[M], distances, world units."""
    flat: NDArray[np.float64]
    """[M, 3], unit normals of the triangles, towards the rays' origins."""
    normals: NDArray[np.float64]
    """[M, 3], unit normals for shading, on that side."""
    albedo: NDArray[np.float64]
    """[M, 3], linear albedo."""
    raised: NDArray[np.float64]
    """[M, 3], from the points to the smooth surface that the triangles stand for, world units."""
    holdout: NDArray[np.bool_]
    """[M], whether the camera sees a hole there."""


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
        self._first_faces = np.cumsum([0, *(len(part.faces) for part in loaded)])[:-1]
        self._holdout = np.array([solid.holdout for solid in solids])
        self._smooth = _Smooth.of(solids, loaded)
        self._textured = _Textured.of(loaded)
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

    def nearest(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], spread: float
    ) -> MeshHits:
        """Find the first triangles along world rays (origins, directions [N, 3]), with float64 distances.

        ``spread``: width of the rays' cones at distance 1.
        """
        rays, starts, local, towards = self._local(origins, directions)
        found = self._scene.run(local, towards, query="INTERSECT", output=1, dists=BEYOND)
        hit = np.flatnonzero(found["primID"] >= 0)
        rays, triangles = rays[hit], found["primID"][hit]
        corners = self._vertices[self._faces[triangles]]
        origins, directions = origins[rays], directions[rays]
        edges = corners[:, 1:] - corners[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        normals /= lengths_of(normals)[:, None]
        reach = corners - origins[:, None]
        slope, height = dots(normals, directions), dots(normals, reach[:, 0])
        along = [dots(reach[:, corner], directions) for corner in range(3)]
        nearest = np.minimum(np.minimum(along[0], along[1]), along[2])
        farthest = np.maximum(np.maximum(along[0], along[1]), along[2])
        coarse = starts[hit] + found["tfar"][hit].astype(np.float64) / self._scale
        exact = np.divide(height, slope, out=coarse, where=slope != 0)
        # At a grazing angle the exact point on the plane may lie beside the triangle that Embree hit after
        # rounding.
        distances = np.clip(exact, np.maximum(nearest, 0), np.maximum(farthest, 0))
        u, v = found["u"][hit, None], found["v"][hit, None]
        colours = self._colours[self._colour_of[triangles]]
        # Differences, so that a colour that is the same at all corners stays exact.
        first = colours[:, 0]
        albedo = np.clip(first + u * (colours[:, 1] - first) + v * (colours[:, 2] - first), 0, 1)
        normals *= np.where(slope > 0, -1.0, 1.0)[:, None]
        weights = np.concatenate([1 - u - v, u, v], axis=1).astype(np.float64)
        shading, raised = normals, np.zeros(normals.shape)
        if self._smooth is not None:
            places = origins + distances[:, None] * directions
            shading, raised = self._smooth.shade(triangles, weights, normals, corners, places)
        painted = albedo.astype(np.float64)
        if self._textured is not None:
            axes = footprints(normals, directions, spread * distances)
            self._textured.paint(painted, triangles, weights, edges, axes)
        holdout = self._holdout[np.searchsorted(self._first_faces, triangles, side="right") - 1]
        return MeshHits(rays, distances, normals, shading, painted, raised, holdout)

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
        middle = -dots(offset, directions)
        passing = offset + middle[:, None] * directions
        near = dots(passing, passing) <= self._radius**2
        rays = np.flatnonzero(near & (middle >= -self._radius))
        starts = np.maximum(middle[rays] - self._radius, 0)
        entry = origins[rays] - self._zero + starts[:, None] * directions[rays]
        local = (entry * self._scale).astype(np.float32)
        return rays, starts, local, directions[rays].astype(np.float32)


class _Smooth:
    """Normals at the corners of triangles."""

    def __init__(self, normals: NDArray[np.float64], normal_of: NDArray[np.int32]) -> None:
        self._normals, self._normal_of = normals, normal_of

    @classmethod
    def of(cls, solids: list[MeshSolid], loaded: list[Triangles]) -> _Smooth | None:
        """Join those of meshes, world; row 0 stands for none. None where all are flat."""
        if all(part.normals is None for part in loaded):
            return None
        normals, normal_of, first = [np.zeros((1, 3))], [], 1
        for solid, part in zip(solids, loaded, strict=True):
            if part.normals is None or part.normal_of is None:
                normal_of.append(np.zeros(part.faces.shape, np.int32))
                continue
            normals.append(unit_or_zero(part.normals @ np.linalg.inv(solid.world_from_object[:3, :3])))
            normal_of.append(part.normal_of + np.int32(first))
            first += len(part.normals)
        return cls(np.concatenate(normals), np.concatenate(normal_of))

    def shade(
        self,
        triangles: NDArray[np.int32],
        weights: NDArray[np.float64],
        flat: NDArray[np.float64],
        corners: NDArray[np.float64],
        places: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Interpolate normals at places on triangles, and raise these to the smooth surface, both [M, 3].

        Shadow rays of flat triangles that start where another triangle of the same smooth surface is in
        their way would show the triangles where the light grazes. They start above, on the planes at right
        angles to the corners' normals (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021).

        Parameters
        ----------
        triangles
            [M], their numbers.
        weights
            [M, 3], barycentric.
        flat
            [M, 3], their normals, on the side that is seen.
        corners
            [M, 3, 3], world.
        places
            [M, 3], world.
        """
        normals = self._normals[self._normal_of[triangles]]
        towards = np.einsum("ijk,ik->i", normals, flat)
        normals *= np.where(towards < 0, -1.0, 1.0)[:, None, None]
        missing = ~normals.any(axis=2)
        normals[missing] = np.broadcast_to(flat[:, None], normals.shape)[missing]
        depths = np.minimum(np.einsum("ijk,ijk->ij", places[:, None] - corners, normals), 0)
        # Normals that lean so far stand for no surface near the triangle: light would leak past its edges.
        leaning = np.einsum("ijk,ik->ij", normals, flat).min(axis=1) < LEANING
        depths[missing] = depths[leaning] = 0
        raised = -np.einsum("ij,ijk->ik", weights * depths, normals)
        shading = unit_or_zero(np.einsum("ij,ijk->ik", weights, normals))
        # What a file says of the other side is no normal of this one.
        strange = np.einsum("ij,ij->i", shading, flat) <= 0
        shading[strange], raised[strange] = flat[strange], 0
        return shading, raised


class _Textured:
    """Images on triangles, and where they lie."""

    def __init__(
        self,
        uv: NDArray[np.float64],
        uv_of: NDArray[np.int32],
        image_of: NDArray[np.int32],
        images: tuple[Mipmap, ...],
    ) -> None:
        self._uv, self._uv_of, self._image_of, self._images = uv, uv_of, image_of, images

    @classmethod
    def of(cls, loaded: list[Triangles]) -> _Textured | None:
        """Join those of meshes; None without any."""
        if not any(part.textures is not None and part.textures.images for part in loaded):
            return None
        uv, uv_of, image_of, first = [np.zeros((1, 2))], [], [], 1
        images: list[Mipmap] = []
        for part in loaded:
            found = part.textures
            if found is None or not found.images:
                uv_of.append(np.zeros(part.faces.shape, np.int32))
                image_of.append(np.full(len(part.faces), -1, np.int32))
                continue
            uv.append(found.uv)
            uv_of.append(found.uv_of + np.int32(first))
            image_of.append(np.where(found.image_of < 0, -1, found.image_of + len(images)))
            images += found.images
            first += len(found.uv)
        return cls(
            np.concatenate(uv),
            np.concatenate(uv_of),
            np.concatenate(image_of).astype(np.int32),
            tuple(images),
        )

    def paint(
        self,
        albedo: NDArray[np.float64],
        triangles: NDArray[np.int32],
        weights: NDArray[np.float64],
        edges: NDArray[np.float64],
        axes: NDArray[np.float64],
    ) -> None:
        """Multiply albedo [M, 3] with the images.

        Parameters
        ----------
        triangles
            [M], their numbers.
        weights
            [M, 3], barycentric.
        edges
            [M, 2, 3], from their first corners to the others, world.
        axes
            [M, 2, 3], of the pixels' footprints, world.
        """
        image_of = self._image_of[triangles]
        for number in np.unique(image_of[image_of >= 0]):
            part = np.flatnonzero(image_of == number)
            uv = self._uv[self._uv_of[triangles[part]]]
            # An axis in barycentric coordinates, by the areas that it makes with the edges.
            one, other = edges[part, :1], edges[part, 1:]
            normal = np.cross(one, other)
            along = np.stack([np.cross(axes[part], other), np.cross(one, axes[part])], axis=2)
            square = np.einsum("ijk,ijk->i", normal, normal)[:, None, None]
            turned = np.einsum("iakj,iaj->iak", along, np.broadcast_to(normal, axes[part].shape))
            # Of triangles too small for their area in float64: no footprint.
            turned = np.divide(turned, square, out=np.zeros_like(turned), where=square > 0)
            differences = turned @ (uv[:, 1:] - uv[:, :1])
            centres = np.einsum("ij,ijk->ik", weights[part], uv)
            albedo[part] *= sampled(self._images[number], centres, differences)


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
