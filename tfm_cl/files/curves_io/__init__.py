"""Curve files: one module per format, selected by the file's extension.

To add a format, write a module with ``read(path)`` that returns
`tfm_cl.files.curves_io.stored.StoredCurves`, and add it to ``FORMATS``.
"""

import importlib
from pathlib import Path

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.paths import check_readable

FORMATS: dict[str, str] = {
    ".hair": "hair",
    ".npz": "numpy_arrays",
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
    module_name = FORMATS.get(path.suffix.lower())
    if module_name is None:
        known = " ".join(sorted(FORMATS))
        raise VolumeError(f"{path}: not a known format of curves '{path.suffix}'; known: {known}")
    check_readable(path, VolumeError)
    module = importlib.import_module(f"{__name__}.{module_name}")
    try:
        curves: StoredCurves = module.read(path)
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not len(curves.counts):
        raise VolumeError(f"{path}: holds no curves")
    return curves
