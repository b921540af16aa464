"""Points of NumPy archives, ``.npz``: arrays of one row a point.

``positions``, ``position``, ``points`` or ``P`` is [n, 3], the others are named as in
`tfm_cl.files.points_io.attributes`; one row, or a single number, is that of all points.
Pickled objects are never loaded.
"""

from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.attributes import POSITIONS, check_count, is_known, points_of, repeated
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.volume_io.grid import shown_names
from tfm_cl.files.volume_io.numpy_array import open_arrays

MOST_NUMBERS = 4
"""Of a point, in an attribute that is read at all; of another number than expected it is refused then."""


def read(path: Path) -> StoredPoints:
    """Read all points of an archive.

    Raises
    ------
    VolumeError
        Damaged, too large, or without an array of positions.
    """
    arrays = open_arrays(path)
    found = {name.lower(): array for name, array in arrays.items()}
    places = [found[name] for name in POSITIONS if name in found]
    if not places:
        raise VolumeError(
            f"{path}: no array 'positions' [n, 3]; its arrays: {shown_names(list(arrays)) or 'none'}"
        )
    count = places[0].rows_of_three()
    check_count(path, count)
    attributes = {
        name: repeated(array.read_up_to(MOST_NUMBERS * count), count)
        for name, array in arrays.items()
        if is_known(name)
    }
    return points_of(path, places[0].read_up_to(3 * count), attributes)
