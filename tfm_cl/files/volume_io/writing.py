"""Writing volume files: one module per format, selected by the file's extension.

To add a format, write a module with ``write(path, grids)`` and add it to ``WRITERS``; one that says the rest
in a JSON file beside also has ``describe(grids)``, its text.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tfm_cl.errors import VolumeError
from tfm_cl.files import paths as files
from tfm_cl.files.paths import path_of, replacing
from tfm_cl.files.volume_io.grid import shown
from tfm_cl.files.volume_io.written_grid import WrittenGrid

WRITERS: dict[str, str] = {".vdb": "vdb_writer", ".nvdb": "nvdb_writer", ".npy": "numpy_writer"}
"""Modules of this package by file extension; imported when a file of that kind is written."""


def write_grids(path: str | Path, grids: Sequence[WrittenGrid]) -> list[Path]:
    """Write grids to a file; the extension determines the format.

    A file appears complete or not at all, and replaces one that is there.

    Parameters
    ----------
    path
        ``.vdb``, ``.nvdb`` or ``.npy``; the last has a JSON file beside it.
    grids
        At least one, each with an active voxel.

    Returns
    -------
    The files written.

    Raises
    ------
    VolumeError
        Unknown extension, a grid that the format cannot hold, or the file cannot be written.
    """
    path = path_of(path, VolumeError)
    module = _format(path)
    for grid in grids:
        if not grid.active.any():
            raise VolumeError(
                f"{path}: grid {shown(grid.name)} has no active voxel; there is nothing to write"
            )
    others = [(other, module.describe(grids)) for other in _beside(path, module)]
    with replacing(path, VolumeError) as temporary:
        module.write(temporary, grids)
        for other, text in others:
            with replacing(other, VolumeError) as beside:
                beside.write_text(text, encoding="utf-8")
    return [path, *(other for other, _ in others)]


def check_writable(path: str | Path) -> list[Path]:
    """Check that `write_grids` can write to a path, and return the files that it would write.

    Raises
    ------
    VolumeError
        Unknown extension, or one of them cannot be written.
    """
    path = path_of(path, VolumeError)
    written = [path, *_beside(path, _format(path))]
    for file in written:
        files.check_writable(file, VolumeError)
    return written


def _format(path: Path) -> Any:
    name = WRITERS.get(path.suffix.lower())
    if name is None:
        raise VolumeError(
            f"{path}: grids cannot be written as '{path.suffix}'; known: {' '.join(sorted(WRITERS))}"
        )
    return importlib.import_module(f"tfm_cl.files.volume_io.{name}")


def _beside(path: Path, module: Any) -> list[Path]:
    return [path.with_suffix(".json")] if hasattr(module, "describe") else []
