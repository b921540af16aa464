"""From the names that programs give attributes to what they mean.

Values are checked, one row a point: nothing that is not a number goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.stored import MAX_POINTS, StoredPoints

POSITIONS = ("positions", "position", "points", "p")
RADII = ("radius", "radii", "pscale")
WIDTHS = ("width", "widths", "diameter")
"""Twice a radius. ``size`` is either, depending on who wrote it, and is left alone."""
DENSITIES = ("density", "densities")
OPACITIES = ("opacity", "opacities", "alpha", "displayopacity", "primvars:displayopacity")
COLOURS = ("cd", "color", "colour", "colors", "colours", "displaycolor", "primvars:displaycolor")
COLOUR_PARTS = (("r", "g", "b"), ("red", "green", "blue"))
VELOCITIES = ("v", "velocity", "velocities", "vel")
VELOCITY_PARTS = (("vx", "vy", "vz"),)

LONGEST_HEADER = 1 << 16
"""Bytes of a ``.ply`` file's that are looked at before it is read."""

_KNOWN = frozenset(
    name
    for names in (RADII, WIDTHS, DENSITIES, OPACITIES, COLOURS, *COLOUR_PARTS, VELOCITIES, *VELOCITY_PARTS)
    for name in names
)


def is_known(name: str) -> bool:
    """Tell whether `points_of` has a use for an attribute of this name."""
    return name.lower() in _KNOWN


def is_ply_with_velocities(path: Path) -> bool:
    """Tell whether a file of any format is a ``.ply`` whose header has velocities among its properties."""
    if path.suffix.lower() != ".ply":
        return False
    try:
        with path.open("rb") as stream:
            header = stream.read(LONGEST_HEADER).partition(b"end_header")[0]
    except OSError:
        return False
    words = {word.decode("latin-1").lower() for word in header.split()}
    return not words.isdisjoint(VELOCITIES) or any(words.issuperset(parts) for parts in VELOCITY_PARTS)


def check_count(path: Path, count: int) -> None:
    """Refuse a number of points that cannot be read, before anything is allocated for them.

    Raises
    ------
    VolumeError
        A negative number, or more than `MAX_POINTS`.
    """
    if not 0 <= count <= MAX_POINTS:
        raise VolumeError(f"{path}: {count:,} points; from 0 to {MAX_POINTS:,} can be read")


def repeated(values: NDArray[Any], count: int) -> NDArray[Any]:
    """Give a single value, [] or [1] or [1, numbers], to all points; return others as they are."""
    if values.ndim == 0:
        return np.broadcast_to(values, count)
    return np.broadcast_to(values, (count, *values.shape[1:])) if len(values) == 1 else values


def points_of(path: Path, positions: NDArray[Any], attributes: Mapping[str, NDArray[Any]]) -> StoredPoints:
    """Find what is said of points among a file's attributes.

    Names count in any case. Where a file has several of a kind, the first in this module's lists is taken.
    Colours and opacities of unsigned integers become 0..1; all else stays as the file has it.

    Parameters
    ----------
    path
        The file, for messages.
    positions
        [n, 3].
    attributes
        [n] or [n, numbers], by the file's names.

    Raises
    ------
    VolumeError
        Too many points, a value that is not finite, a negative radius, or an attribute of another shape.
    """
    check_count(path, len(positions))
    count, named = len(positions), {name.lower(): (name, values) for name, values in attributes.items()}

    if "u" in named:
        named.pop("v", None)  # a place in a texture

    def first(
        names: tuple[str, ...], width: int = 1, *, levels: bool = False, signed: bool = True
    ) -> NDArray[np.float32] | None:
        """Return the first of some attributes that there is."""
        for name, values in (named[name] for name in names if name in named):
            rows = _rows_of(path, name, _unit_levels(values) if levels else values, count, width)
            return rows if signed else _not_negative(path, name, rows)
        return None

    def of_parts(parts: tuple[tuple[str, ...], ...], *, levels: bool = False) -> NDArray[np.float32] | None:
        """Join three attributes of a number each."""
        for names in parts:
            columns = [column for name in names if (column := first((name,), levels=levels)) is not None]
            if len(columns) == len(names):
                return np.stack(columns, axis=1)
        return None

    radii = first(RADII, signed=False)
    if radii is None and (widths := first(WIDTHS, signed=False)) is not None:
        radii = widths * np.float32(0.5)
    colours, velocities = first(COLOURS, 3, levels=True), first(VELOCITIES, 3)
    return StoredPoints(
        positions=_rows_of(path, "positions", positions, count, 3),
        radii=radii,
        densities=first(DENSITIES),
        opacities=first(OPACITIES, levels=True),
        colours=of_parts(COLOUR_PARTS, levels=True) if colours is None else colours,
        velocities=of_parts(VELOCITY_PARTS) if velocities is None else velocities,
    )


def _rows_of(path: Path, name: str, values: NDArray[Any], count: int, width: int) -> NDArray[np.float32]:
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


def _not_negative(path: Path, name: str, rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``rows``, after a look at their signs.

    Raises
    ------
    VolumeError
        A value is negative; the message says of which point.
    """
    _refuse(path, name, rows, rows < 0, "0 or more")
    return rows


def _unit_levels(values: NDArray[Any]) -> NDArray[Any]:
    """Turn unsigned integers, as colours are often stored, to 0..1; return other values as they are."""
    if values.dtype.kind != "u":
        return values
    levels: NDArray[Any] = values / np.float32(np.iinfo(values.dtype).max)
    return levels


def _refuse(path: Path, name: str, rows: NDArray[np.float32], wrong: NDArray[np.bool_], wanted: str) -> None:
    if wrong.any():
        at = np.unravel_index(int(wrong.argmax()), wrong.shape)
        raise VolumeError(f"{path}: {name!r} of point {at[0]} is {rows[at]}; expected {wanted}")
