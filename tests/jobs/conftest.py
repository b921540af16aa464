"""A Dask cluster on this machine, of a scheduler and workers as users start them."""

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


class LocalCluster:
    """A scheduler, and workers that are started and killed."""

    def __init__(self, folder):
        self._folder, self._stack = folder, contextlib.ExitStack()
        self._file = folder / "scheduler.json"

    def __enter__(self):
        address = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", self._file)
        self.process = self._start("scheduler", "--no-dashboard", *address)
        self.address = json.loads(self._read(self._file))["address"]
        return self

    def __exit__(self, *error):
        self._stack.close()

    def add_worker(self, *options, nanny=False):
        """Start a worker with one thread; returns its process."""
        return self._start(
            "worker",
            self.address,
            "--nthreads",
            "1",
            "--no-dashboard",
            "--nanny" if nanny else "--no-nanny",
            "--local-directory",
            self._folder,
            *options,
        )

    def wait_for_workers(self, count):
        """Return when that many have joined."""
        from distributed import Client  # noqa: PLC0415 - where it is not installed, no test comes here

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)

    def _start(self, *arguments):
        path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *map(str, arguments)],
            env=os.environ | {"PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    @staticmethod
    def _read(path):
        until = time.monotonic() + 60
        while time.monotonic() < until:
            with contextlib.suppress(OSError):
                if text := path.read_text(encoding="utf-8"):
                    return text
            time.sleep(0.05)
        raise AssertionError(f"{path}: the scheduler did not start")


@pytest.fixture
def start_cluster(tmp_path_factory):
    """``start_cluster()`` gives a scheduler without workers."""
    pytest.importorskip("distributed")
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(LocalCluster(tmp_path_factory.mktemp("dask")))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler and two workers, of a device each, which are started again when they end."""
    pytest.importorskip("distributed")
    with LocalCluster(tmp_path_factory.mktemp("dask")) as cluster:
        for _ in range(2):
            cluster.add_worker("--resources", "device=1", nanny=True)
        yield cluster
