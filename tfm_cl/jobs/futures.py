"""What pools of futures have in common: `concurrent.futures` has them, and so has Dask."""

from __future__ import annotations

import pickle
import traceback
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from tfm_cl.errors import InputError, TfmError
from tfm_cl.jobs.job import Job, Tracker

LOOKED_AFTER = 1.0
"""Seconds between looks at whether there still is who does the work."""


class LostError(Exception):
    """What worked on a job is gone; the job is done once more."""


class UnfitError(Exception):
    """Nothing can be done here; the error that it is made of says why."""


class Futures(ABC):
    """Executes several jobs at a time, as futures."""

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs in any order, earlier ones first; jobs that they make possible come last."""
        waiting = deque(jobs)
        running: dict[Any, Job] = {}
        ended: SimpleQueue[Any] = SimpleQueue()
        while waiting or running:
            while waiting and self._has_room(len(running)):
                job = waiting.popleft()
                future = self._submitted(job)
                running[future] = job
                future.add_done_callback(ended.put)
            try:
                future = ended.get(timeout=LOOKED_AFTER)
            except Empty:
                self._look(list(running.values()))
                continue
            job = running.pop(future)
            try:
                result = self._result(job, future)
            except LostError:
                waiting.appendleft(job)
                continue
            except UnfitError as error:
                raise error.args[0] from None
            except Exception as error:
                if job.failed is None:
                    raise
                following = job.failed(job, error)
            else:
                following = job.done(job, result)
            tracker.finished(job)
            waiting.extend(following)

    @abstractmethod
    def _has_room(self, running: int) -> bool:
        """Whether one more job may be submitted."""

    @abstractmethod
    def _submitted(self, job: Job) -> Any:
        """Submit a job; returns its future."""

    @abstractmethod
    def _result(self, job: Job, future: Any) -> Any:
        """Return the result of a future that has ended, or raise its error."""

    @abstractmethod
    def _look(self, jobs: list[Job]) -> None:
        """Raise an error if nothing will come of the jobs that run; called while nothing ends."""


def sendable(make_worker: Callable[[], Any]) -> bytes:
    """Pickle what makes the worker.

    Raises
    ------
    InputError
        When it cannot be sent to other processes.
    """
    try:
        return pickle.dumps(make_worker)
    except Exception as error:
        raise InputError(
            "several jobs need overrides that other processes can import: pairs of key and value, or a "
            f"function of a module ({error})"
        ) from error


def portable(error: Exception) -> Exception:
    """Return an error that can be sent; an unexpected one includes its traceback."""
    if not isinstance(error, TfmError):
        error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - our own data
    except Exception:  # noqa: BLE001 - for whatever reason
        return RuntimeError("".join(traceback.format_exception(error)))
    return error
