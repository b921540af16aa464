"""Who hears of Ctrl-C and SIGTERM: Python in its main thread, and nothing that compiles."""

import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tfm_cl.errors import CancelledError
from tfm_cl.files import image_io
from tfm_cl.interrupts import (
    SIGNALS,
    TerminatedError,
    cancelled_by,
    check_cancelled,
    end_on_sigterm,
    interrupts_held,
    interrupts_ours,
)

pytestmark = pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals as POSIX sends them")


@pytest.fixture(params=[(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, TerminatedError)], ids=str)
def raising(request):
    """Return a signal, and what it raises in the program ``tfm``."""
    before = signal.getsignal(signal.SIGTERM)
    end_on_sigterm()
    yield request.param
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("held", [interrupts_held, interrupts_ours])
def test_signals_wait(held, raising):
    number, error = raising
    passed = []

    def interrupt():
        with held():
            signal.pthread_kill(threading.get_ident(), number)
            passed.append("the signal")

    with pytest.raises(error):
        interrupt()
    assert passed
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & {*SIGNALS}


def test_sigterm_that_is_to_be_ignored_is():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        end_on_sigterm()
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)


def test_formats_of_pictures_are_imported_whole(tmp_path, monkeypatch):
    """OpenEXR fails, or forgets Ctrl-C, where that meets it."""
    waiting = []

    def imported(*name):
        waiting.append(signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= {*SIGNALS})
        return importlib.import_module(*name)

    monkeypatch.setattr(image_io, "importlib", SimpleNamespace(import_module=imported))
    image_io.check_writable(tmp_path / "a.exr")
    assert waiting == [True]


CLAIMED = """
import ctypes, os, signal, threading
from tfm_cl.interrupts import TerminatedError, interrupts_to
ended, told = threading.Event(), []
def end():
    told.append(threading.current_thread() is threading.main_thread())
    ended.set()
for number, raised in ((signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, TerminatedError)):
    ended.clear()
    try:
        with interrupts_to(end):
            ctypes.CDLL(None).signal(number, None)  # as a compiler does, here with what ends a process
            os.kill(os.getpid(), number)
            assert ended.wait(30)
    except KeyboardInterrupt as error:
        assert type(error) is raised
    else:
        assert False
with interrupts_to(end):
    pass
assert told == [False, False], told
assert threading.active_count() == 1
assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
"""


TAKEN = """
import signal, threading
from tfm_cl.interrupts import interrupts_to
ended = threading.Event()
library = threading.Thread(target=threading.Event().wait, daemon=True)
library.start()
try:
    with interrupts_to(ended.set):
        signal.pthread_kill(library.ident, signal.SIGINT)
        assert ended.wait(30)
        threading.Event().wait(30)
except KeyboardInterrupt:
    print("raised")
assert threading.active_count() == 2
assert signal.set_wakeup_fd(-1) == -1
"""


def test_ctrl_c_is_heard_where_another_thread_gets_it():
    """Threads that a library began before do not keep it waiting; Python's main thread sleeps on."""
    command, started = [sys.executable, "-c", TAKEN], time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "raised\n", "")
    assert time.monotonic() - started < 30


def test_ctrl_c_ends_what_other_threads_do_whoever_claimed_it():
    done = subprocess.run(
        [sys.executable, "-c", CLAIMED], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")


COMPILING = """
import ctypes, glob, os, threading
import numpy
from tfm_cl.interrupts import end_on_sigterm
libc = ctypes.CDLL(None)
def handlers():
    found = []
    for number in (2, 15):
        action = ctypes.create_string_buffer(256)
        assert libc.sigaction(number, None, action) == 0
        found.append(action.raw[:8])
    return found
end_on_sigterm()
python = handlers()
before = set(os.listdir("/proc/self/task"))
import tfm_cl as tfm
from scenes import make_scene
with tfm.Renderer(DEVICE) as renderer:
    assert handlers() == python, "before the first launch"
    renderer.render(make_scene())
assert handlers() == python, "after a render"
for task in set(os.listdir("/proc/self/task")) - before:
    (mask,) = (line for line in open(f"/proc/self/task/{task}/status") if line.startswith("SigBlk"))
    assert int(mask.split()[1], 16) & 0x4002 == 0x4002, task
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="no /proc as Linux has it")
def test_a_compiler_does_not_take_them(device_name, tmp_path):
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


def test_work_is_cancelled_in_the_thread_that_does_it():
    def cancelled():
        raise CancelledError

    of_another = []
    check_cancelled()
    with cancelled_by(cancelled):
        thread = threading.Thread(target=lambda: of_another.append(check_cancelled()))
        thread.start()
        thread.join()
        with cancelled_by(lambda: None):
            check_cancelled()
        with pytest.raises(CancelledError):
            check_cancelled()
    check_cancelled()
    assert of_another == [None]
