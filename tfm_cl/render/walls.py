"""Solids among the points of a lattice of later orders: where the rays that sweep it meet them.

What arrives at a surface is reflected evenly (Lambert). Surfaces are cut into patches, one for each cube of
the lattice's spacing and each of the six directions that a surface mostly faces. As the rays of a direction
are evenly spread, what a patch reflects is its albedo times the mean of what arrives on them, each weighed by
the solid angle and the area that it stands for: no patch is brighter than the brightest that it sees.

Where it is dark behind a surface (`tfm_cl.render.rooms`), a ray goes on with what it brought there, and from
the middle of its way on with what it takes along as it comes out: points beside a solid lie between rays of
which some are behind its surface.

Rays also meet solids before they enter the lattice, and behind it. Of the light at those patches only a part
has passed through the lattice: the rest is taken for dark, but for that of the lights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.interrupts import cancellable, check_cancelled
from tfm_cl.plan.orders import is_endless
from tfm_cl.render.rooms import sides_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from tfm_cl.plan.orders import Lattice
    from tfm_cl.render.rooms import Hidden
    from tfm_cl.render.tracing.tracer import Hits, Tracer
    from tfm_cl.scene.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_MET = 64
"""Surfaces that a ray meets within the lattice; it passes further ones."""
ABOVE = 0.25
"""Parts of the spacing by which the place where a patch is lit lies above it: shadow maps have errors."""
NO_PATCH, HELD, HELD_FROM = -1, -2, -3
"""What goes on in the place of a patch's light: the ray's own; the same, which it holds in the dark; and that
of a patch, likewise, by so many less than the last number. As in ``kernels/view/walls.h``."""
NOTHING, ITS_OWN, OF_NEXT = 0, 1, 2
FARTHEST = 1 << 17
"""Cubes of a patch from the first point, at most; what is beyond is one."""
LEVELS = 24
"""Sizes of patches: those outside are twice as large at twice the distance."""
CUBE_BITS, SIDE_BITS = 18, 4
LEVEL_BIT = 3 * CUBE_BITS + SIDE_BITS
"""In a patch's name."""
WITHIN = 1e-6
"""Planes by which a ray that enters or leaves at a point beside the lattice is taken to be inside."""
LEAST_COSINE = 0.5
"""Of a surface's normal to the nearest axis: means of normals may be shorter, single ones reach 3^-1/2."""
NAMED = 1 << 16
"""Surfaces whose patches are named at a time."""
TINY = 1e-300
"""More than no weight."""


class Sweep(NamedTuple):
    """How the rays of a direction, which pass between points, cross planes."""

    axis: int
    across: tuple[int, int]
    """The other axes: along columns, and along rows."""
    backwards: bool
    slope: tuple[float, float]
    """Columns and rows that it moves by from plane to plane."""

    @classmethod
    def of(cls, direction: Floats) -> Sweep:
        """Return that of a unit vector [3]."""
        axis = int(np.abs(direction).argmax())
        columns, rows = (other for other in range(3) if other != axis)
        along = abs(direction[axis])
        slopes = [float(np.float32(direction[other] / along)) for other in (columns, rows)]
        return cls(axis, (columns, rows), bool(direction[axis] < 0), (slopes[0], slopes[1]))

    def rays_along(self, number: int, size: tuple[int, int, int]) -> tuple[int, int]:
        """Return the first ray along columns or rows, by where it crosses the first plane, and how many."""
        last = math.floor(np.float32(self.slope[number]) * np.float32(size[self.axis] - 1))
        return -1 - max(last, 0), size[self.across[number]] + 1 + abs(last)


class Met(NamedTuple):
    """Where the rays of a direction meet solids, all [n]; what a ray meets first comes first."""

    column: Ints
    """Of the ray, where it crosses the first plane."""
    row: Ints
    plane: Ints
    """Towards which it is on its way, counted as it goes."""
    part: Floats
    """Of the way from the plane before to that one, which it has gone."""
    departs: Ints
    """Patch whose light goes on; or `NO_PATCH`, `HELD`, `HELD_FROM` less the patch."""
    arrives: Ints
    """Patch at which light arrives, or `NO_PATCH`."""
    share: Floats
    """Of what that patch receives in all, over the mean radiance."""


