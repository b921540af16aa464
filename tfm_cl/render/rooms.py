"""Points of a lattice behind solids, where it is dark: what they stand for.

Light is linear between points, and between the rays that sweep them. Beside a solid some of these lie behind
its surface. If they were dark, light would end half a spacing before it. Instead they stand for what is
before it: points for their neighbours, rays for what arrives at the surface, or departs from it
(`tfm_cl.render.walls`).

Solids are surfaces, and have two sides. Which of them is the dark one is known by the light: points that no
solid parts are a room, and a room where no light comes needs none.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import cancellable, check_cancelled

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.scene.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_CUT = 64
"""Surfaces that a line of points passes; what is behind further ones is as before the last."""
AT_POINT = 1e-3
"""Parts of the spacing: a surface that is nearer to a point parts it from its neighbours on both sides."""
LEAST_LIGHT = 1e-2
"""Of what lights bring to a point of the brightest room, on average."""
LEAST_GLOW = 0.1
"""Of what the room emits that emits most: media may reach somewhat behind the walls around it."""
NEIGHBOURS = np.array([(x, y, z) for z, y, x in product((-1, 0, 1), repeat=3)])
"""Of a point, by the number of their bit: from one to the next along x."""
CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Of a cube of points."""
TINY = 1e-300
"""More than no length."""


class Hidden(NamedTuple):
    """Points that lie behind solids."""

    points: NDArray[np.bool_]
    """[x, y, z], which do."""
    next_to: Ints
    """[n], numbers, x first, of those beside points in the open, whose mean they stand for."""
    open: Ints
    """[n], which of the nearest of their `NEIGHBOURS` these are, one bit each."""
    cubes: NDArray[np.uint8]
    """[x - 1, y - 1, z - 1], which `CORNERS` of the cubes between points are hidden, one bit each."""

    def filled(self, values: Floats) -> Floats:
        """Return values ``[x, y, z, …]`` with those of hidden points filled in."""
        size = self.points.shape
        place = np.stack(np.unravel_index(self.next_to, size[::-1])[::-1], axis=1)
        total = np.zeros((len(place), *values.shape[3:]))
        count = np.zeros(len(place))
        for bit, step in enumerate(NEIGHBOURS):
            some = np.flatnonzero(self.open >> bit & 1)
            total[some] += values[tuple((place[some] + step).T)]
            count[some] += 1
        found = values.copy()
        found[tuple(place.T)] = (total.T / count).T
        return found


def rooms_of(tracer: Tracer, lattice: Lattice) -> Ints | None:
    """Find the rooms of the points, numbers ``[x, y, z]``; None where no solid parts them."""
    cut = np.stack([_cut_along(tracer, lattice, axis) for axis in range(3)])
    return _numbered(cut) if cut.any() else None


def _cut_along(tracer: Tracer, lattice: Lattice, axis: int) -> NDArray[np.bool_]:
    """Mark points ``[x, y, z]`` that a solid parts from the one before along an axis."""
    size = [1 if other == axis else count for other, count in enumerate(lattice.size)]
    first = np.indices(size).reshape(3, -1).T
    cut = np.zeros(lattice.size, dtype=bool)
    origins = np.asarray(lattice.origin) + lattice.spacing * first
    which, along = np.arange(len(first)), np.zeros(len(first))
    direction, last = np.eye(3)[axis], lattice.size[axis] - 1
    for _ in range(MOST_CUT):
        hits = tracer.nearest(origins, direction)
        met = np.flatnonzero(np.isfinite(hits.distance))
        distance = hits.distance[met].astype(np.float64)
        which, along = which[met], along[met] + distance / lattice.spacing
        inner = np.flatnonzero(along <= last + AT_POINT)
        if not len(inner):
            break
        for edge in (np.ceil(along[inner] - AT_POINT), np.floor(along[inner] + AT_POINT) + 1):
            place = first[which[inner]]
            place[:, axis] = edge.astype(np.int64)
            cut[tuple(place[(edge > 0) & (edge <= last)].T)] = True
        points = origins[met[inner]] + distance[inner, None] * direction
        origins = tracer.lifted(points, -hits.flat[met[inner]].astype(np.float64), distance[inner])
        which, along = which[inner], along[inner]
    return cut


def _numbered(cut: NDArray[np.bool_]) -> Ints:
    """Give numbers to rooms of points that are parted, along each axis, from those before: ``[x, y, z]``."""
    size = cut.shape[1:]
    numbers: Ints = np.arange(np.prod(size)).reshape(size)
    while True:
        before = numbers
        for axis in range(3):
            check_cancelled()
            lines, begins = np.moveaxis(numbers, axis, -1), np.moveaxis(cut[axis], axis, -1).copy()
            begins[..., 0] = True
            starts = np.flatnonzero(begins)
            least = np.minimum.reduceat(lines.ravel(), starts)
            runs = np.diff(np.append(starts, lines.size))
            numbers = np.moveaxis(np.repeat(least, runs).reshape(lines.shape), -1, axis)
        if np.array_equal(before, numbers):
            # Each has that of its first point so far.
            place = np.cumsum(numbers.ravel() == np.arange(numbers.size)) - 1
            check_cancelled()
            found: Ints = place[numbers]
            return found


