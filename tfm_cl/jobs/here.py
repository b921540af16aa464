"""Jobs one after another, in this process."""

from __future__ import annotations

from collections import deque
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Self

from tfm_cl.jobs.job import Job, Tracker


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
            result: Any = None
            failure: Exception | None = None
            with tracker.step(job) as progress:
                try:
                    result = getattr(self._worker, job.method)(*job.arguments, progress)
                except Exception as error:
                    if job.failed is None:
                        raise
                    failure = error
            if failure is None:
                queue.extendleft(reversed(job.done(job, result)))
            elif job.failed is not None:
                queue.extendleft(reversed(job.failed(job, failure)))
