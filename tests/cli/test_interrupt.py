"""Ctrl-C in the middle of a long render."""

import os
import select
import signal
import subprocess
import time

import pytest

termios = pytest.importorskip("termios")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")


LONG = {
    "view pass": ("--method", "dual", "--res", "2048x2048", "--steps", "300", "--light-steps", "300"),
    "light pass": ("--look", "plain", "--map-res", "8192", "--coeffs", "1", "--light-steps", "5000"),
}
"""Stage -> options with which it takes far longer than this test."""


class Terminal:
    """What a program writes to the terminal that it takes its stderr for."""

    def __init__(self):
        self._reader, self.writer = os.openpty()
        termios.tcsetwinsize(self.writer, (24, 100))  # a bar needs room
        self.text = ""

    def read(self, seconds):
        """Take what comes within that time, or until the program has ended."""
        while select.select([self._reader], [], [], seconds)[0]:
            try:
                found = os.read(self._reader, 1 << 16)
            except OSError:  # as Linux tells that nobody writes any more
                return
            if not found:
                return
            self.text += found.decode()
            seconds = 0

    def close(self):
        os.close(self._reader)


@pytest.fixture(params=LONG)
def long_render(request, cloud, program, device_name):
    """Start a long render; returns its process and terminal once launches of the stage have ended."""
    device = ("--device", device_name) if device_name else ()
    outputs = ("-o", "a.npy", "-o", "a.exr", "--json", "a.json")
    terminal = Terminal()
    process = subprocess.Popen(
        program("render", cloud, *outputs, *LONG[request.param], *device),
        cwd=cloud.parent,
        stdout=subprocess.PIPE,
        stderr=terminal.writer,
        start_new_session=True,
    )
    os.close(terminal.writer)
    try:
        deadline = time.monotonic() + 120
        while request.param not in terminal.text and process.poll() is None and time.monotonic() < deadline:
            terminal.read(0.05)
        time.sleep(0.5)  # into the middle of a launch
        terminal.read(0)
        assert process.poll() is None, terminal.text
        assert request.param in terminal.text
        yield process, terminal
    finally:
        process.kill()
        process.communicate()
        terminal.close()


def test_ctrl_c(long_render, cloud):
    process, terminal = long_render
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    took = time.monotonic() - sent
    terminal.read(1)
    assert process.returncode == 130
    assert out == b""
    # The bar is wiped from its line, and nothing but this follows.
    lines = terminal.text.replace("\r", "\n").split("\n")
    assert lines[0].startswith("chosen for cloud.npy: ")
    assert [line for line in lines if line.strip()][-1] == "tfm: interrupted"
    assert "Traceback" not in terminal.text
    assert "100%" not in terminal.text
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.npy"]
    # Two launches of a tenth of a second, and the interpreter's end; more where much else runs.
    assert took < 3


@pytest.mark.parametrize("suffix", ["npy", "exr", "png"])
def test_while_a_picture_is_being_written(cli, cloud, tiny, monkeypatch, suffix):
    def interrupted(path, *_):
        path.write_bytes(b"half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(f"tfm_cl.files.image_io.{suffix}.write", interrupted)
    done = cli("render", cloud, "-o", f"a.{suffix}", "-q", *tiny)
    assert (done.code, done.out, done.err) == (130, "", "tfm: interrupted\n")
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.npy"]
