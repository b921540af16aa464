"""What all formats check of curves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.attributes import check_count, points_of


def check_counts(path: Path, counts: NDArray[Any], points: int) -> NDArray[np.int64]:
    """Return the number of points of each curve, [curves].

    Parameters
    ----------
    path
        The file, for messages.
    counts
        Whole numbers of any type.
    points
        Those that the file has for all of them.

    Raises
    ------
    VolumeError
        No whole numbers, too many points, a curve of fewer than 2, or another number in all.
    """
    if counts.ndim != 1 or counts.dtype.kind not in "iu":
        raise VolumeError(f"{path}: the curves' numbers of points should be an array of whole numbers")
    check_count(path, points)
    wrong = (counts < 2) | (counts > points)  # noqa: PLR2004 - a line
    if wrong.any():
        at = int(wrong.argmax())
        raise VolumeError(f"{path}: curve {at} has {counts[at]:,} points, of {points:,}; expected 2 or more")
    found = counts.astype(np.int64)
    if found.sum() != points:
        raise VolumeError(f"{path}: the curves have {found.sum():,} points; the file has {points:,}")
    return found


def curves_of(
    path: Path, positions: NDArray[Any], counts: NDArray[Any], attributes: Mapping[str, NDArray[Any]]
) -> StoredCurves:
    """Find what is said of curves among a file's attributes, named as those of points.

    Parameters
    ----------
    path
        The file, for messages.
    positions
        [n, 3], of one curve after the other.
    counts
        [curves]: points of each.
    attributes
        By the file's names, with a row for each point or for each curve.

    Raises
    ------
    VolumeError
        As of `check_counts`, a value that is not finite, a negative width, or an attribute of another shape.
    """
    counts = check_counts(path, counts, len(positions))
    rows = {
        name: np.repeat(values, counts, axis=0) if len(values) == len(counts) else values
        for name, values in attributes.items()
    }
    points = points_of(path, positions, rows)
    return StoredCurves(
        positions=points.positions,
        counts=counts,
        widths=None if points.radii is None else points.radii * np.float32(2),
        opacities=points.opacities,
        colours=points.colours,
        velocities=points.velocities,
    )
