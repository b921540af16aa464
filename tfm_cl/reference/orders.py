"""The later orders of scattering, on the product's own lattice: `tfm_cl.render.orders`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.plan import orders
from tfm_cl.plan.orders import Lattice, lattice_of, medium_of, orders_of
from tfm_cl.reference.bodies import body_interval, channel_densities
from tfm_cl.reference.geometry import Floats

if TYPE_CHECKING:
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

Arrives = Callable[["Scene", Floats], Floats]
"""RGB of a light, after bodies and solids, at points ``[n, 3]`` of a scene whose medium may be another."""
LEAST_WEIGHT = 1e-6
"""As an optical depth of the distance between points, of what has no density."""


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
        self._scene, self.lattice, own = scene, lattice_of(scene), medium_of(scene)
        self.parts: list[tuple[Scene, Floats]] = []
        """Scenes of a medium each, and what ``[x, y, z, RGB]`` of the light is scattered there."""
        even = _of_medium(scene, own.reduced)
        light = self._brought(even, lights)
        found = scattered_again(
            light, self._extinction(even), _albedo(own.reduced), self.lattice, orders_of(scene)
        )
        if own.phase.mean_cosine == 0:
            self.parts = [(even, _albedo(own.reduced) * found)]
            return
        shown = (1 - own.phase.mean_cosine) * self._brought(_of_medium(scene, own), lights)
        self.parts = [
            (even, _albedo(own.reduced) * (found + light)),
            (_of_medium(scene, own), -_albedo(own) * shown),
        ]

    def _samples(self) -> Iterator[Floats]:
        """Yield points ``[x, y, z, 3]`` in the cubes around those of the lattice."""
        count, spacing = self.lattice.samples, self.lattice.spacing
        places = [
            low + spacing * np.arange(n)
            for low, n in zip(self.lattice.origin, self.lattice.size, strict=True)
        ]
        centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
        offsets = spacing * ((np.arange(count) + 0.5) / count - 0.5)
        for offset in product(offsets, repeat=3):
            yield centres + offset

    def _extinction_at(self, scene: Scene, points: Floats) -> Floats:
        """RGB at samples ``[..., 3]``; of bodies of constant density the mean along its part of x."""
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

    def _extinction(self, scene: Scene) -> Floats:
        """Mean RGB of the cubes around the points, ``[x, y, z, 3]``."""
        samples = [self._extinction_at(scene, points) for points in self._samples()]
        mean: Floats = np.mean(samples, axis=0)
        return mean

    def _brought(self, scene: Scene, lights: Sequence[Arrives]) -> Floats:
        """Mean RGB over all directions of what arrives from the lights, ``[x, y, z, 3]``."""
        total, weight = np.zeros((2, *self.lattice.size, 3))
        for points in self._samples():
            here = self._extinction_at(scene, points) + LEAST_WEIGHT / self.lattice.spacing
            weight += here
            for arrives in lights:
                total += here * arrives(scene, points.reshape(-1, 3)).reshape(points.shape)
        brought: Floats = total / weight / (4 * np.pi)
        return brought


def _of_medium(scene: Scene, medium: Medium) -> Scene:
    return scene.replace(medium=medium, volume=[body.with_medium(None) for body in scene.bodies])


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
        arriving = [swept(albedo * light, extinction, direction, lattice.spacing) for direction in directions]
        light = np.mean(arriving, axis=0)
        total += light
    return total


def swept(source: Floats, extinction: Floats, direction: Floats, spacing: float) -> Floats:
    """Radiance ``[x, y, z, RGB]`` that goes in a direction, of a source over extinction; plane by plane.

    Between the rays, which pass through each plane in the same distances as its points, it is linear, as are
    extinction and source between the points.
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
    radiance = before = dense = np.zeros_like(sources[0])
    for m in range(len(sources)):
        shift = slope * m
        here, thick = _shifted(sources[m], -shift), _shifted(extinctions[m], -shift)
        depth = spacing / along * (dense + thick) / 2
        through = np.exp(-depth)
        mean = np.divide(-np.expm1(-depth), depth, out=np.ones_like(depth), where=depth > 0)
        radiance = radiance * through + before * (mean - through) + here * (1 - mean)
        before, dense = here, thick
        found[m] = _shifted(radiance, shift)
    inside = found[way, reach:-reach, reach:-reach]
    return np.moveaxis(inside, 0, axis)


def _shifted(plane: Floats, shift: Floats) -> Floats:
    """Values ``[a, b, RGB]``, moved by parts of a distance, linear between; 0 comes in from outside."""
    for axis, distance in enumerate(shift):
        whole = int(np.floor(distance))
        part = distance - whole
        plane = (1 - part) * np.roll(plane, whole, axis) + part * np.roll(plane, whole + 1, axis)
    return plane


def between(values: Floats, lattice: Lattice, points: Floats) -> Floats:
    """Interpolate ``[x, y, z, RGB]`` at world points ``[n, 3]``."""
    at = np.clip((points - lattice.origin) / lattice.spacing, 0, np.subtract(lattice.size, 1))
    low = np.minimum(at.astype(np.intp), np.subtract(lattice.size, 2))
    part = at - low
    total = np.zeros(points.shape)
    for corner in product((0, 1), repeat=3):
        weight = np.where(corner, part, 1 - part).prod(axis=-1)
        total += weight[:, None] * values[tuple((low + corner).T)]
    return total
