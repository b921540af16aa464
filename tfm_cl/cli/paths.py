"""Names of files on the command line."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tfm_cl.files.paths import path_of, source_of


class FileName(click.ParamType[Path]):
    """A name that becomes a path the way the library makes one."""

    name = "path"

    def __init__(self, to_path: Callable[[str | os.PathLike[str]], Path]) -> None:
        self._to_path = to_path

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Make the path; what cannot be one raises `InputError`, which `tfm_cl.cli.main` prints."""
        del param, ctx
        return self._to_path(value)


SOURCE = FileName(source_of)
"""A file to read."""
TARGET = FileName(path_of)
"""A file or folder to write."""
