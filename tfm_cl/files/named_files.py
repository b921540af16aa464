"""Which other files a file names: the data of a NRRD header, images and buffers of meshes.

A picture changes with them, too. Whether they can be used is found when they are read.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from tfm_cl.errors import InputError
from tfm_cl.files.paths import is_file

if TYPE_CHECKING:
    from collections.abc import Iterator

FORMATS = {
    ".glb": (".mesh_io.gltf_limits",),
    ".gltf": (".mesh_io.gltf_limits",),
    ".nhdr": (".volume_io.nrrd_file",),
    ".nrrd": (".volume_io.nrrd_file",),
    ".obj": (".mesh_io.obj_library", ".mesh_io.mtl_images"),
}
"""Extension -> the module, of this package, whose ``named_files`` reads the names, and that which reads
those in the files that have these."""

KEPT = 256
"""Files whose names are kept until they change: they are asked for again at each frame and edit."""

UNREADABLE = (
    InputError,
    OSError,
    MemoryError,
    RecursionError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
)
"""What reading names from a file raises that has none."""


def named_by(path: Path) -> tuple[Path, ...]:
    """Return the files that one names, each once, in its folder or below; none where it cannot be read."""
    return tuple(dict.fromkeys(_along(path, FORMATS.get(path.suffix.lower(), ()))))


def _along(path: Path, modules: tuple[str, ...]) -> Iterator[Path]:
    """Yield the files that one names, each before those that it names itself."""
    if not modules or not is_file(path):  # to open anything else may take for ever
        return
    try:
        status = path.stat()
        named = _named_by(path, modules[0], (status.st_size, status.st_mtime_ns))
    except UNREADABLE:
        return  # what is wrong with it is told by who reads it
    for further in named:
        yield further
        yield from _along(further, modules[1:])


@lru_cache(KEPT)
def _named_by(path: Path, module: str, _state: tuple[int, ...]) -> tuple[Path, ...]:
    names = importlib.import_module(module, __package__).named_files(path)
    return tuple(dict.fromkeys(path.parent / name for name in names if _is_below(name)))


def _is_below(name: str) -> bool:
    """Whether a name stays in its folder: no other is ever read."""
    return bool(name) and not Path(name).is_absolute() and ".." not in Path(name).parts and "\0" not in name