def hidden_of(rooms: Ints, light: Floats, emitted: Floats, scene: Scene, lattice: Lattice) -> Hidden | None:
    """Tell which points lie in the dark behind solids; None where none do.

    Parameters
    ----------
    rooms
        As of `rooms_of`.
    light
        What arrives of lights at the points, ``[x, y, z]``, in any unit.
    emitted
        Likewise, what media emit there.
    scene
        Whose lights' rooms are not dark, wherever they shine.
    """
    check_cancelled()
    flat, count = rooms.ravel(), int(rooms.max()) + 1
    # Shadow maps let some light through, which reaches points beside the surface.
    inner = ~_beside_others(rooms).ravel()
    has_inner = np.bincount(flat[inner], minlength=count) > 0
    check_cancelled()
    weight = np.where(inner, 1.0, ~has_inner[flat])
    mean = np.bincount(flat, weight * light.ravel()) / np.bincount(flat, weight)
    glow = np.bincount(flat, emitted.ravel())
    dark = (mean <= LEAST_LIGHT * mean.max()) & (glow <= LEAST_GLOW * glow.max())
    for corners in _corners_of_lights(scene, lattice):
        dark[rooms[tuple(corners.T)]] = False
    if not dark.any():
        return None
    check_cancelled()
    points = dark[rooms]
    cubes = np.zeros(np.subtract(points.shape, 1), np.uint8)
    for bit, corner in enumerate(CORNERS.tolist()):
        ends = (slice(low, low + size) for low, size in zip(corner, cubes.shape, strict=True))
        cubes |= points[tuple(ends)].astype(np.uint8) << bit
    return Hidden(points, *_next_to_open(points), cubes)


def _beside_others(rooms: Ints) -> NDArray[np.bool_]:
    """Mark points ``[x, y, z]`` next to which is another room."""
    found = np.zeros(rooms.shape, dtype=bool)
    for axis in range(3):
        differs = np.diff(rooms, axis=axis) != 0
        ends = [[(0, 0)] * axis + [pad] + [(0, 0)] * (2 - axis) for pad in ((1, 0), (0, 1))]
        found |= np.pad(differs, ends[0]) | np.pad(differs, ends[1])
    return found


def _corners_of_lights(scene: Scene, lattice: Lattice) -> Iterator[Ints]:
    """Yield the points around each light that has a place among them."""
    for light in scene.lights:
        if light.place is None:
            continue
        place = (np.asarray(light.place) - lattice.origin) / lattice.spacing
        low = np.floor(place).astype(np.int64)
        if (low >= 0).all() and (low < np.subtract(lattice.size, 1)).all():
            yield low + CORNERS


def _next_to_open(hidden: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Return the points that have neighbours in the open, and bits of the nearest of these."""
    is_open = np.pad(~hidden, 1)
    place = np.argwhere(hidden)
    distance = np.abs(NEIGHBOURS).sum(axis=1)
    nearest = np.zeros(len(place), np.int64)
    for away in (1, 2, 3):
        bits = np.zeros(len(place), np.int64)
        for bit in cancellable(np.flatnonzero(distance == away).tolist()):
            near = is_open[tuple((place + NEIGHBOURS[bit] + 1).T)]
            bits |= near.astype(np.int64) << bit
        nearest = np.where(nearest == 0, bits, nearest)
    some = nearest != 0
    numbers = np.ravel_multi_index(tuple(place[some].T[::-1]), hidden.shape[::-1])
    return np.asarray(numbers, np.int64), nearest[some]


def sides_of(
    tracer: Tracer, hidden: Hidden, lattice: Lattice, points: Floats, normals: Floats
) -> NDArray[np.bool_]:
    """Tell on which sides of surfaces, at ``points`` [n, 3] towards ``normals``, the dark is, ``[n]``.

    It is where the points of the lattice on that side are hidden; where some are and some are not, the
    nearest that no solid parts from the surface tells.
    """
    place = (points - lattice.origin) / lattice.spacing
    cubes = np.floor(place + normals / 2).astype(np.int64)
    inside = ((cubes >= 0) & (cubes < hidden.cubes.shape)).all(axis=1)
    dark: NDArray[np.bool_] = np.zeros(len(points), dtype=bool)
    some = np.flatnonzero(inside)
    some = some[hidden.cubes[tuple(cubes[some].T)] > 0]
    place, low, normals = place[some], cubes[some], normals[some]
    height = ((low - place) * normals).sum(axis=1)[:, None] + normals @ CORNERS.T
    counts = height > AT_POINT
    bits = np.packbits(counts, axis=1, bitorder="little")[:, 0]
    of_cubes = hidden.cubes[tuple(low.T)]
    dark[some] = bits & of_cubes > 0
    unclear = np.flatnonzero((bits & of_cubes > 0) & (bits & ~of_cubes > 0))
    low, counts, of_cubes, some = low[unclear], counts[unclear], of_cubes[unclear], some[unclear]
    away = np.linalg.norm(low[:, None] + CORNERS - place[unclear, None], axis=2)
    nearest = np.argsort(np.where(counts, away, np.inf), axis=1)
    longest = lattice.spacing * float(np.linalg.norm(lattice.size))
    starts = tracer.lifted(points[some], normals[unclear], longest)
    left = np.arange(len(some))
    for number in range(len(CORNERS)):
        if not len(left):
            break
        check_cancelled()
        corner = nearest[left, number]
        ends = np.asarray(lattice.origin) + lattice.spacing * (low[left] + CORNERS[corner])
        way = ends - starts[left]
        length = np.maximum(np.linalg.norm(way, axis=1), TINY)
        seen = ~tracer.occluded(starts[left], way / length[:, None], length) & counts[left, corner]
        tell = left[seen]
        dark[some[tell]] = of_cubes[tell] >> corner[seen] & 1
        left = left[~seen]
    return dark
