"""``tfm render --frames``: how a range of frames is rendered, and what is told of it."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import click

from tfm_cl.cli.frames import Frame
from tfm_cl.cli.options import GroupedOption, as_flags
from tfm_cl.cli.progress import progress_bar
from tfm_cl.cli.streams import one_line
from tfm_cl.errors import InputError, NoDeviceError
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.run import LOOKED_AGAIN, Failure, Frames, Outcome, Told, run

if TYPE_CHECKING:
    from tfm_cl.cli.openjd import FarmLines
    from tfm_cl.jobs.job import Job, Pool, Progress
    from tfm_cl.sequence.names import Files
    from tfm_cl.sequence.plan import RangePlan
    from tfm_cl.sequence.shot import Shot

Overrides = list[tuple[str, Any]]
THREADS = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
"""Variables of old and new PoCL: threads that work on kernels."""
RETRIES = 2
"""How often other machines try a frame that failed, but not for bad input."""
MOST_JOBS = 61
"""Processes: Windows cannot wait for more."""


def sequence_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--skip-existing``, ``--plan-frames`` and ``--jobs`` to a command."""
    for flag, attributes in (
        (
            "--jobs",
            {
                "default": 1,
                "metavar": "N",
                "type": click.IntRange(1, MOST_JOBS),
                "help": "processes that share the cores, each with a renderer of its own  [1]",
            },
        ),
        (
            "--plan-frames",
            {
                "default": None,
                "metavar": "RANGE",
                "help": "frames that what is left open is decided for, where a machine renders some of them  "
                "[--frames]",
            },
        ),
        (
            "--skip-existing",
            {
                "is_flag": True,
                "help": "leave out frames that are done, made from the same; several processes and machines "
                "share a range so",
            },
        ),
    ):
        function = click.option(flag, cls=GroupedOption, group="Sequence", **attributes)(function)
    return function


def is_range(asked: tuple[Frame, ...], frame: float | None) -> bool:
    """Tell whether frames are asked for by a range; ``frame``: the only one."""
    return frame is None and asked != (None,)


def check_one(jobs: int, plan_frames: str | None, scheduler: str | None, *, skip_existing: bool) -> None:
    """Refuse what is of several frames."""
    given = {
        "--skip-existing": skip_existing,
        "--jobs": jobs > 1,
        "--plan-frames": plan_frames is not None,
        "--scheduler": scheduler is not None,
    }
    for flag, is_given in given.items():
        if is_given:
            raise click.UsageError(f"{flag} is of several frames: say which with --frames")


