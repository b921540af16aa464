"""Which device a name, a number or nothing means."""

from types import SimpleNamespace

import pyopencl as cl
import pytest

from tfm_cl.device import device
from tfm_cl.device.device import VARIABLE, choose_device, list_devices
from tfm_cl.errors import NoDeviceError

CPU, GPU = int(cl.device_type.CPU), int(cl.device_type.GPU)


def _device(platform, name, kind):
    return SimpleNamespace(
        platform=platform,
        name=name,
        type=kind,
        max_compute_units=1,
        global_mem_size=1,
        max_mem_alloc_size=1,
        max_work_group_size=1,
    )


@pytest.fixture
def machine(monkeypatch):
    """A CPU of PoCL, and two GPUs of another platform; returns them in their order."""
    pocl, other = (
        _Platform("Portable Computing Language", "OpenCL 3.0"),
        _Platform("Vendor CUDA", "OpenCL 3.0"),
    )
    devices = [_device(pocl, "cpu-zen", CPU), _device(other, "H200", GPU), _device(other, "RTX 4090", GPU)]
    monkeypatch.setattr(device, "_all_devices", lambda: devices)
    monkeypatch.delenv(VARIABLE, raising=False)
    return devices


class _Platform:
    def __init__(self, name, version):
        self.name, self.version = name, version


def test_a_gpu_comes_before_pocl(machine):
    assert choose_device() is machine[1]
    assert [found.default for found in list_devices()] == [False, True, False]


def test_pocl_comes_before_other_cpus(machine):
    machine[:] = [_device(_Platform("Other", "1"), "cpu", CPU), machine[0]]
    assert choose_device() is machine[1]


@pytest.mark.parametrize(
    ("wanted", "number"),
    [
        *[("0", 0), ("2", 2), ("zen", 0), ("vendor cuda", 1), ("4090", 2)],
        *[("1:1", 2), ("0:0", 0), ("cuda:rtx", 2), ("cuda: 1", 2), ("Vendor CUDA: H200", 1), ("1:4090", 2)],
    ],
)
def test_names_and_numbers(machine, monkeypatch, wanted, number):
    assert choose_device(wanted) is machine[number]
    monkeypatch.setenv(VARIABLE, wanted)
    assert choose_device() is machine[number]
    assert choose_device("H200") is machine[1]


def test_places_are_those_of_their_platform(machine):
    for number, found in enumerate(list_devices()):
        assert found.number == number
        assert choose_device(found.place) is machine[number]


@pytest.mark.parametrize("wanted", ["3", "1:2", "2:0", "pocl:zen", "GeForce"])
@pytest.mark.usefixtures("machine")
def test_what_is_not_there_lists_what_is(wanted):
    with pytest.raises(NoDeviceError, match=rf"^no OpenCL device has .* '{wanted}'; there is 0 '"):
        choose_device(wanted)


@pytest.mark.usefixtures("machine")
def test_the_variable_is_named(monkeypatch):
    monkeypatch.setenv(VARIABLE, "GeForce")
    with pytest.raises(NoDeviceError, match=f"^{VARIABLE}: no OpenCL device has .* 'GeForce'"):
        choose_device()
