"""The later orders of scattering, on the product's own lattice: `tfm_cl.render.orders`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tfm_cl.constants import BEYOND_ANGLES, BEYOND_DEPTHS, BEYOND_HALF
from tfm_cl.plan import orders
from tfm_cl.plan.lobes import beyond, lobe_of, quadrature, zonal
from tfm_cl.plan.orders import Lattice, lattice_of, medium_of, orders_of
from tfm_cl.reference.bodies import body_interval, channel_densities
from tfm_cl.reference.geometry import Floats

if TYPE_CHECKING:
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene


class Brought(NamedTuple):
    """What arrives of a light at points ``[n, 3]``."""

    radiance: Floats
    """RGB, after solids, but not bodies."""
    transmittance: Floats
    """RGB, of the bodies."""
    direction: Floats
    """In which it goes."""


Arrives = Callable[[Floats], Brought]
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
    """

    def __init__(self, scene: Scene, lights: Sequence[Arrives]) -> None:
        self._scene, self.lattice, self._lights = scene, lattice_of(scene), lights
        medium = medium_of(scene)
        self._albedo, self._lobe = _albedo(medium), lobe_of(medium.phase)
        found = self._of_lobe() if self._lobe.degree else self._even()
        self.source = self._albedo * found
        """``[x, y, z, RGB]`` over opacity."""

    def _even(self) -> Floats:
        light = np.sum([self._brought(arrives) for arrives in self._lights], axis=0) / (4 * np.pi)
        count = orders_of(self._scene)
        return scattered_again(light, self._extinction(), self._albedo, self.lattice, count)

    def _of_lobe(self) -> Floats:
        lobe, albedo, spacing = self._lobe, self._albedo, self.lattice.spacing
        ways, weights = quadrature()
        extinction, centres = self._extinction(), self._centres()
        to_camera = np.subtract(self._scene.camera.from_, centres)
        to_camera /= np.maximum(np.linalg.norm(to_camera, axis=-1, keepdims=True), DARK)
        at_centres = [arrives(centres.reshape(-1, 3)) for arrives in self._lights]
        travels = [one.direction.reshape(centres.shape) for one in at_centres]
        left = [self._brought(arrives) for arrives in self._lights]
        radiance = np.zeros((len(ways), *centres.shape))
        rays: list[Floats | None] = [None] * len(ways)
        last = orders_of(self._scene) - 1
        between = weights * zonal(lobe.bent, ways @ ways.T)
        total = np.zeros(centres.shape)
        for order in range(1, last + 1):
            sources = np.tensordot(between, radiance, axes=1)
            for travel, one in zip(travels, left, strict=True):
                sources += zonal(lobe.bent, np.moveaxis(travel @ ways.T, -1, 0))[..., None] * one
            for number, direction in enumerate(ways):
                radiance[number], rays[number] = swept(
                    albedo * sources[number],
                    extinction,
                    direction,
                    spacing,
                    straight=lobe.straight * albedo,
                    before=rays[number],
                )
                seen = zonal(lobe.seen, to_camera @ direction)[..., None]
                total += weights[number] * seen * radiance[number]
            if order > lobe.times_straight(last):
                left = [np.zeros_like(one) for one in left]
            else:
                left = [_straight_on(one, lobe.straight * albedo, order, centres.shape) for one in at_centres]
            for travel, one in zip(travels, left, strict=True):
                total += zonal(lobe.seen, (to_camera * travel).sum(axis=-1))[..., None] * one
        table = beyond(medium_of(self._scene).phase, lobe, last + 1).astype(np.float64)
        for travel, light in zip(travels, at_centres, strict=True):
            total += _beyond(table, light, albedo, (to_camera * travel).sum(axis=-1))
        return np.maximum(total, 0)

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

    def _extinction_at(self, points: Floats) -> Floats:
        """RGB at samples ``[..., 3]``; of bodies of constant density the mean along its part of x."""
        scene = self._scene
        medium, part = medium_of(scene), self.lattice.spacing / self.lattice.samples
        total = np.zeros(points.shape)
        for grid in scene.grids:
            total += medium.sigma_t * channel_densities(grid, points)
        starts = points.reshape(-1, 3) - (part / 2, 0, 0)
        along_x = np.broadcast_to((1.0, 0.0, 0.0), starts.shape)
        for body in scene.homogeneous:
            begin, end = body_interval(body, starts, along_x, part)
            share = ((end - begin) / part).reshape(*points.shape[:-1], 1)
            total += medium.sigma_t * body.density * share
        return total

    def _extinction(self) -> Floats:
        """Mean RGB of the cubes around the points, ``[x, y, z, 3]``."""
        samples = [self._extinction_at(points) for points in self._samples()]
        mean: Floats = np.mean(samples, axis=0)
        return mean

    def _brought(self, arrives: Arrives) -> Floats:
        """RGB that arrives from a light, ``[x, y, z, 3]``."""
        total, weight = np.zeros((2, *self.lattice.size, 3))
        for points in self._samples():
            here = self._extinction_at(points) + LEAST_WEIGHT / self.lattice.spacing
            weight += here
            one = arrives(points.reshape(-1, 3))
            total += here * (one.radiance * one.transmittance).reshape(points.shape)
        brought: Floats = total / weight
        return brought


