"""What the files of a range are called, and where what is noted of it lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tfm_cl.files.paths import remove_unfinished
from tfm_cl.files.patterns import FilePattern

ENDS = "._- "
"""What is between the name of a sequence and a frame's number."""


@dataclass(frozen=True)
class Files:
    """What the files of a range are called.

    Parameters
    ----------
    pictures
        Patterns, one for each picture of a frame; at least one.
    configs
        Likewise of scene files.
    every_key
        Whether these have keys at their default.
    """

    pictures: tuple[Path, ...]
    configs: tuple[Path, ...] = ()
    every_key: bool = False

    def of(self, frame: int) -> tuple[Path, ...]:
        """Return those of a frame, pictures first."""
        return tuple(path if pattern is None else Path(pattern.at(frame)) for path, pattern in self._patterns)

    @property
    def folder(self) -> Path:
        """The one that all frames of the first picture are in."""
        return Path(self._before + "x").parent

    @property
    def sequence(self) -> str:
        """What the frames are called without their numbers."""
        name = Path(self._before + "x").name[:-1].rstrip(ENDS)
        return name or self.pictures[0].name.lstrip("#").partition(".")[0].rstrip(ENDS) or "frames"

    @property
    def plan(self) -> Path:
        """The file of what is decided for the range."""
        return self.folder / f"{self.sequence}.plan.toml"

    @property
    def ledger(self) -> Path:
        """The folder of records and claims."""
        return self.folder / f".{self.sequence}.tfm"

    def remove_unfinished(self, frames: Sequence[int]) -> None:
        """Remove what processes were writing when they were killed."""
        ends = [[path.parent for path in self.of(frame)] for frame in (frames[0], frames[-1])]
        differ = ends[0] != ends[1]
        for folder in {path.parent for frame in frames if differ for path in self.of(frame)} or {*ends[0]}:
            remove_unfinished(folder)

    def name(self, frame: int) -> str:
        """Return what a frame is called beside all others."""
        return str(self.of(frame)[0])[len(str(self.folder / "x")) - 1 :].replace("/", "_")

    @cached_property
    def _patterns(self) -> list[tuple[Path, FilePattern | None]]:
        return [(path, FilePattern.of(path)) for path in (*self.pictures, *self.configs)]

    @property
    def _before(self) -> str:
        path, pattern = self._patterns[0]
        return str(path.with_suffix("") if pattern is None else pattern.parts[0])
