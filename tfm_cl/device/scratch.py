"""Temporary folders with enough room, which are removed when the process ends."""

import contextlib
import os
import shutil
import tempfile
import time
import weakref
from collections.abc import Iterable, Iterator
from pathlib import Path

from tfm_cl.errors import DeviceError
from tfm_cl.files.locks import lock

PREFIX = "tfm_cl-scratch-"
ROOM = 32 << 20
"""Bytes of room required: what is compiled between two checks takes a few MiB at most."""

ATTEMPTS, PAUSE = 20, 0.01
"""To remove a folder, and seconds between two of them."""

LOCKED_BY = 60.0
"""Seconds after which a live process has certainly locked its folder."""


class Scratch:
    """A folder that only this user may read, removed by `close` or when the process ends.

    A killed process cannot remove its folder; the next process that makes one in the same place does.

    Parameters
    ----------
    parent
        The folder in which to make it.

    Raises
    ------
    OSError
        If it cannot be made, has no room, or does not allow executing files.
    """

    path: Path

    def __init__(self, parent: Path) -> None:
        if hasattr(os, "ST_NOEXEC") and os.statvfs(parent).f_flag & os.ST_NOEXEC:
            raise PermissionError(0, "nothing there may be executed")
        _remove_abandoned(parent)
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        self._lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        lock(self._lock)
        self.close = weakref.finalize(self, _remove, self.path, self._lock, os.getpid())
        try:
            self.check_room()
        except OSError:
            self.close()
            raise

    def check_room(self) -> None:
        """Raise an OSError if `ROOM` bytes cannot be written: full disk, quota, or a limit of the process."""
        with tempfile.TemporaryFile(dir=self.path) as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, ROOM)
            else:
                file.write(bytes(ROOM))


def make_scratch(others: Iterable[Path] = ()) -> Scratch:
    """Make a folder in a place with enough room.

    Parameters
    ----------
    others
        Further places to try if none of the system's temporary folders will do.

    Raises
    ------
    DeviceError
        If there is no room anywhere; the message lists the places tried.
    """
    refusals = []
    for parent in dict.fromkeys((*_temporary_folders(), *others)):
        try:
            return Scratch(parent)
        except OSError as error:
            refusals.append(f"{parent} ({error.strerror or error})")
    raise DeviceError(
        f"no folder has the {ROOM >> 20} MiB of room that compiling kernels may take: {', '.join(refusals)}; "
        "make room there, or set TMPDIR to a folder that has it"
    )


def _temporary_folders() -> Iterator[Path]:
    if tempfile.tempdir is not None:
        yield Path(tempfile.tempdir)
    for name in ("TMPDIR", "TEMP", "TMP"):
        if folder := os.environ.get(name):
            yield Path(folder).absolute()
    yield from map(Path, ("/tmp", "/var/tmp", "/dev/shm"))  # noqa: S108 - only this user can access what is made there


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders of processes that were killed."""
    if os.name != "posix":
        return
    for folder in parent.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            found = folder.lstat()
            if found.st_uid != os.geteuid() or time.time() - found.st_mtime < LOCKED_BY:
                continue
            held = os.open(folder / "lock", os.O_RDWR | os.O_NOFOLLOW)
            try:
                if lock(held):  # not while its process lives
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(held)


def _remove(path: Path, held: int, process: int) -> None:
    if os.getpid() == process:  # a forked process has a copy of this, but not the folder
        for _ in range(ATTEMPTS):  # a compiler that nobody waits for may write meanwhile
            shutil.rmtree(path, ignore_errors=True)
            if not path.exists():
                break
            time.sleep(PAUSE)
        with contextlib.suppress(OSError):
            os.close(held)
