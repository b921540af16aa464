"""Caches the kernels that PoCL compiles, in such a way that no run can break a later one.

PoCL terminates the whole process if its cache has no room or holds damaged files. Each process therefore has
a PoCL cache of its own, initially empty, in a folder with room (`tfm_cl.device.scratch`). Programs that ran
successfully are kept for later processes in a folder of the user: one file per program, which begins with its
digest.
"""

import contextlib
import functools
import hashlib
import io
import logging
import os
import shutil
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

from tfm_cl.device.scratch import Scratch, make_scratch
from tfm_cl.errors import DeviceError

POCL = "Portable Computing Language"
"""Name of PoCL's platform: it is installed with the package, and its kernels are kept."""
KEPT_DAYS = 90
"""Age in days at which unused programs are removed."""

MOST_BYTES = 64 << 20
"""Largest number of bytes of a kept program; typical programs have a few hundred KiB."""

SUFFIX = ".kernels"

LOG = logging.getLogger(__name__)
COMPILING = "compiling kernels (first time on this machine)"
"""Told once by a process that has to."""


class Store:
    """The user's folder in which programs are kept.

    Parameters
    ----------
    folder
        Created if missing. If it cannot be used, nothing is kept, and `take_notes` says so.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._usable = self._writable = True
        self._damaged = 0
        self._notes: list[str] = []
        try:
            _make_own(folder)
        except OSError as error:
            self._usable = False
            self._tell(error)

    def read(self, name: str) -> bytes | None:
        """Return what was kept under a name, or None; a damaged file is deleted."""
        path = self._folder / f"{name}{SUFFIX}"
        if not self._usable or not os.path.lexists(path):
            return None
        content = b""
        with contextlib.suppress(OSError):
            if path.is_file() and path.stat().st_size <= MOST_BYTES:
                content = path.read_bytes()
        digest, packed = content[:32], content[32:]
        if digest != hashlib.sha256(packed).digest():
            self._damaged += 1
            _remove(path)
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return packed

    def write(self, name: str, packed: bytes) -> None:
        """Keep data under a name, or note why they cannot be kept."""
        if not self._usable or not self._writable:
            return
        temporary = None
        try:
            with tempfile.NamedTemporaryFile(dir=self._folder, suffix=f"{SUFFIX}.tmp", delete=False) as file:
                temporary = Path(file.name)
                file.write(hashlib.sha256(packed).digest() + packed)
            temporary.replace(self._folder / f"{name}{SUFFIX}")
        except OSError as error:
            self._writable = False
            self._tell(error)
            if temporary is not None:
                _remove(temporary)
        self._remove_old()

    def take_notes(self) -> tuple[str, ...]:
        """Return notes for the user, each once."""
        notes, self._notes = self._notes, []
        if self._damaged:
            files = "1 damaged file" if self._damaged == 1 else f"{self._damaged} damaged files"
            notes.append(f"{self._folder}: {files} thrown away, the kernels in there were compiled again")
            self._damaged = 0
        return tuple(notes)

    def _tell(self, error: OSError) -> None:
        self._notes.append(
            f"{self._folder}: compiled kernels cannot be kept there ({error.strerror or error}), so each run "
            "compiles them again; set POCL_CACHE_DIR to a folder of your own that has room"
        )

    @functools.cache  # noqa: B019 - once for the single store of a process
    def _remove_old(self) -> None:
        with contextlib.suppress(OSError):
            for path in self._folder.glob(f"*{SUFFIX}*"):
                if time.time() - path.lstat().st_mtime > KEPT_DAYS * 86400:
                    _remove(path)


class KernelCache:
    """The PoCL cache of this process, exchanging programs with a store.

    Parameters
    ----------
    scratch
        The folder of this process.
    store
        Where programs are kept for other processes.
    """

    def __init__(self, scratch: Scratch, store: Store) -> None:
        self.folder = scratch.path / "pocl"
        """Folder of PoCL's own cache, ``POCL_CACHE_DIR``."""
        self.others = scratch.path / "caches"
        """``XDG_CACHE_HOME`` for pyopencl's database, whose contents are quick to recreate."""
        for folder in (self.folder, self.others):
            folder.mkdir()
        self._scratch, self._store = scratch, store
        self._programs: dict[str, KeptProgram] = {}
        self.lock = threading.Lock()
        """Held while a program is built, so that the folders it creates can be identified."""

    def program(self, *key: str) -> "KeptProgram":
        """Return the program identified by these texts."""
        name = _name(key)
        return self._programs.setdefault(name, KeptProgram(self, name))

    def answer(self, *key: str) -> str | None:
        """Return the line that was kept under these texts, or None."""
        kept = self._store.read(_name(key, "answer"))
        return None if kept is None else kept.decode()

    def keep_answer(self, line: str, *key: str) -> None:
        """Keep what a program told, instead of the program."""
        self._store.write(_name(key, "answer"), line.encode())

    def take_notes(self) -> tuple[str, ...]:
        """Return notes for the user, each once."""
        return self._store.take_notes()

    def folders(self) -> set[Path]:
        """Return PoCL's folders, one per program."""
        return {path for path in self.folder.glob("*/*") if path.is_dir()}

    def restore(self, name: str, compiling: Callable[[], None]) -> None:
        """Give PoCL the kept copy of a program, or make sure that there is room to compile it, and say so.

        Raises
        ------
        DeviceError
            If there is no room.
        """
        packed = self._store.read(name)
        try:
            if packed is None:
                self._scratch.check_room()
                say_compiling()
                compiling()
            else:
                zipfile.ZipFile(io.BytesIO(packed)).extractall(self.folder)
        except OSError as error:
            raise DeviceError(
                f"{self._scratch.path.parent}: no room is left for compiling kernels "
                f"({error.strerror or error}); make room there, or set TMPDIR to a folder that has it"
            ) from error

    def keep(self, name: str, folders: set[Path]) -> None:
        """Keep PoCL's files of a program."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", strict_timestamps=False) as archive:
            for path in sorted(path for folder in folders for path in folder.rglob("*")):
                archive.write(path, path.relative_to(self.folder))
        self._store.write(name, packed.getvalue())


class KeptProgram:
    """A program in a `KernelCache`.

    Parameters
    ----------
    cache
        The cache in which it is built.
    name
        The name under which it is kept.
    """

    def __init__(self, cache: KernelCache, name: str) -> None:
        self._cache, self._name = cache, name
        self._folders: set[Path] = set()
        self._kept: set[Path] = set()

    @contextlib.contextmanager
    def building(self, compiling: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Build the program inside this context, from its kept copy if there is one.

        Parameters
        ----------
        compiling
            Called if there is none.

        Raises
        ------
        DeviceError
            If it is not kept and there is no room to compile it.
        """
        with self._cache.lock:
            if self._folders:  # built before, in another context
                yield
                return
            before = self._cache.folders()
            try:
                self._cache.restore(self._name, compiling)
                restored = self._cache.folders() - before
                yield
            except BaseException:
                for folder in self._cache.folders() - before:
                    _remove(folder)
                raise
            # PoCL creates another folder if the kept copy is for another processor or another included file.
            self._folders = self._cache.folders() - before - restored or restored
            self._kept = self._compiled(restored)

    def keep(self) -> None:
        """Keep the program with everything compiled so far; call this after it has run."""
        compiled = self._compiled(self._folders)
        if not compiled <= self._kept:
            self._kept = compiled
            self._cache.keep(self._name, self._folders)

    @staticmethod
    def _compiled(folders: set[Path]) -> set[Path]:
        """Return folders: the program's, and one for each work-group size for which a kernel was compiled."""
        return folders | {path for folder in folders for path in folder.glob("*/*")}


