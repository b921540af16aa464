"""What archives of points and those of curves have in common: arrays by their names, one row a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from tfm_cl.files.points_io.attributes import check_count, is_known, repeated

if TYPE_CHECKING:
    from tfm_cl.files.volume_io.numpy_array import StoredArray

MOST_NUMBERS = 4
"""Of a point, in an attribute that is read at all; of another number than expected it is refused then."""


def first_of(arrays: Mapping[str, StoredArray], names: Sequence[str]) -> StoredArray | None:
    """Return the array with the first of some names that there is, in any case."""
    found = {name.lower(): array for name, array in arrays.items()}
    return next((found[name] for name in names if name in found), None)


def read_rows(
    path: Path, arrays: Mapping[str, StoredArray], positions: StoredArray
) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """Read the array of positions, and those of all known attributes.

    Raises
    ------
    VolumeError
        Damaged, or too large.
    """
    count = positions.rows_of_three()
    check_count(path, count)
    attributes = {
        name: repeated(array.read_up_to(MOST_NUMBERS * count), count)
        for name, array in arrays.items()
        if is_known(name)
    }
    return positions.read_up_to(3 * count), attributes
