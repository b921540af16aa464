"""Keeping Ctrl-C, and SIGTERM, to the thread that can do something about it; ending work of other threads."""

import signal
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")

SIGNALS = signal.SIGINT, signal.SIGTERM
"""What ends a program that may clean up: Ctrl-C, and what farms and systems send before they kill."""


_ask: ContextVar[Callable[[], None] | None] = ContextVar("ask", default=None)
"""Asks whether the work of this thread was cancelled."""


class TerminatedError(KeyboardInterrupt):
    """What SIGTERM raises after `end_on_sigterm`: whatever tidies up after Ctrl-C does so after this."""


def end_on_sigterm() -> None:
    """Let SIGTERM end this program as Ctrl-C does, unless whoever began it wants it ignored."""
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminated)


def _terminated(_number: int, _frame: Any) -> NoReturn:
    raise TerminatedError


@contextmanager
def cancelled_by(ask: Callable[[], None]) -> Iterator[None]:
    """Let `check_cancelled` call ``ask`` in what this thread does inside; it raises if that was cancelled."""
    before = _ask.set(ask)
    try:
        yield
    finally:
        _ask.reset(before)


def check_cancelled() -> None:
    """End what this thread does if it was cancelled: long work of the host asks between its parts.

    Raises
    ------
    CancelledError
        It was.
    """
    ask = _ask.get()
    if ask is not None:
        ask()


def cancellable(parts: Iterable[T]) -> Iterator[T]:
    """Yield parts of long work, each after `check_cancelled`."""
    for part in parts:
        check_cancelled()
        yield part


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


@contextmanager
def interrupts_to(end: Callable[[], None]) -> Iterator[None]:
    """Call a function, in a thread of its own, when one of `SIGNALS` comes; what they raise is raised after.

    So it ends what waits in other threads than Python's main one, whatever a compiler there does with the
    signal. Where the system cannot keep signals waiting, they are raised as ever.

    Parameters
    ----------
    end
        Ends what is done inside the block.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    is_over, came = False, list[int]()

    def hear(number: int) -> None:
        if not is_over:
            came.append(number)
            end()

    def wait() -> None:
        hear(signal.sigwait(SIGNALS))

    with interrupts_held(), _told_by_handlers(hear):
        waiting = threading.Thread(target=wait, name="signals", daemon=True)
        waiting.start()
        try:
            yield
        finally:
            is_over = True
            if waiting.is_alive():
                signal.pthread_kill(waiting.ident or 0, signal.SIGINT)
            waiting.join()
    if came:
        raise TerminatedError if came[0] == signal.SIGTERM else KeyboardInterrupt


@contextmanager
def _told_by_handlers(hear: Callable[[int], None]) -> Iterator[None]:
    """Call a function with `SIGNALS` that Python handles, at once and not when its main thread wakes up.

    Threads that libraries began before do not keep signals waiting, and may be those that get them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def listen() -> None:
        while numbers := ear.recv(64):
            for number in numbers:
                if number in SIGNALS:
                    hear(number)

    mouth, ear = socket.socketpair()
    with mouth, ear:
        mouth.settimeout(0)
        listening = threading.Thread(target=listen, name="signals handled", daemon=True)
        listening.start()
        before = signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            mouth.shutdown(socket.SHUT_WR)
            listening.join()
