"""Memory that kernels write and the host reads."""

import numpy as np
import pytest

from tfm_cl.errors import DeviceMemoryError


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
