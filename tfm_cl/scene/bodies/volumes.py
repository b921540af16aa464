"""Several volumes as one: their densities add up, each in its own grid with its own transform."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError

if TYPE_CHECKING:
    from tfm_cl.scene.bodies.volume import Volume

MOST_VOLUMES = 16
"""In one scene: each adds to what kernels are told."""


class Volumes:
    """What a scene has in the place of its volume when it has several.

    Parameters
    ----------
    parts
        2 to `MOST_VOLUMES` volumes, without colour. They may overlap, and lie anywhere.

    Raises
    ------
    VolumeError
        Too many volumes, or one with a colour of its own.
    """

    colour = None

    def __init__(self, parts: Sequence[Volume]) -> None:
        self.parts = tuple(parts)
        if not 1 <= len(self.parts) <= MOST_VOLUMES:
            raise VolumeError(f"a scene has 1 to {MOST_VOLUMES} volumes; got {len(self.parts)}")
        for volume in self.parts:
            if volume.colour is not None:
                raise VolumeError(
                    f"{volume.label}: has a colour of its own; among several volumes none may: colour = false"
                )

    @property
    def voxel_size(self) -> NDArray[np.float64]:
        """Edges of the smallest voxel along x, y, z of its grid, world units."""
        return min((volume.voxel_size for volume in self.parts), key=lambda size: float(size.min()))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """World box around all, [2, 3]: low and high corner."""
        return _around([volume.bounds for volume in self.parts])

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World box around all voxels with density, [2, 3]."""
        return _around([volume.occupied_bounds for volume in self.parts])

    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere, looking at what it was made from only."""
        return (
            isinstance(other, Volumes)
            and len(self.parts) == len(other.parts)
            and all(one.same_density(two) for one, two in zip(self.parts, other.parts, strict=True))
        )


def joined(volumes: Sequence[Volume]) -> Volume | Volumes:
    """Return one volume as it is, several as one."""
    return volumes[0] if len(volumes) == 1 else Volumes(volumes)


def _around(boxes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    corners = np.stack(boxes)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
