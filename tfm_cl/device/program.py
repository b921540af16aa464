"""Building kernels: one small stub a program, that names the headers and the entry file.

Drivers cache what they compile. PoCL has, by the preprocessed text, each program and, for each work-group
size a kernel is launched with, its machine code; `tfm_cl.device.kernel_cache` keeps that for later
processes. For drivers without a cache of their own pyopencl keeps binaries.
"""

import contextlib
import functools
import hashlib
import importlib.util
import os
import shutil
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
from pyopencl import cltypes

from tfm_cl.device.kernel_cache import POCL, KeptProgram, KernelCache, kernel_cache
from tfm_cl.device.structs import c_text
from tfm_cl.errors import KernelBuildError
from tfm_cl.interrupts import check_cancelled, interrupts_ours


def kernels_dir() -> Path:
    """Return the folder of the OpenCL sources: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "kernels", package.parent / "kernels"):
        if (folder / "light_pass.cl").is_file():
            return folder
    raise KernelBuildError(f"the OpenCL sources are missing from {package}; reinstall tfm_cl")


def source(entry: str, headers: tuple[str, ...], defines: Mapping[str, int | str]) -> str:
    """Return the text handed to the compiler.

    The sources are included, not pasted, so that the compiler's messages name file and line. Ours by their
    whole path: drivers look in the working directory first, where a file may have the same name.
    """
    folder = kernels_dir()
    lines = [f"#define {name} {value}" for name, value in sorted(defines.items())]
    files = [folder / name if (folder / name).is_file() else name for name in (*headers, entry)]
    lines += [f"/* {name}: {_beside(Path(name))} */" for name in headers if Path(name).is_absolute()]
    return "\n".join([*lines, c_text(), *(f'#include "{name}"' for name in files), ""])


@functools.cache
def _beside(header: Path) -> str:
    """Return a digest of a plugin's header, and of those beside it that it may include, as first seen."""
    return fingerprint(header.parent, "*.h")


def fingerprint(folder: Path, files: str = "**/*") -> str:
    """Return a digest of all OpenCL sources below a folder, by name and content."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.glob(files) if path.suffix in {".cl", ".h"}):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(folder).as_posix()} {len(content)} ".encode() + content)
    return digest.hexdigest()


def kernel_name(context: cl.Context, text: str, options: tuple[str, ...]) -> str:
    """Return the name of a program's only kernel: it is kept where programs are, and saves building that.

    Raises
    ------
    KernelBuildError
        With the compiler's log.
    """
    (device,) = context.devices
    cache, key = _cache_of(device), (text, *options, *_versions(device))
    known = cache.answer(*key) if cache else None
    if known is None:
        program, _ = build(context, text, options, "a probe of the compiler")
        known = program.kernel_names
        if cache:
            cache.keep_answer(known, *key)
    return known


def _cache_of(device: cl.Device) -> KernelCache | None:
    """Return where its programs are kept, if the driver leaves that to us."""
    return kernel_cache() if os.name == "posix" and POCL in device.platform.name else None


def _versions(device: cl.Device) -> tuple[str, ...]:
    """Return what a compiled program is good for; PoCL's version of a device names the processor."""
    added = os.environ.get("POCL_EXTRA_BUILD_FLAGS", "")  # options that PoCL adds to ours
    return device.name, device.version, device.driver_version, device.platform.version, added


def build(
    context: cl.Context,
    text: str,
    options: tuple[str, ...],
    what: str,
    compiling: Callable[[], None] = lambda: None,
) -> tuple[cl.Program, KeptProgram | None]:
    """Build a program; returns it, and what keeps it where the driver leaves that to us.

    Parameters
    ----------
    what
        That is compiled, for messages.
    compiling
        Called first if it is not kept.

    Raises
    ------
    KernelBuildError
        With the compiler's log.
    """
    (device,) = context.devices
    kept = None
    if cache := _cache_of(device):
        _check_linker(device.platform.version)
        kept = cache.program(text, *options, *_versions(device))
    else:
        compiling()
    keeping = kept.building(compiling) if kept else contextlib.nullcontext()
    with warnings.catch_warnings(), keeping, interrupts_ours():
        # pyopencl warns of any compiler output, even empty remarks; errors raise all the same.
        warnings.simplefilter("ignore", cl.CompilerWarning)
        try:
            program: cl.Program = cl.Program(context, text).build(list(options))
        except cl.Error as error:
            raise KernelBuildError(f"{what} does not compile on this device: {error}") from error
    return program, kept


def _check_linker(version: str) -> None:
    """Refuse to compile where the PoCL that pip installs would end the process for want of a linker."""
    pip_installed = importlib.util.find_spec("pocl_binary_distribution") is not None
    if not pip_installed or "PoCL 3.0" not in version:
        return
    folders = os.pathsep.join((os.environ.get("PATH", ""), *LINKER_FOLDERS))
    if shutil.which("ld", path=folders) is None:
        raise KernelBuildError(
            "PoCL needs the linker 'ld', which is not installed; on Debian and Ubuntu: apt install binutils"
        )


LINKER_FOLDERS = ("/usr/bin", "/usr/local/bin", "/bin")
"""Where PoCL finds it even if PATH does not name them."""


