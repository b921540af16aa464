"""The folder that a page may see: what is in it, what is saved there, and what is dropped onto the page."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, get_args

from tfm_cl.errors import InputError
from tfm_cl.files import curves_io, phase_table, points_io, volume_io
from tfm_cl.files.named_files import named_by
from tfm_cl.files.paths import is_file, name_of, real_path, reason_of, replacing

MOST_UPLOAD = 2 << 30
"""Bytes of a file that is dropped onto the page."""
MOST_NAME = 200
"""Bytes of a new file's name; file systems take 255, and what is written has a name of its own at first."""
MOST_CHARACTERS = 4096
"""Of a path."""
MOST_LISTED = 5000
"""Folders and files of a listing."""
MOST_ENTRIES = 100_000
"""Of a folder, that are looked at."""
MOST_OF_A_NAME = 1000
"""Files called alike, but for a number."""
_FORBIDDEN = frozenset('<>:"|?*\\')
"""What no name on Windows holds: there ``a:b`` is a stream of a file, or on another drive."""
_DEVICE = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE | re.DOTALL
)
"""Names of devices there, with any extension."""


_Stamp = tuple[int, int, int]
Kind = Literal["scene", "phase"]
"""What files a page asks for: what it opens, or tables of phase functions, which a scene names."""
KINDS: tuple[Kind, ...] = get_args(Kind)
_MEANT: dict[Kind, str] = {"scene": "scene and no volume", "phase": "table of a phase function"}


