"""Visibility among solids: nearest surfaces, distances and shadows of many rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.errors import SceneError
from tfm_cl.extras import needs
from tfm_cl.render.tracing.textures import footprints, sampled
from tfm_cl.render.tracing.threads import in_chunks
from tfm_cl.scene.solids.base import AnalyticSolid, Solid
from tfm_cl.scene.transform import corners_of, dots

if TYPE_CHECKING:
    from tfm_cl.render.regions import LitRegions
    from tfm_cl.render.tracing.embree import Meshes
    from tfm_cl.scene.solids.mesh import MeshSolid

LIFT = 2.0**-20
"""Height above the surface at which shadow rays start, as a fraction of the meshes' size or the ray's length.

In float32 a vertex and a ray's origin each move by up to √3·2⁻²⁴ of the meshes' size, the rounded direction
moves the end of the ray by as much of its length, and a distance stored as float32 has an error of 2⁻²⁴ of
itself: 2⁻²² in all.
"""

LIFT_EXACT = 2.0**-40
"""The same for analytic shapes, which are traced in float64, as a fraction of the coordinates."""


@dataclass(frozen=True)
class Hits:
    """The first surfaces that rays meet, of those that are visible."""

    distance: NDArray[np.float32]
    """[N], distances, world units; inf for rays that miss."""
    normal: NDArray[np.float32]
    """[N, 3], unit normals for shading, world, on the side of the ray's origin; 0 for rays that miss, and on
    holdouts."""
    flat: NDArray[np.float32]
    """[N, 3], unit normals of the surface itself, towards the ray's origin; 0 for rays that miss."""
    albedo: NDArray[np.float32]
    """[N, 3], linear albedo; 0 for rays that miss, and on holdouts."""
    raised: NDArray[np.float32]
    """[N, 3], from the point to the smooth surface that triangles stand for, world units: shadow rays start
    there."""
    holdout: NDArray[np.bool_]
    """[N], whether the camera sees a hole there."""

    def __getitem__(self, part: slice) -> Hits:
        return Hits(*(getattr(self, field.name)[part] for field in fields(self)))


