"""Standard output and error that are full, closed or without a reader, and messages of any length."""

import os
import subprocess
import sys

import numpy as np
import pytest

from tfm_cl.cli.streams import END, START, one_line

FULL = "tfm: standard output: cannot be written (No space left on device)\n"

pytestmark = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")  # noqa: PTH110


@pytest.fixture
def spoilt(cloud, program, tmp_path):
    """``spoilt("full", "info", …)`` runs a command with its output spoilt; returns code and stderr."""
    np.save(tmp_path / "image.npy", np.ones((16, 16, 4), np.float32))

    def run(how, *arguments, **environment):
        redirect = {"full": "> /dev/full", "closed": ">&-", "left": '| true; exit "${PIPESTATUS[0]}"'}[how]
        done = subprocess.run(
            ["bash", "-c", f'"$@" {redirect}', "bash", *program(*arguments)],
            cwd=cloud.parent,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.stdout == ""
        return done.returncode, done.stderr

    return run


COMMANDS = {
    "version": ("--version",),
    "help": ("--help",),
    "help of a command": ("render", "--help"),
    "info": ("info", "cloud.npy"),
    "compare": ("compare", "image.npy", "image.npy"),
    "configuration": ("render", "cloud.npy", "--print-config", "-q"),
}


@pytest.mark.parametrize("arguments", COMMANDS.values(), ids=COMMANDS)
def test_full(spoilt, arguments):
    assert spoilt("full", *arguments) == (3, FULL)


def test_full_without_a_buffer(spoilt):
    assert spoilt("full", "info", "cloud.npy", PYTHONUNBUFFERED="1") == (3, FULL)


@pytest.mark.parametrize("arguments", COMMANDS.values(), ids=COMMANDS)
def test_nobody_reads(spoilt, arguments):
    assert spoilt("left", *arguments) == (0, "")


def test_closed(spoilt):
    assert spoilt("closed", "info", "cloud.npy") == (0, "")


def test_nobody_reads_in_ascii(spoilt):
    assert spoilt("left", "--help", PYTHONIOENCODING="ascii") == (0, "")


@pytest.mark.parametrize("how", ["full", "closed", "left"])
def test_the_code_is_that_of_the_command(spoilt, how):
    code, err = spoilt(how, "compare", "image.npy", "image.npy", "--fail-under", "ssim=2")
    assert (code, err.splitlines()[0]) == (1, "tfm: ssim = 1 misses 2")


@pytest.mark.parametrize("how", ["full", "left"])
def test_the_picture_is_there_all_the_same(spoilt, tmp_path, tiny, how):
    code, err = spoilt(how, "render", "cloud.npy", "-q", "-o", "a.npy", "--print-config", *tiny)
    assert (code, err) == ((3, FULL) if how == "full" else (0, ""))
    assert np.load(tmp_path / "a.npy").shape == (9, 16, 4)


@pytest.mark.parametrize("redirect", ["2> /dev/full", "2>&-", "2>&1 | true; exit ${PIPESTATUS[0]}"])
def test_an_error_that_cannot_be_told_has_its_code(program, folder, redirect):
    command = ["bash", "-c", f'"$@" {redirect}', "bash", *program("info", "missing.npy")]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", b"")


DESCRIPTORS = """
import os
from tfm_cl.cli import main
from tfm_cl.cli.streams import guarded_streams
with guarded_streams():
    descriptor = os.open("/dev/null", os.O_RDONLY)
assert descriptor > 2
raise SystemExit(main(["--version"]))
"""


@pytest.mark.parametrize("redirect", [">&-", "2>&-", ">&- 2>&- <&-"])
def test_no_file_takes_the_place_of_a_closed_stream(redirect):
    command = ["bash", "-c", f'"$@" {redirect}', "bash", sys.executable, "-c", DESCRIPTORS]
    assert subprocess.run(command, timeout=120, capture_output=True, check=False).returncode == 0


def test_a_long_message_keeps_its_start_and_its_end():
    message = "grid 'x" + "y" * 26000 + "z': not in the file"
    shown = one_line(message)
    assert len(shown) == START + END + 3
    assert shown.startswith("grid 'xyyy")
    assert shown.endswith("yyz': not in the file")


def test_a_message_is_one_line():
    assert one_line("a\nb\x1b[1mc\u2028d × é") == r"a\nb\x1b[1mc\u2028d × é"
    whole = "x" * (START + END)
    assert one_line(whole) == whole
    assert len(one_line("\n" * (START + END))) == START + END + 3  # what is counted is what is shown


def test_a_long_name_is_cut_in_an_error(refused, cloud):
    message = refused("render", cloud, "-o", "a.png", "--grid", "density" * 4000)
    assert message.startswith("tfm: ")
    assert len(message) < START + END + 20
