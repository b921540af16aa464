"""How much memory a call takes."""

import tracemalloc
from pathlib import Path

import pytest

from tfm_cl.errors import VolumeError


def peak_of(function):
    """What a function returns (or a `VolumeError` it raises), and the memory that takes at most."""
    tracemalloc.start()
    try:
        result = function()
    except VolumeError as error:
        result = error
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return result, peak


def resident():
    """Bytes of this process in memory; skips where the system does not say."""
    status = Path("/proc/self/status")
    if not status.is_file():
        pytest.skip("no /proc/self/status here")
    (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmRSS:"))
    return 1024 * int(line.split()[1])
