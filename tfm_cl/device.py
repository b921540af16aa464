"""Choosing an OpenCL device by name, and describing what there is."""

from dataclasses import asdict, dataclass
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