@dataclass(frozen=True)
class Walls:
    """Patches of solids, and what the rays of all orders meet of them."""

    points: Floats
    """[patches, 3], world, a little above."""
    normals: Floats
    """[patches, 3], unit, on the side that is lit."""
    albedo: Floats
    """[patches, RGB]."""
    met: dict[int, tuple[Met, ...]]
    """What rays of each order and direction meet; orders of the same directions share it."""

    @property
    def nbytes(self) -> int:
        """Size."""
        sets = {id(some): some for some in self.met.values()}.values()
        of_rays = sum(values.nbytes for some in sets for one in some for values in one)
        return of_rays + self.points.nbytes + self.normals.nbytes + self.albedo.nbytes


class _Found(NamedTuple):
    """Surfaces that the rays of a direction meet, before patches have numbers."""

    column: Ints
    row: Ints
    plane: Ints
    part: Floats
    point: Floats
    normal: Floats
    """Towards where the ray came from."""
    albedo: Floats
    departs: NDArray[np.bool_]
    arrives: NDArray[np.bool_]
    holds: Ints
    """What the ray holds from there on: `NOTHING`, `ITS_OWN` light, or that `OF_NEXT`, which departs."""


def walls_of(
    tracer: Tracer,
    scene: Scene,
    lattice: Lattice,
    ways_of_orders: Mapping[int, tuple[Floats, Floats]],
    hidden: Hidden | None = None,
) -> Walls | None:
    """Trace the rays that sweep a lattice; None where they meet no solid.

    Parameters
    ----------
    ways_of_orders
        Directions ``[n, 3]`` of each order, and solid angles ``[n]``.
    hidden
        Points behind solids; None where there are none.
    """
    names = {order: ways.tobytes() for order, (ways, _) in ways_of_orders.items()}
    sets = list({names[order]: one for order, one in ways_of_orders.items()}.values())
    beyond = not is_endless(scene)
    found = [[_Rays(tracer, lattice, way).found(beyond=beyond) for way in ways] for ways, _ in sets]
    if hidden is not None:
        found = [[_held(tracer, one, hidden, lattice) for one in some] for some in found]
    joined = _joined([one for some in found for one in some])
    if not len(joined.plane):
        return None
    # Either side of each surface: where light arrives, and where it departs.
    sides = [(joined.normal, joined.arrives), (-joined.normal, joined.departs)]
    unique, numbers = _numbered(lattice, joined.point, sides)
    count, first = len(unique), int(joined.arrives.sum())
    place, normal, albedo = (
        _means(_one_behind_the_other(values[some] for values, some in each), numbers, count)
        for each in (
            ((joined.point, joined.arrives), (joined.point, joined.departs)),
            sides,
            ((joined.albedo, joined.arrives), (joined.albedo, joined.departs)),
        )
    )
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), TINY)
    arrives, departs = np.full((2, len(joined.plane)), NO_PATCH)
    arrives[joined.arrives], departs[joined.departs] = numbers[:first], numbers[first:]
    check_cancelled()
    takes = np.flatnonzero(joined.holds == OF_NEXT)
    departs[takes] = HELD_FROM - departs[takes + 1]
    departs[joined.holds == ITS_OWN] = HELD
    edge = lattice.spacing * 2.0 ** (unique >> LEVEL_BIT)
    area = edge**2 / np.maximum(np.abs(normal).max(axis=1), LEAST_COSINE)
    least = np.where(_inside(lattice, place), 0.0, math.pi * area)
    made, at = dict[bytes, tuple[Met, ...]](), 0
    for (ways, weights), some in zip(sets, found, strict=True):
        of_set = []
        check_cancelled()
        ends = at + np.cumsum([len(one.plane) for one in some])
        known = slice(at, int(ends[-1]))
        of_rays = weights * np.abs(ways).max(axis=1) * lattice.spacing**2
        weight = np.repeat(of_rays, [len(one.plane) for one in some])
        here = arrives[known]
        total = np.bincount(here[here != NO_PATCH], weight[here != NO_PATCH], count)
        share = np.where(here != NO_PATCH, weight / np.maximum(np.maximum(total, least)[here], TINY), 0.0)
        for one, end in zip(some, ends.tolist(), strict=True):
            part = slice(end - len(one.plane), end)
            shares = share[part.start - at : part.stop - at]
            of_set.append(Met(one.column, one.row, one.plane, one.part, departs[part], arrives[part], shares))
        made[ways.tobytes()] = tuple(of_set)
        at = int(ends[-1])
    met = {order: made[name] for order, name in names.items()}
    return Walls(place + ABOVE * edge[:, None] * normal, normal, albedo, met)


