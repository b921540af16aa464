"""Goes through the frames of a range: the next is read, and the last one written, while one is rendered.

The next is begun before one has ended, if it is read soon, so that the device always has work.
"""

from __future__ import annotations

import errno
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

from tfm_cl.errors import OUT_OF_MEMORY, DeviceError, DeviceMemoryError, NoDeviceError, TfmError
from tfm_cl.interrupts import interrupts_held
from tfm_cl.sequence.claims import Claim, Ledger

T = TypeVar("T")

EXIT_MEMORY = 4
EXIT_SOME = 5
READ_SOON = 0.5
"""Seconds that a frame which the device makes waits, at most, for the next to be read and begun, before it is
ended and written."""
LOOKED_AGAIN = 1.0
"""Seconds after which frames that others make are looked at again."""
NO_ROOM = {errno.ENOSPC, errno.EROFS, errno.EDQUOT}
"""What no later frame can be written for either."""


class Frames(Protocol):
    """What the frames of a range take; each step is called by one thread at a time."""

    def name(self, frame: int) -> str:
        """Return what a frame is called beside all others."""

    def outputs(self, frame: int) -> Sequence[Path]:
        """Return a frame's files."""

    def fingerprint(self, frame: int) -> str:
        """Return what a frame is made from, as a number."""

    def read(self, frame: int) -> Any:
        """Read what a frame needs, on the host."""

    def render(self, read: Any) -> Callable[[], Any]:
        """Begin to make its pictures, on the device; what is returned waits until they are made."""

    def write(self, frame: int, made: Any) -> Any:
        """Write its files; returns what there is to tell."""


@dataclass(frozen=True)
class Told:
    """What there is to tell of a frame that was made."""

    warnings: tuple[str, ...]
    report: dict[str, Any]


@dataclass(frozen=True)
class Failure:
    """A frame that could not be made."""

    frame: int
    error: Exception

    @property
    def exit_code(self) -> int:
        """That of the command line, were it the only frame."""
        if isinstance(self.error, MemoryError | DeviceMemoryError):
            return EXIT_MEMORY
        return self.error.exit_code if isinstance(self.error, TfmError) else DeviceError.exit_code

    def __str__(self) -> str:
        begin = f"frame {self.frame}: "
        if isinstance(self.error, MemoryError):
            return begin + OUT_OF_MEMORY
        return begin + "; ".join(map(str, self.error.args)).removeprefix(begin)


@dataclass
class Outcome:
    """What became of a range."""

    made: list[int] = field(default_factory=list)
    """Frames that were rendered and written, in the order in which that ended."""
    kept: list[int] = field(default_factory=list)
    """Frames that were done already, or that others made meanwhile."""
    failures: list[Failure] = field(default_factory=list)
    left: list[int] = field(default_factory=list)
    """Frames that were not made, as nothing could be written any more."""
    busy: list[int] = field(default_factory=list)
    """Frames that others are making."""
    is_full: bool = False
    """Whether nothing could be written any more."""

    @property
    def exit_code(self) -> int:
        """0; 4: memory ran out; 5: some frames failed; where all failed alike, what the failure has."""
        codes = {failure.exit_code for failure in self.failures}
        if not codes or codes & {EXIT_MEMORY}:
            return EXIT_MEMORY if codes else 0
        return codes.pop() if len(codes) == 1 and not (self.made or self.kept or self.left) else EXIT_SOME


@dataclass(frozen=True)
class _Taken:
    """A frame that is read and ours to make."""

    frame: int
    read: Any
    fingerprint: str
    claim: Claim | None


class _Begun(NamedTuple):
    """A frame that the device makes."""

    taken: _Taken
    made: Callable[[], Any]
    """Waits for it."""


class _Busy:
    """Stands for a frame that another process makes."""


class _Kept:
    """Stands for a frame that is done."""


Tell = Callable[[int, str, Any], None]
"""Called with a frame, what became of it, and what `Frames.write` returned."""


def nothing_told(_frame: int, _how: str, _what: Any) -> None:
    """Tell nobody."""


def run(
    frames: Iterable[int],
    work: Frames,
    ledger: Ledger,
    *,
    skip_existing: bool = False,
    waits: bool = True,
    tell: Tell = nothing_told,
) -> Outcome:
    """Make the frames of a range, in order; one that fails does not stop the others.

    On Ctrl-C the frame that is being written is finished, and no other is there in part.

    Parameters
    ----------
    frames
        Their numbers.
    work
        How a frame is made.
    ledger
        Where it is noted which are done; entered.
    skip_existing
        Leave out those that are done, and share the others with whatever processes do the same: each claims
        the frames that it makes.
    waits
        For frames that others have claimed; otherwise they are ``busy``.
    tell
        Called with each frame that is ``made``, ``kept`` or ``failed``, and the first that is ``waiting``.
    """
    return _Run(work, ledger, tell, skip_existing=skip_existing).all(frames, waits=waits)


