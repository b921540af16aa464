"""What primitives hold in the cubes around the points of the lattice of later orders (`tfm_cl.plan.orders`).

There they are a density. Light from all sides meets of each what it covers, as far as it is opaque.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tfm_cl.plan.orders import Lattice
    from tfm_cl.scene.scene import Scene

RGB = 3


def deposited(scene: Scene, lattice: Lattice, is_grey: bool) -> NDArray[np.float64]:  # noqa: FBT001
    """Return densities ``[media, 1 or RGB, z, y, x]`` of a scene's media at the points.

    What lies between points is shared by the eight around it, so that all of it is there.

    Parameters
    ----------
    is_grey
        Whether one number stands for red, green and blue.
    """
    x, y, z = lattice.size
    media = list(scene.media)
    found = np.zeros((len(media), 1 if is_grey else RGB, z * y * x))
    for body in scene.primitives:
        medium = scene.medium_of(body)
        of_medium = found[media.index(medium)]
        held = body.held(float(np.mean(medium.sigma_t)))
        colour = np.ones((1, RGB)) if body.colour is None else body.colour
        for places, shares, numbers in body.spread(lattice.spacing):
            masses = held[numbers] * shares
            at = np.clip((places - lattice.origin) / lattice.spacing, 0, np.subtract(lattice.size, 1))
            low = np.minimum(at.astype(np.intp), np.subtract(lattice.size, 2))
            part = at - low
            for corner in product((0, 1), repeat=3):
                weights = masses * np.abs(1 - np.array(corner) - part).prod(axis=1)
                column, row, layer = (low + corner).T
                index = (layer * y + row) * x + column
                for channel in range(len(of_medium)):
                    shades = 1.0 if body.colour is None else colour[numbers, channel]
                    of_medium[channel] += np.bincount(index, weights * shades, minlength=x * y * z)
    return (found / lattice.spacing**3).reshape(*found.shape[:2], z, y, x)
