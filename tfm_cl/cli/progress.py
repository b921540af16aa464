"""How far a command is, on stderr: a bar only on a terminal, a line about what takes long on any."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from tfm_cl.cli.streams import one_line

if TYPE_CHECKING:  # printing a configuration needs no OpenCL
    from tfm_cl.cli.openjd import FarmLines
    from tfm_cl.device.launch import Progress


@contextmanager
def progress_bar(*, quiet: bool, farm: "FarmLines | None" = None) -> "Iterator[Progress]":
    """Give a callback ``progress(stage, fraction)`` that draws a bar for each stage, or tells a farm.

    Unless ``quiet``, what the library tells meanwhile, as that it compiles kernels, is printed.
    """
    if farm is not None:
        with nullcontext() if quiet else log_shown("tfm: %(message)s", logging.INFO):
            yield farm.advance
        return
    if quiet:
        yield lambda _stage, _fraction: None
        return
    with log_shown("tfm: %(message)s", logging.INFO):
        if sys.stderr.isatty():
            with _bar() as advance:
                yield advance
        else:
            yield lambda _stage, _fraction: None


class _OneLine(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """Return a message as one line of bearable length."""
        return one_line(super().format(record))


@contextmanager
def log_shown(form: str, level: int) -> Iterator[None]:
    """Print what the library's logger is told meanwhile, from a level on, to stderr."""
    log = logging.getLogger("tfm_cl")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_OneLine(form))
    before = log.level
    log.addHandler(handler)
    log.setLevel(level)
    try:
        yield
    finally:
        log.setLevel(before)
        log.removeHandler(handler)


@contextmanager
def _bar() -> "Iterator[Progress]":
    from tqdm import tqdm  # noqa: PLC0415 - only where a bar is drawn

    bar: tqdm[None] | None = None

    def advance(stage: str, fraction: float) -> None:
        nonlocal bar
        if bar is None or bar.desc.removesuffix(": ") != stage:
            if bar is not None:
                bar.close()
            bar = tqdm(
                total=100,
                desc=stage,
                leave=False,
                bar_format="{desc}: {percentage:3.0f}% {bar:30} {elapsed}<{remaining}",
            )
            bar.desc = stage
        bar.update(100 * fraction - bar.n)

    try:
        yield advance
    finally:
        if bar is not None:
            bar.close()
