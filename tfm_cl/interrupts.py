"""Keeping Ctrl-C to the thread that can do something about it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C waiting, where the system can: threads and processes begun now never hear of it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def interrupts_ours() -> Iterator[None]:
    """Keep Ctrl-C waiting while a compiler works, and take it back from it.

    LLVM answers the signal itself from its first file on: it removes the files that it is writing, in any
    thread, which fails what it compiles there, aloud. It claims the signal once only.
    """
    with interrupts_held():
        try:
            yield
        finally:
            handler = signal.getsignal(signal.SIGINT)
            if handler is not None and threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, handler)
