"""What a file says of how fast the contents of a grid move."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from tfm_cl.files.volume_io.leaves import Leaves

if TYPE_CHECKING:
    from numpy.typing import NDArray

VelocitySource = str | Path | Sequence[str] | Literal[False] | None
"""The source of a velocity, as for `tfm_cl.scene.bodies.volume.Volume.with_velocity`."""


class Component(NamedTuple):
    """How fast something moves along one axis of the world."""

    leaves: Leaves
    """World units per second."""
    world_from_index: NDArray[np.float64] | None
    """4×4, column vectors: position of the centre of voxel (x, y, z); None: the density's."""


class StoredVelocity(NamedTuple):
    """A velocity that was read."""

    label: str
    """File and grid, for messages."""
    components: tuple[Component, ...]
    """Along x, y and z."""


def components_of(vectors: NDArray[np.float32]) -> tuple[Component, ...]:
    """Return the components of vectors [z, y, x, 3] at the density's voxels."""
    return tuple(Component(Leaves.from_dense(vectors[..., axis]), None) for axis in range(3))
