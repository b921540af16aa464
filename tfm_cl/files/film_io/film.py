"""A film as the formats know it: frames, and how they are to be shown."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError

SLOWEST, FASTEST = 0.1, 240
"""Fewest and most frames a second."""
MOST_CELLS = 100
"""Most columns, and most rows, of a contact sheet."""

Progress = Callable[[str, float], None]
"""Takes what is done, and how much of it, 0 to 1."""


class EncodingError(ImageError):
    """What encodes a film has failed, or cannot have frames like these."""


class Film(Protocol):
    """Frames of one size, each made when it is asked for."""

    @property
    def numbers(self) -> Sequence[int]:
        """Numbers of the frames, in the film's order."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        ...

    def codes(self, index: int) -> NDArray[np.uint8]:
        """Return a frame, counted from 0: sRGB, [H, W, 3], row 0 on top."""
        ...


@dataclass(frozen=True, kw_only=True)
class FilmOptions:
    """Options for writing a film; each format uses those that apply to it."""

    fps: float = 24.0
    """Frames a second."""
    quality: int = 80
    """From 0, smallest, to 100."""
    contact_sheet: tuple[int, int] = (6, 4)
    """Columns and rows, at most."""

    def __post_init__(self) -> None:
        if not SLOWEST <= self.fps <= FASTEST:
            raise ImageError(
                f"fps is a number of frames a second from {SLOWEST} to {FASTEST}; got {self.fps:g}"
            )
        if not 0 <= self.quality <= 100:  # noqa: PLR2004 - percent
            raise ImageError(f"quality is a number from 0 to 100; got {self.quality}")
        if not all(1 <= cells <= MOST_CELLS for cells in self.contact_sheet):
            columns, rows = self.contact_sheet
            raise ImageError(f"a contact sheet has 1 to {MOST_CELLS} columns and rows; got {columns}x{rows}")

    def milliseconds(self, count: int, unit: int = 1) -> list[int]:
        """Return how long each frame is shown: whole units of milliseconds, which add up to the whole."""
        second = 1000 / (unit * Fraction(self.fps))
        ends = [round(second * end) for end in range(count + 1)]
        return [unit * (ends[i + 1] - ends[i]) for i in range(count)]
