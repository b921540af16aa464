"""What a volume format hands over: a description of each grid, and a way to read its voxels."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.leaves import Leaves

GridClass = Literal["fog volume", "level set", "staggered", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """One scalar grid of a file, described without reading its voxels.

    Reading a header must be cheap and safe: sizes are checked against the file before anything is
    allocated, and `read` is called only after the caller has accepted ``shape``.
    """

    name: str
    """As stored; may be empty."""
    grid_class: GridClass
    """``unknown`` is treated as a fog volume."""
    value_type: str
    """Type in the file, as NumPy names it (``float16``, ``uint8`` …) or as the format does."""
    shape: tuple[int, int, int]
    """(z, y, x) of the array that `read` returns: the dense box around all that is stored."""
    world_from_index: NDArray[np.float64]
    """4×4, column vectors: world position of the *centre* of voxel (x, y, z) of that array."""
    has_transform: bool
    """False where the format says nothing of position and size: a voxel of edge 1, low corner at 0."""
    read: Callable[[], NDArray[np.float32]] = field(repr=False)
    """Reads the voxels as a new array, float32 [z, y, x], C order; raises `VolumeError` on damage."""
    read_leaves: Callable[[], Leaves] | None = field(default=None, repr=False)
    """Reads the same voxels without a dense array in between; None where the format stores no tree."""
    leaf_count: int = 0
    """Leaves that `read_leaves` makes room for: those stored, and those that tiles expand to."""
    background: float = 0.0
    """Value outside the array."""
    active_voxels: int | None = None
    """Number of active voxels where the format knows (.vdb, .nvdb)."""
    unsupported: str = ""
    """Not empty: why `read` cannot serve this grid ("vec3s values", "frustum transform" …)."""


class VolumeFormat(Protocol):
    """A module of this package that reads one family of files; registered in ``volume_io/__init__.py``."""

    EXTENSIONS: tuple[str, ...]
    """Lower case, with the dot."""

    def open_grids(self, path: Path) -> list[Grid]:
        """List the grids of a file; raises `VolumeError` when it is damaged or of another kind."""
        ...


def world_from_index_of(
    voxel_size: tuple[float, float, float], origin: tuple[float, float, float]
) -> NDArray[np.float64]:
    """World-from-index of an axis-aligned grid.

    Parameters
    ----------
    voxel_size
        Edge lengths (x, y, z), world units.
    origin
        World position of the low *corner* of voxel (0, 0, 0); its centre is half a voxel further.
    """
    matrix = np.diag([*voxel_size, 1.0]).astype(np.float64)
    matrix[:3, 3] = np.asarray(origin) + 0.5 * np.asarray(voxel_size)
    return matrix
