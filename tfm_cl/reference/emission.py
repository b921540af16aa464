"""What media emit, as light on their surroundings, on the product's own lattice: `tfm_cl.render.emission`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.constants import OCTAVE_DEPTH_AT_POINTS
from tfm_cl.reference.geometry import between
from tfm_cl.reference.octaves import later_octaves

if TYPE_CHECKING:
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.reference.bodies import Matter
    from tfm_cl.reference.geometry import Floats
    from tfm_cl.reference.light import Brought
    from tfm_cl.reference.march import Step
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene


class EmittedLight:
    """What some lights bring to the points of a lattice, scattered towards the camera by each medium.

    Parameters
    ----------
    scene
        With numbers.
    lights
        What each of its single, fitted lights brings to points.
    """

    def __init__(self, scene: Scene, lattice: Lattice, lights: Sequence[Callable[[Floats], Brought]]) -> None:
        self._lattice = lattice
        places = [
            low + lattice.spacing * np.arange(n) for low, n in zip(lattice.origin, lattice.size, strict=True)
        ]
        points = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
        to_camera = np.asarray(scene.camera.from_) - points
        to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
        media = dict.fromkeys(scene.medium_of(body) for body in scene.bodies)
        self._of_media: dict[Medium, Floats] = {medium: np.zeros_like(points) for medium in media}
        for light in lights:
            brought = light(points)
            mu = (brought.direction * to_camera).sum(axis=1)
            for medium in media:
                scattered = np.asarray(medium.phase.evaluate(mu))[:, None] * brought.transmittance
                if medium.octaves > 1:
                    scattered = scattered + later_octaves(
                        medium, mu[:, None], brought.transmittance, OCTAVE_DEPTH_AT_POINTS
                    )
                self._of_media[medium] += scattered * brought.radiance
        self._of_media = {medium: total.reshape(*lattice.size, 3) for medium, total in self._of_media.items()}

    def source(self, matter: Matter, step: Step, points: Floats) -> Floats:
        """RGB ``[n, 3]`` that a step at points scatters to the camera, over its opacity."""
        scattered = np.zeros((len(points), 3))
        for medium, sigma_s, amount in zip(matter.media, matter.sigma_s, step.amounts, strict=True):
            if sigma_s.any():
                scattered += sigma_s * amount * between(self._of_media[medium], self._lattice, points)
        return np.divide(scattered, step.depth, out=np.zeros_like(scattered), where=step.depth > 0)
