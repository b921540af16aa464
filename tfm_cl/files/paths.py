"""Names of files: from what a user wrote to a path, what can be read, and writing whole or not at all."""

import contextlib
import importlib
import os
import re
import secrets
import stat
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tfm_cl.errors import InputError, VolumeError
from tfm_cl.files.locks import has_ended, machine

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
"""What would break a message's line, or be obeyed by a terminal."""


def name_of(value: Any, what: str = "a file") -> str:
    """Return the name of ``what``, as text; raises `ValueError`, which says what it should be."""
    text = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(text, str) or not text:
        raise ValueError(f"should be the name of {what}")
    if _CONTROL.search(text):
        raise ValueError(f"should be the name of {what}, without control characters")
    return text


def path_of(name: str | os.PathLike[str], error: type[InputError] = InputError) -> Path:
    """Turn what a user wrote into a path; ``~`` is the home directory, unless something is called so.

    Raises
    ------
    InputError
        An empty name, or one with control characters.
    """
    return _expanded(_checked(name, error), Path())


def source_of(
    name: str | os.PathLike[str], folder: Path | None = None, error: type[InputError] = InputError
) -> Path:
    """Turn the name of a file to read into a path.

    Parameters
    ----------
    name
        What a user wrote, as for `path_of`. Back-slashes separate folders, as on Windows, where this leads
        to a file and the name taken literally does not.
    folder
        That a relative name is relative to; by default the current one.
    error
        What to raise.

    Raises
    ------
    InputError
        As `path_of`.
    """
    text, folder = _checked(name, error), folder or Path()
    literal, other = _expanded(text, folder), _expanded(text.replace("\\", "/"), folder)
    return other if not _is_there(literal) and _is_there(other) else literal


