"""Measured phase functions: text with a cosine and a value in every line."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import check_readable, name_of, reason_of, source_of
from tfm_cl.model_fields import TEXT, Accepts, accepts

MAX_BYTES = 4 << 20
"""A file larger than this is not one."""
EXTENSIONS = (".txt", ".csv", ".tsv", ".dat")
"""Which such files mostly have; any other name will do."""
MOST_ROWS = 1 << 16
END = 1e-6
"""How far from -1 and 1 the first and last cosine may be written; they are moved there."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A phase function by its values: float64, read-only."""

    cosines: NDArray[np.float64]
    """Ascending from -1 to 1."""
    values: NDArray[np.float64]
    """Per steradian: linear in between, it integrates to 1 over the sphere."""


@accepts(TEXT)
def _name(value: Any) -> str:
    return "" if value == "" else name_of(value, "a file with a cosine and a value in every line")


TablePath = Accepts[str | Path, Annotated[str, PlainValidator(_name)]]
"""Path of a table; empty if there is none."""


def read(name: str) -> Curve:
    """Read a table: lines of two numbers, with white space or a comma between; ``#`` begins a remark.

    Raises
    ------
    SceneError
        The file cannot be read or holds other lines, or as `checked`.
    """
    path = source_of(name, error=SceneError)
    if check_readable(path, SceneError) > MAX_BYTES:
        raise SceneError(f"{path}: larger than {MAX_BYTES:,} bytes: not a table of a phase function")
    try:
        status = path.stat()
        return _kept(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({reason_of(error)})") from None


@lru_cache(maxsize=8)
def _kept(path: Path, _changed: int, _size: int) -> Curve:
    with path.open("rb") as file:
        text = file.read(MAX_BYTES).decode("utf-8-sig", errors="replace")
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            cosine, value = map(float, words)
        except ValueError:
            shown = ascii(line.strip()[:40])
            raise SceneError(f"{path}: line {number} should be a cosine and a value, not {shown}") from None
        rows.append((cosine, value))
        if len(rows) > MOST_ROWS:
            raise SceneError(f"{path}: has more than {MOST_ROWS:,} rows; leave some out")
    try:
        return checked(*np.array(rows, dtype=np.float64).reshape(-1, 2).T)
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None


def checked(cosines: NDArray[np.float64], values: NDArray[np.float64]) -> Curve:
    """Check a table, whose cosines may ascend or descend, of values on any scale.

    Raises
    ------
    ValueError
        Not of one length of 2 or more, cosines that are not in order or do not reach from -1 to 1, or values
        that are negative, not finite, or all 0.
    """
    if not 2 <= len(cosines) == len(values) <= MOST_ROWS:  # noqa: PLR2004 - both ends
        got = f"{len(cosines):,} and {len(values):,}"
        raise ValueError(f"should hold 2 to {MOST_ROWS:,} cosines and as many values; got {got}")
    if cosines[0] > cosines[-1]:
        cosines, values = cosines[::-1], values[::-1]
    rising = np.diff(cosines) > 0
    if not rising.all():
        at = int(np.argmin(rising))
        raise ValueError(f"cosines should be in order; {cosines[at]:g} and {cosines[at + 1]:g} are not")
    if not (abs(cosines[0] + 1) <= END and abs(cosines[-1] - 1) <= END):
        raise ValueError(f"cosines should reach from -1 to 1, not from {cosines[0]:g} to {cosines[-1]:g}")
    wrong = ~(values >= 0) | np.isinf(values)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"values should be finite and ≥ 0; at cosine {cosines[at]:g} is {values[at]:g}")
    if not values.any():
        raise ValueError("values are all 0: nothing would be scattered")
    cosines, values = cosines.copy(), values / values.max()
    cosines[[0, -1]] = -1, 1
    values /= 2 * np.pi * np.trapezoid(values, cosines)
    cosines.flags.writeable = values.flags.writeable = False
    return Curve(cosines, values)
