"""Locks on files that end with the process that holds them, and whether processes have ended."""

import errno
import os
import socket
import sys
from functools import cache
from pathlib import Path


@cache
def machine() -> str:
    """Name where the numbers of processes are one's own: this machine or, on Linux, this container on it."""
    try:
        return f"{socket.gethostname()} {Path('/proc/self/ns/pid').readlink()}"
    except OSError:
        return socket.gethostname()


def has_ended(process: int) -> bool:
    """Tell whether a process of this `machine` has certainly ended; never where that cannot be told."""
    if os.name != "posix" or process <= 0:
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


def lock(descriptor: int) -> bool:
    """Lock an open file, or tell that another holds it; a file system without locks gives every one.

    Closing the file ends the lock.
    """
    try:
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 - Windows only

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl  # noqa: PLC0415 - POSIX only

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
    return True
