"""Curves of NumPy archives, ``.npz``: arrays of one row a point, of one curve after the other.

``points``, ``positions``, ``position`` or ``P`` is [n, 3]; ``counts`` or ``curveVertexCounts``, the points of
each curve, is [curves] of whole numbers. Widths, opacities and colours are named as those of points, and have
a row for each point or each curve, or one for all.
Pickled objects are never loaded.
"""

from __future__ import annotations

from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.attributes import curves_of
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.arrays import first_of, read_rows
from tfm_cl.files.points_io.attributes import POSITIONS
from tfm_cl.files.volume_io.grid import shown_names
from tfm_cl.files.volume_io.numpy_array import open_arrays

COUNTS = ("counts", "curvevertexcounts")


def read(path: Path) -> StoredCurves:
    """Read all curves of an archive.

    Raises
    ------
    VolumeError
        Damaged, too large, or without an array of points or of their numbers.
    """
    arrays = open_arrays(path)
    positions, counts = first_of(arrays, POSITIONS), first_of(arrays, COUNTS)
    if positions is None or counts is None:
        raise VolumeError(
            f"{path}: curves are arrays 'points' [n, 3] and 'counts' [curves]; "
            f"its arrays: {shown_names(list(arrays)) or 'none'}"
        )
    points, attributes = read_rows(path, arrays, positions)
    return curves_of(path, points, counts.read_up_to(len(points) // 2), attributes)
