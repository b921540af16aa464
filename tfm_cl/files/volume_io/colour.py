"""Sources of a volume's colour: an array [z, y, x, 3], a vector grid, or three scalar grids."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.paths import source_of
from tfm_cl.files.volume_io import numpy_array
from tfm_cl.files.volume_io.grid import COLOUR, Grid, shown, shown_names
from tfm_cl.files.volume_io.leaves import Index
from tfm_cl.files.volume_io.limits import too_large
from tfm_cl.limits import LARGEST_COLOUR

ColourSource = str | Path | Sequence[str] | Literal[False] | None
"""The source of a colour, as for `tfm_cl.scene.bodies.volume.Volume.load`."""

USUAL_NAMES = ("Cd", "colour", "color")
"""Names of the vector grid that is used as the colour if another file has several."""
ALIGNMENT = 1e-3
"""Largest distance, as a fraction of a voxel, between corresponding voxels of grids that belong together."""


def check_array(
    found: tuple[int, ...], dtype: np.dtype[Any], shape: Index, label: str, hint: str = ""
) -> None:
    """Raise `VolumeError` unless an array can be the colour of a volume of ``shape`` (z, y, x)."""
    if dtype.kind not in "fiub":
        raise VolumeError(f"{label} is of real numbers; these are of type {dtype.name}")
    if found != (*shape, 3):
        raise VolumeError(
            f"{label} has the shape {list(found)}; expected [z, y, x, 3] of the volume, {[*shape, 3]}{hint}"
        )


def checked(rgb: NDArray[np.float32], label: str, *, sanitize: bool) -> NDArray[np.float32]:
    """Return a read-only colour whose values are all valid; invalid ones raise, or become 0.

    Raises
    ------
    VolumeError
        A value is negative, infinite, NaN or too large, and such values are not to be set to 0.
    """
    low, high = float(rgb.min()), float(rgb.max())
    if not 0 <= low <= high <= LARGEST_COLOUR:  # NaN is not
        wrong = ~((rgb >= 0) & (rgb <= LARGEST_COLOUR))
        if not sanitize:
            z, y, x, c = (int(i) for i in np.argwhere(wrong)[0])
            count = np.count_nonzero(wrong)
            raise VolumeError(
                f"{label} holds {count} numbers that are not from 0 to {LARGEST_COLOUR:g}, the first "
                f"{rgb[z, y, x, c]:g} at [z={z}, y={y}, x={x}, {'rgb'[c]}]; set them to 0 with "
                "--set volume.sanitize=true"
            )
        if not rgb.flags.writeable:
            rgb = rgb.copy()
        rgb[wrong] = 0.0
    rgb.flags.writeable = False
    return rgb


def read_colour(
    path: Path, grid: Grid, source: ColourSource, *, sanitize: bool
) -> tuple[NDArray[np.float32] | None, tuple[str, ...]]:
    """Read the colour for a grid of ``path`` that has one value per voxel.

    Parameters
    ----------
    source, sanitize
        As in `tfm_cl.scene.bodies.volume.Volume.load`.

    Returns
    -------
    float32 [z, y, x, RGB], or None if there is none; and notes like `Grid.notes`.

    Raises
    ------
    VolumeError
        The array or grid does not exist, is damaged, or has another shape, type or position; or its values
        are not valid colours.
    """
    hint = ""
    if source is None and path.suffix.lower() == ".npz" and numpy_array.has_colour(path):
        source, hint = COLOUR, "; to leave it out, --set volume.colour=false"
    if source is None or source is False:
        return None, ()
    z, y, x = grid.shape
    if reason := too_large((z, y, 3 * x), sparse=False):
        raise VolumeError(f"{path}: the colour of grid {shown(grid.name)} {reason}, channels counted")
    if not isinstance(source, str | Path):
        rgb, notes = _read_three_grids(path, grid, source)
        names = ", ".join(shown(name)[1:-1] for name in source)
        return checked(rgb, f"{path}: the colour of the grids {names}", sanitize=sanitize), notes
    in_file = source_of(source, error=VolumeError) if volume_io.is_volume_file(source) else path
    name = None if volume_io.is_volume_file(source) else str(source)
    if in_file.suffix.lower() not in numpy_array.EXTENSIONS:
        vectors = _vectors_of(in_file, name)
        rgb = _read_vectors(in_file, grid, vectors)
        return checked(rgb, f"{in_file}: grid {shown(vectors.name)}", sanitize=sanitize), vectors.notes
    if name is not None and path.suffix.lower() == ".npy":
        raise VolumeError(
            f"{path}: colour = {shown(name)}: a .npy file has no other arrays; give a file, as 'colour.npy'"
        )
    stored = numpy_array.open_colour(in_file, name)
    check_array(stored.header.shape, stored.header.dtype, grid.shape, stored.label, hint)
    return checked(stored.read(), stored.label, sanitize=sanitize), ()


def _vectors_of(path: Path, name: str | None) -> Grid:
    """Find the named grid with three values per voxel, or the one that is a file's colour."""
    grids = volume_io.open_grids(path)
    if name is not None:
        grid = volume_io.find_grid(path, grids, name)
        if grid.read_colour is None:
            raise VolumeError(
                f"{path}: grid {shown(name)}, of {grid.value_type} values, is not a colour with three "
                f"values per "
                "voxel; name three scalar grids instead, as ['r', 'g', 'b']"
            )
        return grid
    found = [grid for grid in grids if grid.read_colour is not None]
    found = [grid for grid in found if grid.name in USUAL_NAMES] or found
    if len(found) != 1:
        names = shown_names([grid.name for grid in grids])
        what = "several grids" if found else "no grid"
        raise VolumeError(
            f"{path}: has {what} with three values per voxel to be a colour; its grids: {names}"
        )
    return found[0]


