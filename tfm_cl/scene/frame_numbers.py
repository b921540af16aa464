"""What is read from a file of its own in each frame: which file that is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from tfm_cl.errors import Fault, SceneError
from tfm_cl.files.paths import is_file, source_of
from tfm_cl.files.patterns import FilePattern, shown_frames
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Model

Missing = Literal["hold", "empty", "error"]


class FrameNumbers(Model):
    """Which of the files of a pattern, as ``smoke.####.vdb``, is that of a frame.

    It has the number ``frame_offset + frame_step * frame``, rounded down.
    """

    frame_offset: int = Field(
        default=0,
        examples=[100],
        ge=-LARGEST_COORDINATE,
        le=LARGEST_COORDINATE,
        description="with a pattern of files, as smoke.####.vdb: number of the file at frame 0, so 100 for "
        "files that begin a hundred later",
    )
    frame_step: float = Field(
        default=1.0,
        examples=[0.5],
        ge=-LARGEST_COORDINATE,
        le=LARGEST_COORDINATE,
        description="with a pattern of files: by how much the file's number grows from frame to frame; 0.5 "
        "shows each file for two frames, -1 runs backwards",
    )
    before: Missing = Field(
        default="error",
        examples=["empty"],
        description="with a pattern of files: what is there in frames before the first file; hold: the "
        "first file",
    )
    after: Missing = Field(
        default="error",
        examples=["hold"],
        description="with a pattern of files: what is there in frames after the last file; hold: the last "
        "file",
    )

    def number(self, frame: float) -> int:
        """Return the number of a frame's file; between whole frames it is that of the frame before."""
        return math.floor(self.frame_offset + self.frame_step * math.floor(frame))

    def frames(self, first: int, last: int) -> tuple[int, ...]:
        """Return the first and the last whole frame of files numbered so; none where all frames have one."""
        if self.frame_step == 0:
            return ()
        ends = [(number - self.frame_offset) / self.frame_step for number in (first, last + 1)]
        if self.frame_step > 0:
            return math.ceil(ends[0]), math.ceil(ends[1]) - 1
        return math.floor(ends[1]) + 1, math.floor(ends[0])


KEYS = tuple(FrameNumbers.model_fields)


class OfFrames(FrameNumbers):
    """What a scene file reads from a file, which may be another in each frame."""

    @model_validator(mode="after")
    def _has_files_of_frames(self) -> Self:
        """Refuse what says nothing; where a scene file names a pattern, these keys have done their work."""
        fields = FrameNumbers.model_fields
        said = [name for name in fields if getattr(self, name) != fields[name].default]
        if said:
            line = (
                f"{self.SECTION}.{said[0]}: is for files that change from frame to frame, whose name is a "
                "pattern, as NAME.####.EXTENSION; name them so, or leave it out"
            )
            raise PydanticCustomError("faults", "{lines}", {"lines": [Fault(line, (said[0],))]})
        return self


def name_at(pattern: FilePattern, frame: float, numbers: FrameNumbers, folder: Path = Path()) -> str | None:
    """Return the name of a frame's file; None where ``before`` or ``after`` says that there is none.

    Parameters
    ----------
    folder
        That a relative name is relative to.

    Raises
    ------
    SceneError
        The file is not there.
    """
    number = numbers.number(frame)
    name = pattern.at(number)
    if is_file(source_of(name, folder)):
        return name
    there = pattern.frames_in(folder)
    if not there:
        raise SceneError(f"frame {frame:g}: there is no {name}, nor any other of {pattern.text}")
    side: Literal["before", "after"] = "before" if number < there[0] else "after"
    if number in there:
        raise SceneError(f"frame {frame:g}: {name} is not a plain file, or leads nowhere")
    nearest = there[0 if side == "before" else -1]
    missing: Missing = getattr(numbers, side) if number not in range(there[0], there[-1] + 1) else "error"
    if missing != "error":
        return pattern.at(nearest) if missing == "hold" else None
    raise SceneError(
        f"frame {frame:g}: there is no {name}; of {pattern.text} there are {shown_frames(there)}"
        + (f'; {side} = "hold" would keep {nearest}' if number < there[0] or number > there[-1] else "")
    )