class Files:
    """What a page may see, open and write: one folder. Any thread may use it.

    A name is relative to the folder, with ``/`` between folders. What leads out of it is refused, by ``..``,
    as an absolute path or through a link, and so are hidden files and names that mean something else on
    Windows. Nothing is replaced but what was saved from the page.

    Parameters
    ----------
    folder
        The folder.
    most_upload
        Bytes of a file that is dropped onto the page, at most.

    Raises
    ------
    InputError
        It is no folder.
    """

    def __init__(self, folder: Path, *, most_upload: int = MOST_UPLOAD) -> None:
        self.folder = real_path(folder)
        self.most_upload = most_upload
        if not self.folder.is_dir():
            raise InputError(f"{folder}: is not a folder; the viewer opens and saves files in one")
        self._trusted: frozenset[Path] = frozenset()
        self._also: tuple[Callable[[Path], bool], ...] = ()
        self._saved: dict[Path, _Stamp | None] = {}
        self._arriving: set[Path] = set()
        self._lock = threading.Lock()

    @property
    def may_save(self) -> bool:
        """Whether files can be written there."""
        return os.access(self.folder, os.W_OK)

    def inside(self, name: str) -> Path:
        """Return the real path of something in the folder, there or not.

        Raises
        ------
        InputError
            A name that leads elsewhere, or means something else elsewhere.
        """
        path = self.folder.joinpath(*_parts(name))
        try:
            real = real_path(path)
        except OSError as problem:
            raise InputError(f"{_shown(name)}: cannot be read ({reason_of(problem)})") from None
        if not real.is_relative_to(self.folder):
            raise InputError(f"{_shown(name)}: leads out of the viewer's folder; name a file in it")
        return real

    def trust(self, paths: Iterable[Path], also: Callable[[Path], bool] | None = None) -> None:
        """Let scenes read files wherever they are: those of the scene that the command line named.

        Parameters
        ----------
        paths
            The files.
        also
            Tells of further ones, as of other frames.
        """
        with self._lock:
            self._trusted |= {real_path(path) for path in paths}
            self._also += () if also is None else (also,)

    def check(self, paths: Iterable[Path]) -> None:
        """Refuse files of a scene that lie outside the folder, unless they are trusted.

        So is what is named, in its folder or below, by a trusted one before it: the data of another frame.

        Raises
        ------
        InputError
            The first of them.
        """
        named: set[Path] = set()
        for path in paths:
            real = real_path(path)
            if real.is_relative_to(self.folder):
                continue  # who looks at the viewer may have written it
            if real in self._trusted or any(trusts(path) for trusts in self._also):
                named |= {real_path(further) for further in named_by(path)}
            elif real not in named:
                raise InputError(f"{path.name}: lies outside the viewer's folder; copy it there first")

    def listing(self, name: str, kind: Kind = "scene") -> dict[str, Any]:
        """List a folder: files of a kind, and further folders.

        Parameters
        ----------
        name
            Empty for the folder itself.

        Returns
        -------
        dict
            The page's message: ``path``, ``kind``, and the names of ``folders`` and ``files`` in it.

        Raises
        ------
        InputError
            As `inside`; nothing there, no folder, or it cannot be read.
        """
        folder = self.inside(name) if name.strip("/") else self.folder
        folders, files, extensions = [], [], extensions_of(kind)
        try:
            with os.scandir(folder) as entries:
                for seen, entry in enumerate(entries):
                    if seen == MOST_ENTRIES:
                        break
                    if entry.name.startswith(".") or not self._is_inside(entry):
                        continue
                    path = Path(entry.path)
                    if path.is_dir():
                        folders.append(entry.name)
                    elif _suffix(entry.name) in extensions and is_file(path):
                        files.append(entry.name)
        except OSError as problem:
            raise InputError(f"{_shown(name)}: cannot be listed ({reason_of(problem)})") from None
        shown = folder.relative_to(self.folder).as_posix()
        return {
            "type": "listing",
            "kind": kind,
            "path": "" if shown == "." else shown,
            "folders": sorted(folders, key=_order)[:MOST_LISTED],
            "files": sorted(files, key=_order)[:MOST_LISTED],
        }

    def opened(self, name: str) -> Path:
        """Return the path of a file that can be opened: a scene or something to show.

        Raises
        ------
        InputError
            As `inside`; of an unknown kind, or not there.
        """
        path = self.inside(name)
        _check_kind(path.name, "scene")
        if not is_file(path):
            raise InputError(f"{_shown(name)}: no such file in the viewer's folder")
        return path

    def saved(self, name: str, suffix: str) -> Path:
        """Return where something may be written: where nothing is, or what the viewer alone wrote.

        Parameters
        ----------
        name
            With the suffix or without.
        suffix
            As ``.exr``.

        Raises
        ------
        InputError
            As `inside`; its folder is not there, or the name is taken.
        """
        text = name if _suffix(name) == suffix or not name else name + suffix
        parts = _parts(text)
        _check_length(parts[-1])
        folder = self.inside("/".join(parts[:-1])) if parts[:-1] else self.folder
        if not folder.is_dir():
            raise InputError(f"{_shown(text)}: its folder is not there; save it in one that is")
        path = folder / parts[-1]
        with self._lock:
            is_other = os.path.lexists(path) and _stamp(path) != self._saved.get(path)
            if path in self._arriving or is_other:
                raise InputError(f"{_shown(text)}: is there already; choose another name")
            self._saved.setdefault(path, None)
        return path

    def written(self, path: Path) -> None:
        """Note that what `saved` returned is written: it may be replaced until somebody else changes it."""
        with self._lock:
            self._saved[path] = _stamp(path)

    def most_of(self, kind: Kind) -> int:
        """Return how many bytes a file of a kind may have that is sent by the page."""
        return min(self.most_upload, phase_table.MAX_BYTES) if kind == "phase" else self.most_upload

    @contextlib.contextmanager
    def upload(self, name: str, kind: Kind = "scene") -> Iterator[Upload]:
        """Take a file that the page sends: it is there when it is whole, or not at all.

        Parameters
        ----------
        name
            A plain name of something of a kind; where it is taken, the file gets a number.

        Raises
        ------
        InputError
            As `inside`; a name that is no plain one or of an unknown kind; too many bytes, or none; or it
            cannot be written.
        """
        parts = _parts(name)
        if len(parts) != 1:
            raise InputError(f"{_shown(name)}: should be a plain name, without folders")
        _check_length(name)
        _check_kind(name, kind)
        path = self._free(name)
        try:
            with replacing(path) as temporary, temporary.open("wb") as stream:
                upload = Upload(path.name, stream, self.most_of(kind))
                yield upload
                if not upload.size:
                    raise InputError(f"{_shown(name)}: is empty")
        finally:
            with self._lock:
                self._arriving.discard(path)

    def _free(self, name: str) -> Path:
        """Take a name for a new file."""
        stem, suffix = name[: -len(_suffix(name))], name[-len(_suffix(name)) :]
        with self._lock:
            for number in range(1, MOST_OF_A_NAME + 1):
                path = self.folder / (name if number == 1 else f"{stem}-{number}{suffix}")
                if not os.path.lexists(path) and path not in {*self._arriving, *self._saved}:
                    self._arriving.add(path)
                    return path
        raise InputError(f"{_shown(name)}: is there {MOST_OF_A_NAME:,} times already; choose another name")

    def _is_inside(self, entry: os.DirEntry[str]) -> bool:
        return not entry.is_symlink() or real_path(Path(entry.path)).is_relative_to(self.folder)


