"""Which frames a command is of, and what their files are called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from tfm_cl.cli.options import GroupedOption
from tfm_cl.errors import InputError
from tfm_cl.files.patterns import FilePattern
from tfm_cl.sequence.ranges import LARGEST_FRAME, frames_of

Frame = float | None
"""None where nothing changes from frame to frame."""


frame_option = click.option(
    "--frame",
    metavar="N",
    type=click.FLOAT,
    cls=GroupedOption,
    group="Sequence",
    help="one frame of a scene that changes from frame to frame",
)
"""Of every command that reads scenes of one frame."""


def frame_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--frames``, ``--frame`` and ``--turntable`` to a command."""
    function = frame_option(function)
    for flag, metavar, kind, text in (
        (
            "--turntable",
            "N",
            click.INT,
            "turn the camera once about camera.up through camera.to in N frames, 1 to N",
        ),
        (
            "--frames",
            "RANGE",
            click.STRING,
            "frames to render, as 1-100, 1-100x2 or 3,5-10,47; -o has #### in place of their numbers",
        ),
    ):
        function = click.option(
            flag, default=None, metavar=metavar, type=kind, cls=GroupedOption, group="Sequence", help=text
        )(function)
    return function


def frames_asked(frames: str | None, frame: float | None, turntable: int | None) -> tuple[Frame, ...]:
    """Return the frames that the options ask for; one that is None without any.

    Raises
    ------
    click.UsageError
        Both one frame and several, or no frame that there can be.
    InputError
        No range of frames.
    """
    if frames is not None and frame is not None:
        raise click.UsageError("--frame is one frame, --frames are several; keep one")
    if turntable is not None and turntable < 1:
        raise click.UsageError(f"--turntable {turntable}: should be a number of frames from 1")
    if frames is not None:
        return _read("--frames", frames)
    if frame is not None:
        return (checked(frame),)
    return (None,) if turntable is None else _read("--turntable", f"1-{turntable}")


def checked(frame: float | None) -> Frame:
    """Return the frame that ``--frame`` names.

    Raises
    ------
    click.UsageError
        There can be no such frame.
    """
    if frame is None:
        return None
    if not abs(frame) <= LARGEST_FRAME:
        raise click.UsageError(f"--frame {frame:g}: should be a number up to {LARGEST_FRAME:,}")
    return int(frame) if frame.is_integer() else frame


def _read(flag: str, frames: str) -> tuple[int, ...]:
    try:
        return frames_of(frames)
    except InputError as error:
        raise InputError(f"{flag}: {error}") from None


def check_names(outputs: Sequence[Path], frames: Sequence[Frame]) -> None:
    """Refuse several frames of one name, and patterns of names without frames.

    Raises
    ------
    click.UsageError
        Says what to do.
    """
    for path in outputs:
        is_pattern = FilePattern.of(path) is not None
        if is_pattern and frames == (None,):
            raise click.UsageError(f"{path}: is a name of many frames; say which: --frames 1-24")
        if is_pattern and not all(isinstance(frame, int) for frame in frames):
            raise click.UsageError(f"{path}: has no place for frame {frames[0]:g}; choose a plain name")
        if not is_pattern and len(frames) > 1:
            stem, dot, rest = path.name.partition(".")
            name = path.with_name(f"{stem}.####{dot}{rest}")
            raise click.UsageError(f"{path}: {len(frames):,} frames, one name; add ####, as {name}")


def named(outputs: Sequence[Path], frame: Frame) -> tuple[Path, ...]:
    """Return the names of a frame's outputs."""
    patterns = ((path, FilePattern.of(path)) for path in outputs)
    return tuple(path if pattern is None else Path(pattern.at(int(frame or 0))) for path, pattern in patterns)
