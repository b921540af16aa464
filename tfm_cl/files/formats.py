"""Files of many points: one module per format, selected by the file's extension."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import check_readable


def read_stored(path: Path, package: str, formats: Mapping[str, str], what: str) -> Any:
    """Read a file with the ``read`` of the module that knows its format.

    Parameters
    ----------
    path
        The file.
    package
        That the modules belong to.
    formats
        Names of modules by file extension; imported when a file of that kind is opened.
    what
        Such files hold, for messages.

    Raises
    ------
    VolumeError
        The file is missing, damaged, too large or of unknown type, or has no points.
    """
    module_name = formats.get(path.suffix.lower())
    if module_name is None:
        known = " ".join(sorted(formats))
        raise VolumeError(f"{path}: not a known format of {what} '{path.suffix}'; known: {known}")
    check_readable(path, VolumeError)
    module = importlib.import_module(f"{package}.{module_name}")
    try:
        stored = module.read(path)
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not len(stored.positions):
        raise VolumeError(f"{path}: holds no {what}")
    return stored
