"""The material file that an OBJ file names."""

from __future__ import annotations

from pathlib import Path

KEY = b"mtllib"
MAX_NAME = 4096
"""Bytes of a line that hold a name."""
AT_ONCE = 1 << 20
"""Bytes that are read at once: if a file were mapped, to cut it short meanwhile would end the process."""


def named_files(path: Path) -> list[str]:
    """Return the name of an OBJ file's materials, the first that it names, if any.

    Raises
    ------
    OSError, ValueError
        It cannot be read.
    """
    with path.open("rb") as stream:
        text = b""
        while part := stream.read(AT_ONCE):
            text += part
            at = text.find(KEY)
            if at >= 0:
                line = text[at:] + stream.read(MAX_NAME)
                return [line[:MAX_NAME].splitlines()[0].removeprefix(KEY).strip().decode()]
            text = text[-len(KEY) :]
    return []
