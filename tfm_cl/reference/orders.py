"""The later orders of scattering, on the product's own lattice: `tfm_cl.render.orders`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import BEYOND_ANGLES, BEYOND_DEPTHS, BEYOND_HALF
from tfm_cl.plan.deposits import deposited
from tfm_cl.plan.lobes import zonal
from tfm_cl.plan.orders import (
    Lattice,
    beyond_of_media,
    is_endless,
    lattice_of,
    lobes,
    media_of,
    orders_of,
    sweeps_emission,
    swept_media,
    ways_of,
)
from tfm_cl.reference.bodies import body_interval, channel_densities
from tfm_cl.reference.geometry import Floats, between
from tfm_cl.render.rooms import Hidden, hidden_of, rooms_of
from tfm_cl.render.walls import HELD, HELD_FROM, NO_PATCH, walls_of

if TYPE_CHECKING:
    from tfm_cl.plan.lobes import Lobe
    from tfm_cl.reference.bodies import Matter
    from tfm_cl.reference.light import Brought, Coefficients
    from tfm_cl.reference.march import Step
    from tfm_cl.render.tracing.tracer import Tracer
    from tfm_cl.render.walls import Met, Walls
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene


Arrives = Callable[[Floats], "Brought"]
LEAST_WEIGHT = 1e-6
"""As an optical depth of the distance between points, of what has no density."""
DARK = 1e-300
"""More than a transmittance or a length of 0."""


class LaterOrders:
    """What all orders but the first scatter to the camera, at the points of a lattice.

    Parameters
    ----------
    scene
        With numbers.
    lights
        What arrives of each of its single, fitted lights.
    tracer
        Of its solids; None without any.
    """

    def __init__(self, scene: Scene, lights: Sequence[Arrives], tracer: Tracer | None = None) -> None:
        self._scene, self.lattice, self._lights = scene, lattice_of(scene), lights
        self._media, self._lobes = media_of(scene), lobes(scene)
        self._all_media = scene.media
        self._held = (
            deposited(scene, self.lattice, is_grey=False).swapaxes(2, 4) if scene.primitives else None
        )
        amounts = self._amounts()
        self._ways, self._emits = ways_of(scene), sweeps_emission(scene)
        hidden = None if tracer is None else self._hidden_by(tracer, _emitted(swept_media(scene), amounts))
        walls = None if tracer is None else walls_of(tracer, scene, self.lattice, self._ways, hidden)
        self._surfaces = Surfaces(walls, hidden)
        fill = self._surfaces.filled
        amounts = np.stack([fill(one) for one in amounts])
        self._matter, self._emitted = (
            LatticeMatter.of(self._media, self._lobes, amounts),
            _emitted(swept_media(scene), amounts),
        )
        found = self._of_lobe() if self._lobes[0].degree else [self._even()] * len(self._media)
        found = [fill(one) for one in found]
        if is_endless(scene):
            for one in found:
                one[_outermost(one.shape)] = 0
        self._found = dict(zip(self._media, found, strict=True))

    def source(self, matter: Matter, step: Step, points: Floats) -> Floats:
        """RGB ``[n, 3]`` that a step at points scatters to the camera, over its opacity."""
        scattered = np.zeros((len(points), 3))
        for medium, sigma_s, amount in zip(matter.media, matter.sigma_s, step.amounts, strict=True):
            if sigma_s.any():
                scattered += sigma_s * amount * between(self._found[medium], self.lattice, points)
        return np.divide(scattered, step.depth, out=np.zeros_like(scattered), where=step.depth > 0)

    def _hidden_by(self, tracer: Tracer, emitted: Floats) -> Hidden | None:
        """Return the points behind solids."""
        rooms = rooms_of(tracer, self.lattice)
        if rooms is None:
            return None
        light, centres = np.zeros(self.lattice.size), self._centres().reshape(-1, 3)
        for arrives in self._lights:
            one = arrives(centres)
            light += (one.radiance * one.transmittance).sum(axis=-1).reshape(light.shape)
        return hidden_of(rooms, light, emitted.sum(axis=-1), self._scene, self.lattice)

    def _even(self) -> Floats:
        light, emitted = np.zeros((2, *self.lattice.size, 3))
        for arrives in self._lights:
            light += self._brought(arrives) / (4 * np.pi)
        surfaces = self._surfaces
        if self._emits:
            emitted = np.mean([one for one, _ in self._unscattered()], axis=0)
        surfaces.light(surfaces.reached_by(self._lights))
        again = scattered_again(light + emitted, self._matter, self.lattice, self._ways, surfaces)
        return emitted + again

    def _unscattered(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield, of what is emitted, as `swept`, of all directions."""
        for number, direction in enumerate(self._ways[0][0]):
            wall = self._surfaces.of(0, number)
            extinction, spacing = self._matter.extinction, self.lattice.spacing
            yield swept_emission(self._emitted, extinction, direction, spacing, wall)
        self._surfaces.reflect(0)

    def _of_lobe(self) -> list[Floats]:
        """Of each medium, what of the light it would scatter to the camera, over what it scatters."""
        spacing, matter, shares = self.lattice.spacing, self._matter, self._matter.shares()
        ways, weights = self._ways[0]
        centres = self._centres()
        to_camera = np.subtract(self._scene.camera.from_, centres)
        to_camera /= np.maximum(np.linalg.norm(to_camera, axis=-1, keepdims=True), DARK)
        at_centres = [arrives(centres.reshape(-1, 3)) for arrives in self._lights]
        travels = [one.direction.reshape(centres.shape) for one in at_centres]
        left = [self._brought(arrives) for arrives in self._lights]
        radiance = np.zeros((len(ways), *centres.shape))
        rays: list[Floats | None] = [None] * len(ways)
        last = orders_of(self._scene) - 1
        times = max(lobe.times_straight(last) for lobe in self._lobes)
        total = [np.zeros(centres.shape) for _ in self._lobes]
        straight = {
            medium: lobe.straight * np.asarray(medium.sigma_s)
            for medium, lobe in zip(self._media, self._lobes, strict=True)
        }
        if self._emits:
            for number, found in enumerate(self._unscattered()):
                radiance[number], rays[number] = found
                self._see(total, weights[number] * radiance[number], to_camera @ ways[number])
        surfaces = self._surfaces
        on_walls = surfaces.reached_by(self._lights)
        surfaces.light(on_walls)
        for order in range(1, last + 1):
            sources = np.sum(
                [
                    share * _bent(lobe, ways, weights, radiance, travels, left)
                    for lobe, share in zip(self._lobes, shares, strict=True)
                ],
                axis=0,
            )
            sources = np.stack([surfaces.filled(one) for one in sources])
            for number, direction in enumerate(ways):
                radiance[number], rays[number] = swept(
                    sources[number],
                    matter,
                    direction,
                    spacing,
                    before=rays[number],
                    wall=surfaces.of(0, number),
                )
                self._see(total, weights[number] * radiance[number], to_camera @ direction)
            surfaces.reflect(0)
            if order > times:
                left = [np.zeros_like(one) for one in left]
            else:
                left = [_straight_on(one, straight, order, centres.shape) for one in at_centres]
                surfaces.light(on_walls, straight, order)
            for travel, one in zip(travels, left, strict=True):
                self._see(total, one, (to_camera * travel).sum(axis=-1))
        scattered = {medium: np.asarray(medium.sigma_s) for medium in self._media}
        spreads = sorted({0.0, *(light.spread for light in at_centres)})
        tables = beyond_of_media(self._scene, spreads).astype(np.float64)
        for travel, light in zip(travels, at_centres, strict=True):
            for i, table in enumerate(tables[spreads.index(light.spread)]):
                total[i] += _beyond(table, light, scattered, (to_camera * travel).sum(axis=-1))
        return [np.maximum(one, 0) for one in total]

    def _see(self, total: list[Floats], light: Floats, mu: Floats) -> None:
        """Add what each medium scatters to the camera of light, by the cosine to its way."""
        for i, lobe in enumerate(self._lobes):
            total[i] += zonal(lobe.seen, mu)[..., None] * light

    def _centres(self) -> Floats:
        """Points ``[x, y, z, 3]``."""
        places = [
            low + self.lattice.spacing * np.arange(n)
            for low, n in zip(self.lattice.origin, self.lattice.size, strict=True)
        ]
        return np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)

    def _samples(self) -> Iterator[Floats]:
        """Yield points ``[x, y, z, 3]`` in the cubes around those of the lattice."""
        count, spacing, centres = self.lattice.samples, self.lattice.spacing, self._centres()
        offsets = spacing * ((np.arange(count) + 0.5) / count - 0.5)
        for offset in product(offsets, repeat=3):
            yield centres + offset

    def _amounts_at(self, points: Floats) -> Floats:
        """Density of each medium, flames last, at samples, ``[media, ..., RGB]``.

        Of bodies of constant density it is the mean along its part of x, of primitives that of the cube.
        """
        scene = self._scene
        part = self.lattice.spacing / self.lattice.samples
        total = np.zeros((len(self._all_media), *points.shape))
        if self._held is not None:
            total += np.moveaxis(self._held, 1, -1)
        for grid in (*scene.grids, *scene.flames):
            total[self._all_media.index(scene.medium_of(grid))] += channel_densities(grid, points)
        starts = points.reshape(-1, 3) - (part / 2, 0, 0)
        along_x = np.broadcast_to((1.0, 0.0, 0.0), starts.shape)
        for body in scene.homogeneous:
            begin, end = body_interval(body, starts, along_x, part)
            share = ((end - begin) / part).reshape(*points.shape[:-1], 1)
            total[self._all_media.index(scene.medium_of(body))] += body.density * share
        return total

    def _amounts(self) -> Floats:
        """Mean of the cubes around the points, ``[media, x, y, z, 3]``."""
        samples = [self._amounts_at(points) for points in self._samples()]
        mean: Floats = np.mean(samples, axis=0)
        return mean

    def _brought(self, arrives: Arrives) -> Floats:
        """RGB that arrives from a light, ``[x, y, z, 3]``."""
        total, weight = np.zeros((2, *self.lattice.size, 3))
        for points in self._samples():
            here = _extinguished(self._media, self._amounts_at(points)) + LEAST_WEIGHT / self.lattice.spacing
            weight += here
            one = arrives(points.reshape(-1, 3))
            total += here * (one.radiance * one.transmittance).reshape(points.shape)
        brought: Floats = total / weight
        return brought


