"""Ctrl-C in the middle of a long render."""

import os
import signal
import subprocess
import time

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")


@pytest.fixture
def long_render(cloud, program, device_name):
    """Start a dual render of minutes; returns the process once it has started to march."""
    device = ("--device", device_name) if device_name else ()
    size = ("--method", "dual", "--res", "1024x1024", "--steps", "300", "--light-steps", "300")
    report = cloud.with_name("told")
    with report.open("wb") as told:
        process = subprocess.Popen(
            program("render", cloud, "-o", "a.npy", "-o", "a.exr", "--json", "a.json", *size, *device),
            cwd=cloud.parent,
            stdout=subprocess.PIPE,
            stderr=told,
            start_new_session=True,
        )
    try:
        deadline = time.monotonic() + 60
        while b"chosen" not in report.read_bytes() and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(1.5)
        assert process.poll() is None, report.read_text()
        yield process, report
    finally:
        process.kill()
        process.wait()


def test_ctrl_c(long_render, cloud):
    process, report = long_render
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    took = time.monotonic() - sent
    assert process.returncode == 130
    assert out == b""
    chosen, told = report.read_text().splitlines()
    assert chosen.startswith("chosen for cloud.npy: ")
    assert told == "tfm: interrupted"
    assert sorted(path.name for path in cloud.parent.iterdir()) == ["cloud.npy", "told"]
    assert took < 5


@pytest.mark.parametrize("suffix", ["npy", "exr", "png"])
def test_while_a_picture_is_being_written(cli, cloud, tiny, monkeypatch, suffix):
    def interrupted(path, *_):
        path.write_bytes(b"half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(f"tfm_cl.image_io.{suffix}.write", interrupted)
    done = cli("render", cloud, "-o", f"a.{suffix}", "-q", *tiny)
    assert (done.code, done.out, done.err) == (130, "", "tfm: interrupted\n")
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.npy"]