def _held(tracer: Tracer, found: _Found, hidden: Hidden, lattice: Lattice) -> _Found:
    """Let the rays of a direction hold their light where they pass through solids in which it is dark."""
    ray, place = found.column * FARTHEST + found.row, found.plane - 1 + found.part
    check_cancelled()
    order = np.lexsort((place, ray))
    check_cancelled()
    ray, place, arrives, departs = ray[order], place[order], found.arrives[order], found.departs[order]
    front, back = np.zeros((2, len(order)), dtype=bool)
    within = np.flatnonzero(arrives & departs)
    points, normals = found.point[order[within]], found.normal[order[within]]
    front[within] = sides_of(tracer, hidden, lattice, points, normals)
    check_cancelled()
    back[within] = sides_of(tracer, hidden, lattice, points, -normals)
    check_cancelled()
    same = np.diff(ray) == 0
    follows, goes_on = np.append(False, same), np.append(same, False)
    # What is before the lattice and behind it is as what the ray meets next in it, or met last.
    back = np.where(arrives, back, np.append(front[1:], False) & goes_on)
    front = np.where(departs, front, np.append(False, back[:-1]) & follows)
    # In the dark from here up to the next, from the one before up to here, or beyond the lattice's ends.
    enters = back & (~goes_on | np.append(front[1:], False))
    leaves = front & (~follows | np.append(False, back[:-1]))
    # What is met in the dark counts for nothing.
    kept = np.flatnonzero(~(enters & leaves))
    order, ray, place, enters, leaves = order[kept], ray[kept], place[kept], enters[kept], leaves[kept]
    arrives, departs = arrives[kept] & ~leaves, departs[kept] & ~enters
    same, comes_out = np.diff(ray) == 0, leaves & departs
    through = np.flatnonzero(same & enters[:-1] & comes_out[1:])
    begins = np.flatnonzero(comes_out & ~np.append(False, same))
    # From the middle on; from the solid before the lattice nothing arrives that might be held.
    middle = np.where(arrives[through], (place[through] + place[through + 1]) / 2, place[through])
    middle = np.append(middle, np.zeros(len(begins)))
    plane, none = np.ceil(middle).astype(np.int64), np.zeros(len(middle), dtype=bool)
    number = np.argsort(np.concatenate([np.arange(len(order)), through + 0.5, begins - 0.5]))
    which = np.concatenate([order, order[through], order[begins]])[number]
    holds = np.where(enters, ITS_OWN, NOTHING)
    check_cancelled()
    return _taken(found, which)._replace(
        plane=np.append(found.plane[order], plane)[number],
        part=np.append(found.part[order], middle - (plane - 1))[number],
        departs=np.append(departs, none)[number],
        arrives=np.append(arrives, none)[number],
        holds=np.append(holds, np.full(len(middle), OF_NEXT))[number],
    )