def _read_vectors(path: Path, grid: Grid, vectors: Grid) -> NDArray[np.float32]:
    """Red, green and blue from a grid with three values per voxel, in the box of the density grid."""
    of_grid, of_part = _common(grid, vectors, f"{path}: grid {shown(vectors.name)}, the colour,")
    rgb = np.full((*grid.shape, 3), vectors.colour_background, np.float32)
    rgb[of_grid] = volume_io.read_vectors(path, vectors)[of_part]
    return rgb


def _read_three_grids(
    path: Path, grid: Grid, names: Sequence[str]
) -> tuple[NDArray[np.float32], tuple[str, ...]]:
    """Red, green and blue from scalar grids of the same file, in the box of the density grid."""
    if len(names) != 3:  # noqa: PLR2004 - red, green, blue
        raise VolumeError(
            f"{path}: colour is three names of grids, for red, green and blue; got {len(names)}"
        )
    rgb = np.empty((*grid.shape, 3), np.float32)
    notes: list[str] = []
    for channel, name in enumerate(names):
        part = volume_io.choose_grid(path, name)
        if part.read_colour is not None:
            raise VolumeError(f"{path}: grid {shown(name)} is a colour by itself, not a channel of one")
        of_grid, of_part = _common(grid, part, f"{path}: grid {shown(name)}, a channel of the colour,")
        rgb[..., channel] = part.background
        rgb[..., channel][of_grid] = volume_io.read_grid(path, part)[of_part]
        notes += part.notes
    return rgb, tuple(dict.fromkeys(notes))


def _common(grid: Grid, part: Grid, label: str) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Find the voxels that two grids share, as slices of each.

    Raises
    ------
    VolumeError
        Their voxels are not at the same positions, or the shared part is too large to be read.
    """
    # Trees store a box around the non-empty part, which may differ between grids.
    if not part.is_box_of_stored and part.shape != grid.shape:
        raise VolumeError(f"{label} has the shape {list(part.shape)}; expected {list(grid.shape)}")
    grid_from_part = np.eye(4)
    if part.has_transform and grid.has_transform:
        grid_from_part = _relative(grid, part)
    offset = np.rint(grid_from_part[:3, 3])
    aligned = np.eye(4)
    aligned[:3, 3] = offset
    if not np.abs(grid_from_part - aligned).max() <= ALIGNMENT:  # NaN is not
        raise VolumeError(f"{label} does not have its voxels where grid {shown(grid.name)} has them")
    z, y, x = part.shape
    if reason := too_large((z, y, x * (1 if part.read_colour is None else 3)), sparse=False):
        raise VolumeError(f"{label} {reason} for a dense array")
    common = [_overlap(*sides) for sides in zip(grid.shape, part.shape, offset[::-1], strict=True)]
    of_grid, of_part = zip(*common, strict=True)
    return of_grid, of_part


def _relative(grid: Grid, part: Grid) -> NDArray[np.float64]:
    """Matrix 4×4 from the indices of one grid to those of another; NaN if there is none."""
    try:
        with np.errstate(all="ignore"):
            relative: NDArray[np.float64] = np.linalg.inv(grid.world_from_index) @ part.world_from_index
    except np.linalg.LinAlgError:
        return np.full((4, 4), np.nan)
    return relative if np.isfinite(relative).all() else np.full((4, 4), np.nan)


def _overlap(size: int, other_size: int, offset: float) -> tuple[slice, slice]:
    """Find the voxels that two rows share, as a slice of each; the second begins at ``offset``."""
    begin, end = (int(np.clip(at, 0, size)) for at in (offset, offset + other_size))
    start = int(offset) if begin < end else begin
    return slice(begin, end), slice(begin - start, end - start)
