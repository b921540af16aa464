"""Curve files: one module per format, selected by the file's extension.

To add a format, write a module with ``read(path)`` that returns
`tfm_cl.files.curves_io.stored.StoredCurves`, and add it to ``FORMATS``.
"""

from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.paths import read_by_extension

FORMATS: dict[str, str] = {
    ".hair": ".hair",
    ".npz": ".numpy_arrays",
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), ".usd_curves"),
}
"""Modules of this package by file extension; imported when a file of that kind is opened."""

__all__ = ["FORMATS", "StoredCurves", "read_curves"]


def read_curves(path: Path) -> StoredCurves:
    """Read the curves of a file.

    Raises
    ------
    VolumeError
        The file is missing, damaged, too large or of unknown type, or has no curves.
    """
    curves: StoredCurves = read_by_extension(path, __name__, FORMATS, "format of curves")
    if not len(curves.counts):
        raise VolumeError(f"{path}: holds no curves")
    return curves
