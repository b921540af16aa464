"""Checks of what files say of points and curves, one row a point: nothing that is not a number goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError


def rows_of(path: Path, name: str, values: NDArray[Any], count: int, width: int) -> NDArray[np.float32]:
    """Turn an attribute into float32 [count] (``width`` 1) or [count, width].

    Parameters
    ----------
    path, name
        File and attribute, for messages.
    values
        Real numbers [count] or [count, width].
    count, width
        Number of points, and numbers of each.

    Raises
    ------
    VolumeError
        Another shape, no real numbers, or a value that is not finite; the message says of which point.
    """
    if values.dtype.kind not in "fiub":
        raise VolumeError(f"{path}: {name!r} holds no real numbers but {values.dtype.name}")
    if values.ndim == 2 and values.shape[1] == 1:  # noqa: PLR2004 - points and numbers
        values = values[:, 0]
    expected = (count, width) if width > 1 else (count,)
    if values.shape != expected:
        # A shape of a file may be of any length.
        got = "×".join(map(str, values.shape[:4])) or "one number"
        raise VolumeError(f"{path}: {name!r} is {got}; expected {'×'.join(map(str, expected))}")
    with np.errstate(over="ignore", invalid="ignore"):  # signalling NaN
        rows = np.ascontiguousarray(values, np.float32)
    _refuse(path, name, rows, ~np.isfinite(rows), "a finite number of float32")
    return rows


def repeated(values: NDArray[Any], count: int) -> NDArray[Any]:
    """Give a single value, [] or [1] or [1, numbers], to all points; return others as they are."""
    if values.ndim == 0:
        return np.broadcast_to(values, count)
    return np.broadcast_to(values, (count, *values.shape[1:])) if len(values) == 1 else values


def not_negative(path: Path, name: str, rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``rows``, after a look at their signs.

    Raises
    ------
    VolumeError
        A value is negative; the message says of which point.
    """
    _refuse(path, name, rows, rows < 0, "0 or more")
    return rows


def unit_levels(values: NDArray[Any]) -> NDArray[Any]:
    """Turn unsigned integers, as colours are often stored, to 0..1; return other values as they are."""
    if values.dtype.kind != "u":
        return values
    levels: NDArray[Any] = values / np.float32(np.iinfo(values.dtype).max)
    return levels


def _refuse(path: Path, name: str, rows: NDArray[np.float32], wrong: NDArray[np.bool_], wanted: str) -> None:
    if wrong.any():
        at = np.unravel_index(int(wrong.argmax()), wrong.shape)
        raise VolumeError(f"{path}: {name!r} of point {at[0]} is {rows[at]}; expected {wanted}")
