"""Progress for render farms: lines on standard output as Open Job Description has them.

They are ``openjd_progress: PERCENT``, ``openjd_status: TEXT`` and ``openjd_fail: TEXT``.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import Any

import click

from tfm_cl.cli.options import GroupedOption
from tfm_cl.cli.streams import one_line
from tfm_cl.errors import TfmError
from tfm_cl.interrupts import TerminatedError


class FarmLines:
    """Tells how far some frames are."""

    count = 1
    """Number of frames."""

    def __init__(self) -> None:
        self._done, self._told = 0, -1
        self._begin()

    def _begin(self) -> None:
        self._stage, self._begun, self._left = "", 0.0, 1.0

    def advance(self, stage: str, fraction: float) -> None:
        """Tell of a frame's stage, as `tfm_cl.device.launch.Progress`.

        How many stages there are is not known before: each takes half of what is left.
        """
        if stage != self._stage:
            _say("status", stage)
            if self._stage:
                self._left /= 2
                self._begun += self._left
            self._stage = stage
        self._tell(self._begun + fraction * self._left / 2)

    def ended(self, status: str) -> None:
        """Count a frame that is done, kept or failed."""
        _say("status", status)
        self._done += 1
        self._begin()
        self._tell(0.0)

    def failed(self, line: str) -> None:
        """Tell what went wrong with a frame."""
        _say("fail", line)

    def _tell(self, fraction: float) -> None:
        """Tell whole per cents, each once."""
        percent = int(100 * min((self._done + fraction) / self.count, 1.0))
        if percent > self._told:
            self._told = percent
            _say("progress", str(percent))


def progress_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--progress`` to a command, which gets ``farm``: `FarmLines`, or None if the farm is none."""

    @click.option(
        "--progress",
        type=click.Choice(["bar", "openjd"]),
        default="bar",
        cls=GroupedOption,
        help="bar: drawn on a terminal; openjd: lines on stdout that render farms read, as Open Job "
        "Description has them  [bar]",
    )
    @functools.wraps(function)
    def command(*arguments: Any, progress: str, **given: Any) -> Any:
        if progress == "bar":
            return function(*arguments, farm=None, **given)
        with failures_told():
            if given["json_path"] == "-" or given["print_config"]:
                raise click.UsageError("--progress openjd: standard output is the farm's; write other files")
            return function(*arguments, farm=FarmLines(), **given)

    return command


@contextlib.contextmanager
def failures_told() -> Iterator[None]:
    """Tell, too, what a command fails for."""
    try:
        yield
    except TfmError as error:
        for line in error.args:
            _say("fail", str(line))
        raise
    except click.ClickException as error:
        _say("fail", error.format_message())
        raise
    except MemoryError:
        _say("fail", "out of memory")
        raise
    except (click.Abort, KeyboardInterrupt) as error:
        _say("fail", "terminated" if isinstance(error, TerminatedError) else "interrupted")
        raise


def _say(what: str, text: str) -> None:
    print(f"openjd_{what}: {one_line(text)}", flush=True)
