"""What a volume format hands over: a description of each grid, and a way to read its voxels."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import Leaves

LONGEST_SHOWN = 40
"""Characters of a name in a message."""
MOST_SHOWN = 12
"""Names in a message."""

DEFAULT_NAME = "density"
"""Grid that is rendered when none is named."""
COLOUR = "colour"
"""Grid or array that is a colour, where none is named."""

GridClass = Literal["fog volume", "level set", "staggered", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """One grid of a file, described without reading its voxels.

    Reading a header must be cheap and safe: sizes are checked against the file before anything is
    allocated, and `read` is called only after the caller has accepted ``shape``.
    """

    name: str
    """As stored, or with a number where grids share it (``density[1]``); may be empty."""
    shared_name: str | None = None
    """The name as stored, of a grid that shares it with others; they are told apart by numbers."""
    is_part: bool = False
    """It is one of several along an axis that is not space: rendered when it is named, not by default."""
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
    """Value outside the array, as stored; a volume has 0 there."""
    read_colour: Callable[[], NDArray[np.float32]] | None = field(default=None, repr=False)
    """Reads a grid of three values a voxel, as a new array [z, y, x, 3]; None where it has one value.

    ``read`` then gives 1 where one of the three is not 0, unless the grid is unsupported as a density.
    """
    colour_background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Value outside the array of `read_colour`, as stored."""
    is_box_of_stored: bool = False
    """The array is the box around what a tree stores: grids that belong together may have other boxes."""
    active_voxels: int | None = None
    """Number of active voxels where the format knows (.vdb, .nvdb)."""
    unsupported: str = ""
    """Not empty: why `read` cannot serve this grid ("a frustum transform" …), and what to do instead."""
    notes: tuple[str, ...] = ()
    """What a user should know of how the grid was chosen or is read: sentences for a warning."""


def shown(name: str) -> str:
    """Quote a name of a file for a message: printable, and not longer than a message bears."""
    return repr(name if len(name) <= LONGEST_SHOWN else name[:LONGEST_SHOWN] + "…")


def shown_names(names: Sequence[str]) -> str:
    """Quote names for a message, as many as it bears."""
    listed = ", ".join(shown(name) for name in names[:MOST_SHOWN])
    return listed if len(names) <= MOST_SHOWN else f"{listed} and {len(names) - MOST_SHOWN:,} more"


def coloured_where(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the density [z, y, x] of a grid that is a colour: 1 where it is not black, else 0."""
    density: NDArray[np.float32] = (rgb != 0).any(axis=-1).astype(np.float32)
    return density


def as_colour(grid: Grid, read_colour: Callable[[], NDArray[np.float32]]) -> Grid:
    """Describe the colour that three channels like ``grid`` make."""
    return replace(
        grid,
        value_type=f"3 × {grid.value_type}",
        read=lambda: coloured_where(read_colour()),
        read_colour=read_colour,
    )


def refuse(path: Path, name: str, reason: str) -> NDArray[np.float32]:
    """Serve as `Grid.read` of a grid that cannot be read."""
    raise VolumeError(f"{path}: grid {shown(name)} cannot be read: {reason}")


def with_distinct_names(grids: list[Grid]) -> list[Grid]:
    """Give grids that share a name the numbers OpenVDB shows: ``density[0]``, ``density[1]``."""
    counts, seen = Counter(grid.name for grid in grids), Counter[str]()
    distinct = []
    for grid in grids:
        number, seen[grid.name] = seen[grid.name], seen[grid.name] + 1
        is_shared = counts[grid.name] > 1
        distinct.append(
            replace(grid, name=f"{grid.name}[{number}]", shared_name=grid.name) if is_shared else grid
        )
    return distinct


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
