"""The images that a material file of an OBJ file names."""

from __future__ import annotations

from pathlib import Path

MAX_BYTES = 1 << 24
"""Of a material file that are looked through."""


def named_files(path: Path) -> list[str]:
    """Return the names of the images that the colours of materials are.

    Raises
    ------
    OSError
        It cannot be read.
    """
    with path.open("rb") as stream:
        lines = stream.read(MAX_BYTES).decode(errors="replace").splitlines()
    words = [line.split(None, 1) for line in lines]
    return [found[1].strip() for found in words if len(found) > 1 and found[0].lower() == "map_kd"]
