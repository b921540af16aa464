"""Point files: one module per format, selected by the file's extension.

To add a format, write a module with ``read(path)`` that returns
`tfm_cl.files.points_io.stored.StoredPoints`, and add it to ``FORMATS``.
"""

from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import read_by_extension
from tfm_cl.files.points_io.stored import StoredPoints

FORMATS: dict[str, str] = {
    ".bgeo": ".bgeo",
    ".npz": ".numpy_arrays",
    ".ply": ".ply",
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), ".usd_points"),
    ".vtk": ".vtk_legacy",
    ".vtp": ".vtk_xml",
    ".vtu": ".vtk_xml",
}
"""Modules of this package by file extension; imported when a file of that kind is opened."""

__all__ = ["FORMATS", "StoredPoints", "holds_points", "read_points"]


def read_points(path: Path) -> StoredPoints:
    """Read the points of a file.

    Raises
    ------
    VolumeError
        The file is missing, damaged, too large or of unknown type, or has no points.
    """
    points: StoredPoints = read_by_extension(path, __name__, FORMATS, "format of points")
    if not len(points.positions):
        raise VolumeError(f"{path}: holds no points")
    return points


def holds_points(path: Path) -> bool:
    """Whether points can be read from a file, whatever else it holds."""
    try:
        read_points(path)
    except VolumeError:
        return False
    return True