def _taken(found: _Found, which: Ints) -> _Found:
    """Return some of them, in that order."""
    taken: list[NDArray[Any]] = [values[which] for values in found]
    return _Found(*taken)


def _joined(parts: Sequence[_Found]) -> _Found:
    """Return all of them, one after the other."""
    return _Found(*map(_one_behind_the_other, zip(*parts, strict=True)))


def _one_behind_the_other(parts: Iterable[NDArray[Any]]) -> NDArray[Any]:
    parts = list(cancellable(parts))
    kind = np.result_type(*{part.dtype for part in parts})
    together = np.empty((sum(map(len, parts)), *parts[0].shape[1:]), kind)
    end = 0
    for part in cancellable(parts):
        end += len(part)
        together[end - len(part) : end] = part
    return together


def _means(values: Floats, number: Ints, count: int) -> Floats:
    """Return the means ``[count, 3]`` of values ``[n, 3]`` that belong to numbers ``[n]``."""
    means = np.empty((count, values.shape[1]))
    of = np.bincount(number, minlength=count)
    for axis, one in enumerate(cancellable(values.T)):
        means[:, axis] = np.bincount(number, one, count) / of
    return means


def _inside(lattice: Lattice, points: Floats) -> NDArray[np.bool_]:
    """Tell which points lie where the rays of all directions pass."""
    places = (points - lattice.origin) / lattice.spacing
    inside = (places >= 0) & (places <= np.subtract(lattice.size, 1))
    return np.asarray(inside.all(axis=1))


def _keys(lattice: Lattice, points: Floats, normals: Floats) -> Ints:
    """Name the patch that each surface belongs to."""
    places = (points - lattice.origin) / lattice.spacing
    middle, half = np.subtract(lattice.size, 1) / 2, np.linalg.norm(lattice.size) / 2
    offset = places - middle
    distance = np.sqrt(np.einsum("ij,ij->i", offset, offset)) / half
    level = np.minimum(np.frexp(np.maximum(distance, 1))[1] - 1, LEVELS).astype(np.int64)
    cubes = np.floor(places * np.ldexp(1.0, -level)[:, None])
    cubes = np.clip(cubes, -FARTHEST, FARTHEST - 1).astype(np.int64)
    axis = np.abs(normals).argmax(axis=1)
    key: Ints = level
    for number in cubes.T:
        key = (key << CUBE_BITS) + number + FARTHEST
    upwards = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0
    named: Ints = (key << SIDE_BITS) + 2 * axis + upwards
    return named


def _numbered(
    lattice: Lattice, points: Floats, sides: Sequence[tuple[Floats, NDArray[np.bool_]]]
) -> tuple[Ints, Ints]:
    """Return the patches' names, in order, and the number among them of that of each surface.

    Parameters
    ----------
    points
        Of all surfaces, ``[n, 3]``.
    sides
        Their normals ``[n, 3]``, and which of them count, ``[n]``.
    """
    found = []
    for normals, counts in sides:
        which = np.flatnonzero(counts)
        for first in range(0, len(which), NAMED):
            check_cancelled()
            part = which[first : first + NAMED]
            found.append(np.unique(_keys(lattice, points[part], normals[part]), return_inverse=True))
    check_cancelled()
    every = np.sort(np.concatenate([names for names, _ in found]), kind="stable")  # which are in order each
    unique = every[np.append(True, np.diff(every) > 0)]
    return unique, _one_behind_the_other(np.searchsorted(unique, names)[own] for names, own in found)


