"""Records of frames that are done, and claims on those that are being made."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import tfm_cl as tfm
from tfm_cl.sequence import claims
from tfm_cl.sequence.claims import Ledger

HOLDS = """
import sys, time
from pathlib import Path
from tfm_cl.sequence.claims import Ledger
with Ledger(Path(sys.argv[1])) as ledger:
    print(ledger.claim("a.0001.exr") is not None, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / ".a.tfm") as ledger:
        yield ledger


@pytest.fixture
def outputs(tmp_path):
    """Files of a frame that are there."""
    paths = [tmp_path / "a.0001.exr", tmp_path / "a.0001.png"]
    for path in paths:
        path.write_bytes(b"picture")
    return paths


@pytest.fixture
def other(tmp_path):
    """Another process that has claimed the frame."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(tmp_path / ".a.tfm")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "True\n"
    yield process
    process.kill()
    process.communicate()


class TestDone:
    def test_as_long_as_nothing_changes(self, ledger, outputs):
        assert not ledger.is_done("a.0001.exr", "1", outputs)
        ledger.record("a.0001.exr", "1", outputs)
        assert ledger.is_done("a.0001.exr", "1", outputs)
        ledger.forget("a.0001.exr")
        assert not ledger.is_done("a.0001.exr", "1", outputs)

    @pytest.mark.parametrize("change", ["fingerprint", "gone", "shorter", "newer", "asked for"])
    def test_not_when_anything_does(self, ledger, outputs, change):
        ledger.record("a.0001.exr", "1", outputs)
        if change == "gone":
            outputs[1].unlink()
        elif change == "shorter":
            status = outputs[1].stat()
            outputs[1].write_bytes(b"pict")
            os.utime(outputs[1], ns=(status.st_atime_ns, status.st_mtime_ns))
        elif change == "newer":
            os.utime(outputs[1], (0, 0))
        asked = outputs[:1] if change == "asked for" else outputs
        assert not ledger.is_done("a.0001.exr", "2" if change == "fingerprint" else "1", asked)

    @pytest.mark.parametrize("text", [b"", b"{", b"[]", b"\xff", b"[" * 10**5, b'{"fingerprint": "1"}'])
    def test_damage_counts_as_not_done(self, ledger, outputs, tmp_path, text):
        (tmp_path / ".a.tfm" / "a.0001.exr.done").write_bytes(text)
        assert not ledger.is_done("a.0001.exr", "1", outputs)


class TestClaims:
    def test_one_at_a_time(self, ledger):
        claim = ledger.claim("a.0001.exr")
        assert claim.is_held()
        assert ledger.claim("a.0001.exr") is None
        assert ledger.holder("a.0001.exr").pid == os.getpid()
        assert ledger.claim("a.0002.exr") is not None
        ledger.release(claim)
        assert ledger.holder("a.0001.exr") is None
        assert ledger.claim("a.0001.exr") is not None

    def test_many_at_once_give_one(self, tmp_path):
        with ThreadPoolExecutor(8) as threads, Ledger(tmp_path / "x") as ledger:
            found = list(threads.map(lambda _: ledger.claim("a"), range(64)))
        assert len([claim for claim in found if claim]) == 1

    def test_nothing_is_left(self, tmp_path):
        with Ledger(tmp_path / "x") as ledger:
            ledger.claim("a")
            ledger.claim("b")
        assert not (tmp_path / "x").exists()

    def test_ends_with_its_process(self, ledger, other):
        assert ledger.claim("a.0001.exr") is None
        assert str(ledger.holder("a.0001.exr")) == f"process {other.pid} on {socket.gethostname()}"
        os.kill(other.pid, signal.SIGKILL)
        other.wait()
        assert ledger.claim("a.0001.exr") is not None

    @pytest.mark.skipif(os.name != "posix", reason="processes are told by number on POSIX")
    def test_ends_with_its_process_where_there_are_no_locks(self, ledger, other, monkeypatch):
        monkeypatch.setattr(claims, "lock", lambda _: True)
        path = next(ledger._folder.glob("*.claim"))
        path.write_text(json.dumps(json.loads(path.read_text()) | {"locked": False}))
        assert ledger.claim("a.0001.exr") is None
        os.kill(other.pid, signal.SIGKILL)
        other.wait()
        assert ledger.claim("a.0001.exr") is not None

    @pytest.mark.parametrize(
        "text", ["", "{}", '{"host": "elsewhere", "machine": "x", "pid": 1, "token": "1", "locked": true}']
    )
    def test_of_another_machine_expires(self, tmp_path, text):
        with Ledger(tmp_path / "x", expired_after=60) as ledger:
            path = tmp_path / "x" / "a.claim"
            path.write_text(text)
            assert ledger.claim("a") is None
            before = time.time() - 61
            os.utime(path, (before, before))
            assert ledger.claim("a") is not None

    @pytest.mark.parametrize("kind", ["later", "link", "pipe"])
    def test_what_nobody_renews_expires(self, tmp_path, kind):
        """Also one of a clock that was set back since, or what is no claim at all."""
        with Ledger(tmp_path / "x", expired_after=60) as ledger:
            path, old = tmp_path / "x" / "a.claim", time.time() + (61 if kind == "later" else -61)
            if kind == "link":
                path.symlink_to("nowhere")
            elif kind == "pipe":
                if not hasattr(os, "mkfifo"):
                    pytest.skip("no pipes with names")
                os.mkfifo(path)
            else:
                path.write_text("{}")
            assert ledger.claim("a") is None
            os.utime(path, (old, old), follow_symlinks=False)
            assert ledger.claim("a") is not None

    @pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="no /proc as Linux has it")
    def test_whoever_renews_hears_of_no_ctrl_c(self, ledger):
        """Else it waits nowhere: a process's signal goes to any thread that takes it."""
        status = Path(f"/proc/self/task/{ledger._renewer.native_id}/status").read_text()
        blocked = next(line for line in status.splitlines() if line.startswith("SigBlk"))
        assert int(blocked.split()[1], 16) & 1 << signal.SIGINT - 1

    def test_is_renewed(self, tmp_path):
        with Ledger(tmp_path / "x", expired_after=0.2) as ledger:
            claim = ledger.claim("a")
            os.utime(tmp_path / "x" / "a.claim", (0, 0))
            deadline = time.monotonic() + 10
            while (tmp_path / "x" / "a.claim").stat().st_mtime == 0 and time.monotonic() < deadline:
                time.sleep(0.01)
            assert (tmp_path / "x" / "a.claim").stat().st_mtime > 0
            assert claim.is_held()

    def test_what_another_took_stays_its(self, tmp_path):
        """A machine that slept for long neither thinks that it holds the frame nor ends the new claim."""
        with Ledger(tmp_path / "x") as ledger:
            claim, path = ledger.claim("a"), tmp_path / "x" / "a.claim"
            path.write_text('{"host": "elsewhere", "machine": "x", "pid": 1, "token": "1", "locked": true}')
            assert not claim.is_held()
            claim.renew()
        assert path.exists()


def test_an_empty_folder_goes_and_comes_again(ledger, outputs, tmp_path):
    with Ledger(tmp_path / ".a.tfm"):
        pass
    assert not (tmp_path / ".a.tfm").exists()
    assert ledger.claim("a.0001.exr") is not None
    ledger.record("a.0001.exr", "made", outputs)
    assert ledger.is_done("a.0001.exr", "made", outputs)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "x").write_text("")
    with pytest.raises(tfm.InputError, match="x: cannot be written"), Ledger(tmp_path / "x"):
        pass
