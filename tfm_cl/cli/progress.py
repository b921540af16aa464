"""A progress bar on stderr, only on a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # printing a configuration needs no OpenCL
    from tfm_cl.device.launch import Progress


@contextmanager
def progress_bar(*, quiet: bool) -> "Iterator[Progress]":
    """Give a callback ``progress(stage, fraction)`` that draws a bar for each stage."""
    if quiet or not sys.stderr.isatty():
        yield lambda _stage, _fraction: None
        return
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
