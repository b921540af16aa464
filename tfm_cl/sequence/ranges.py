"""Ranges of frames: ``1-100``, ``1-100x2``, ``3,5-10,47-327``, ``100-1``."""

from __future__ import annotations

import re

from tfm_cl.errors import InputError

MOST_FRAMES = 1_000_000
"""Of one range."""
LARGEST_FRAME = 10**9
"""Number of a frame, either side of 0."""

_PART = re.compile(r"(-?\d{1,12})(?:-(-?\d{1,12})(?:([xy:])(\d{1,12}))?)?")
FORMS = "1-100, 1-100x2 (every second), 3,5-10,47-327, or 100-1"


def frames_of(text: str) -> tuple[int, ...]:
    """Return the frames of a range, each once, in the order in which it names them.

    Parameters
    ----------
    text
        Frames and ranges with commas or spaces between. ``1-9x2`` is every second, ``1-9y2`` all others, and
        ``1-9:3`` the same frames in passes of every third, every second and every one, as in OpenCue and
        fileseq, which reads them.

    Raises
    ------
    InputError
        It is no range, or has more than `MOST_FRAMES` frames.
    """
    parts = [part for part in re.split(r"[,\s]+", text.strip()) if part]
    read = [_PART.fullmatch(part) for part in parts]
    for part, found in zip(parts or [text], read or [None], strict=True):
        if found is None:
            raise InputError(f"'{part}': is no range of frames; write {FORMS}")
        if found[4] is not None and int(found[4]) == 0:
            raise InputError(f"'{part}': a step of 0 leads nowhere; write {FORMS}")
        if max(abs(int(number)) for number in found.group(1, 2) if number) > LARGEST_FRAME:
            raise InputError(f"'{part}': frames are numbers up to {LARGEST_FRAME:,}")
    if sum(map(_count, filter(None, read))) > MOST_FRAMES:
        raise InputError(f"'{text}': more than {MOST_FRAMES:,} frames; render them in parts")
    from fileseq.frameset import FrameSet  # noqa: PLC0415 - single frames need none

    return tuple(dict.fromkeys(int(frame) for part in parts for frame in FrameSet(part)))


def _count(part: re.Match[str]) -> int:
    """Return how many frames a part has, at most."""
    first, last = int(part[1]), int(part[2] or part[1])
    step = int(part[4]) if part[3] == "x" else 1
    return abs(last - first) // step + 1