def _depth(arrival: Brought) -> Floats:
    return -np.log(np.maximum(arrival.transmittance, DARK))


def _straight_on(arrival: Brought, straight: Coefficients, times: int, shape: tuple[int, ...]) -> Floats:
    """RGB of a light that was scattered straight on so many times, ``[x, y, z, 3]``."""
    chance = arrival.depth_of(straight) ** times / math.factorial(times)
    return (arrival.radiance * arrival.transmittance * chance).reshape(shape)


def _beyond(table: Floats, arrival: Brought, scattered: Coefficients, mu: Floats) -> Floats:
    """RGB of a light that a lobe scatters beyond its degree, ``[x, y, z, 3]``; linear in the table."""
    depth = _depth(arrival).reshape(*mu.shape, 3)
    met = arrival.depth_of(scattered).reshape(depth.shape)
    row = met / (met + BEYOND_HALF) * (BEYOND_DEPTHS - 1)
    column = np.sqrt(np.sqrt(np.clip((1 - mu) / 2, 0, 1)))[..., None] * (BEYOND_ANGLES - 1)
    total = np.zeros_like(met)
    i, j = np.minimum(row, BEYOND_DEPTHS - 2).astype(int), np.minimum(column, BEYOND_ANGLES - 2).astype(int)
    for below, right in product((0, 1), repeat=2):
        weight = np.abs(1 - below - (row - i)) * np.abs(1 - right - (column - j))
        total += weight * table[i + below, j + right]
    return total * np.exp(met - depth) * arrival.radiance.reshape(depth.shape)


