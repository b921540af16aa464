"""Curves of USD files: prims of type ``BasisCurves``, in world space, with widths, colours and opacities.

Cubic curves become polylines as `tfm_cl.files.curves_io.splines` says; between control points, values stay
within those of the file.

https://openusd.org/release/api/class_usd_geom_basis_curves.html
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.attributes import check_counts, curves_of
from tfm_cl.files.curves_io.splines import Polylines, polylines
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.stored import MAX_POINTS
from tfm_cl.files.usd import Prim, at_points, joined, read_prims


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
def read(path: Path) -> StoredCurves:
    """Read the curves of all visible prims.

    Raises
    ------
    VolumeError
        As of `read_prims`, too many points, curves of impossible numbers of points, or values of others.
    """
    parts, left = [], MAX_POINTS
    for prim in read_prims(path, "BasisCurves"):
        parts.append(_part(path, prim, left))
        left -= len(parts[-1]["positions"])
    attributes = joined(path, parts)
    return curves_of(path, attributes.pop("positions"), attributes.pop("counts"), attributes)


def _part(path: Path, prim: Prim, most: int) -> dict[str, NDArray[Any]]:
    """Evaluate a prim's curves."""
    positions, tokens = prim.positions, prim.tokens
    counts = check_counts(path, prim.arrays.get("counts", np.zeros(0, np.int64)), len(positions))
    basis = tokens["basis"] if tokens["type"] == "cubic" else tokens["type"]
    try:
        lines = polylines(counts, basis, tokens["wrap"], most)
    except ValueError as error:
        raise VolumeError(f"{path}: {prim.path[:80]}: {error}") from error
    part = {name: _values(path, prim, name, lines) for name in prim.interpolation}
    if "widths" in part:
        part["widths"] = part["widths"] * prim.scale
    if prim.velocities is not None:
        velocities = at_points(path, prim, "velocities", prim.velocities, lines.vertices)
        part["velocities"] = lines.of_vertices(velocities)
    return part | {"positions": lines.of_vertices(positions), "counts": lines.counts}


def _values(path: Path, prim: Prim, name: str, lines: Polylines) -> NDArray[Any]:
    """Give the polylines' points one attribute of a prim."""
    values, kind = prim.arrays[name], prim.interpolation[name]
    if kind == "constant":
        return at_points(path, prim, name, values[:1], len(lines.at))
    if kind == "uniform":
        return np.repeat(at_points(path, prim, name, values, len(lines.counts)), lines.counts, axis=0)
    if kind == "vertex":
        found = lines.of_vertices(at_points(path, prim, name, values, lines.vertices))
        # A cubic may swing beyond its control points: below 0, or above an opacity of 1.
        return np.clip(found, values.min(axis=0), values.max(axis=0))
    return lines.of_span_ends(at_points(path, prim, name, values, lines.span_ends))
