"""What is to be done, who hears how far it is, and what does it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

Progress = Callable[[str, float], None]
"""``progress(stage, fraction)``, with the fraction of the stage that is done."""


@dataclass(frozen=True)
class Job:
    """A call of one of a worker's methods: ``worker.METHOD(*arguments, progress)``."""

    method: str
    arguments: tuple[Any, ...]
    label: str
    """Name of the job in messages."""
    weight: float
    """Amount of work, in an arbitrary unit."""
    done: Callable[[Job, Any], list[Job]]
    """Takes the job and its result, and returns the jobs that it makes possible."""
    failed: Callable[[Job, Exception], list[Job]] | None = None
    """Takes the job and its error, likewise, where the others go on all the same; None: all end with it."""


class Tracker(Protocol):
    """Callbacks for progress."""

    def step(self, job: Job) -> AbstractContextManager[Progress]:
        """Report a job that runs in this process."""

    def finished(self, job: Job) -> None:
        """Report a job that ran in another process."""


class Pool(Protocol):
    """Executes jobs while it is entered: `Here`, `Processes` or `Cluster`.

    What is left when it is exited with an error, also with that of Ctrl-C, is not done; nothing of it
    remains.
    """

    def __enter__(self) -> Self:
        """Begin."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """End."""

    def run(self, jobs: list[Job], tracker: Tracker) -> None:
        """Do jobs, and those that they make possible; jobs given earlier begin earlier.

        Raises
        ------
        TfmError
            From a job that has no ``failed``. Unforeseen errors tell in a note where they come from.
        DeviceError
            A process ended by itself, or the cluster is not what is needed.
        """


def silent(stage: str, fraction: float) -> None:
    """Ignore progress."""
