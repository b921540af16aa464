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


@pytest.mark.parametrize(
    "array",
    [
        np.arange(12, dtype=np.float32).reshape(3, 4)[:, ::2],
        np.array([(1, 2.0)], [("number", np.int32), ("value", np.float32)]),
        np.arange(3, dtype=np.uint8),
        np.zeros((0, 4), np.float32),
    ],
    ids=["strided", "struct", "three bytes", "empty"],
)
def test_what_is_uploaded_is_there_without_a_command(launcher, monkeypatch, array):
    monkeypatch.setattr(launcher, "write", lambda *_: pytest.fail("a command was enqueued"))
    buffer = launcher.upload("some numbers", array)
    assert buffer.size == max(array.nbytes, 16)
    assert (launcher.download(buffer, array.shape, array.dtype) == array).all()


def test_what_is_uploaded_is_as_large_as_a_buffer_at_most(launcher, monkeypatch):
    monkeypatch.setattr(launcher, "largest_buffer", 1 << 20)
    with pytest.raises(DeviceMemoryError, match=r"the voxels needs a buffer of 2 MiB; .* allows 1 MiB"):
        launcher.upload("the voxels", np.zeros(1 << 19, np.float32))
