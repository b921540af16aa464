"""Executes the jobs of a sweep: one after another in this process, or in other processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from types import TracebackType
from typing import Any, Protocol, Self

from tfm_cl.device.scratch import make_scratch
from tfm_cl.errors import DeviceError, InputError, TfmError, TfmWarning
from tfm_cl.interrupts import interrupts_held

Progress = Callable[[str, float], None]

MOST_JOBS = 61
"""Largest number of processes; Windows cannot wait for more."""


@dataclass(frozen=True)
class Job:
    """A call of one of a worker's methods."""

    method: str
    arguments: tuple[Any, ...]
    label: str
    """Name of the job in messages."""
    weight: float
    """Amount of work, in an arbitrary unit."""
    done: Callable[[Job, Any], list[Job]]
    """Takes the job and its result, and returns the jobs that it makes possible."""


class Tracker(Protocol):
    """Callbacks for progress."""

    def step(self, job: Job) -> AbstractContextManager[Progress]:
        """Report a job that runs in this process."""

    def finished(self, job: Job) -> None:
        """Report a job that ran in another process."""


class Here:
    """Executes jobs one after another in this process.

    Parameters
    ----------
    worker
        What does the work, from when it is entered.
    """

    def __init__(self, worker: AbstractContextManager[Any]) -> None:
        self._entered = worker

    def __enter__(self) -> Self:
        self._worker = self._entered.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        del self._worker
        self._entered.__exit__(kind, error, trace)

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs in order; each is followed by the jobs that it makes possible."""
        queue = deque(jobs)
        while queue:
            job = queue.popleft()
            with tracker.step(job) as progress:
                result = getattr(self._worker, job.method)(*job.arguments, progress)
            queue.extendleft(reversed(job.done(job, result)))


class Processes:
    """Executes several jobs at a time, each in a process with a renderer of its own.

    The processes share only the folder and end with this one; only this process handles Ctrl-C. Their
    unfinished work is then lost and may leave incomplete images, which `SweepFolder.close` removes.

    Each process has its own pipe, which this process reads and writes in one thread. There is no queue, lock
    or helper thread that a terminated process could leave in an invalid state.

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
        try:
            pickle.dumps(make_worker)
        except Exception as error:
            raise InputError(
                "several jobs need overrides that other processes can import: pairs of key and value, or a "
                f"function of a module ({error})"
            ) from error
        self._make_worker, self._count = make_worker, count
        self._processes: dict[Connection, SpawnProcess] = {}

    def __enter__(self) -> Self:
        self._scratch = make_scratch()  # terminated processes do not clean up after themselves
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with interrupts_held():
            for pipe, process in self._processes.items():
                if kind is not None:
                    process.kill()  # at once: compilers print messages on gentler signals
                pipe.close()  # this tells the process that there is no more work
            for process in self._processes.values():
                process.join()
            self._processes.clear()
            self._scratch.close()

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs in any order, earlier ones first; jobs that they make possible come last.

        Raises
        ------
        DeviceError
            If a process ends by itself.
        """
        waiting = deque(jobs)
        running: dict[Connection, Job] = {}
        while waiting or running:
            while waiting and (pipe := self._idle(running)) is not None:
                running[pipe] = job = waiting.popleft()
                with _other_end(job):
                    pipe.send((job.method, job.arguments))
            ready = set(wait(running))
            for pipe in [pipe for pipe in running if pipe in ready]:
                job = running.pop(pipe)
                with _other_end(job):
                    result, error = pipe.recv()
                if error is not None:
                    raise error
                tracker.finished(job)
                waiting.extend(job.done(job, result))

    def _idle(self, running: dict[Connection, Job]) -> Connection | None:
        """Return the pipe of an idle process, which may be started now; None if all are busy."""
        idle = next((pipe for pipe in self._processes if pipe not in running), None)
        if idle is None and len(self._processes) < self._count:
            idle, theirs = multiprocessing.Pipe()
            process = multiprocessing.get_context("spawn").Process(
                target=_serve, args=(theirs, self._make_worker, str(self._scratch.path)), daemon=True
            )
            try:
                if os.name == "posix":
                    resource_tracker.ensure_running()  # starting a process ends the blocking of interrupts
                with interrupts_held():  # the process inherits this
                    process.start()
                    self._processes[idle] = process
            except OSError as error:
                idle.close()
                raise DeviceError(
                    f"jobs = {self._count}: a process cannot be started ({error.strerror}); use fewer jobs"
                ) from error
            finally:
                theirs.close()  # the process has its own end: when that closes, ours notices
        return idle


@contextmanager
def _other_end(job: Job) -> Iterator[None]:
    """Convert the error of a pipe whose process is gone into an error that names the job."""
    try:
        yield
    except (EOFError, OSError) as error:
        raise DeviceError(
            f"{job.label}: a process ended by itself, perhaps for lack of memory; use fewer jobs"
        ) from error


# ----------------------------------------------------------------------------- in the other processes


def _serve(pipe: Connection, make_worker: Callable[[], Any], scratch: str) -> None:
    """Do the jobs from a pipe until it closes; answer each with its result or error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    tempfile.tempdir = scratch
    warnings.simplefilter("ignore", TfmWarning)  # the first process cannot catch them
    worker: Any = None
    while True:
        try:
            method, arguments = pipe.recv()
        except (EOFError, OSError):
            return
        result: Any = None
        failure: Exception | None = None
        try:
            worker = worker or make_worker()
            result = getattr(worker, method)(*arguments, _silent)
        except Exception as error:  # noqa: BLE001 - the first process raises it
            failure = _portable(error)
        pipe.send((result, failure))


def _portable(error: Exception) -> Exception:
    """Return an error that can be sent; an unexpected one includes its traceback."""
    if not isinstance(error, TfmError):
        error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - our own data
    except Exception:  # noqa: BLE001 - for whatever reason
        return RuntimeError("".join(traceback.format_exception(error)))
    return error


def _end_with_parent() -> None:
    """End if the first process was killed: nobody would send work or say that it is over."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