def check_readable(path: Path, error: type[InputError] = InputError) -> int:
    """Find out whether a path leads to a plain file, and how many bytes it has; a pipe would never end.

    Raises
    ------
    InputError
        Nothing there, something else than a plain file, or the system refuses the name.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise error(f"{path}: no such file") from None
    except OSError as problem:
        raise error(f"{path}: cannot be read ({reason_of(problem)})") from problem
    if not stat.S_ISREG(status.st_mode):
        kind = "a directory" if stat.S_ISDIR(status.st_mode) else "a pipe or device"
        raise error(f"{path}: is not a file but {kind}")
    return status.st_size


def read_by_extension(
    path: Path, package: str, formats: Mapping[str, str], kind: str, function: str = "read"
) -> Any:
    """Return what a function of the module that knows the file's format makes of it; imports that module.

    Parameters
    ----------
    path
        The file.
    package
        That the modules belong to.
    formats
        Names of modules by file extension, as ``.NAME`` of those in the package.
    kind
        Of format, for messages.
    function
        Of the module; it takes the path.

    Raises
    ------
    VolumeError
        The file is missing, cannot be read or is of unknown type; and what the function raises.
    """
    module_name = formats.get(path.suffix.lower())
    if module_name is None:
        known = " ".join(sorted(formats))
        raise VolumeError(f"{path}: not a known {kind} '{path.suffix}'; known: {known}")
    check_readable(path, VolumeError)
    module = importlib.import_module(module_name, package)
    try:
        return getattr(module, function)(path)
    except OSError as error:
        raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error


def is_file(path: Path) -> bool:
    """Tell whether a path leads to a plain file; a name that the system refuses leads nowhere."""
    try:
        return stat.S_ISREG(_mode(path))
    except OSError:
        return False


def real_path(path: Path) -> Path:
    """Follow all links, as far as they lead."""
    return Path(os.path.realpath(path))  # Path.resolve raises where a link leads to itself


def reason_of(problem: BaseException) -> str:
    """Say on one line why the system failed."""
    return " ".join(str(getattr(problem, "strerror", None) or problem).split()) or type(problem).__name__


@contextlib.contextmanager
def replacing(
    path: Path, error: type[InputError] = InputError, *, survives_power_cuts: bool = True
) -> Iterator[Path]:
    """Give a name to write to; what is there afterwards becomes ``path``, or is removed on any failure.

    A link stays a link.

    Parameters
    ----------
    path
        The file to write or replace.
    error
        What to raise.
    survives_power_cuts
        Flush the new contents to the disk before they take the name, which takes some milliseconds. Otherwise
        ``path`` may be empty after a power cut, or what it was.

    Raises
    ------
    InputError
        No such directory, something there that is not a plain file, or it cannot be written.
    """
    target = _target(path, error)
    # Short, whatever the target's name: that may be as long as names can be.
    temporary = target.with_name(f"{_our_prefix()}{os.getpid()}-{secrets.token_hex(4)}.tmp")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        if survives_power_cuts:
            with temporary.open("rb+") as stream:
                os.fsync(stream.fileno())
        temporary.replace(target)
    except (OSError, MemoryError) as problem:
        raise error(f"{path}: cannot be written ({reason_of(problem)})") from problem
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def remove_unfinished(folder: Path) -> None:
    """Remove what processes of this machine were writing there when they were killed."""
    with contextlib.suppress(OSError):
        for path in folder.glob(f"{_our_prefix()}*.tmp"):
            process = path.name.removeprefix(_our_prefix()).partition("-")[0]
            if process.isdecimal() and has_ended(int(process)):
                path.unlink(missing_ok=True)


def _our_prefix() -> str:
    return f".tfm-{zlib.crc32(machine().encode()):08x}-"


def check_writable(path: Path, error: type[InputError] = InputError) -> None:
    """Find out whether `replacing` could write there, before the hours that make the contents.

    Raises
    ------
    InputError
        As `replacing`.
    """
    with contextlib.suppress(_TriedError), replacing(path, error):
        raise _TriedError


def write_text(path: Path, text: str, *, survives_power_cuts: bool = True) -> None:
    """Write a small text file, whole or not at all; ``survives_power_cuts`` as of `replacing`.

    Raises
    ------
    InputError
        As `replacing`.
    """
    with replacing(path, survives_power_cuts=survives_power_cuts) as temporary:
        temporary.write_text(text, encoding="utf-8")


class _TriedError(Exception):
    """Ends a trial without replacing anything."""


def _target(path: Path, error: type[InputError]) -> Path:
    """File to write: what a link leads to."""
    target = real_path(path)
    try:
        folder, there = _mode(target.parent), _mode(target)
    except OSError as problem:
        raise error(f"{path}: cannot be written ({reason_of(problem)})") from problem
    if not stat.S_ISDIR(folder):
        raise error(f"{path}: there is no directory {target.parent}; create it first")
    if there and not stat.S_ISREG(there):
        kind = "a directory" if stat.S_ISDIR(there) else "not a plain file"
        raise error(f"{path}: is {kind}; choose another name")
    if there and not os.access(target, os.W_OK):
        raise error(f"{path}: exists and is read-only; choose another name")
    return target


def _mode(path: Path) -> int:
    """Return what kind of thing is there, as `stat` tells it; 0 for nothing."""
    try:
        return path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return 0


def _is_there(path: Path) -> bool:
    try:
        return bool(_mode(path))
    except OSError:
        return False


def _checked(name: str | os.PathLike[str], error: type[InputError]) -> str:
    try:
        return name_of(name)
    except ValueError as problem:
        raise error(f"{name!r}: {problem}") from None


def _expanded(text: str, folder: Path) -> Path:
    """Join to ``folder`` and put the home directory where ``~`` or ``~user`` stands for it."""
    first = text.partition("/")[0]
    if first.startswith("~") and not _is_there(folder / first):
        text = os.path.expanduser(text)  # noqa: PTH111 - Path raises for users that there are not
    return folder / text
