"""Which other files a file names: the data of a NRRD header, images and buffers of meshes.

A picture changes with them, too. Whether they can be used is found when they are read.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from pathlib import Path

from tfm_cl.errors import InputError

FORMATS = {
    ".glb": ".mesh_io.gltf_limits",
    ".gltf": ".mesh_io.gltf_limits",
    ".nhdr": ".volume_io.nrrd_file",
    ".nrrd": ".volume_io.nrrd_file",
    ".obj": ".mesh_io.obj_materials",
}
"""Extension -> the module, of this package, whose ``named_files`` reads the names."""

KEPT = 256
"""Files whose names are kept until they change: they are asked for again at each frame and edit."""


def named_by(path: Path) -> tuple[Path, ...]:
    """Return the files that one names, each once, in its folder or below; none where it cannot be read."""
    module = FORMATS.get(path.suffix.lower())
    if module is None:
        return ()
    try:
        status = path.stat()
        return _named_by(path, module, (status.st_size, status.st_mtime_ns))
    except (OSError, InputError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ()  # what is wrong with it is told by who reads it


@lru_cache(KEPT)
def _named_by(path: Path, module: str, _state: tuple[int, ...]) -> tuple[Path, ...]:
    names = importlib.import_module(module, __package__).named_files(path)
    return tuple(dict.fromkeys(path.parent / name for name in names if _is_below(name)))


def _is_below(name: str) -> bool:
    """Whether a name stays in its folder: no other is ever read."""
    return bool(name) and not Path(name).is_absolute() and ".." not in Path(name).parts and "\0" not in name
