"""Choosing an OpenCL device by name, and describing what there is."""

import atexit
import contextlib
import functools
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pyopencl as cl

from tfm_cl.errors import NoDeviceError

DEFAULT_PLATFORM = "Portable Computing Language"
"""PoCL, which pip installs with us: the device used when none is named."""

HOW_TO_GET_ONE = "install the embedded CPU device with: pip install 'pyopencl[pocl]'"


@dataclass(frozen=True)
class DeviceInfo:
    """One row of ``tfm devices``."""

    name: str
    platform: str
    version: str
    kind: str
    compute_units: int
    global_memory: int
    """Bytes."""
    max_allocation: int
    """Bytes of the largest single buffer."""
    max_work_group: int
    default: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self)


def list_devices() -> list[DeviceInfo]:
    """Describe every OpenCL device of this machine; an empty list when there is none."""
    devices = _all_devices()
    default = _preferred(devices) if devices else None
    return [
        DeviceInfo(
            name=device.name.strip(),
            platform=device.platform.name.strip(),
            version=device.platform.version.strip(),
            kind=_kind(device.type),
            compute_units=device.max_compute_units,
            global_memory=device.global_mem_size,
            max_allocation=device.max_mem_alloc_size,
            max_work_group=device.max_work_group_size,
            default=device is default,
        )
        for device in devices
    ]


def choose_device(name: str | None = None) -> cl.Device:
    """Find a device.

    Parameters
    ----------
    name
        Part of the device's or its platform's name, in any case; by default PoCL, else the first device.

    Raises
    ------
    NoDeviceError
        There is none (says how to get PoCL), or none of that name (lists the names).
    """
    devices = _all_devices()
    if not devices:
        raise NoDeviceError(f"no OpenCL device found; {HOW_TO_GET_ONE}")
    if name:
        wanted = name.casefold()
        for device in devices:
            if wanted in f"{device.platform.name} {device.name}".casefold():
                return device
        names = ", ".join(f"'{device.platform.name.strip()}: {device.name.strip()}'" for device in devices)
        raise NoDeviceError(f"no OpenCL device with '{name}' in its name; there is {names}")
    return _preferred(devices)


def _preferred(devices: list[cl.Device]) -> cl.Device:
    ours = [device for device in devices if DEFAULT_PLATFORM in device.platform.name]
    return (ours or devices)[0]


def _kind(bits: int) -> str:
    kinds = {"CPU": cl.device_type.CPU, "GPU": cl.device_type.GPU, "accelerator": cl.device_type.ACCELERATOR}
    return next((name for name, bit in kinds.items() if bits & int(bit)), "other")


def _all_devices() -> list[cl.Device]:
    with _usable_caches():
        try:
            platforms = cl.get_platforms()
        except cl.Error:  # the loader reports "no platform" as an error
            return []
        devices = []
        for platform in platforms:
            try:
                devices += platform.get_devices()
            except cl.Error:  # a platform without a device
                continue
        return devices


@contextlib.contextmanager
def _usable_caches() -> Iterator[None]:
    """Let PoCL and pyopencl start where the user's cache folder cannot be written.

    Without a folder to write to, PoCL has no device or compiles nothing, and pyopencl makes no kernel. Each
    looks for its folder once, so the environment names a temporary one only while they start.
    """
    caches = {"POCL_CACHE_DIR": _pocl_cache(), "XDG_CACHE_HOME": _pyopencl_cache()}
    unusable = [name for name, folder in caches.items() if os.name == "posix" and not _writable(folder)]
    before = {name: os.environ.get(name) for name in unusable}
    try:
        with contextlib.suppress(OSError):  # there is no temporary folder either
            os.environ.update({name: str(_temporary_folder() / name) for name in unusable})
            if "XDG_CACHE_HOME" in unusable:
                import pyopencl.invoker  # noqa: F401, PLC0415 - opens its cache when it is imported
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _pocl_cache() -> str:
    """Where PoCL keeps programs and machine code."""
    named, home = os.environ.get("POCL_CACHE_DIR"), os.environ.get("HOME")
    if named is not None:
        return named
    caches = os.environ.get("XDG_CACHE_HOME") or (f"{home}/.cache" if home is not None else "/tmp")  # noqa: S108
    return f"{caches}/pocl/kcache"


def _pyopencl_cache() -> str:
    """Where pyopencl keeps the Python code that launches kernels."""
    caches = os.environ.get("XDG_CACHE_HOME", "").strip() or os.path.expanduser("~/.cache")  # noqa: PTH111
    return f"{caches}/pytools"


def _writable(path: str) -> bool:
    """Whether the folder and what is in it can be written, or the folder can be made."""
    if not path:
        return False
    folder = Path(path).absolute()
    try:
        if folder.is_dir():
            return all(os.access(inner, os.W_OK) for inner in (folder, *folder.iterdir()))
        there = next(outer for outer in (folder, *folder.parents) if os.path.lexists(outer))
        return there.is_dir() and os.access(there, os.W_OK | os.X_OK)
    except OSError:
        return False


@functools.cache
def _temporary_folder() -> Path:
    """Make a folder that lasts as long as the process."""
    folder = Path(tempfile.mkdtemp(prefix="tfm_cl-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
