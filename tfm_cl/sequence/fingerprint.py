"""What a frame is made from, as one number: two frames of one fingerprint are the same picture."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tfm_cl import plugins
from tfm_cl._version import __version__
from tfm_cl.files.paths import real_path
from tfm_cl.model import Model
from tfm_cl.scene.scene_file import SceneFile

OF_READING = ("source", "path", "changing", "patterns", "asked")
"""Attributes of a scene file that say where something comes from, not what it is."""


def of_frame(file: SceneFile, outputs: Sequence[Path]) -> str:
    """Return the fingerprint of a frame: the scene as it is then, its files' size and time, and the version.

    Names of files count relative to the scene file, so that a folder may be mounted elsewhere.

    Parameters
    ----------
    file
        The scene at the frame, with all that was decided for the range.
    outputs
        Its pictures, whose names count.
    """
    asked = {field.name: getattr(file, field.name) for field in dataclasses.fields(file)}
    for name in OF_READING:
        del asked[name]
    names = {str(real_path(path)): _relative(path, file.path.parent) for path in _files(file)}
    return fingerprint([asked, [path.name for path in outputs], states(file)], names)


def states(file: SceneFile) -> list[tuple[str, int, int]]:
    """Return the name, size and time of change, nanoseconds, of all files of a frame; -1: not there."""
    return [_state(path, file.path.parent) for path in _files(file)]


def _files(file: SceneFile) -> list[Path]:
    own = [] if file.source.lines else [file.path]  # of a scene file what it says counts
    return [*file.files(), *own, *_plugins()]


def fingerprint(said: Any, renamed: Mapping[str, str] | None = None) -> str:
    """Return a number, hexadecimal, of any data of scene files, and the version of tfm_cl.

    Parameters
    ----------
    said
        Models, dataclasses, tables, arrays, numbers and text.
    renamed
        Text -> what counts in its place.
    """
    digest = hashlib.sha256(__version__.encode())
    for part in _parts(said, renamed or {}):
        digest.update(part.encode() if isinstance(part, str) else part)
        digest.update(b"\0")
    return digest.hexdigest()


def _parts(value: Any, renamed: Mapping[str, str]) -> Iterator[str | bytes]:
    """Yield what a value consists of, in an order of its own."""
    if isinstance(value, Model):
        value = (type(value).__name__, {name: getattr(value, name) for name in type(value).model_fields})
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = (
            type(value).__name__,
            {one.name: getattr(value, one.name) for one in dataclasses.fields(value)},
        )
    if isinstance(value, str | Path):
        yield f"s{renamed.get(str(value), str(value))}"
    elif isinstance(value, Mapping):
        yield f"m{len(value)}"
        for key in sorted(value, key=str):
            yield from _parts(key, renamed)
            yield from _parts(value[key], renamed)
    elif isinstance(value, np.ndarray):
        yield f"a{value.dtype.str}{value.shape}"
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, list | tuple | set | frozenset):
        yield f"l{len(value)}"
        for item in value if isinstance(value, list | tuple) else sorted(value, key=repr):
            yield from _parts(item, renamed)
    else:
        yield repr(float(value)) if isinstance(value, np.floating) else repr(value)


def _state(path: Path, folder: Path) -> tuple[str, int, int]:
    """Return a file's name, size and time of change, nanoseconds; -1 where it is not there."""
    try:
        found = path.stat()
    except OSError:
        return _relative(path, folder), -1, -1
    return _relative(path, folder), found.st_size, found.st_mtime_ns


def _relative(path: Path, folder: Path) -> str:
    try:
        return os.path.relpath(real_path(path), real_path(folder))
    except ValueError:  # another drive of Windows
        return str(path)


def _plugins() -> list[Path]:
    """Files that change what a scene may mean."""
    return [Path(name) for name in os.environ.get(plugins.VARIABLE, "").split(os.pathsep) if name]
