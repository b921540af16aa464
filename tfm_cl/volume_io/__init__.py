"""Volume files: one module a format, found by the file's extension.

To add a format, write a module with ``EXTENSIONS`` and ``open_grids(path)`` (see
`tfm_cl.volume_io.grid.VolumeFormat`) and name it in ``FORMATS``.
"""

import importlib
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files import check_readable
from tfm_cl.leaves import MAX_LEAVES, Leaves
from tfm_cl.volume_io.grid import Grid, VolumeFormat

FORMATS: dict[str, str] = {
    ".vdb": "vdb",
    ".nvdb": "nvdb",
    ".npy": "numpy_array",
    ".npz": "numpy_array",
    ".vol": "mitsuba_vol",
    ".nrrd": "nrrd_file",
    ".nhdr": "nrrd_file",
    ".raw": "raw",
}
"""Extension -> module of this package; imported when a file of that kind is opened."""

MAX_VOXELS = 1 << 31
"""Largest dense grid read into memory (8 GiB of float32)."""
MAX_BOX_VOXELS, MAX_BOX_EDGE = 1 << 34, 1 << 24
"""Largest box around a grid read as leaves, in all and along an axis: what the device's table holds."""

__all__ = [
    "FORMATS",
    "MAX_BOX_EDGE",
    "MAX_BOX_VOXELS",
    "MAX_VOXELS",
    "beyond_limits",
    "choose_grid",
    "open_grids",
    "read_grid",
    "read_stored",
    "refusal",
    "too_large",
    "too_many_leaves",
]


def open_grids(path: Path) -> list[Grid]:
    """Describe the grids of a volume file without reading their voxels.

    Raises
    ------
    VolumeError
        Missing, damaged or unknown file.
    """
    module_name = FORMATS.get(path.suffix.lower())
    if module_name is None:
        raise VolumeError(
            f"{path}: not a known volume format '{path.suffix}'; known: {' '.join(sorted(FORMATS))}"
        )
    check_readable(path, VolumeError)
    module: VolumeFormat = importlib.import_module(f"{__name__}.{module_name}")
    try:
        grids = module.open_grids(path)
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not grids:
        raise VolumeError(f"{path}: holds no grid")
    return grids


def choose_grid(path: Path, name: str | None = None) -> Grid:
    """Find the grid to render: the one named, else ``density``, else the file's only fog volume.

    Raises
    ------
    VolumeError
        No such grid, or none can be chosen (the message lists the names), or it is a level set or of
        a type that cannot be a density.
    """
    grids = open_grids(path)
    names = ", ".join(repr(grid.name) for grid in grids)
    if name is not None:
        found = [grid for grid in grids if grid.name == name]
        if not found:
            raise VolumeError(f"{path}: no grid named '{name}'; it has {names}")
    else:
        found = [grid for grid in grids if grid.name == "density"] or grids
        if len(found) > 1:
            found = [grid for grid in grids if refusal(grid) == ""]
        if len(found) != 1:
            raise VolumeError(f"{path}: several grids ({names}); choose one with --grid NAME")
    reason = refusal(found[0])
    if reason:
        raise VolumeError(f"{path}: grid '{found[0].name}' {reason}")
    return found[0]


def read_grid(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Read the voxels of a grid of ``path`` as float32 [z, y, x], within `MAX_VOXELS`."""
    try:
        return grid.read()
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def read_stored(path: Path, grid: Grid) -> NDArray[np.float32] | Leaves:
    """Read the voxels of a grid of ``path`` in the form its format stores: leaves of a tree, or all."""
    if grid.read_leaves is None:
        return read_grid(path, grid)
    try:
        return grid.read_leaves()
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def beyond_limits(grid: Grid) -> str:
    """Why a grid is too large to be read with `read_stored`; empty when it is not."""
    return too_large(grid.shape, sparse=grid.read_leaves is not None) or too_many_leaves(grid.leaf_count)


def too_large(shape: tuple[int, int, int], *, sparse: bool) -> str:
    """Why a box of (z, y, x) voxels cannot be read, as leaves or densely; empty when it can."""
    z, y, x = shape
    limit = MAX_BOX_VOXELS if sparse else MAX_VOXELS
    if math.prod(shape) > limit:
        return f"spans {x}×{y}×{z} = {x * y * z:,} voxels; the limit is {limit:,}"
    if sparse and max(shape) > MAX_BOX_EDGE:
        return f"spans {x}×{y}×{z} voxels; the limit along an axis is {MAX_BOX_EDGE:,}"
    return ""


def too_many_leaves(count: int) -> str:
    """Why that many leaves cannot be read; empty when they can."""
    return f"takes {count:,} leaves of 8³ voxels; the limit is {MAX_LEAVES:,}" if count > MAX_LEAVES else ""


def refusal(grid: Grid) -> str:
    """Why a grid cannot be rendered as a density; empty when it can."""
    if grid.unsupported:
        return f"cannot be rendered: {grid.unsupported}"
    if grid.grid_class == "level set":
        return (
            "is a level set (signed distances), not a fog volume: its values are not densities; "
            "convert it first, for instance with OpenVDB's sdfToFogVolume"
        )
    if grid.background != 0.0:
        return f"has the background {grid.background:g}: it fills all space, where a fog volume ends in 0"
    if min(grid.shape) < 1:
        return "is empty: it stores no voxel"
    return beyond_limits(grid)