class _LaunchClock:
    """Adds up what the driver does between taking a launch and starting it on the device.

    That is compilation: PoCL makes a kernel's machine code when it first meets a work-group size, and GPU
    drivers finish theirs likewise. The launches before it on an in-order queue are not counted.
    """

    def __init__(self) -> None:
        self._seconds = 0.0
        self._events: list[cl.Event] = []
        self._busy_until = 0

    def add(self, event: cl.Event) -> None:
        """Take note of a launch."""
        self._settle()
        self._events.append(event)

    @property
    def seconds(self) -> float:
        """Of the launches that are finished."""
        self._settle()
        return self._seconds

    def _settle(self) -> None:
        running = []
        for event in self._events:
            if event.command_execution_status > cl.command_execution_status.COMPLETE:
                running.append(event)
                continue
            try:
                queued, start, end = event.profile.queued, event.profile.start, event.profile.end
            except cl.Error:  # it failed, or its queue takes no times
                continue
            self._seconds += max(0, start - max(queued, self._busy_until)) * 1e-9
            self._busy_until = end
        self._events = running


class Kernel(cl.Kernel):
    """A kernel of ours: its launches are timed, and its arguments have names."""

    def __init__(self, program: cl.Program, name: str, clock: _LaunchClock, kept: KeptProgram | None) -> None:
        super().__init__(program, name)
        self._clock, self._kept = clock, kept
        self._sizes: set[tuple[int, ...]] = set()
        info = cl.kernel_arg_info
        self.parameters: dict[str, str] = {
            str(self.get_arg_info(i, info.NAME)): str(self.get_arg_info(i, info.TYPE_NAME))
            for i in range(self.num_args)
        }
        """Name -> OpenCL type of each argument, in order: of its own signature."""

    def keep(self, size: tuple[int, ...]) -> None:
        """Keep what was compiled for its launches so far; the last one, of that size, has ended."""
        # Nothing is compiled for sizes like those before: drivers tell small ones from large ones.
        like = tuple(n.bit_length() for n in size)
        if self._kept is not None and like not in self._sizes:
            self._kept.keep()
            self._sizes.add(like)

    def ordered(self, arguments: Mapping[str, Any]) -> list[Any]:
        """Put arguments in the order of its signature, as the types that it has.

        Raises
        ------
        TypeError
            Arguments that it does not have, or that are missing: a mistake of the program.
        """
        if arguments.keys() != self.parameters.keys():
            missing = ", ".join(name for name in self.parameters if name not in arguments)
            strange = ", ".join(name for name in arguments if name not in self.parameters)
            raise TypeError(
                f"{self.function_name}: missing: {missing or 'none'}; unknown: {strange or 'none'}"
            )
        return [_argument(arguments[name], kind) for name, kind in self.parameters.items()]

    def __call__(self, *args: Any, **options: Any) -> cl.Event:
        """Launch it, as `pyopencl.Kernel` does."""
        event = super().__call__(*args, **options)
        self._clock.add(event)
        return event


SCALARS = {"int": np.int32, "float": np.float32}
"""OpenCL types that Python's numbers are passed as."""


def _argument(value: Any, kind: str) -> Any:
    """Make a number, or numbers in a tuple, what a kernel's argument of that OpenCL type takes."""
    if kind in SCALARS:
        return SCALARS[kind](value)
    return np.array(value, getattr(cltypes, kind)) if isinstance(value, tuple) else value


class KernelLibrary:
    """Compiled programs of one context; each variant is built once and its kernels are kept.

    Parameters
    ----------
    context
        With one device.
    options
        Further compiler options; ``-Werror`` makes warnings errors.
    """

    def __init__(self, context: cl.Context, options: tuple[str, ...] = ()) -> None:
        self._context = context
        self._options = ("-cl-std=CL1.2", "-cl-kernel-arg-info", *options)
        self._kernels: dict[tuple[object, ...], Kernel] = {}
        self._build_seconds = 0.0
        self._clock = _LaunchClock()
        self.on_compiling: Callable[[str], None] | None = None
        """Called before a program is compiled that is not kept from before, with its name in words."""

    @functools.cached_property
    def _fingerprint(self) -> str:
        """Of the sources as this library first saw them."""
        return fingerprint(kernels_dir())

    @property
    def seconds(self) -> float:
        """Time spent compiling so far: building programs, and what drivers put off until a launch."""
        return self._build_seconds + self._clock.seconds

    def kernel(
        self,
        name: str,
        entry: str,
        headers: tuple[str, ...] = (),
        defines: Mapping[str, int | str] | None = None,
    ) -> Kernel:
        """Return kernel ``name`` of the file ``entry``.

        Parameters
        ----------
        entry
            Name below ``kernels/``.
        headers
            Included before it: the basis, light and phase function chosen.
        defines
            Macros that the entry file lists as required.

        Raises
        ------
        KernelBuildError
            With the compiler's log.
        """
        variant = (entry, headers, *sorted((defines or {}).items()))
        if (name, variant) not in self._kernels:
            check_cancelled()
            started = time.perf_counter()
            program, kept = self._build(source(entry, headers, defines or {}), entry)
            for found in program.kernel_names.split(";"):
                self._kernels[found, variant] = Kernel(program, found, self._clock, kept)
            self._build_seconds += time.perf_counter() - started
            check_cancelled()
        return self._kernels[name, variant]

    def ran(self, kernel: cl.Kernel, size: tuple[int, ...]) -> None:
        """Take note that a launch of that size has ended well: what was compiled for it can be kept."""
        if isinstance(kernel, Kernel):
            kernel.keep(size)

    def _build(self, text: str, entry: str) -> tuple[cl.Program, KeptProgram | None]:
        # Some drivers' caches know a program by its text alone, and miss that an included file has changed.
        text += f"/* kernels: {self._fingerprint} */\n"
        options = (*self._options, "-I", str(kernels_dir()))
        return build(self._context, text, options, entry, lambda: self._tell_compiling(entry))

    def _tell_compiling(self, entry: str) -> None:
        if self.on_compiling is not None:
            self.on_compiling(Path(entry).stem.replace("_", " "))