class _Rays:
    """The rays of a direction, which sweep a lattice."""

    def __init__(self, tracer: Tracer, lattice: Lattice, direction: Floats) -> None:
        self._tracer, self._lattice, self._direction = tracer, lattice, direction
        self._sweep = sweep = Sweep.of(direction)
        self._length = lattice.spacing / float(np.abs(direction).max())
        first, along = zip(*(sweep.rays_along(number, lattice.size) for number in (0, 1)), strict=True)
        rays = np.indices(along).reshape(2, -1) + np.array(first)[:, None]
        begin, end = np.zeros(rays.shape[1]), np.full(rays.shape[1], lattice.size[sweep.axis] - 1.0)
        for start, slant, axis in zip(rays, sweep.slope, sweep.across, strict=True):
            slope = math.copysign(max(abs(slant), TINY), slant)
            enter, leave = np.sort([(-1 - start) / slope, (lattice.size[axis] - start) / slope], axis=0)
            begin, end = np.maximum(begin, enter + WITHIN), np.minimum(end, leave - WITHIN)
        passes = np.floor(end) >= np.ceil(begin)  # at least one plane, between its points
        self._rays, self._begin = rays[:, passes], begin[passes]
        self._last: Ints = np.floor(end[passes]).astype(np.int64)

    def found(self, *, beyond: bool) -> _Found:
        """Follow them through the lattice, and to what is before and, if asked, behind it."""
        which = np.arange(len(self._begin))
        origins = self._places(which, self._begin)
        before = [self._before(which, origins)] if beyond else []
        return _joined([*before, *self._within(which, origins, beyond=beyond)])

    def _places(self, which: Ints, along: Floats) -> Floats:
        """World points ``[n, 3]`` where rays are so many planes on their way."""
        sweep, lattice = self._sweep, self._lattice
        index = np.empty((len(which), 3))
        index[:, sweep.axis] = lattice.size[sweep.axis] - 1 - along if sweep.backwards else along
        for start, slope, axis in zip(self._rays, sweep.slope, sweep.across, strict=True):
            index[:, axis] = start[which] + slope * along
        places: Floats = np.asarray(lattice.origin) + lattice.spacing * index
        return places

    def _before(self, which: Ints, origins: Floats) -> _Found:
        hits = self._tracer.nearest(origins, -self._direction)
        met = np.flatnonzero(np.isfinite(hits.distance))
        points = origins[met] - hits.distance[met, None].astype(np.float64) * self._direction
        plane = np.ceil(self._begin[met]).astype(np.int64)
        part: Floats = self._begin[met] - (plane - 1)
        return self._of_hits(which[met], plane, part, points, (hits, met), arrives=False)

    def _within(self, which: Ints, origins: Floats, *, beyond: bool) -> Iterator[_Found]:
        along = self._begin
        for _ in range(MOST_MET):
            hits = self._tracer.nearest(origins, self._direction)
            met = np.flatnonzero(np.isfinite(hits.distance))
            distance = hits.distance[met].astype(np.float64)
            which, points = which[met], origins[met] + distance[:, None] * self._direction
            along = along[met] + distance / self._length
            plane = np.ceil(along).astype(np.int64)
            inner = plane <= self._last[which]
            some, others = np.flatnonzero(inner), np.flatnonzero(~inner)
            part = along - (plane - 1)
            yield self._of_hits(which[some], plane[some], part[some], points[some], (hits, met[some]))
            if beyond:
                end, whole = self._last[which[others]], np.ones(len(others))
                behind = hits, met[others]
                yield self._of_hits(which[others], end, whole, points[others], behind, departs=False)
            if not len(some):
                return
            flat = hits.flat[met[some]].astype(np.float64)
            origins = self._tracer.lifted(points[some], -flat, distance[some])
            which, along = which[some], along[some]

    def _of_hits(
        self,
        which: Ints,
        plane: Ints,
        part: Floats,
        points: Floats,
        met: tuple[Hits, Ints],
        *,
        departs: bool = True,
        arrives: bool = True,
    ) -> _Found:
        hits, numbers = met
        normals = hits.flat[numbers].astype(np.float64)
        column, row = self._rays[:, which]
        return _Found(
            column,
            row,
            plane,
            np.clip(part, 0, 1),
            points,
            normals if arrives else -normals,
            hits.albedo[numbers].astype(np.float64),
            np.full(len(which), departs),
            np.full(len(which), arrives),
            np.full(len(which), NOTHING),
        )
