"""Keeping Ctrl-C, and SIGTERM, to the thread that can do something about it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

SIGNALS = signal.SIGINT, signal.SIGTERM
"""What ends a program that may clean up: Ctrl-C, and what farms and systems send before they kill."""


class TerminatedError(KeyboardInterrupt):
    """What SIGTERM raises after `end_on_sigterm`: whatever tidies up after Ctrl-C does so after this."""


def end_on_sigterm() -> None:
    """Let SIGTERM end this program as Ctrl-C does, unless whoever began it wants it ignored."""
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminated)


def _terminated(_number: int, _frame: Any) -> NoReturn:
    raise TerminatedError


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Keep `SIGNALS` waiting, where the system can: threads and processes begun now never hear of them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def interrupts_ours() -> Iterator[None]:
    """Keep `SIGNALS` waiting while a compiler works, and take them back from it.

    LLVM answers them itself from its first file on: it removes the files that it is writing, in any
    thread, which fails what it compiles there, aloud. It claims them once only.
    """
    with interrupts_held():
        try:
            yield
        finally:
            for number in SIGNALS if threading.current_thread() is threading.main_thread() else ():
                handler = signal.getsignal(number)
                if handler is not None:
                    signal.signal(number, handler)
