"""Which files are the frames of a film, in which order, and what becomes of those that are missing."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, get_args

from tfm_cl.errors import ImageError
from tfm_cl.files.paths import is_file, path_of, source_of
from tfm_cl.files.patterns import FilePattern, shown_frames

Missing = Literal["error", "hold", "skip"]
MISSING: tuple[Missing, ...] = get_args(Missing)
"""What becomes of frames that are not there: ``hold`` shows the one before, or the first, in their place."""

_NUMBERED = re.compile(r"(.*?)(\d+)(\D*)", re.DOTALL)
"""What comes before the last number of a name, the number, and what comes after."""
MOST_FRAMES = 1_000_000
"""Of a film."""


@dataclass(frozen=True)
class Frame:
    """One picture of a film."""

    number: int
    path: Path


def frames_of(
    names: Sequence[str], asked: Sequence[int] | None = None, missing: Missing = "error"
) -> list[Frame]:
    """Find the frames of a film.

    Parameters
    ----------
    names
        A pattern (see `tfm_cl.files.patterns`), or files. Files whose names differ in their last number only
        are put in its order; others stay as they are, and are numbered from 1.
    asked
        Numbers of a pattern's frames, in the film's order; None: all that are there.
    missing
        What becomes of those that are not there. Where ``asked`` does not say which should be, they are the
        gaps in the step of those that are there.

    Raises
    ------
    ImageError
        No frames, frames that are missing, or ``asked`` beside files.
    """
    pattern = FilePattern.of(path_of(names[0], ImageError)) if len(names) == 1 else None
    if pattern is not None:
        what = names[0]
        paths = {number: Path(pattern.at(number)) for number in asked or pattern.frames_in()}
        there = {number: path for number, path in paths.items() if is_file(path)}
    elif asked is not None:
        raise ImageError(f"{names[0]}: has no place for the numbers of frames; write it like out.####.exr")
    else:
        files = [source_of(name, error=ImageError) for name in names]
        numbered = _numbered(files)
        if numbered is None:
            return [Frame(number, path) for number, path in enumerate(files, 1)]
        what, there = f"{files[0]} to {files[-1].name}" if len(files) > 1 else str(files[0]), numbered
    if not there:
        raise ImageError(f"{what}: no such file" + ("s" if pattern else ""))
    return _without_gaps(what, there, asked or _steps(what, sorted(there)), missing)


def _numbered(paths: Sequence[Path]) -> dict[int, Path] | None:
    """Return files by the last number of their names; None unless that alone tells them apart."""
    found, around = {}, set()
    for path in paths:
        parts = _NUMBERED.fullmatch(path.name)
        if parts is None:
            return None
        head, digits, tail = parts.groups()
        sign = -1 if head.endswith("-") and re.search(r"[._]-$", head) else 1
        found[sign * int(digits)] = path
        around.add((path.parent, head.removesuffix("-") if sign < 0 else head, tail))
    return found if len(found) == len(paths) and len(around) == 1 else None


def _steps(what: str, numbers: list[int]) -> Sequence[int]:
    """Return numbers from the first to the last in the largest step that meets them all."""
    step = math.gcd(*(after - before for before, after in pairwise(numbers))) or 1
    if (numbers[-1] - numbers[0]) // step >= MOST_FRAMES:
        raise ImageError(f"{what}: {numbers[0]} and {numbers[-1]} are too far apart to be of one film")
    return range(numbers[0], numbers[-1] + 1, step)


def _without_gaps(what: str, there: dict[int, Path], wanted: Sequence[int], missing: Missing) -> list[Frame]:
    gaps = [number for number in wanted if number not in there]
    if gaps and missing == "error":
        raise ImageError(
            f"{what}: no frame {shown_frames(gaps)}; render what is missing, or add --missing hold, which "
            "shows the frame before instead, or --missing skip"
        )
    if missing == "skip" or not gaps:
        return [Frame(number, there[number]) for number in wanted if number in there]
    return list(_held(there, wanted))


def _held(there: dict[int, Path], wanted: Sequence[int]) -> Iterator[Frame]:
    before = next(there[number] for number in wanted if number in there)
    for number in wanted:
        before = there.get(number, before)
        yield Frame(number, before)
