"""VTK's legacy files, ``.vtk``: the points and what is said of them; cells are left alone.

Lines of text with arrays after them, as text or as big-endian bytes ("VTK File Formats",
https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html; cells of versions from 5 on are two
arrays, OFFSETS and CONNECTIVITY)::

    # vtk DataFile Version 3.0
    title
    ASCII | BINARY
    DATASET POLYDATA | UNSTRUCTURED_GRID | ...
    POINTS n type
    ...
    POINT_DATA n
    SCALARS name type [numbers] / LOOKUP_TABLE name | VECTORS name type | FIELD name arrays | ...

meshio, which reads such files too, refuses POLYDATA, as which most programs write particles, and allocates
what a file's header declares.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io.attributes import check_count, points_of
from tfm_cl.files.points_io.lines import Lines
from tfm_cl.files.points_io.stored import StoredPoints

TYPES = {
    "unsigned_char": "u1",
    "char": "i1",
    "unsigned_short": "u2",
    "short": "i2",
    "unsigned_int": "u4",
    "int": "i4",
    "unsigned_long": "u8",
    "long": "i8",
    "float": "f4",
    "double": "f8",
    "vtkidtype": "i4",
    **{f"vtktypeint{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"vtktypeuint{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)},
}
CELLS = ("CELLS", "VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
COORDINATES = ("X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES")
ON_ONE_LINE = ("DATASET", "DIMENSIONS", "ORIGIN", "SPACING", "ASPECT_RATIO")
GEOMETRY = (*CELLS, "CELL_TYPES", *COORDINATES, *ON_ONE_LINE)
ATTRIBUTES = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}
"""Numbers of a point, where the keyword tells."""
MOST_NUMBERS = 1024
"""Of a point, in one attribute."""


def read(path: Path) -> StoredPoints:
    """Read all points of a file.

    Raises
    ------
    VolumeError
        Not such a file, damaged, too large, or of a kind without points.
    """
    return _Legacy(path).read()


class _Legacy:
    def __init__(self, path: Path) -> None:
        self.path, self.lines = path, Lines(path)
        self.is_text = self.has_offsets = False
        self.positions: NDArray[Any] | None = None
        self.attributes: dict[str, NDArray[Any]] = {}
        self.count, self.of_points = 0, False

    def read(self) -> StoredPoints:
        """Read section after section."""
        start, version = "# vtk DataFile Version ", self.lines.line()
        if not version.startswith(start):
            raise VolumeError(
                f"{self.path}: not a legacy .vtk file: it does not begin with '{start.strip()}'"
            )
        self.has_offsets = version.removeprefix(start)[:1] >= "5"
        self.lines.line()  # a title
        kind = self.lines.line().upper()
        if kind not in {"ASCII", "BINARY"}:
            raise self.lines.damaged(f"its third line is {kind[:20]!r}, not ASCII or BINARY")
        self.is_text = kind == "ASCII"
        while words := self.lines.words():
            self._section(words)
        if self.positions is None:
            raise VolumeError(f"{self.path}: holds no section POINTS; grids are no points")
        return points_of(self.path, self.positions, self.attributes)

    def _section(self, words: list[str]) -> None:
        """Read what a line announces."""
        count = self.lines.count
        match [words[0].upper(), *words[1:]]:
            case ["METADATA"]:
                self._skip_metadata()
            case ["POINTS", number, kind]:
                points = count(number, "the points")
                check_count(self.path, points)
                self.positions = self._array(points, 3, kind, "the points")
            case ["POINT_DATA" | "CELL_DATA" as name, number]:
                self.count, self.of_points = count(number, "the points"), name == "POINT_DATA"
            case ["FIELD", _, number]:
                self._field(count(number, "the arrays"))
            case [name, *rest] if name in GEOMETRY:
                self._geometry(name, rest)
            case [keyword, *rest]:
                self._attribute(keyword, rest)

    def _geometry(self, keyword: str, words: list[str]) -> None:
        """Skip what is said of cells and grids."""
        count = self.lines.count
        match words:
            case [cells, numbers] if keyword in CELLS:
                self._cells(count(cells, "the cells"), count(numbers, "the cells"))
            case [number] if keyword == "CELL_TYPES":
                self._array(count(number, "the cells"), 1, "int", "the types of cells")
            case [number, kind] if keyword in COORDINATES:
                self._array(count(number, "the coordinates"), 1, kind, "the coordinates")
            case _:
                pass  # all is on this line

    def _attribute(self, keyword: str, words: list[str]) -> None:
        """Read an attribute of all points or cells."""
        count, colour = self.lines.count, "float" if self.is_text else "unsigned_char"
        match [keyword, *words]:
            case ["SCALARS", name, kind, *numbers]:
                each = count(numbers[0], "the numbers", least=1) if numbers else 1
                if (self.lines.words() or [""])[0].upper() != "LOOKUP_TABLE":
                    raise self.lines.damaged(f"the LOOKUP_TABLE of {name[:40]!r} should be here")
                self._keep(name, self.count, each, kind)
            case ["COLOR_SCALARS", name, numbers]:
                self._keep(name, self.count, count(numbers, "the numbers", least=1), colour)
            case ["LOOKUP_TABLE", _, number]:
                self._array(count(number, "a table"), 4, colour, "a table")
            case ["TEXTURE_COORDINATES", name, numbers, kind]:
                self._keep(name, self.count, count(numbers, "the numbers"), kind)
            case [_, name, kind] if keyword in ATTRIBUTES:
                self._keep(name, self.count, ATTRIBUTES[keyword], kind)
            case _:
                raise self.lines.damaged(f"a section begins with {' '.join([keyword, *words])[:60]!r}")

    def _field(self, arrays: int) -> None:
        """Read arrays that bring their own sizes."""
        done = 0
        while done < arrays:
            match self.lines.words():
                case ["METADATA"]:
                    self._skip_metadata()
                case [name, numbers, rows, kind]:
                    each, count = self.lines.count(numbers, "the numbers"), self.lines.count(rows, "the rows")
                    self._keep(name, count, each, kind)
                    done += 1
                case words:
                    raise self.lines.damaged(f"an array begins with {' '.join(words)[:60]!r}")

    def _skip_metadata(self) -> None:
        while self.lines.line():
            pass  # an empty line ends it

    def _cells(self, cells: int, numbers: int) -> None:
        if not self.has_offsets:
            self._array(numbers, 1, "int", "the cells")
            return
        for keyword, count in (("OFFSETS", cells), ("CONNECTIVITY", numbers)):
            match self.lines.words():
                case [word, kind] if word.upper() == keyword:
                    self._array(count, 1, kind, "the cells")
                case _:
                    raise self.lines.damaged(f"{keyword} of the cells should be here")

    def _keep(self, name: str, count: int, each: int, kind: str) -> None:
        """Read an attribute, and keep it if it is one of points."""
        values = self._array(count, each, kind, f"{name[:40]!r}")
        if self.of_points:
            self.attributes[name] = values

    def _array(self, count: int, each: int, kind: str, what: str) -> NDArray[Any]:
        """Read an array [count, each]."""
        if not 0 <= each <= MOST_NUMBERS:
            raise self.lines.damaged(f"{what} has {each:,} numbers a point")
        if kind.lower() not in TYPES:
            raise VolumeError(
                f"{self.path}: {what} is of type {kind[:20]!r}, which cannot be read; export it without"
            )
        dtype = np.dtype(TYPES[kind.lower()])
        if self.is_text:
            values = self.lines.typed(self.lines.text_numbers(count * each, what), dtype, what)
        else:
            values = self.lines.numbers(count * each, dtype.newbyteorder(">"), what)
        return values.reshape(count, each)