class _Run:
    def __init__(self, work: Frames, ledger: Ledger, tell: Tell, *, skip_existing: bool) -> None:
        self._work, self._ledger, self._tell, self._skips = work, ledger, tell, skip_existing
        self._outcome = Outcome()
        self._hopeless = False

    def all(self, frames: Iterable[int], *, waits: bool) -> Outcome:
        with interrupts_held():
            # Ctrl-C is for the thread that renders.
            reader, writer = ThreadPoolExecutor(1, "reads"), ThreadPoolExecutor(1, "writes")
            for executor in (reader, writer):
                executor.submit(int).result()
        try:
            waiting = deque(frames)
            while waiting:
                before = len(self._outcome.made)
                busy = self._once(waiting, reader, writer)
                if not waits:
                    self._outcome.busy += busy
                    break
                if busy and len(self._outcome.made) == before:
                    self._tell(busy[0], "waiting", None)
                    time.sleep(LOOKED_AGAIN)
                waiting.extend(busy)
        finally:
            reader.shutdown(cancel_futures=True)
            writer.shutdown()  # what is rendered is written
        return self._outcome

    def _once(self, waiting: deque[int], reader: ThreadPoolExecutor, writer: ThreadPoolExecutor) -> list[int]:
        """Go through the frames that are waiting; returns those that others are making."""
        busy: list[int] = []
        ahead, begun, behind = self._next(waiting, reader), None, None
        while ahead is not None:
            (frame, reading), ahead = ahead, None
            if begun is not None and not wait([reading], READ_SOON).done:
                begun, behind = None, self._made(begun, behind, writer)  # and written meanwhile
            taken = self._result(frame, reading)
            if isinstance(taken, _Taken) and self._hopeless:
                self._leave(taken)
                break
            ahead = self._next(waiting, reader)
            if isinstance(taken, _Busy):
                busy.append(frame)
            elif isinstance(taken, _Kept):
                self._outcome.kept.append(frame)
                self._tell(frame, "kept", None)
            elif isinstance(taken, _Taken):
                next_begun = self._begin(taken)
                behind, begun = self._made(begun, behind, writer), next_begun
                del next_begun
            del taken
        behind = self._made(begun, behind, writer)
        if behind is not None:
            self._end(*behind)
        if self._hopeless:
            self._outcome.left += [*waiting, *busy]
            waiting.clear()
            return []
        return busy

    def _made(
        self, begun: _Begun | None, behind: tuple[int, Future[Any]] | None, writer: ThreadPoolExecutor
    ) -> tuple[int, Future[Any]] | None:
        """Wait for a frame, and begin to write it when the one before is written; returns what is written."""
        if begun is None:
            return behind
        taken, made = begun.taken, self._tried(begun.taken, begun.made)
        if behind is not None:
            self._end(*behind)
        if made is None:
            return None
        if self._hopeless:
            self._leave(taken)
            return None
        return taken.frame, writer.submit(self._write, taken, made[0])

    def _next(self, waiting: deque[int], reader: ThreadPoolExecutor) -> tuple[int, Future[Any]] | None:
        if not waiting:
            return None
        frame = waiting.popleft()
        return frame, reader.submit(self._take, frame)

    def _take(self, frame: int) -> _Taken | _Busy | _Kept:
        """Claim a frame and read it."""
        fingerprint, outputs = self._work.fingerprint(frame), self._work.outputs(frame)
        name, claim = self._work.name(frame), None
        if self._skips:
            if self._ledger.is_done(name, fingerprint, outputs):
                return _Kept()
            claim = self._ledger.claim(name)
            if claim is None:
                return _Busy()
        try:
            if claim is not None and self._ledger.is_done(name, fingerprint, outputs):  # by now
                self._ledger.release(claim)
                return _Kept()
            return _Taken(frame, self._work.read(frame), fingerprint, claim)
        except BaseException:
            self._give_back(claim)
            raise

    def _begin(self, taken: _Taken) -> _Begun | None:
        found = self._tried(taken, lambda: self._work.render(taken.read))
        return None if found is None else _Begun(taken, found[0])

    def _tried(self, taken: _Taken, step: Callable[[], T]) -> tuple[T] | None:
        try:
            return (step(),)
        except NoDeviceError:
            raise
        except (TfmError, MemoryError, OSError) as error:
            self._fail(taken.frame, error)
            self._give_back(taken.claim)
            return None

    def _write(self, taken: _Taken, made: Any) -> Any:
        outputs, name = self._work.outputs(taken.frame), self._work.name(taken.frame)
        try:
            if taken.claim is not None and not taken.claim.is_held():
                return None  # this machine slept, and another has taken the frame
            self._ledger.forget(name)
            told = self._work.write(taken.frame, made)
            self._ledger.record(name, taken.fingerprint, outputs)
            return told
        finally:
            self._give_back(taken.claim)

    def _end(self, frame: int, writing: Future[Any]) -> None:
        """Wait until a frame is written."""
        try:
            told = writing.result()
        except (TfmError, MemoryError, OSError) as error:
            self._hopeless |= getattr(error.__cause__ or error, "errno", None) in NO_ROOM
            self._outcome.is_full |= self._hopeless
            self._fail(frame, error)
        else:
            self._outcome.made.append(frame)
            self._tell(frame, "made", told)

    def _result(self, frame: int, reading: Future[Any]) -> Any:
        try:
            return reading.result()
        except (TfmError, MemoryError, OSError) as error:
            self._fail(frame, error)
            return None

    def _fail(self, frame: int, error: Exception) -> None:
        # What it came from holds the voxels of the frame.
        error.__traceback__ = error.__cause__ = error.__context__ = None
        self._outcome.failures.append(Failure(frame, error))
        self._tell(frame, "failed", error)

    def _leave(self, taken: _Taken) -> None:
        """Leave a frame to later runs."""
        self._give_back(taken.claim)
        self._outcome.left.append(taken.frame)

    def _give_back(self, claim: Claim | None) -> None:
        if claim is not None:
            self._ledger.release(claim)
