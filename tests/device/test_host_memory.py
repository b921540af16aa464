"""Memory of pictures: whose it is, and how much is kept."""

import gc

import numpy as np

from tfm_cl.device.host_memory import HostMemory


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
