"""Names of files with a frame's number in them: ``smoke.####.vdb``, ``smoke.%04d.vdb``, ``smoke.$F4.vdb``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HASH_DIGITS = 4
"""Of a lone ``#``, as in Houdini's and Nuke's file dialogs and in fileseq; a run of n is n digits."""
MOST_ENTRIES = 1_000_000
"""Of a folder, that are looked at."""
MOST_SHOWN = 200
"""Letters of the frames that a message names."""

_PLACE = re.compile(
    r"(?P<hashes>#+)"
    r"|%(?:0(?P<printf>[1-9]))?d"
    r"|\$F(?:(?P<houdini>[1-9])|(?![A-Za-z0-9_]))"
    r"|\$\{F(?P<braced>[1-9])?\}"
)
"""What stands for a frame's number."""
_NUMBER = r"-?[0-9]{1,18}"


@dataclass(frozen=True)
class FilePattern:
    """A file's name with the place of a frame's number.

    ``####`` is a number of at least four digits, ``#`` too, ``##`` of two; ``%04d`` and ``$F4`` of four;
    ``%d`` and ``$F`` of as many as it has. Every such place takes the number, in folders too. A minus sign
    counts as a digit, as in C's ``printf``: ``-005``.
    """

    text: str
    """The name, as it was written."""
    parts: tuple[str, ...]
    """The text between the places."""
    widths: tuple[int, ...]
    """Digits of the number in each place, at least; 0: as many as it has."""

    @classmethod
    def of(cls, name: str | os.PathLike[str], folder: Path = Path()) -> FilePattern | None:
        """Return the pattern that a name is; None for the name of a single file.

        What is really called so is no pattern: neither a file nor the folders that it is in.

        Parameters
        ----------
        name
            What a user wrote.
        folder
            That a relative name is relative to.
        """
        text = os.fspath(name)
        if _PLACE.search(text) is None or _exists(folder / text):
            return None
        literal = _literal_folders(text, folder)
        parts, widths, end = [], [], 0
        for place in _PLACE.finditer(text, literal):
            parts.append(text[end : place.start()])
            widths.append(_width(place))
            end = place.end()
        return cls(text, (*parts, text[end:]), tuple(widths)) if widths else None

    def at(self, frame: int) -> str:
        """Return the name of a frame's file."""
        numbers = [f"{frame:0{width}d}" for width in self.widths]
        return "".join(piece for pair in zip(self.parts, (*numbers, ""), strict=True) for piece in pair)

    def frame_of(self, name: str | os.PathLike[str]) -> int | None:
        """Return the frame whose file is called so; None where none is."""
        text = os.fspath(name)
        found = re.fullmatch(f"({_NUMBER})".join(map(re.escape, self.parts)), text, re.DOTALL)
        frame = int(found[1]) if found else None
        return frame if frame is not None and self.at(frame) == text else None

    def frames_in(self, folder: Path = Path()) -> tuple[int, ...]:
        """Return the frames whose files are there, in order; ``folder``: as of `of`."""
        known = [""]
        *folders, last = re.split(r"(?<=/)", self.text)
        for part in (*folders, last):
            known = [name for before in known for name in _like(before, part, folder)]
        found = (self.frame_of(name) for name in known)
        return tuple(sorted({frame for frame in found if frame is not None}))


def shown_frames(frames: Iterable[int]) -> str:
    """Write frames as a range, ``1-24,30``, of bearable length."""
    from fileseq.frameset import FrameSet  # noqa: PLC0415 - only where something is missing

    text = FrameSet.from_iterable(frames, sort=True).frameRange()
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN].rpartition(',')[0]},…"


def _width(place: re.Match[str]) -> int:
    if place["hashes"]:
        return HASH_DIGITS if len(place["hashes"]) == 1 else len(place["hashes"])
    return int(place["printf"] or place["houdini"] or place["braced"] or 0)


def _literal_folders(text: str, folder: Path) -> int:
    """Return how many letters of a name are those of folders that are really called so."""
    end = 0
    while (slash := text.find("/", end)) >= 0 and _exists(folder / text[: slash + 1]):
        end = slash + 1
    return end


def _like(before: str, part: str, folder: Path) -> list[str]:
    """Return names that continue ``before`` by a part of a pattern: a file's or, with a ``/``, a folder's."""
    name = part.removesuffix("/")
    pieces = _PLACE.split(name)[:: _PLACE.groups + 1]
    if len(pieces) == 1:
        return [before + part]
    form = re.compile(_NUMBER.join(map(re.escape, pieces)), re.DOTALL)
    found = []
    try:
        with os.scandir(folder / before) as entries:
            for _, entry in zip(range(MOST_ENTRIES), entries, strict=False):
                if form.fullmatch(entry.name):
                    found.append(before + entry.name + part[len(name) :])
    except OSError:
        return []
    return found


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False
