"""Curves of NumPy archives, ``.npz``: arrays of one row a point, of one curve after the other.

``points``, ``positions``, ``position`` or ``P`` is [n, 3]; ``counts`` or ``curveVertexCounts``, the points of
each curve, is [curves] of whole numbers. Widths, opacities and colours are named as those of points, and have
a row for each point or each curve, or one for all.
Pickled objects are never loaded.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.attributes import curves_of
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.attributes import POSITIONS, check_count, is_known, repeated
from tfm_cl.files.volume_io.grid import shown_names
from tfm_cl.files.volume_io.numpy_array import open_arrays

COUNTS = ("counts", "curvevertexcounts")
MOST_NUMBERS = 4
"""Of a point, in an attribute that is read at all; of another number than expected it is refused then."""


def read(path: Path) -> StoredCurves:
    """Read all curves of an archive.

    Raises
    ------
    VolumeError
        Damaged, too large, or without an array of points or of their numbers.
    """
    arrays = open_arrays(path)
    found = {name.lower(): array for name, array in arrays.items()}
    places = [found[name] for name in POSITIONS if name in found]
    numbers = [found[name] for name in COUNTS if name in found]
    if not places or not numbers:
        raise VolumeError(
            f"{path}: curves are arrays 'points' [n, 3] and 'counts' [curves]; "
            f"its arrays: {shown_names(list(arrays)) or 'none'}"
        )
    points = places[0].rows_of_three()
    check_count(path, points)
    attributes: dict[str, NDArray[Any]] = {
        name: repeated(array.read_up_to(MOST_NUMBERS * points), points)
        for name, array in arrays.items()
        if is_known(name)
    }
    counts = numbers[0].read_up_to(points // 2)
    return curves_of(path, places[0].read_up_to(3 * points), counts, attributes)
