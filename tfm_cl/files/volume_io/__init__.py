"""Volume files: one module per format, selected by the file's extension.

To add a format, write a module with ``EXTENSIONS`` and ``open_grids(path)`` (see
`tfm_cl.files.volume_io.grid.VolumeFormat`) and add it to ``FORMATS``.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import read_by_extension
from tfm_cl.files.volume_io.grid import COLOUR, DEFAULT_NAME, Grid, shown, shown_names
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.files.volume_io.limits import too_large, too_many_leaves
from tfm_cl.plugins import register_format, register_installed

FORMATS: dict[str, str] = {
    ".vdb": ".vdb",
    ".nvdb": ".nvdb",
    ".npy": ".numpy_array",
    ".npz": ".numpy_array",
    ".vol": ".mitsuba_vol",
    ".nrrd": ".nrrd_file",
    ".nhdr": ".nrrd_file",
    ".raw": ".raw",
}
"""Modules by file extension, those of this package as ``.NAME``; imported when a file of that kind is met."""

__all__ = [
    "COLOUR",
    "DEFAULT_NAME",
    "FORMATS",
    "beyond_limits",
    "choose_grid",
    "find_grid",
    "is_volume_file",
    "open_grids",
    "read_grid",
    "read_stored",
    "read_vectors",
    "refusal",
    "register_volume_format",
]


def is_volume_file(source: str | Path) -> bool:
    """Tell whether the source of a colour or a velocity is a file, not the name of an array or a grid."""
    return Path(source).suffix.lower() in FORMATS


def open_grids(path: Path) -> list[Grid]:
    """Describe the grids of a volume file without reading their voxels.

    Raises
    ------
    VolumeError
        The file is missing, damaged or of unknown type.
    """
    grids: list[Grid] = read_by_extension(path, __name__, FORMATS, "volume format", "open_grids")
    if not grids:
        raise VolumeError(f"{path}: holds no grid")
    return grids


def choose_grid(path: Path, name: str | None = None) -> Grid:
    """Find the grid to render: the one named, else ``density``, else the file's only fog volume.

    If several grids share a name, it selects the first of them, as in OpenVDB, and a note of the grid says
    so; ``name[1]`` selects the second. Grids with one value per voxel are preferred to those with three
    (colours).

    Raises
    ------
    VolumeError
        There is no such grid, none can be chosen (the message lists the names), or the grid is a level set or
        of a type that cannot be a density.
    """
    grids = open_grids(path)
    grid = _default_grid(path, grids) if name is None else find_grid(path, grids, name)
    reason = refusal(grid)
    if reason:
        raise VolumeError(f"{path}: grid {shown(grid.name)} {reason}")
    return grid


def find_grid(path: Path, grids: list[Grid], name: str) -> Grid:
    """Find a grid by its name among those of ``path``.

    Raises
    ------
    VolumeError
        There is no such grid; the message lists the names.
    """
    for grid in grids:
        if grid.name == name:
            return grid
    sharing = [grid for grid in grids if grid.shared_name == name]
    if not sharing:
        raise VolumeError(
            f"{path}: no grid named {shown(name)}; it has {shown_names([grid.name for grid in grids])}"
        )
    return _first_of(path, sharing, sharing)


def _default_grid(path: Path, grids: list[Grid]) -> Grid:
    whole = [grid for grid in grids if not grid.is_part]
    named = [grid for grid in whole if DEFAULT_NAME in (grid.name, grid.shared_name)]
    found = named or whole
    if len(found) > 1:
        found = [grid for grid in found if refusal(grid) == ""]
        found = [grid for grid in found if grid.read_colour is None] or found
    if found and named:
        return _first_of(path, found, named)
    if len(found) != 1:
        names = shown_names([grid.name for grid in grids])
        raise VolumeError(f"{path}: several grids ({names}); choose one with --grid NAME")
    return found[0]


def _first_of(path: Path, found: list[Grid], sharing: list[Grid]) -> Grid:
    first = found[0]
    if len(sharing) == 1:
        return first
    others = shown_names([grid.name for grid in sharing if grid is not first])
    note = (
        f"{path}: {len(sharing)} grids are named {shown(str(first.shared_name))}; this is "
        f"{shown(first.name)}, choose {others} with --grid"
    )
    return replace(first, notes=(*first.notes, note))


def read_grid(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Read the voxels of a grid of ``path`` as float32 [z, y, x], within `MAX_VOXELS`."""
    try:
        return grid.read()
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def read_stored(path: Path, grid: Grid) -> NDArray[np.float32] | Leaves:
    """Read the voxels of a grid of ``path`` in the form in which they are stored: leaves or dense."""
    if grid.read_leaves is None:
        return read_grid(path, grid)
    try:
        return grid.read_leaves()
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def read_vectors(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Read a grid with three values per voxel as float32 [z, y, x, 3]."""
    if grid.read_colour is None:
        raise VolumeError(f"{path}: grid {shown(grid.name)} has one value per voxel, not three")
    try:
        return grid.read_colour()
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def beyond_limits(grid: Grid) -> str:
    """Reason why a grid is too large for `read_stored`; empty if it is not."""
    if grid.read_colour is not None:
        z, y, x = grid.shape
        return too_large((z, y, 3 * x), sparse=False)
    return too_large(grid.shape, sparse=grid.read_leaves is not None) or too_many_leaves(grid.leaf_count)


def refusal(grid: Grid) -> str:
    """Reason why a grid cannot be rendered as a density; empty if it can."""
    if grid.unsupported:
        return f"cannot be rendered: {grid.unsupported}"
    if grid.grid_class == "level set":
        return (
            "is a level set (signed distances), not a fog volume: its values are not densities; "
            "convert it first, for instance with OpenVDB's sdfToFogVolume"
        )
    if min(grid.shape) < 1:
        return "is empty: it stores no voxel"
    return beyond_limits(grid)


def register_volume_format(extension: str, module: str) -> None:
    """Add a format of volumes.

    Parameters
    ----------
    extension
        Of its files, as ``.abc``.
    module
        Name of the module that knows it, in a plugin's file ``__name__``; it has what
        `tfm_cl.files.volume_io.grid.VolumeFormat` says, and is imported when such a file is met.

    Raises
    ------
    InputError
        The extension is none, or known already.
    """
    register_format("volumes", extension, module, FORMATS)


register_installed(
    "volume_formats",
    lambda name, module: register_volume_format(f".{name.removeprefix('.')}", module.__name__),
)