def _depth(arrival: Brought) -> Floats:
    return -np.log(np.maximum(arrival.transmittance, DARK))


def _straight_on(arrival: Brought, share: Floats, times: int, shape: tuple[int, ...]) -> Floats:
    """RGB of a light that was scattered straight on so many times, ``[x, y, z, 3]``."""
    chance = (share * _depth(arrival)) ** times / math.factorial(times)
    return (arrival.radiance * arrival.transmittance * chance).reshape(shape)


def _beyond(table: Floats, arrival: Brought, albedo: Floats, mu: Floats) -> Floats:
    """RGB of a light that a lobe scatters beyond its degree, ``[x, y, z, 3]``; linear in the table."""
    depth = _depth(arrival).reshape(*mu.shape, 3)
    met = albedo * depth
    row = met / (met + BEYOND_HALF) * (BEYOND_DEPTHS - 1)
    column = np.sqrt(np.sqrt(np.clip((1 - mu) / 2, 0, 1)))[..., None] * (BEYOND_ANGLES - 1)
    total = np.zeros_like(met)
    i, j = np.minimum(row, BEYOND_DEPTHS - 2).astype(int), np.minimum(column, BEYOND_ANGLES - 2).astype(int)
    for below, right in product((0, 1), repeat=2):
        weight = np.abs(1 - below - (row - i)) * np.abs(1 - right - (column - j))
        total += weight * table[i + below, j + right]
    return total * np.exp(met - depth) * arrival.radiance.reshape(depth.shape)


def _albedo(medium: Medium) -> Floats:
    return np.divide(medium.sigma_s, medium.sigma_t, out=np.zeros(3), where=medium.sigma_t > 0)


def scattered_again(
    light: Floats, extinction: Floats, albedo: Floats, lattice: Lattice, count: int
) -> Floats:
    """Sum of what arrives at points ``[x, y, z, RGB]`` after each scattering but the last.

    Parameters
    ----------
    light
        That arrives unscattered: mean over all directions.
    extinction
        Per world unit.
    count
        Orders.
    """
    total = np.zeros_like(light)
    for order in range(1, count):
        directions = orders.directions(orders.DIRECTIONS, order)
        arriving = [
            swept(albedo * light, extinction, direction, lattice.spacing)[0] for direction in directions
        ]
        light = np.mean(arriving, axis=0)
        total += light
    return total


def swept(
    source: Floats,
    extinction: Floats,
    direction: Floats,
    spacing: float,
    *,
    straight: Floats | float = 0.0,
    before: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Radiance ``[x, y, z, RGB]`` that goes in a direction, of a source over extinction; plane by plane.

    Between the rays, which pass through each plane in the same distances as its points, it is linear, as are
    extinction and source between the points. The second result is of the rays: of ``before``, that of the
    last order, a part is ``straight`` on added to the source.
    """
    axis = int(np.abs(direction).argmax())
    along = abs(direction[axis])
    slope = np.delete(direction, axis) / along
    way = slice(None, None, -1 if direction[axis] < 0 else 1)

    def planes(values: Floats) -> Floats:
        """With a border of 0 across, as wide as rays are shifted in all."""
        ordered = np.moveaxis(values, axis, 0)[way]
        return np.pad(ordered, [(0, 0), (reach, reach), (reach, reach), (0, 0)])

    reach = source.shape[axis] + 1
    sources, extinctions = planes(source), planes(extinction)
    found = np.zeros_like(sources)
    rays = np.zeros_like(sources)
    radiance = last = dense = np.zeros_like(sources[0])
    for m in range(len(sources)):
        shift = slope * m
        here, thick = _shifted(sources[m], -shift), _shifted(extinctions[m], -shift)
        if before is not None:
            here = here + straight * before[m]
        depth = spacing / along * (dense + thick) / 2
        through = np.exp(-depth)
        mean = np.divide(-np.expm1(-depth), depth, out=np.ones_like(depth), where=depth > 0)
        radiance = radiance * through + last * (mean - through) + here * (1 - mean)
        last, dense, rays[m] = here, thick, radiance
        found[m] = _shifted(radiance, shift)
    inside = found[way, reach:-reach, reach:-reach]
    return np.moveaxis(inside, 0, axis), rays


def _shifted(plane: Floats, shift: Floats) -> Floats:
    """Values ``[a, b, RGB]``, moved by parts of a distance, linear between; 0 comes in from outside."""
    for axis, distance in enumerate(shift):
        whole = int(np.floor(distance))
        part = distance - whole
        plane = (1 - part) * np.roll(plane, whole, axis) + part * np.roll(plane, whole + 1, axis)
    return plane
