"""Points of NumPy archives, ``.npz``: arrays of one row a point.

``positions``, ``position``, ``points`` or ``P`` is [n, 3], the others are named as in
`tfm_cl.files.points_io.attributes`; one row, or a single number, is that of all points.
Pickled objects are never loaded.
"""

from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.arrays import first_of, read_rows
from tfm_cl.files.points_io.attributes import POSITIONS, points_of
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.volume_io.grid import shown_names
from tfm_cl.files.volume_io.numpy_array import open_arrays


def read(path: Path) -> StoredPoints:
    """Read all points of an archive.

    Raises
    ------
    VolumeError
        Damaged, too large, or without an array of positions.
    """
    arrays = open_arrays(path)
    positions = first_of(arrays, POSITIONS)
    if positions is None:
        raise VolumeError(
            f"{path}: no array 'positions' [n, 3]; its arrays: {shown_names(list(arrays)) or 'none'}"
        )
    return points_of(path, *read_rows(path, arrays, positions))
