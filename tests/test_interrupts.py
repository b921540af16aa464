"""Who hears of Ctrl-C: Python in its main thread, and nothing that compiles."""

import importlib
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from tfm_cl.files import image_io
from tfm_cl.interrupts import interrupts_held, interrupts_ours

pytestmark = pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals as POSIX sends them")


@pytest.mark.parametrize("held", [interrupts_held, interrupts_ours])
def test_ctrl_c_waits(held):
    passed = []

    def interrupt():
        with held():
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)
            passed.append("the signal")

    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert passed
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_formats_of_pictures_are_imported_whole(tmp_path, monkeypatch):
    """OpenEXR fails, or forgets Ctrl-C, where that meets it."""
    waiting = []

    def imported(*name):
        waiting.append(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))
        return importlib.import_module(*name)

    monkeypatch.setattr(image_io, "importlib", SimpleNamespace(import_module=imported))
    image_io.check_writable(tmp_path / "a.exr")
    assert waiting == [True]


COMPILING = """
import ctypes, glob, os, threading
import numpy
libc = ctypes.CDLL(None)
def handler():
    action = ctypes.create_string_buffer(256)
    assert libc.sigaction(2, None, action) == 0
    return action.raw[:8]
python = handler()
before = set(os.listdir("/proc/self/task"))
import tfm_cl as tfm
from scenes import make_scene
with tfm.Renderer(DEVICE) as renderer:
    assert handler() == python, "before the first launch"
    renderer.render(make_scene())
assert handler() == python, "after a render"
for task in set(os.listdir("/proc/self/task")) - before:
    (mask,) = (line for line in open(f"/proc/self/task/{task}/status") if line.startswith("SigBlk"))
    assert int(mask.split()[1], 16) & 2, task
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="no /proc as Linux has it")
def test_a_compiler_does_not_take_it(device_name, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", COMPILING.replace("DEVICE", repr(device_name))],
        cwd=Path(__file__).parent,
        env=os.environ | {"POCL_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