def _bent(
    lobe: Lobe,
    ways: Floats,
    weights: Floats,
    radiance: Floats,
    travels: Sequence[Floats],
    left: Sequence[Floats],
) -> Floats:
    """Return what a lobe scatters into directions, ``[ways, x, y, z, RGB]``, of theirs and of lights."""
    bent: Floats = np.tensordot(weights * zonal(lobe.bent, ways @ ways.T), radiance, axes=1)
    for travel, one in zip(travels, left, strict=True):
        bent += zonal(lobe.bent, np.moveaxis(travel @ ways.T, -1, 0))[..., None] * one
    return bent


def _extinguished(media: Sequence[Medium], amounts: Floats) -> Floats:
    """RGB, of densities ``[media, ..., RGB]``; flames, which come last, extinguish nothing."""
    total: Floats = np.sum([one.sigma_t * part for one, part in zip(media, amounts, strict=False)], axis=0)
    return total


def _emitted(media: Sequence[Medium], amounts: Floats) -> Floats:
    """RGB radiance per world unit, of densities ``[media, ..., RGB]``."""
    parts = [np.asarray(one.emission) * part for one, part in zip(media, amounts, strict=True)]
    total: Floats = np.sum(parts, axis=0)
    return total


class LatticeMatter(NamedTuple):
    """What the points hold, ``[x, y, z, RGB]``, per world unit."""

    extinction: Floats
    albedo: Floats | None
    """RGB, where all is of one medium."""
    straight: Floats
    """That of what goes straight on; or, of several media, at the points."""
    scattering: list[Floats]
    """Of each medium."""

    @classmethod
    def of(cls, media: Sequence[Medium], known: Sequence[Lobe], amounts: Floats) -> LatticeMatter:
        """Return what densities ``[media, x, y, z, RGB]`` do; those of flames, which come last, nothing."""
        scattering = [np.asarray(one.sigma_s) * part for one, part in zip(media, amounts, strict=False)]
        straight = [lobe.straight * part for lobe, part in zip(known, scattering, strict=True)]
        extinction = _extinguished(media, amounts)
        if len(media) == 1:
            albedo = media[0].albedo
            return cls(extinction, albedo, known[0].straight * albedo, scattering)
        return cls(extinction, None, np.sum(straight, axis=0), scattering)

    def shares(self) -> list[Floats]:
        """Of what is scattered, each medium's share; where nothing is, that of the points around."""
        if self.albedo is not None:
            return [np.ones_like(self.extinction)]
        near = [part + OF_NEIGHBOURS * _around(part) for part in self.scattering]
        total = np.sum(near, axis=0)
        return [np.divide(part, total, out=np.zeros_like(part), where=total > 0) for part in near]