def share_cores(jobs: int) -> None:
    """Leave each of several processes its part of the cores, of those that this one says nothing of."""
    share = max((os.cpu_count() or 1) // jobs, 1)
    for name in THREADS:
        os.environ.setdefault(name, str(share))  # read when OpenCL is loaded, which it is not yet


class Making(Frames, Protocol):
    """What makes frames in this process, as `tfm_cl.sequence.shot_frames.ShotFrames` does."""

    progress: Progress | None

    @property
    def renderer(self) -> Any:
        """What renders."""

    def decided(self, shot: Shot) -> None:
        """Go on with a shot of which all is decided."""

    def close(self) -> None:
        """Close the renderer."""


@dataclass
class Range:
    """A range of frames to render."""

    frames: tuple[int, ...]
    files: Files
    made: Making
    """How this process makes frames."""
    steady: Callable[[Ledger, Callable[[], Any]], RangePlan]
    """Decides what is left open; takes what gives the renderer."""
    worker: Callable[[Overrides], Callable[[], Any]]
    """Given what was decided, returns what makes a worker in another process."""
    shot: Callable[[Overrides], Shot]
    jobs: int
    skip_existing: bool
    quiet: bool = False
    verbose: bool = False
    reports: bool = False
    """Whether figures of all frames are asked for."""
    scheduler: str | None = None
    """Of a Dask cluster, which does the work."""
    farm: FarmLines | None = None
    """That hears how far it is."""
    told: set[str] = field(default_factory=set)
    found: list[dict[str, Any]] = field(default_factory=list)
    ended: int = 0

    def render(self) -> int:
        """Render it; returns the exit code."""
        if self.scheduler is not None:
            self._check_scheduler(self.scheduler)
        if self.farm is not None:
            self.farm.count = len(self.frames)
        with (
            Ledger(self.files.ledger) as ledger,
            _tidied(self.files, self.frames),
            progress_bar(quiet=self.quiet, farm=self.farm) as progress,
            closing(self.made),
        ):
            self.made.progress = progress
            decided = self._decided(ledger)
            if self.jobs > 1 or self.scheduler is not None:
                self.made.close()  # the device is for the other processes
                outcome = self._in_processes(decided)
            else:
                self.made.decided(self.shot(decided))
                outcome = run(
                    self.frames, self.made, ledger, skip_existing=self.skip_existing, tell=self._tell
                )
        return self._end(outcome)

    def _decided(self, ledger: Ledger) -> Overrides:
        """Decide what is left open, or read what was decided."""
        decided = self.steady(ledger, lambda: self.made.renderer)
        for line in decided.lines() if self.verbose else ():
            print(f"# {one_line(line)}", file=sys.stderr)
        if decided.told and not self.quiet:
            print(one_line(f"chosen for all frames: {as_flags(decided.told)}"), file=sys.stderr)
        return decided.overrides

    def _check_scheduler(self, address: str) -> None:
        """Find out, before anything is read, whether there is a cluster."""
        from tfm_cl.jobs.cluster import Cluster  # noqa: PLC0415 - few ask

        if self.jobs > 1:
            raise click.UsageError("--jobs is of this machine, --scheduler of others; keep one")
        with Cluster(address, int):
            pass

    def _pool(self, make: Callable[[], Any]) -> Pool:
        """Return what gives the frames out."""
        from tfm_cl.jobs.cluster import Cluster  # noqa: PLC0415
        from tfm_cl.jobs.processes import Processes  # noqa: PLC0415

        if self.scheduler is not None:
            return Cluster(self.scheduler, make)
        return Processes(make, min(self.jobs, len(self.frames)))

    def _in_processes(self, decided: Overrides) -> Outcome:
        """Render in several processes, of this machine or others."""
        from tfm_cl.jobs.job import Job  # noqa: PLC0415 - few ask

        outcome = Outcome()
        tries: Counter[int] = Counter()

        def done(job: Job, result: tuple[Outcome, Told | None]) -> list[Job]:
            of, told = result
            frame = job.arguments[0]
            if self._may_succeed_elsewhere(of) and tries[frame] < RETRIES:
                tries[frame] += 1
                return [job]
            outcome.made += of.made
            outcome.kept += of.kept
            outcome.failures += of.failures
            if of.busy:
                time.sleep(LOOKED_AGAIN)
                return [job]
            if of.is_full:
                raise _FullError
            for how, frames in (("made", of.made), ("kept", of.kept), ("failed", of.failures)):
                if frames:
                    self._tell(frame, how, told)
            return []

        def failed(job: Job, error: Exception) -> list[Job]:
            if isinstance(error, NoDeviceError):
                raise error
            outcome.failures.append(Failure(job.arguments[0], error))
            self._tell(job.arguments[0], "failed", error)
            return []

        jobs = [Job("frame", (frame,), f"frame {frame}", 1.0, done, failed) for frame in self.frames]
        with suppress(_FullError), self._pool(self.worker(decided)) as pool:
            pool.run(jobs, _Silent())
        ended = {*outcome.made, *outcome.kept, *(failure.frame for failure in outcome.failures)}
        outcome.left = [frame for frame in self.frames if frame not in ended]
        return outcome

    def _may_succeed_elsewhere(self, outcome: Outcome) -> bool:
        """Whether a frame failed for its machine's sake, and there are others."""
        errors = [failure.error for failure in outcome.failures]
        return self.scheduler is not None and any(not isinstance(error, InputError) for error in errors)

    def _tell(self, frame: int, how: str, what: Any) -> None:
        """Print what became of a frame."""
        if how == "waiting":
            self._print(f"waiting for frame {frame}, which another process makes")
            return
        self.ended += 1
        if self.farm is not None:
            self.farm.ended(f"frame {frame}: {how} ({self.ended} of {len(self.frames)})")
        if how == "made" and what is not None:
            for warning in what.warnings:
                if warning not in self.told and not self.quiet:
                    self.told.add(warning)
                    print(f"tfm: warning: {one_line(warning)}", file=sys.stderr)
            seconds = what.report["seconds"]["total"]
            self._print(f"frame {frame}: {seconds:.1f} s ({self.ended} of {len(self.frames)})")
            if self.reports:
                self.found.append({"frame": frame} | what.report)
        elif how == "kept":
            self._print(f"frame {frame}: is there ({self.ended} of {len(self.frames)})")

    def _print(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr)

    def _end(self, outcome: Outcome) -> int:
        """Print a line for each frame that failed; returns the exit code."""
        for failure in sorted(outcome.failures, key=lambda one: one.frame):
            print(f"tfm: {one_line(str(failure))}", file=sys.stderr)
            if self.farm is not None:
                self.farm.failed(str(failure))
        if outcome.left:
            print(f"tfm: {len(outcome.left)} frames were not made: nothing can be written", file=sys.stderr)
        return outcome.exit_code


@contextmanager
def _tidied(files: Files, frames: tuple[int, ...]) -> Iterator[None]:
    """Remove what killed processes were writing, before and after."""
    files.remove_unfinished(frames)
    try:
        yield
    finally:
        files.remove_unfinished(frames)


class _FullError(Exception):
    """Ends a run of which nothing more can be written."""


class _Silent:
    """Hears how far jobs are, and tells nobody."""

    def step(self, job: Job) -> AbstractContextManager[Progress]:
        """As `Tracker.step`."""
        del job
        return nullcontext(lambda _stage, _fraction: None)

    def finished(self, job: Job) -> None:
        """As `Tracker.finished`."""
