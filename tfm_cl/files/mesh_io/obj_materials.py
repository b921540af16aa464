"""The material file that an OBJ file names, and the images that are named in there."""

from __future__ import annotations

import mmap
from pathlib import Path

MAX_NAME = 4096
"""Bytes of a line that hold a name."""
MAX_MATERIALS = 1 << 24
"""Bytes of a material file that are looked through."""


def named_files(path: Path) -> list[str]:
    """Return the names of an OBJ file's materials, the first that it names, and of their images.

    Raises
    ------
    OSError, ValueError
        It cannot be read, or is empty.
    """
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as text:
        at = text.find(b"mtllib")
        if at < 0:
            return []
        library = text[at : at + MAX_NAME].splitlines()[0].removeprefix(b"mtllib").strip().decode()
    return [library, *_images(path.parent / library)]


def _images(library: Path) -> list[str]:
    """Return the names of the images in a material file; none where it cannot be read."""
    try:
        with library.open("rb") as stream:
            lines = stream.read(MAX_MATERIALS).decode(errors="replace").splitlines()
    except OSError:
        return []
    words = [line.split(None, 1) for line in lines]
    return [found[1].strip() for found in words if len(found) > 1 and found[0].lower() == "map_kd"]
