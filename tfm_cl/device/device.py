"""Selects an OpenCL device by name or number, and describes the available ones."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import pyopencl as cl

from tfm_cl.device.kernel_cache import POCL, kernel_cache
from tfm_cl.errors import DeviceError, NoDeviceError
from tfm_cl.interrupts import interrupts_held

VARIABLE = "TFM_CL_DEVICE"
"""Environment variable that names the device where nothing else does."""

HOW_TO_GET_ONE = {
    "Linux x86-64": "the CPU, PoCL: pip install 'pyopencl[pocl]'",
    "Linux arm64": "the CPU, PoCL: conda install -c conda-forge pyopencl pocl",
    "macOS": "the CPU, PoCL: conda install -c conda-forge pyopencl pocl",
    "Windows": "the CPU, PoCL: conda install -c conda-forge pyopencl pocl",
    "GPUs": "the vendor's driver with its OpenCL; on Debian nvidia-opencl-icd or intel-opencl-icd",
}
"""System -> what brings a device to it."""
MOST_DEVICES = 100
"""Of a machine: a larger number is part of a name, as in "4090"."""
NO_DEVICE = (
    "no OpenCL device found; install a CPU's: pip install 'pyopencl[pocl]' (`tfm devices` lists what other "
    "systems and GPUs need)"
)


@dataclass(frozen=True)
class DeviceInfo:
    """A device, as in one row of ``tfm devices``."""

    number: int
    """Position in the list, from 0: what ``--device`` takes."""
    place: str
    """Numbers of the platform and of the device in it, ``0:0``."""
    name: str
    platform: str
    version: str
    kind: str
    compute_units: int
    global_memory: int
    """Size of the global memory, bytes."""
    max_allocation: int
    """Largest size of a single buffer, bytes."""
    max_work_group: int
    default: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self)


def list_devices() -> list[DeviceInfo]:
    """Describe every OpenCL device of this machine; the list is empty if there is none."""
    devices = _all_devices()
    default = _preferred(devices) if devices else None
    return [
        DeviceInfo(
            number=number,
            place=place,
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
        for number, (device, place) in enumerate(zip(devices, _places(devices), strict=True))
    ]


def choose_device(name: str | None = None) -> cl.Device:
    """Find a device.

    Parameters
    ----------
    name
        Part of the device's or its platform's name, in any case; its number in `list_devices`; or
        ``platform:device``, each by number or by part of its name. By default what the environment variable
        ``TFM_CL_DEVICE`` says; else a GPU if there is one, else PoCL, else the first device.

    Raises
    ------
    NoDeviceError
        If there is no device, or none of that name or number (the message lists those that there are).
    """
    devices = _all_devices()
    if not devices:
        raise NoDeviceError(NO_DEVICE)
    wanted = (name or os.environ.get(VARIABLE, "")).strip()
    if not wanted:
        return _preferred(devices)
    found = _of_name(devices, wanted)
    if found is None:
        names = ", ".join(
            f"{number} '{device.platform.name.strip()}: {device.name.strip()}'"
            for number, device in enumerate(devices)
        )
        said = "" if name else f"{VARIABLE}: "
        raise NoDeviceError(f"{said}no OpenCL device has the name or number '{wanted}'; there is {names}")
    return found


def _of_name(devices: list[cl.Device], wanted: str) -> cl.Device | None:
    if wanted.isdecimal() and int(wanted) < len(devices):
        return devices[int(wanted)]
    platform, colon, name = (part.strip() for part in wanted.partition(":"))
    for device, place in zip(devices, _places(devices), strict=True):
        of_platform, of_device = place.split(":")
        whole = wanted.casefold() in f"{device.platform.name} {device.name}".casefold()
        apart = (
            colon
            and _is_meant(platform, of_platform, device.platform.name)
            and _is_meant(name, of_device, device.name)
        )
        if whole or apart:
            return device
    return None


def _is_meant(wanted: str, number: str, name: str) -> bool:
    is_number = wanted.isdecimal() and int(wanted) < MOST_DEVICES
    return wanted == number if is_number else wanted.casefold() in name.casefold()


def _places(devices: list[cl.Device]) -> list[str]:
    """``platform:device`` of each, as numbers from 0."""
    platforms = list(dict.fromkeys(device.platform for device in devices))
    count = dict.fromkeys(platforms, 0)
    places = []
    for device in devices:
        places.append(f"{platforms.index(device.platform)}:{count[device.platform]}")
        count[device.platform] += 1
    return places


def _preferred(devices: list[cl.Device]) -> cl.Device:
    """Return a GPU if there is one, else PoCL, which is installed with the package, else the first."""
    gpus = [device for device in devices if int(device.type) & int(cl.device_type.GPU)]
    ours = [device for device in devices if POCL in device.platform.name]
    return (gpus or ours or devices)[0]


def _kind(bits: int) -> str:
    kinds = {"CPU": cl.device_type.CPU, "GPU": cl.device_type.GPU, "accelerator": cl.device_type.ACCELERATOR}
    return next((name for name, bit in kinds.items() if bits & int(bit)), "other")


def was_forked() -> bool:
    """Tell whether this process was forked from one that used OpenCL."""
    return bool(_used_by) and os.getpid() not in _used_by


def check_process() -> None:
    """Refuse OpenCL in a process that was forked from one that used it: its first call would hang.

    Raises
    ------
    DeviceError
        If this is such a process.
    """
    if was_forked():
        raise DeviceError(
            "this process was forked from one that uses OpenCL, which does not survive that; start processes "
            "with spawn: multiprocessing.get_context('spawn')"
        )


_used_by: set[int] = set()
"""Number of the process that has used OpenCL, if any; a forked process inherits it."""


def _all_devices() -> list[cl.Device]:
    check_process()
    _used_by.add(os.getpid())
    devices = []
    with interrupts_held(), _own_caches() as refusal:  # drivers start threads, which start compilers
        try:
            platforms = cl.get_platforms()
        except cl.Error:  # the loader reports "no platform" as an error
            platforms = []
        for platform in platforms:
            with contextlib.suppress(cl.Error):  # a platform without a device
                devices += platform.get_devices()
    if refusal is not None and not devices:
        raise refusal
    return devices


@contextlib.contextmanager
def _own_caches() -> Iterator[DeviceError | None]:
    """Start PoCL and pyopencl with the caches of this process; yields the reason if that is impossible.

    Each reads the name of its folder once, so the environment variables are set only while they start.
    """
    if os.name != "posix":
        yield None
        return
    try:
        cache = kernel_cache()
    except DeviceError as error:
        yield error
        return
    folders = {"POCL_CACHE_DIR": str(cache.folder), "XDG_CACHE_HOME": str(cache.others)}
    before = {name: os.environ.get(name) for name in folders}
    os.environ.update(folders)
    try:
        import pyopencl.invoker  # noqa: F401, PLC0415 - opens its database when it is imported

        yield None
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
