"""Standard output and error: one line a message, and what becomes of a stream that cannot be written."""

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

START, END = 600, 300
"""Characters that are left of a message that is longer."""


def one_line(message: str) -> str:
    """Return a message as one line of bearable length: names from files may hold line breaks and anything."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)
    return shown if len(shown) <= START + END else f"{shown[:START]} … {shown[-END:]}"


STDERR = 2
"""Number of the last standard descriptor."""


class Guarded:
    """A stream that a command may write to whatever has become of it: what cannot be written goes nowhere.

    Parameters
    ----------
    stream
        None where the program was started without.
    """

    failure: OSError | None = None
    """Why the first of it could not be written; None too where the reader has left, as ``head`` does."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream if stream is not None else io.StringIO()
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks × is no reason to fail

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":  # click would write to that
            raise AttributeError(name)
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write."""
        with self._never_failing():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush."""
        with self._never_failing():
            self._stream.flush()

    @contextlib.contextmanager
    def _never_failing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno != errno.EPIPE:
                self.failure = error
            # What is still in the buffer would fail again, at the latest when the interpreter ends.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextlib.contextmanager
def guarded_streams() -> Iterator[Guarded]:
    """Let nothing go wrong in here because standard output or error is full or closed; yields the output."""
    if None in (sys.stdout, sys.stderr):
        _fill_standard_descriptors()
    out, err = Guarded(sys.stdout), Guarded(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            yield out
        finally:
            out.flush()
            err.flush()


def _fill_standard_descriptors() -> None:
    """Open nothing in the place of what is closed: else a picture gets its number, and what drivers print."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= STDERR:
        pass
    os.close(descriptor)
