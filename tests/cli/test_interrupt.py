"""Ctrl-C, and SIGTERM, in the middle of a long render."""

import os
import select
import signal
import subprocess
import time

import pytest

from tfm_cl.interrupts import TerminatedError

termios = pytest.importorskip("termios")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")


LONG = {
    "view pass": ("--method", "dual", "--res", "2048x2048", "--steps", "300", "--light-steps", "300"),
    "light pass": ("--look", "plain", "--map-res", "2048", "--coeffs", "1", "--light-steps", "5000"),
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


@pytest.fixture
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


ENDS = {signal.SIGINT: (130, "tfm: interrupted"), signal.SIGTERM: (143, "tfm: terminated")}
"""Signal -> exit code and last line."""


@pytest.mark.quick("view pass-2", "view pass-15")
@pytest.mark.parametrize(
    ("long_render", "number"),
    [("view pass", signal.SIGINT), ("light pass", signal.SIGINT), ("view pass", signal.SIGTERM)],
    indirect=["long_render"],
)
def test_ended_by_a_signal(long_render, number, cloud):
    process, terminal = long_render
    sent = time.monotonic()
    process.send_signal(number)
    out, _ = process.communicate(timeout=30)
    took = time.monotonic() - sent
    terminal.read(1)
    code, line = ENDS[number]
    assert process.returncode == code
    assert out == b""
    # The bar is wiped from its line, and nothing but this follows.
    lines = terminal.text.replace("\r", "\n").split("\n")
    assert lines[0].startswith("chosen for cloud.npy: ")
    assert [one for one in lines if one.strip()][-1] == line
    assert "Traceback" not in terminal.text
    assert "100%" not in terminal.text
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.npy"]
    # Two launches of a tenth of a second, and the interpreter's end; more where much else runs.
    assert took < 3


@pytest.mark.parametrize(
    ("suffix", "error"),
    [("npy", KeyboardInterrupt), ("exr", TerminatedError), ("png", KeyboardInterrupt)],
)
def test_while_a_picture_is_being_written(cli, cloud, tiny, monkeypatch, suffix, error):
    def interrupted(path, *_):
        path.write_bytes(b"half of it")
        raise error

    monkeypatch.setattr(f"tfm_cl.files.image_io.{suffix}.write", interrupted)
    done = cli("render", cloud, "-o", f"a.{suffix}", "-q", *tiny)
    code, line = ENDS[signal.SIGTERM if error is TerminatedError else signal.SIGINT]
    assert (done.code, done.out, done.err) == (code, "", f"{line}\n")
    assert [path.name for path in cloud.parent.iterdir()] == ["cloud.npy"]


def test_interrupted_before_the_command_line_is_there(program, tmp_path):
    # The first that it imports from elsewhere; what is raised in there may be caught there too.
    (tmp_path / "click.py").write_text(
        "import os, signal\n"
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept KeyboardInterrupt:\n    pass\n"
        "print('goes on')\n"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    ended = subprocess.run(
        program("--version"),
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "tfm: interrupted\n")
