"""Where a volume's colour comes from: an array [z, y, x, 3], or three scalar grids."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl import volume_io
from tfm_cl.errors import VolumeError
from tfm_cl.files import source_of
from tfm_cl.leaves import Index
from tfm_cl.model import LARGEST_COLOUR
from tfm_cl.volume_io import numpy_array
from tfm_cl.volume_io.grid import Grid

ColourSource = str | Path | Sequence[str] | Literal[False] | None
"""See `tfm_cl.volume.Volume.load`."""

EXTENSIONS = (".npy", ".npz")
"""Of files that hold an array [z, y, x, 3]."""
ALIGNMENT = 1e-3
"""Of a voxel: how far apart the voxels of grids that belong together may lie."""


def is_file(source: str | Path) -> bool:
    """Tell whether the source of a colour is a file, not an array's name."""
    return Path(source).suffix.lower() in EXTENSIONS


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
    """Return a colour, frozen, whose numbers are all what they can be; others raise, or become 0.

    Raises
    ------
    VolumeError
        A number is negative, infinite, NaN or too large, and they are not to be set to 0.
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
) -> NDArray[np.float32] | None:
    """Read the colour of a grid of ``path``, float32 [z, y, x, RGB]; None where it has none.

    Parameters
    ----------
    source, sanitize
        As of `tfm_cl.volume.Volume.load`.

    Raises
    ------
    VolumeError
        No such array or grid, one that is damaged, or one of another shape, type or place; numbers that
        are no colours.
    """
    hint = ""
    if source is None and path.suffix.lower() == ".npz" and numpy_array.has_colour(path):
        source, hint = numpy_array.COLOUR, "; to leave it out, --set volume.colour=false"
    if source is None or source is False:
        return None
    z, y, x = grid.shape
    if reason := volume_io.too_large((z, y, 3 * x), sparse=False):
        raise VolumeError(f"{path}: the colour of grid '{grid.name}' {reason}, channels counted")
    if not isinstance(source, str | Path):
        rgb = _read_three_grids(path, grid, source)
        return checked(rgb, f"{path}: the colour of the grids {', '.join(source)}", sanitize=sanitize)
    if is_file(source):
        stored = numpy_array.open_colour(source_of(source, error=VolumeError))
    elif path.suffix.lower() == ".npz":
        stored = numpy_array.open_colour(path, str(source))
    else:
        raise VolumeError(
            f"{path}: colour = {str(source)!r}: only .npz files have arrays by name; give a "
            f"{' or '.join(EXTENSIONS)} file, or three grids of this one, as ['r', 'g', 'b']"
        )
    check_array(stored.header.shape, stored.header.dtype, grid.shape, stored.label, hint)
    return checked(stored.read(), stored.label, sanitize=sanitize)


def _read_three_grids(path: Path, grid: Grid, names: Sequence[str]) -> NDArray[np.float32]:
    """Red, green and blue from scalar grids of the same file, in the box of the grid of densities."""
    if len(names) != 3:  # noqa: PLR2004 - red, green, blue
        raise VolumeError(
            f"{path}: colour is three names of grids, for red, green and blue; got {len(names)}"
        )
    rgb = np.zeros((*grid.shape, 3), np.float32)
    for channel, name in enumerate(names):
        part = volume_io.choose_grid(path, name)
        label = f"{path}: grid '{name}', a channel of the colour,"
        grid_from_part = np.linalg.inv(grid.world_from_index) @ part.world_from_index
        offset = np.rint(grid_from_part[:3, 3])
        aligned = np.eye(4)
        aligned[:3, 3] = offset
        # Trees store a box around what is not empty, which may be another for each grid.
        if part.read_leaves is None and part.shape != grid.shape:
            raise VolumeError(f"{label} has the shape {list(part.shape)}; expected {list(grid.shape)}")
        if not np.abs(grid_from_part - aligned).max() <= ALIGNMENT:  # NaN is not
            raise VolumeError(f"{label} does not have its voxels where grid '{grid.name}' has them")
        if reason := volume_io.too_large(part.shape, sparse=False):
            raise VolumeError(f"{label} {reason} for a dense array")
        common = [_overlap(*sides) for sides in zip(grid.shape, part.shape, offset[::-1], strict=True)]
        of_grid, of_part = zip(*common, strict=True)
        rgb[(*of_grid, channel)] = volume_io.read_grid(path, part)[of_part]
    return rgb


def _overlap(size: int, other_size: int, offset: float) -> tuple[slice, slice]:
    """Find what two rows of voxels have in common, as a slice of each; the other begins at ``offset``."""
    begin, end = (int(np.clip(at, 0, size)) for at in (offset, offset + other_size))
    start = int(offset) if begin < end else begin
    return slice(begin, end), slice(begin - start, end - start)