OF_NEIGHBOURS = 1e-3
"""As kernels have it."""


def _around(values: Floats) -> Floats:
    """Sum of points ``[x, y, z, RGB]`` and of their 26 neighbours."""
    wide = np.pad(values, [(1, 1)] * 3 + [(0, 0)])
    x, y, z = values.shape[:3]
    total: Floats = np.sum(
        [wide[i : i + x, j : j + y, k : k + z] for i, j, k in product(range(3), repeat=3)], axis=0
    )
    return total


def _outermost(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask of a lattice's outermost points ``[x, y, z]``."""
    ends = np.ones(shape[:3], dtype=bool)
    ends[1:-1, 1:-1, 1:-1] = False
    return ends


class Wall(NamedTuple):
    """What the rays of a direction meet of solids."""

    met: Met
    reflected: Floats
    """RGB of all patches, ``[patches, 3]``."""
    arriving: Floats
    """RGB that arrives at each of what is met, ``[n, 3]``: written to."""
    held: set[tuple[int, int]]
    """Rays that hold what they carry: written to."""


class Surfaces:
    """Solids among the points: what their patches reflect.

    Parameters
    ----------
    walls
        As the product traces them; None without any.
    hidden
        Points behind them, likewise.
    """

    def __init__(self, walls: Walls | None, hidden: Hidden | None = None) -> None:
        self._walls, self._hidden = walls, hidden
        self._reflected = np.zeros((0, 3)) if walls is None else np.zeros_like(walls.albedo)
        self._met = {} if walls is None else walls.met
        self._arriving = {
            order: [np.zeros((len(met.plane), 3)) for met in some] for order, some in self._met.items()
        }

    def filled(self, values: Floats) -> Floats:
        """Return values ``[x, y, z, RGB]``, those behind solids as they are before them."""
        return values if self._hidden is None else self._hidden.filled(values)

    def of(self, order: int, number: int) -> Wall | None:
        """Return those that the rays of a direction meet; None without solids."""
        if self._walls is None:
            return None
        return Wall(self._met[order][number], self._reflected, self._arriving[order][number], set())

    def reached_by(self, lights: Sequence[Arrives]) -> list[Brought]:
        """Return what of lights arrives at the patches; nothing without solids."""
        return [] if self._walls is None else [arrives(self._walls.points) for arrives in lights]

    def light(self, lights: Sequence[Brought], straight: Coefficients | None = None, times: int = 0) -> None:
        """Add what is reflected of lights that arrive, after being scattered straight on so many times."""
        if self._walls is None:
            return
        for one in lights:
            cosine = np.maximum(-(one.direction * self._walls.normals).sum(axis=1), 0)
            arrives = one.radiance * one.transmittance
            if straight is not None:
                arrives = _straight_on(one, straight, times, arrives.shape)
            self._reflected += self._walls.albedo / np.pi * cosine[:, None] * arrives

    def reflect(self, order: int) -> None:
        """Replace what is reflected by what is of all that arrived."""
        if self._walls is None:
            return
        self._reflected[:] = 0
        for met, arriving in zip(self._met[order], self._arriving[order], strict=True):
            known = met.arrives != NO_PATCH
            shares = met.share[known, None] * arriving[known]
            np.add.at(self._reflected, met.arrives[known], shares)
        self._reflected *= self._walls.albedo


def scattered_again(
    light: Floats,
    matter: LatticeMatter,
    lattice: Lattice,
    ways: dict[int, tuple[Floats, Floats]],
    surfaces: Surfaces,
) -> Floats:
    """Sum of what arrives at points ``[x, y, z, RGB]`` after each scattering but the last.

    Parameters
    ----------
    light
        That arrives unscattered: mean over all directions.
    ways
        Directions of each order from the first on, and their solid angles.
    surfaces
        Of solids, with what they reflect of lights.
    """
    total = np.zeros_like(light)
    for order in sorted(set(ways) - {0}):
        light = surfaces.filled(light)
        arriving = [
            swept(
                light,
                matter,
                direction,
                lattice.spacing,
                wall=surfaces.of(order, number),
            )[0]
            for number, direction in enumerate(ways[order][0])
        ]
        surfaces.reflect(order)
        light = np.mean(arriving, axis=0)
        total += light
    return total


def swept(
    light: Floats,
    matter: LatticeMatter,
    direction: Floats,
    spacing: float,
    *,
    before: Floats | None = None,
    wall: Wall | None = None,
) -> tuple[Floats, Floats]:
    """Radiance ``[x, y, z, RGB]`` that goes in a direction, plane by plane.

    Between the rays, which pass through each plane in the same distances as its points, it is linear, as are
    the light that is scattered and what scatters it between the points. The second result is of the rays: of
    ``before``, that of the last order, a part goes straight on. On either side of a wall what is scattered is
    as at the step's end there.
    """
    planes = _Planes.of(direction)
    lights, extinctions = planes.ordered(light), planes.ordered(matter.extinction)
    is_mixed = matter.albedo is None
    scatters = planes.ordered(np.sum(matter.scattering, axis=0))
    straight = planes.ordered(matter.straight) if is_mixed else np.zeros_like(scatters)
    found = np.zeros_like(lights)
    rays = np.zeros_like(lights)
    radiance = dense = arrived = passed = share = on = source = np.zeros_like(lights[0])
    for m in range(len(lights)):
        shift = planes.slope * m
        arrives, thick = _shifted(lights[m], -shift), _shifted(extinctions[m], -shift)
        passes = np.zeros_like(arrives) if before is None else before[m]
        if is_mixed:  # where nothing is extinguished, shares are as at the step's other end
            share = np.divide(_shifted(scatters[m], -shift), thick, out=share.copy(), where=thick > 0)
            on = np.divide(_shifted(straight[m], -shift), thick, out=on.copy(), where=thick > 0)
        elif matter.albedo is not None:
            share, on = matter.albedo, matter.straight
        here = share * arrives + on * passes
        last = np.where(dense > 0, source, share * arrived + on * passed) if is_mixed else source
        depth = spacing / planes.along * (dense + thick) / 2
        through, mean = _through(depth)
        step = _Step(radiance, depth, depth * source, depth * here)
        radiance = radiance * through + last * (mean - through) + here * (1 - mean)
        radiance = step.ended(radiance, wall, m, len(lights) + 1)
        source, dense, rays[m], arrived, passed = here, thick, radiance, arrives, passes
        found[m] = _shifted(radiance, shift)
    return planes.restored(found), rays


def swept_emission(
    emitted: Floats, extinction: Floats, direction: Floats, spacing: float, wall: Wall | None = None
) -> tuple[Floats, Floats]:
    """As `swept`, of what is emitted per world unit: along a step both are as on average."""
    planes = _Planes.of(direction)
    length = spacing / planes.along
    emits, extinctions = planes.ordered(emitted), planes.ordered(extinction)
    found, rays = np.zeros_like(emits), np.zeros_like(emits)
    radiance = before = dense = np.zeros_like(emits[0])
    for m in range(len(emits)):
        shift = planes.slope * m
        here, thick = _shifted(emits[m], -shift), _shifted(extinctions[m], -shift)
        depth = length * (dense + thick) / 2
        through, mean = _through(depth)
        step = _Step(radiance, depth, length * before, length * here)
        radiance = radiance * through + length * (before + here) / 2 * mean
        radiance = step.ended(radiance, wall, m, len(emits) + 1)
        before, dense, rays[m] = here, thick, radiance
        found[m] = _shifted(radiance, shift)
    return planes.restored(found), rays


class _Step(NamedTuple):
    """A step of rays up to a plane, ``[columns, rows, RGB]``."""

    radiance: Floats
    """At its beginning."""
    depth: Floats
    gain: Floats
    """What it adds where nothing is extinguished, as at its beginning."""
    gain_after: Floats
    """As at its end."""

    def ended(self, radiance: Floats, wall: Wall | None, plane: int, first: int) -> Floats:
        """Radiance at its end, which is given for where there is no wall; ``first``: ray 0 among the rays."""
        if wall is None:
            return radiance
        met, found = wall.met, radiance.copy()
        gone: dict[tuple[int, int], tuple[float, Floats]] = {}
        here = np.flatnonzero(met.plane == plane)
        for n in here[np.argsort(met.part[here], kind="stable")].tolist():
            ray = int(met.column[n]) + first, int(met.row[n]) + first
            begun, light = gone.get(ray, (0.0, self.radiance[ray]))
            part, goes_on = float(met.part[n]), int(met.departs[n])
            if ray not in wall.held:
                gain = self.gain_after[ray] if ray in gone else self.gain[ray]
                light = _after_part(light, gain, self.depth[ray], part - begun)
            wall.arriving[n] = light
            if goes_on >= 0:
                gone[ray] = part, wall.reflected[goes_on].copy()
                wall.held.discard(ray)
            elif goes_on != NO_PATCH:
                held = light if goes_on == HELD else wall.reflected[HELD_FROM - goes_on]
                gone[ray] = part, held.copy()
                wall.held.add(ray)
        for ray, (begun, light) in gone.items():
            found[ray] = _after_part(light, self.gain_after[ray], self.depth[ray], 1 - begun)
        for ray in wall.held:
            found[ray] = gone[ray][1] if ray in gone else self.radiance[ray]
        return found


def _after_part(light: Floats, gain: Floats, depth: Floats, part: float) -> Floats:
    through, mean = _through(part * depth)
    after: Floats = light * through + gain * part * mean
    return after


def _through(depth: Floats) -> tuple[Floats, Floats]:
    """Transmittance of a step, and its mean along it."""
    mean = np.divide(-np.expm1(-depth), depth, out=np.ones_like(depth), where=depth > 0)
    return np.exp(-depth), mean


class _Planes(NamedTuple):
    """Those that a direction crosses."""

    axis: int
    along: float
    slope: Floats
    way: slice

    @classmethod
    def of(cls, direction: Floats) -> _Planes:
        """Return those of a direction, across the axis that it goes along most."""
        axis = int(np.abs(direction).argmax())
        along = float(abs(direction[axis]))
        slope = np.delete(direction, axis) / along
        return cls(axis, along, slope, slice(None, None, -1 if direction[axis] < 0 else 1))

    def ordered(self, values: Floats) -> Floats:
        """Values ``[x, y, z, RGB]`` by planes, with a border of 0 as wide as rays are shifted in all."""
        planes, reach = np.moveaxis(values, self.axis, 0)[self.way], values.shape[self.axis] + 1
        return np.pad(planes, [(0, 0), (reach, reach), (reach, reach), (0, 0)])

    def restored(self, planes: Floats) -> Floats:
        """Return them as they were."""
        reach = len(planes) + 1
        return np.moveaxis(planes[self.way, reach:-reach, reach:-reach], 0, self.axis)


def _shifted(plane: Floats, shift: Floats) -> Floats:
    """Values ``[a, b, RGB]``, moved by parts of a distance, linear between; 0 comes in from outside."""
    for axis, distance in enumerate(shift):
        whole = int(np.floor(distance))
        part = distance - whole
        plane = (1 - part) * np.roll(plane, whole, axis) + part * np.roll(plane, whole + 1, axis)
    return plane
