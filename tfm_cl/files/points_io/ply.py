"""Stanford's polygon files, ``.ply``: the vertices and their properties; faces are left alone.

Lines of text, then rows of text or of bytes in either order
(http://paulbourke.net/dataformats/ply/)::

    ply
    format ascii | binary_little_endian | binary_big_endian 1.0
    comment ...
    element NAME ROWS
    property TYPE NAME
    property list TYPE TYPE NAME
    end_header

trimesh, which reads such meshes, keeps properties of vertices only where it keeps private notes, and refuses
polygons of several sizes, which do not matter here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.attributes import check_count, points_of
from tfm_cl.files.points_io.lines import Lines
from tfm_cl.files.points_io.stored import StoredPoints

FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
MOST_LINES = 10_000
"""Of a header."""


@dataclass
class _Element:
    name: str
    rows: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    """Name and NumPy's type of each; no type for a list."""


def read(path: Path) -> StoredPoints:
    """Read all vertices of a file.

    Raises
    ------
    VolumeError
        Not such a file, damaged, too large, or without vertices.
    """
    lines = Lines(path)
    if lines.line() != "ply":
        raise VolumeError(f"{path}: not a .ply file: it does not begin with 'ply'")
    order, elements = _header(lines)
    for element in elements:
        if element.name == "vertex":
            break
        _rows(lines, element, order)
    else:
        raise VolumeError(f"{path}: has no element 'vertex'")
    check_count(path, element.rows)
    rows = _rows(lines, element, order)
    missing = [axis for axis in "xyz" if axis not in rows]
    if missing:
        raise VolumeError(f"{path}: its vertices have no {', '.join(missing)}")
    return points_of(path, np.stack([rows[axis] for axis in "xyz"], axis=1), rows)


def _header(lines: Lines) -> tuple[str, list[_Element]]:
    """Read a byte order, empty for text, and the elements."""
    order, elements = None, []
    for _ in range(MOST_LINES):
        match lines.line().split():
            case ["format", name, *_] if name in FORMATS:
                order = FORMATS[name]
            case ["comment" | "obj_info", *_]:
                pass
            case ["element", name, rows]:
                elements.append(_Element(name, lines.count(rows, f"the rows of {name[:20]!r}")))
            case ["property", "list", _, _, name] if elements:
                elements[-1].properties.append((name, ""))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind]))
            case ["end_header"] if order is not None:
                return order, elements
            case words:
                raise lines.damaged(f"the header has a line {' '.join(words)[:60]!r}")
    raise lines.damaged(f"the header has more than {MOST_LINES} lines")


def _rows(lines: Lines, element: _Element, order: str) -> dict[str, NDArray[Any]]:
    """Read an element's properties."""
    names = [name for name, _ in element.properties]
    if any(not kind for _, kind in element.properties):
        raise VolumeError(
            f"{lines.path}: element {element.name[:40]!r} has lists of numbers and is not behind the "
            "points; export the points alone"
        )
    if len(set(names)) < len(names):
        raise lines.damaged(f"two properties of element {element.name[:40]!r} have the same name")
    what = f"element {element.name[:40]!r}"
    if order:
        dtype = np.dtype([(name, order + kind) for name, kind in element.properties])
        rows = lines.numbers(element.rows, dtype, what)
        return {name: rows[name] for name in names}
    values = lines.text_numbers(element.rows * len(names), what).reshape(element.rows, len(names))
    return {
        name: lines.typed(values[:, at], np.dtype(kind), f"property {name[:40]!r}")
        for at, (name, kind) in enumerate(element.properties)
    }