class Tracer:
    """Solids prepared for ray tracing.

    The methods trace many rays at once, use all cores and may be interrupted.

    Rays are float64, [N, 3], in world units; the origin or the direction may be one [3] for all rays.
    Directions have unit length.

    Parameters
    ----------
    solids
        The solids; mesh files are read here.
    origin
        Point at which coordinates of meshes are most precise, [3], world; None: their centre. Useful for a
        detail that is small compared with all the meshes.

    Raises
    ------
    SceneError
        If a mesh file cannot be used.
    """

    def __init__(self, solids: Sequence[Solid], origin: ArrayLike | None = None) -> None:
        self._shapes = [solid for solid in solids if isinstance(solid, AnalyticSolid)]
        # Any other solid is a mesh.
        meshes = [cast("MeshSolid", solid) for solid in solids if not isinstance(solid, AnalyticSolid)]
        self._meshes = _embree(meshes, origin) if meshes else None
        self._seen_shapes = [shape for shape in self._shapes if shape.visible]
        seen = [mesh for mesh in meshes if mesh.visible]
        self._seen_meshes = (
            self._meshes if len(seen) == len(meshes) else _embree(seen, origin) if seen else None
        )
        boxes = [box for box in (solid.bounds() for solid in solids) if box is not None]
        self.bounds: NDArray[np.float64] | None = None
        """Low and high corner of the finite solids, [2, 3], world; None if there are none."""
        if boxes:
            corners = np.stack(boxes)
            self.bounds = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
        planes = [(solid.world_plane(), solid.visible) for solid in solids]
        self._planes = [(*plane, visible) for plane, visible in planes if plane is not None]
        self._boxes = [box[None] for box in (shape.bounds() for shape in self._shapes) if box is not None]
        if self._meshes is not None:
            self._boxes.append(self._meshes.boxes)

    def may_shade(
        self,
        regions: LitRegions,
        eye: NDArray[np.float64] | None = None,
        within: NDArray[np.float64] | None = None,
    ) -> NDArray[np.bool_]:
        """Tell in which lights' regions [n] there may be shadows; the others need no rays.

        Parameters
        ----------
        eye
            [3]: only shadows that are seen from there count. A plane hides what it shades where the eye and
            the light are on the same side of it.
        within
            Box [2, 3]: only shadows in there count. A plane shades nothing on the light's side of it.
        """
        met = np.zeros(len(regions.apex), dtype=bool)
        for point, normal, visible in self._planes:
            height = 0.0 if eye is None or not visible else float((eye - point) @ normal)
            sides = regions.sides(point, normal)
            may = regions.touch_plane(point, normal) & (sides * height <= 0)
            if within is not None and np.isfinite(within).all():
                heights = (corners_of(within) - point) @ normal
                may &= (sides * heights.min() < 0) | (sides * heights.max() < 0) | (sides == 0)
            met |= may
        for boxes in self._boxes:
            whole = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
            left = np.flatnonzero(~met)
            left = left[regions[left].touch_boxes(whole[None])]
            met[left] = regions[left].touch_boxes(boxes[:, None]).any(axis=0)
        return met

    def nearest(self, origins: ArrayLike, directions: ArrayLike, spread: float = 0.0) -> Hits:
        """Find the first visible surface along rays; distances are computed in float64, then rounded.

        Parameters
        ----------
        origins, directions
            Of the rays.
        spread
            Width of the rays' cones at distance 1, over which images are averaged; 0: they are interpolated.
        """
        rays = _Rays(origins, directions)
        hits = Hits(
            np.full(rays.count, np.inf, np.float32),
            normal=np.zeros((rays.count, 3), np.float32),
            flat=np.zeros((rays.count, 3), np.float32),
            albedo=np.zeros((rays.count, 3), np.float32),
            raised=np.zeros((rays.count, 3), np.float32),
            holdout=np.zeros(rays.count, bool),
        )

        in_chunks(rays.count, lambda part: self._find(hits[part], *rays[part], spread))
        return hits

    def distances(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.float32]:
        """Find the distances to the first surfaces, [N]; inf for rays that miss. Faster than `nearest`.

        The distances to meshes are Embree's, in float32: their error is about `LIFT` of the meshes' size,
        divided by the cosine of the angle of incidence.
        """
        rays = _Rays(origins, directions)
        result = np.full(rays.count, np.inf, np.float32)

        def trace(part: slice) -> None:
            start, towards = rays[part]
            nearest = np.full(len(start), np.inf)
            if self._meshes is not None:
                found, distance = self._meshes.distances(start, towards)
                nearest[found] = distance
            for shape in self._shapes:
                np.minimum(nearest, shape.distances(*shape.object_rays(start, towards)), out=nearest)
            result[part] = nearest

        in_chunks(rays.count, trace)
        return result

    def occluded(
        self, origins: ArrayLike, directions: ArrayLike, distances: ArrayLike, *, by_seen: bool = False
    ) -> NDArray[np.bool_]:
        """Tell whether any solid lies strictly between the ends of rays, [N].

        Surfaces within `LIFT` of the far end do not count. Rays that start on a surface should start at
        `lifted` points.

        Parameters
        ----------
        origins, directions
            As in `nearest`.
        distances
            Length of each ray, [N] or one for all, world units; may be infinite.
        by_seen
            Whether only solids that are visible count.
        """
        shapes = self._seen_shapes if by_seen else self._shapes
        meshes = self._seen_meshes if by_seen else self._meshes
        rays = _Rays(origins, directions)
        lengths = np.broadcast_to(np.asarray(distances, dtype=np.float64), rays.count)
        result = np.zeros(rays.count, dtype=bool)

        def trace(part: slice) -> None:
            start, towards = rays[part]
            limits = lengths[part] * (1 - LIFT)
            blocked = np.zeros(len(start), dtype=bool)
            for shape in shapes:
                blocked |= shape.distances(*shape.object_rays(start, towards)) < limits
            if meshes is not None and not blocked.all():
                left = np.flatnonzero(~blocked)
                ends = limits[left] - LIFT * meshes.size
                blocked[left] = meshes.occluded(start[left], towards[left], ends)
            result[part] = blocked

        in_chunks(rays.count, trace)
        return result

    def lifted(self, points: ArrayLike, normals: ArrayLike, distances: ArrayLike) -> NDArray[np.float64]:
        """Move points off their surface, to where shadow rays may start.

        Points move along the normal by `LIFT` times the larger of the meshes' size and the length of the ray
        that found them. A shadow ray on the side of the normal then starts above its surface at any angle.
        Solids thicker than that cast shadows. On the other side (a cosine ≤ 0) the surface itself blocks the
        light, so no ray is needed.

        Parameters
        ----------
        points
            [N, 3], float64, world.
        normals
            [N, 3], unit, on the lit side, as in `Hits.normal`.
        distances
            Lengths, [N] or one for all, of the rays that found the points in float32; 0 for float64 points.
        """
        points, normals = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
        size = 0.0 if self._meshes is None else self._meshes.size
        x, y, z = np.abs(np.moveaxis(points, -1, 0))
        exact = LIFT_EXACT * np.maximum(np.maximum(x, y), z)
        offset = np.maximum(exact, LIFT * np.maximum(np.asarray(distances, dtype=np.float64), size))
        lifted: NDArray[np.float64] = points + offset[..., None] * normals
        return lifted

    def _find(
        self, found: Hits, origins: NDArray[np.float64], directions: NDArray[np.float64], spread: float
    ) -> None:
        """Trace one chunk of rays, whose hits there are none of yet."""
        nearest = np.full(len(origins), np.inf)
        if self._seen_meshes is not None:
            met = self._seen_meshes.nearest(origins, directions, spread)
            nearest[met.rays], found.flat[met.rays] = met.distances, met.flat
            found.normal[met.rays], found.albedo[met.rays] = met.normals, met.albedo
            found.raised[met.rays], found.holdout[met.rays] = met.raised, met.holdout
        for solid in self._seen_shapes:
            start, towards = solid.object_rays(origins, directions)
            distance = solid.distances(start, towards)
            closer = np.flatnonzero(distance < nearest)
            nearest[closer] = distance[closer]
            place = start[closer] + distance[closer, None] * towards[closer]
            normals = solid.world_normals(solid.normals(place))
            normals[dots(normals, directions[closer]) > 0] *= -1
            found.normal[closer] = found.flat[closer] = normals
            found.raised[closer], found.holdout[closer] = 0, solid.holdout
            mapped = solid.mapped()
            if mapped is None:
                found.albedo[closer] = solid.albedo
                continue
            # Of world points, which for a plane are those of the ray.
            points = origins[closer] + distance[closer, None] * directions[closer]
            axes, offset = mapped.uv_from_world[:, :3], mapped.uv_from_world[:, 3]
            along = footprints(normals, directions[closer], spread * distance[closer])
            found.albedo[closer] = sampled(mapped.image, points @ axes.T + offset, along @ axes.T)
        found.distance[:] = nearest
        found.normal[found.holdout] = found.albedo[found.holdout] = 0


def _embree(meshes: list[MeshSolid], origin: ArrayLike | None) -> Meshes:
    with needs("solids", "solid: a mesh", SceneError):
        from tfm_cl.render.tracing.embree import Meshes  # noqa: PLC0415 - Embree is slow to import

    return Meshes(meshes, None if origin is None else np.asarray(origin, dtype=np.float64))


class _Rays:
    """Origins and directions of N rays, without copying values shared by all of them."""

    def __init__(self, origins: ArrayLike, directions: ArrayLike) -> None:
        one, other = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        shape = np.broadcast_shapes(one.shape, other.shape, (1, 3))
        self._origins, self._directions = np.broadcast_to(one, shape), np.broadcast_to(other, shape)
        self.count = shape[0]

    def __getitem__(self, part: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self._origins[part], self._directions[part]
