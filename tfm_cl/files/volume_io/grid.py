"""The interface of volume formats: a description of each grid, and a way to read its voxels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError

if TYPE_CHECKING:
    from tfm_cl.files.volume_io.leaves import Leaves

LONGEST_SHOWN = 40
"""Largest number of characters of a name in a message."""
MOST_SHOWN = 12
"""Largest number of names in a message."""

DEFAULT_NAME = "density"
"""Name of the grid that is rendered if none is named."""
COLOUR = "colour"
"""Name of the grid or array that is used as the colour if none is named."""

GridClass = Literal["fog volume", "level set", "staggered", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """One grid of a file, described without reading its voxels.

    Reading a header must be cheap and safe: sizes are checked against the file before anything is
    allocated, and `read` is called only after the caller has accepted ``shape``.
    """

    name: str
    """Name as stored, or with an index if several grids share it (``density[1]``); may be empty."""
    shared_name: str | None = None
    """Name as stored, if the grid shares it with others, which are distinguished by an index."""
    is_part: bool = False
    """Whether it is one of several volumes along a non-spatial axis: rendered if named, not by default."""
    grid_class: GridClass
    """Class of the grid; ``unknown`` is treated as a fog volume."""
    value_type: str
    """Type of the values in the file, named as in NumPy (``float16``, ``uint8`` …) or as in the format."""
    shape: tuple[int, int, int]
    """Shape (z, y, x) of the array that `read` returns: the dense box around all stored voxels."""
    world_from_index: NDArray[np.float64]
    """4×4, column vectors: world position of the *centre* of voxel (x, y, z) of that array."""
    has_transform: bool
    """False if the format does not state position and size: voxels have edge 1, with the low corner at 0."""
    read: Callable[[], NDArray[np.float32]] = field(repr=False)
    """Reads the voxels as a new array, float32 [z, y, x], C order; raises `VolumeError` on damage."""
    read_leaves: Callable[[], Leaves] | None = field(default=None, repr=False)
    """Reads the same voxels without an intermediate dense array; None if the format does not store a tree."""
    leaf_count: int = 0
    """Number of leaves that `read_leaves` allocates: stored ones, and those that tiles expand to."""
    background: float = 0.0
    """Value outside the array, as stored in the file; the rendered volume has 0 there."""
    read_colour: Callable[[], NDArray[np.float32]] | None = field(default=None, repr=False)
    """Reads a grid with three values per voxel as a new array [z, y, x, 3]; None if it has one value.

    ``read`` then returns 1 where any of the three is not 0, unless the grid is unsupported as a density.
    """
    colour_background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Value outside the array of `read_colour`, as stored in the file."""
    read_vector_leaves: Callable[[], tuple[Leaves, ...]] | None = field(default=None, repr=False)
    """Reads the three components of a grid of vectors as leaves, 0 where nothing is stored; None if the
    format does not store a tree."""
    is_box_of_stored: bool = False
    """Whether the array is the box around the voxels of a tree; grids that belong together may then have
    different boxes."""
    active_voxels: int | None = None
    """Number of active voxels, if the format stores it (.vdb, .nvdb)."""
    unsupported: str = ""
    """If not empty, the reason why the grid cannot be read ("a frustum transform" …), and what to do."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how the grid was chosen or is read: sentences for a warning."""


def shown(name: str) -> str:
    """Quote a name from a file for a message: printable, and not too long."""
    return repr(name if len(name) <= LONGEST_SHOWN else name[:LONGEST_SHOWN] + "…")


def shown_names(names: Sequence[str]) -> str:
    """Quote names for a message, at most `MOST_SHOWN` of them."""
    listed = ", ".join(shown(name) for name in names[:MOST_SHOWN])
    return listed if len(names) <= MOST_SHOWN else f"{listed} and {len(names) - MOST_SHOWN:,} more"


def coloured_where(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the density [z, y, x] of a colour grid: 1 where it is not black, else 0."""
    density: NDArray[np.float32] = (rgb != 0).any(axis=-1).astype(np.float32)
    return density


def as_colour(grid: Grid, read_colour: Callable[[], NDArray[np.float32]]) -> Grid:
    """Describe the colour that three channels like ``grid`` form."""
    return replace(
        grid,
        value_type=f"3 × {grid.value_type}",
        read=lambda: coloured_where(read_colour()),
        read_colour=read_colour,
    )


def refuse(path: Path, name: str, reason: str) -> NDArray[np.float32]:
    """Raise the error; this is the `Grid.read` of a grid that cannot be read."""
    raise VolumeError(f"{path}: grid {shown(name)} cannot be read: {reason}")


def with_distinct_names(grids: list[Grid]) -> list[Grid]:
    """Give grids that share a name the indices that OpenVDB shows: ``density[0]``, ``density[1]``."""
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
    """File extensions in lower case, with the dot."""

    def open_grids(self, path: Path) -> list[Grid]:
        """List the grids of a file; raises `VolumeError` if it is damaged or of another kind."""
        ...


def world_from_index_of(
    voxel_size: tuple[float, float, float], origin: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Return the world-from-index matrix of an axis-aligned grid.

    Parameters
    ----------
    voxel_size
        Edge lengths (x, y, z), world units.
    origin
        World position of the low *corner* of voxel (0, 0, 0); its centre is half a voxel further in.
    """
    matrix = np.diag([*voxel_size, 1.0]).astype(np.float64)
    matrix[:3, 3] = np.asarray(origin) + 0.5 * np.asarray(voxel_size)
    return matrix
