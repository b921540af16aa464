"""The command line, run in this process."""

import json
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.cli import main
from tfm_cl.device.kernel_cache import COMPILING


@dataclass(frozen=True)
class Done:
    """What a command line did."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def cli(folder, one_lane, capsys):  # noqa: ARG001 - the command runs there
    """``cli("render", …)`` runs a command line in ``folder``."""

    def run(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        # Whether anything has to be compiled depends on the tests before.
        return Done(code, captured.out, captured.err.replace(f"tfm: {COMPILING}\n", ""))

    return run


@pytest.fixture
def program():
    """``program("render", …)`` is the command line of a process of its own."""
    return lambda *arguments: [sys.executable, "-m", "tfm_cl", *map(str, arguments)]


@pytest.fixture
def tiny(device_name):
    """Options that render in no time, bare files with one spot, on the tests' device."""
    device = ("--device", device_name) if device_name else ()
    return (
        "--look",
        "plain",
        "--res",
        "16x9",
        "--map-res",
        "16",
        "--steps",
        "8",
        "--light-steps",
        "8",
        *device,
    )


@pytest.fixture
def render(cli, tiny):
    """``render(INPUT, …)`` renders in no time and must succeed."""

    def run(*arguments):
        done = cli("render", *arguments, *tiny)
        assert done.code == 0, done.err
        return done

    return run


@pytest.fixture
def cloud(folder):
    """A small bare volume, ``cloud.npy``."""
    path = folder / "cloud.npy"
    np.save(path, blobs())
    return path


@pytest.fixture
def refused(cli, folder):
    """Run a command line that must fail: one line on stderr, nothing else anywhere; returns the line."""

    def run(*arguments, code=2):
        before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        done = cli(*arguments)
        after = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        assert done.code == code, done.err
        assert done.out == ""
        assert done.err.startswith("tfm: ")
        assert done.err.count("\n") == 1
        assert done.err.endswith("\n")
        assert after == before
        return done.err

    return run