def _name(key: tuple[str, ...], kind: str = "program") -> str:
    return hashlib.sha256("\0".join((kind, *key)).encode()).hexdigest()


@functools.cache
def kernel_cache() -> KernelCache:
    """Return the cache of this process; it is created at the first call.

    Raises
    ------
    DeviceError
        If there is no room for it anywhere.
    """
    folder = store_folder()
    store = Store(folder)
    return KernelCache(make_scratch(others=[folder]), store)


@functools.cache  # a process has much to compile, if it has anything
def say_compiling() -> None:
    """Log that kernels are compiled, which takes seconds."""
    LOG.info(COMPILING)


def take_notes() -> tuple[str, ...]:
    """Return notes for the user about this process's cache, if it has one; each line once."""
    return kernel_cache().take_notes() if kernel_cache.cache_info().currsize else ()


def store_folder() -> Path:
    """Folder for compiled kernels: in ``POCL_CACHE_DIR``, or else in the user's cache folder."""
    if named := os.environ.get("POCL_CACHE_DIR"):
        return Path(named).absolute() / "tfm_cl" / "kernels"
    caches = os.environ.get("XDG_CACHE_HOME", "").strip() or os.path.expanduser("~/.cache")  # noqa: PTH111
    return Path(caches) / "tfm_cl" / "kernels"


def _make_own(folder: Path) -> None:
    """Make a folder; raise an OSError unless only this user can write there, since its files are executed."""
    if not folder.is_absolute():
        raise FileNotFoundError(0, "there is no home folder")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = folder.stat()
    if found.st_uid != os.geteuid():
        raise PermissionError(0, "it belongs to somebody else")
    if found.st_mode & 0o022:
        raise PermissionError(0, "others may write there")


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
