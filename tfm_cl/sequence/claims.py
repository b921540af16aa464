"""Which frames of a range are done, and which are being made: small files that several machines share.

They lie in one folder beside the frames. ``FRAME.done`` says what a frame was made from, and how large and
how old its files were then; it is written last. ``FRAME.claim`` says which process makes the frame: it is
created only where there is none, its holder renews it, and it expires when it has not been renewed for
`EXPIRED_AFTER` seconds. On the same machine it ends with the process at once.

Ages are told by the clock of the file system: those of machines differ.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import socket
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tfm_cl.errors import InputError
from tfm_cl.files.locks import has_ended, lock, machine
from tfm_cl.files.paths import is_file, reason_of, remove_unfinished, write_text
from tfm_cl.interrupts import interrupts_held

EXPIRED_AFTER = 120.0
"""Seconds without renewal after which a claim holds nothing."""
RENEWALS = 4
"""Of a claim, before it would expire."""
LARGEST = 1 << 20
"""Bytes of such a file, at most: more is none."""
DONE, CLAIM, GUARD = ".done", ".claim", "takeover"


@dataclass(frozen=True)
class Holder:
    """Who has claimed a frame."""

    host: str
    machine: str
    """As `tfm_cl.files.locks.machine` names it."""
    pid: int
    token: str
    """Of this claim alone."""
    locked: bool
    """Whether the file is locked too, as long as the process lives, so that its machine can tell."""

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}"


class Claim:
    """A frame that this process, and no other, makes; from `Ledger.claim`."""

    def __init__(self, path: Path, holder: Holder, descriptor: int) -> None:
        self._path, self._holder, self._descriptor = path, holder, descriptor

    def is_held(self) -> bool:
        """Tell whether it is still ours: a machine that slept for long has lost it."""
        found = _holder(self._path)
        return found is not None and found.token == self._holder.token

    def renew(self) -> None:
        """Say that the frame is still being made."""
        with contextlib.suppress(OSError):
            if self.is_held():
                os.utime(self._path)

    def release(self) -> None:
        """Give the frame back, done or not."""
        with contextlib.suppress(OSError):
            if self.is_held():
                self._path.unlink()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class Ledger:
    """The folder of a range's small files; a context manager, which renews claims meanwhile.

    Parameters
    ----------
    folder
        Made where it is not there.
    expired_after
        Seconds without renewal after which a claim holds nothing; the same on all machines.

    Raises
    ------
    InputError
        It cannot be made or written.
    """

    def __init__(self, folder: Path, *, expired_after: float = EXPIRED_AFTER) -> None:
        self._folder, self._expired_after = folder, expired_after
        self._claims: set[Claim] = set()
        self._changing, self._ended = threading.Lock(), threading.Event()
        self._renewer = threading.Thread(target=self._renew, name="claims", daemon=True)

    def __enter__(self) -> Self:
        self._make()
        try:
            self._now()
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written ({reason_of(error)})") from error
        remove_unfinished(self._folder)
        with interrupts_held():  # which this thread would take, while others are to wait for it
            self._renewer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._renewer.join()
        for claim in list(self._claims):
            self.release(claim)
        self._release_ended()
        remove_unfinished(self._folder)
        with contextlib.suppress(OSError):
            self._folder.rmdir()  # if nothing was done

    def _make(self) -> None:
        """Make the folder, which goes with the last process that had nothing to note."""
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written ({reason_of(error)})") from error

    # ----------------------------------------------------------------- what is done

    def is_done(self, name: str, fingerprint: str, outputs: Sequence[Path]) -> bool:
        """Tell whether a frame was made from the same, and its files are those that were written then."""
        said, there = _read(self._folder / f"{name}{DONE}") or {}, _states(outputs)
        return said == {"fingerprint": fingerprint, "outputs": there} and len(there) == len(outputs)

    def record(self, name: str, fingerprint: str, outputs: Sequence[Path]) -> None:
        """Say that a frame is done: all its files are there.

        Raises
        ------
        InputError
            It cannot be written.
        """
        self._make()
        text = json.dumps({"fingerprint": fingerprint, "outputs": _states(outputs)})
        # The files are on the disk; were this lost, the frame would be made again.
        write_text(self._folder / f"{name}{DONE}", text + "\n", survives_power_cuts=False)

    def forget(self, name: str) -> None:
        """Say that a frame is not done, before its files change."""
        with contextlib.suppress(OSError):
            (self._folder / f"{name}{DONE}").unlink()

    # ----------------------------------------------------------------- what is being done

    def claim(self, name: str) -> Claim | None:
        """Take a frame for this process; None where another has it.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        self._make()
        path = self._folder / f"{name}{CLAIM}"
        try:
            claim = _created(path) or (self._taken_over(path) if self._is_stale(path) else None)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({reason_of(error)})") from error
        if claim is not None:
            with self._changing:
                self._claims.add(claim)
        return claim

    def release(self, claim: Claim) -> None:
        """Give a frame back."""
        with self._changing:
            self._claims.discard(claim)
        claim.release()

    def _release_ended(self) -> None:
        """Give back what processes of this machine had claimed that have been killed."""
        with contextlib.suppress(OSError, InputError):
            for path in self._folder.glob(f"*{CLAIM}"):
                holder = _holder(path)
                if holder is not None and holder.machine == machine() and _has_ended(path, holder):
                    claim = self.claim(path.name.removesuffix(CLAIM))
                    if claim is not None:
                        self.release(claim)

    def holder(self, name: str) -> Holder | None:
        """Tell who has a frame; None where nobody has."""
        return _holder(self._folder / f"{name}{CLAIM}")

    def _taken_over(self, path: Path) -> Claim | None:
        """Put a claim in the place of a stale one; None where another process, one at a time, is doing so."""
        descriptor = os.open(self._folder / GUARD, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if not lock(descriptor) or not self._is_stale(path):
                return None
            path.unlink(missing_ok=True)
            return _created(path)
        finally:
            os.close(descriptor)

    def _is_stale(self, path: Path) -> bool:
        """Tell whether nobody makes the frame of a claim any more."""
        holder = _holder(path)
        if holder is not None and holder.machine == machine() and _has_ended(path, holder):
            return True
        try:
            age = self._now() - path.lstat().st_mtime  # of a link that leads nowhere, too
        except FileNotFoundError:
            return False  # released meanwhile
        # In the future are claims from before a clock was set back: whoever lives renews them.
        return abs(age) > self._expired_after

    def _now(self) -> float:
        """Return the file system's time."""
        with tempfile.NamedTemporaryFile(dir=self._folder, prefix=".now-") as file:
            return os.fstat(file.fileno()).st_mtime

    def _renew(self) -> None:
        while not self._ended.wait(self._expired_after / RENEWALS):
            with self._changing:
                claims = list(self._claims)
            for claim in claims:
                claim.renew()


def _created(path: Path) -> Claim | None:
    """Create a claim; None where one is there."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        return None
    try:
        lock(descriptor)
        holder = Holder(socket.gethostname(), machine(), os.getpid(), secrets.token_hex(8), _is_locked(path))
        os.write(descriptor, json.dumps(vars(holder) | {"time": time.time()}).encode())
    except BaseException:
        os.close(descriptor)
        path.unlink(missing_ok=True)
        raise
    if holder.locked:
        return Claim(path, holder, descriptor)
    os.close(descriptor)
    return Claim(path, holder, -1)


def _has_ended(path: Path, holder: Holder) -> bool:
    """Tell whether the process that holds a claim on this machine has ended, where that can be told."""
    if holder.locked:
        try:
            descriptor = os.open(path, os.O_RDWR)
        except OSError:
            return False
        try:
            return lock(descriptor)
        finally:
            os.close(descriptor)
    return has_ended(holder.pid)


def _is_locked(path: Path) -> bool:
    """Tell whether a lock that is held keeps others out: not every file system has locks."""
    if os.name != "posix":
        return False  # on Windows what is locked cannot be read
    descriptor = os.open(path, os.O_RDWR)
    try:
        return not lock(descriptor)
    finally:
        os.close(descriptor)


def _holder(path: Path) -> Holder | None:
    """Read a claim; None where there is none, or it is being written."""
    said = _read(path) or {}
    try:
        names = str(said["host"]), str(said["machine"])
        return Holder(*names, int(said["pid"]), str(said["token"]), said["locked"] is True)
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _read(path: Path) -> dict[str, Any] | None:
    if not is_file(path):  # a pipe would never end
        return None
    try:
        with path.open("rb") as file:
            said = json.loads(file.read(LARGEST))
    except (OSError, ValueError, RecursionError):
        return None
    return said if isinstance(said, dict) else None


def _states(paths: Sequence[Path]) -> list[list[str | int]]:
    """Return name, bytes and time of change, nanoseconds, of the files that are there."""
    found: list[list[str | int]] = []
    for path in paths:
        with contextlib.suppress(OSError):
            status = path.stat()
            found.append([path.name, status.st_size, status.st_mtime_ns])
    return found
