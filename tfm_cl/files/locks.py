"""Locks on files that end with the process that holds them, however it ends."""

import errno
import sys


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
