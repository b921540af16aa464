"""Writing files so that they appear whole or not at all."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from tfm_cl.errors import InputError


@contextlib.contextmanager
def replacing(path: Path, error: type[InputError] = InputError) -> Iterator[Path]:
    """Give a name to write to; what is there afterwards becomes ``path``, or is removed on any failure.

    The new contents are flushed to the disk before they take the name. A link stays a link.

    Parameters
    ----------
    path
        The file to write or replace.
    error
        What to raise.

    Raises
    ------
    InputError
        No such directory, something there that is not a plain file, or it cannot be written.
    """
    target = _target(path, error)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(target)
    except (OSError, MemoryError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem) or type(problem).__name__
        raise error(f"{path}: cannot be written ({' '.join(reason.split())})") from problem
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_writable(path: Path, error: type[InputError] = InputError) -> None:
    """Find out whether `replacing` could write there, before the hours that make the contents.

    Raises
    ------
    InputError
        As `replacing`.
    """
    with contextlib.suppress(_TriedError), replacing(path, error):
        raise _TriedError


def write_text(path: Path, text: str) -> None:
    """Write a small text file, whole or not at all.

    Raises
    ------
    InputError
        As `replacing`.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


class _TriedError(Exception):
    """Ends a trial without replacing anything."""


def _target(path: Path, error: type[InputError]) -> Path:
    """File to write: what a link leads to."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise error(f"{path}: there is no directory {target.parent}; create it first")
    if target.exists() and not target.is_file():
        kind = "a directory" if target.is_dir() else "not a plain file"
        raise error(f"{path}: is {kind}; choose another name")
    if target.exists() and not os.access(target, os.W_OK):
        raise error(f"{path}: exists and is read-only; choose another name")
    return target
