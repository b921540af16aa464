"""Jobs in other processes of this machine, as `concurrent.futures` spawns them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
import uuid
import warnings
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tfm_cl.device.scratch import make_scratch
from tfm_cl.errors import DeviceError, TfmWarning
from tfm_cl.interrupts import interrupts_held
from tfm_cl.jobs.futures import Futures, LostError, portable, sendable
from tfm_cl.jobs.job import Job, silent

MOST_JOBS = 61
"""Largest number of processes; Windows cannot wait for more."""

LARGEST_SENT = 32 << 10
"""Bytes that go through the executor's pipes; what is larger goes through files. A process that is killed
while it writes more than a pipe holds, 64 KiB, leaves an executor waiting for the rest."""


class Processes(Futures):
    """Executes several jobs at a time, each in a process with a renderer of its own.

    The processes share files only, and end with this one; only this process handles Ctrl-C and SIGTERM. Their
    unfinished work is then lost and may leave unfinished files, which whoever asks for the work removes.

    Where a process ends by itself, the jobs that ran are done once more, each alone.

    Parameters
    ----------
    make_worker
        Makes what does the work, in each process.
    count
        Largest number of processes; they start when there is work for them.

    Raises
    ------
    InputError
        When what makes the worker cannot be sent to other processes.
    """

    def __init__(self, make_worker: Callable[[], Any], count: int) -> None:
        sendable(make_worker)
        self._make_worker, self._count = make_worker, count
        self._executor: ProcessPoolExecutor | None = None
        self._context = _Context()
        self._suspected: set[int] = set()
        """Of the jobs that ran when a process ended, and have not ended since."""

    def __enter__(self) -> Self:
        self._scratch = make_scratch()  # terminated processes do not clean up after themselves
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with interrupts_held():
            self._end(kill=kind is not None)
            self._scratch.close()

    def _end(self, *, kill: bool) -> None:
        if self._executor is not None:
            if kill:
                for process in filter(SpawnProcess.is_alive, self._context.started):
                    process.kill()  # at once: compilers print messages on gentler signals
            self._executor.shutdown(cancel_futures=True)
        self._executor = None
        self._context.started.clear()

    def _has_room(self, running: int) -> bool:
        return running < (1 if self._suspected else self._count)

    def _submitted(self, job: Job) -> Future[Any]:
        if os.name == "posix":
            resource_tracker.ensure_running()  # starting a process ends the blocking of interrupts
        scratch = str(self._scratch.path)
        work = _packed((job.method, job.arguments), scratch)
        try:
            with interrupts_held():  # processes and threads that begin here inherit this
                if self._executor is None:
                    self._executor = ProcessPoolExecutor(
                        self._count, self._context, _begin, (self._make_worker, scratch)
                    )
                return self._executor.submit(_do, work)
        except BrokenProcessPool as error:  # a process ended that had nothing to do
            future: Future[Any] = Future()
            future.set_exception(error)
            return future
        except OSError as error:
            raise DeviceError(
                f"jobs = {self._count}: a process cannot be started ({error.strerror}); use fewer jobs"
            ) from error

    def _result(self, job: Job, future: Future[Any]) -> Any:
        try:
            result, error = _unpacked(future.result())
        except BrokenProcessPool:
            with interrupts_held():
                self._end(kill=True)
            if id(job) not in self._suspected:
                self._suspected.add(id(job))
                raise LostError from None
            self._suspected.remove(id(job))
            raise DeviceError(
                f"{job.label}: a process ended by itself, perhaps for lack of memory; use fewer jobs"
            ) from None
        self._suspected.discard(id(job))
        if error is not None:
            raise error
        return result

    def _look(self, jobs: list[Job]) -> None:
        """Do nothing: the executor notices when a process ends."""


class _Context(SpawnContext):
    """Spawns processes, and knows them."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(self, *args: Any, **keywords: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802 - its name
        """Make one."""
        process = SpawnProcess(*args, **keywords)
        self.started.append(process)
        return process


def _packed(value: Any, folder: str) -> bytes | Path:
    data = pickle.dumps(value)
    if len(data) <= LARGEST_SENT:
        return data
    path = Path(folder) / f"{uuid.uuid4().hex}.sent"
    path.write_bytes(data)
    return path


def _unpacked(sent: bytes | Path) -> Any:
    """Return what was packed; its file is gone afterwards."""
    if isinstance(sent, bytes):
        return pickle.loads(sent)  # noqa: S301 - our own data
    data = sent.read_bytes()
    sent.unlink()
    return pickle.loads(data)  # noqa: S301


# ----------------------------------------------------------------------------- in the other processes


class _Mine:
    """What this process works with."""

    make_worker: Callable[[], Any]
    scratch: str
    worker: Any = None


def _begin(make_worker: Callable[[], Any], scratch: str) -> None:
    """Prepare this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):  # the executor ends those that are left with SIGTERM
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    tempfile.tempdir = scratch
    warnings.simplefilter("ignore", TfmWarning)  # the first process cannot catch them
    _Mine.make_worker, _Mine.scratch = staticmethod(make_worker), scratch


def _do(work: bytes | Path) -> bytes | Path:
    """Do a job; returns its result or error."""
    result: Any = None
    failure: Exception | None = None
    try:
        method, arguments = _unpacked(work)
        _Mine.worker = _Mine.worker or _Mine.make_worker()
        result = getattr(_Mine.worker, method)(*arguments, silent)
    except Exception as error:  # noqa: BLE001 - the first process raises it
        failure = portable(error)
    return _packed((result, failure), _Mine.scratch)


def _end_with_parent() -> None:
    """End if the first process was killed: nobody would send work or say that it is over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
