"""Where the work of a sweep is done: here, one piece after the other, or in other processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from tfm_cl.errors import DeviceError, InputError
from tfm_cl.sweep_work import Task, Worker

if TYPE_CHECKING:
    from tfm_cl.passes.launch import Progress
    from tfm_cl.renderer import Renderer

MOST_JOBS = 61
"""More processes than this Windows cannot wait for."""


@dataclass(frozen=True)
class Job:
    """A call of one of `Worker`'s methods."""

    method: str
    arguments: tuple[Any, ...]
    label: str
    """For people."""
    weight: float
    """Its share of the work, in any unit."""
    done: Callable[[Job, Any], list[Job]]
    """Takes the job and what it gave, and returns the jobs that can be done now because of it."""


class Tracker(Protocol):
    """What is told of progress."""

    def step(self, job: Job) -> AbstractContextManager[Progress]:
        """Report a job that runs here."""

    def finished(self, job: Job) -> None:
        """Report a job that ran elsewhere."""


class Here:
    """One piece after the other, in this process.

    Parameters
    ----------
    task
        What is swept.
    renderer, device
        What renders; or, where it is None, part of the name of the device of one made for the purpose.
    """

    def __init__(self, task: Task, renderer: Renderer | None, device: str | None) -> None:
        if renderer is None:
            self._renderer: AbstractContextManager[Renderer] = _renderer(device)
        else:
            self._renderer = nullcontext(renderer)
        self._task = task

    def __enter__(self) -> Self:
        self._worker = Worker(self._task, self._renderer.__enter__())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        del self._worker
        self._renderer.__exit__(kind, error, trace)

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs in order; those that they lead to come next."""
        queue = deque(jobs)
        while queue:
            job = queue.popleft()
            with tracker.step(job) as progress:
                result = getattr(self._worker, job.method)(*job.arguments, progress)
            queue.extendleft(reversed(job.done(job, result)))


class Processes:
    """Several pieces at a time, each in a process with a renderer of its own.

    They share nothing but the folder, and end with this one: Ctrl-C is heard here only. What they were doing
    then is lost; it leaves halves of images, which `SweepFolder.tidy` removes.

    Parameters
    ----------
    task
        What is swept.
    count
        Processes.
    device
        Part of the name of the device.

    Raises
    ------
    InputError
        When the task cannot be sent to other processes.
    """

    def __init__(self, task: Task, count: int, device: str | None) -> None:
        try:
            pickle.dumps(task)
        except Exception as error:
            raise InputError(
                "several jobs need overrides that other processes can import: pairs of key and value, or a "
                f"function of a module ({error})"
            ) from error
        self._others = set(multiprocessing.active_children())
        self._pool = ProcessPoolExecutor(
            count, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(task, device)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            ours = set(multiprocessing.active_children()) - self._others
            for process in ours:
                process.terminate()
            for process in ours:
                process.join()
        self._pool.shutdown()

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs in any order, earlier ones first; those that they lead to come last.

        Raises
        ------
        DeviceError
            When a process ends by itself.
        """
        running: dict[Future[Any], Job] = {}
        self._submit(jobs, running)
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job = running.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool as error:
                    raise DeviceError(
                        f"{job.label}: a process ended by itself, perhaps for lack of memory; use fewer jobs"
                    ) from error
                tracker.finished(job)
                self._submit(job.done(job, result), running)

    def _submit(self, jobs: list[Job], running: dict[Future[Any], Job]) -> None:
        with _interrupts_held():  # processes begin here, and inherit that
            for job in jobs:
                running[self._pool.submit(_do, job.method, job.arguments)] = job


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C waiting, where the system can: a process begun now never hears of it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _renderer(device: str | None) -> Renderer:
    from tfm_cl.renderer import Renderer  # noqa: PLC0415 - a caller's own renderer needs no OpenCL

    return Renderer(device)


# ----------------------------------------------------------------------------- in the other processes

_begun: list[tuple[Task, str | None]] = []
_worker: list[Worker] = []


def _begin(task: Task, device: str | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _begun.append((task, device))


def _end_with_parent() -> None:
    """End when the first process was killed: nobody would ever send work again, or say that it is over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(method: str, arguments: tuple[Any, ...]) -> Any:
    if not _worker:  # not in `_begin`, whose errors are lost
        task, device = _begun[0]
        _worker.append(Worker(task, _renderer(device)))
    return getattr(_worker[0], method)(*arguments, _silent)


def _silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
