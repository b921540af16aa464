"""Memory that kernels write and the host reads."""

import gc

import numpy as np
import pytest

from tfm_cl.device.launch import HostMemory
from tfm_cl.errors import DeviceMemoryError


def test_memory_serves_again_when_nobody_looks_at_it():
    memory = HostMemory()
    first = memory.take(1 << 16)
    where, part = first.ctypes.data, first[16:32].view(np.float32)
    del first
    gc.collect()
    assert memory.take(1 << 16).ctypes.data != where, "a part is still looked at"
    del part
    gc.collect()
    assert memory.take(1 << 15).ctypes.data != where, "another size"
    again = memory.take(1 << 16)
    assert again.ctypes.data == where
    again[:] = 3
    assert (again == 3).all()


def test_no_more_is_kept_than_there_is_room_for(monkeypatch):
    monkeypatch.setattr(HostMemory, "MOST_BYTES", 100_000)
    memory = HostMemory()
    held = [memory.take(60_000) for _ in range(3)]
    held.clear()
    gc.collect()
    assert memory.nbytes == 60_000
    memory.clear()
    assert memory.nbytes == 0


@pytest.mark.parametrize("shares", [True, False])
def test_the_host_reads_what_was_written(launcher, monkeypatch, shares):
    monkeypatch.setattr(launcher, "_shares_memory", shares)
    output = launcher.output("numbers", (5, 3), np.uint32)
    launcher.write(output.buffer, np.arange(15, dtype=np.uint32))
    numbers = launcher.read(output)
    assert (numbers == np.arange(15).reshape(5, 3)).all()
    assert output.nbytes == 60


def test_outputs_are_as_large_as_a_buffer_at_most(launcher, monkeypatch):
    monkeypatch.setattr(launcher, "largest_buffer", 1 << 20)
    with pytest.raises(DeviceMemoryError, match=r"the picture needs a buffer of 2 MiB; .* allows 1 MiB"):
        launcher.output("the picture", (1 << 19,), np.float32)