@dataclass
class Upload:
    """A file that arrives in parts."""

    name: str
    """What it will be called in the folder."""
    stream: BinaryIO
    most: int
    """Bytes."""
    size: int = 0
    """Bytes so far."""

    def write(self, chunk: bytes) -> None:
        """Add a part.

        Raises
        ------
        InputError
            There are too many bytes, or no room for them.
        """
        self.size += len(chunk)
        if self.size > self.most:
            raise too_large(self.name, self.most)
        try:
            self.stream.write(chunk)
        except OSError as problem:
            full = problem.errno in {errno.ENOSPC, errno.EDQUOT}
            reason = "no room on the server's disk" if full else reason_of(problem)
            raise InputError(f"{self.name}: cannot be written ({reason})") from None


def break_off(opened: contextlib.ExitStack) -> None:
    """End an upload that was entered into a stack, if there is one: what is there of its file is removed."""
    error = ConnectionAbortedError()
    with contextlib.suppress(ConnectionAbortedError, InputError):
        opened.__exit__(type(error), error, None)


def too_large(name: str, most: int) -> InputError:
    """Return what is said of a file with too many bytes."""
    return InputError(f"{_shown(name)}: larger than {most:,} bytes; copy it into the viewer's folder instead")


def openable() -> set[str]:
    """Return the extensions of what the viewer opens: scenes, volumes, particles and curves."""
    return {".toml", *volume_io.FORMATS, *points_io.FORMATS, *curves_io.FORMATS}


def kind_of(said: object) -> Kind:
    """Return the kind that a page says.

    Raises
    ------
    InputError
        Another.
    """
    for kind in KINDS:
        if said == kind:
            return kind
    raise InputError(f"a file is of one kind: {' or '.join(KINDS)}")


def extensions_of(kind: Kind) -> set[str]:
    """Return the extensions of files of a kind."""
    return set(phase_table.EXTENSIONS) if kind == "phase" else openable()


def _check_kind(name: str, kind: Kind) -> None:
    known = extensions_of(kind)
    if _suffix(name) not in known:
        raise InputError(f"{_shown(name)}: is no {_MEANT[kind]}; known: {' '.join(sorted(known))}")


def _suffix(name: str) -> str:
    return Path(name).suffix.lower()


def _stamp(path: Path) -> _Stamp | None:
    """Tell a file from what it may become; None where it is gone."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _order(name: str) -> tuple[str, str]:
    return name.casefold(), name


def _check_length(name: str) -> None:
    if len(os.fsencode(name)) > MOST_NAME:
        raise InputError(f"{_shown(name)}: the name is longer than {MOST_NAME} bytes; shorten it")


def _parts(name: str) -> tuple[str, ...]:
    """Split a name from a page into those of folders and of what is in the last."""
    if not name:
        raise InputError("the name is empty: name a file of the viewer's folder")
    try:
        text = name_of(name)
        text.encode()
    except ValueError:
        wanted = "should be the name of a file, without control characters"
        raise InputError(f"{_shown(name)}: {wanted}") from None
    parts = tuple(text.removesuffix("/").split("/"))
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"{_shown(name)}: longer than {MOST_CHARACTERS:,} characters")
    for part in parts:
        if part in {"", ".", ".."}:
            raise InputError(f"{_shown(name)}: leads out of the viewer's folder; name a file in it")
        if part.startswith("."):
            raise InputError(f"{_shown(name)}: is hidden; the viewer leaves hidden files alone")
        if _FORBIDDEN & set(part) or part.endswith((".", " ")) or _DEVICE.fullmatch(part):
            raise InputError(f"{_shown(name)}: not every system has files called so; choose another name")
    return parts


def _shown(name: str) -> str:
    """Return a name as a message shows it: on one line, and not too long."""
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in name)
    return text if len(text) <= MOST_NAME else f"{text[:MOST_NAME]}…"
