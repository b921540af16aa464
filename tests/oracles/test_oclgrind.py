"""Every kernel on the Oclgrind simulator: no access out of bounds, no race, the same pictures.

Oclgrind needs an environment of its own, because it becomes OpenCL's first platform wherever it is
installed; ``make oracles`` makes ``.venv-oclgrind``.

Its check for uninitialised values stays off: Oclgrind 21.10's crashes on these kernels, and takes what
clEnqueueFillBuffer wrote for uninitialised. API calls need no check of theirs: pyopencl raises.
"""

import os
import runpy
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tolerances import PASS

REPOSITORY = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("oclgrind_run.py")
CASES = runpy.run_path(str(SCRIPT))["CASES"]

SECONDS = 120
"""In which a process ends that has nothing left to do, or one wrong kernel to run."""

QUANTISED = 5e-4
"""8-bit coefficients: where a value lies between two steps, the devices' rounding may choose another."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def oclgrind(tmp_path_factory):
    """Start ``oclgrind_run.py`` with some arguments; returns its process and the file of its complaints."""
    chosen = os.environ.get("TFM_OCLGRIND_PYTHON")
    python = Path(chosen or REPOSITORY / ".venv-oclgrind" / "bin" / "python")
    if not python.is_file():
        if chosen:
            pytest.fail(f"TFM_OCLGRIND_PYTHON: there is no {python}")
        pytest.skip(f"no Oclgrind: there is no {python}; set TFM_OCLGRIND_PYTHON")

    def start(*arguments):
        log = tmp_path_factory.mktemp("oclgrind") / "log"
        environment = os.environ | {
            "PYTHONPATH": str(REPOSITORY),
            "PYOPENCL_NO_CACHE": "1",
            "OCLGRIND_DATA_RACES": "1",
            "OCLGRIND_UNIFORM_WRITES": "1",
            "OCLGRIND_LOG": str(log),
        }
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        return subprocess.Popen([python, SCRIPT, *arguments], env=environment, **pipes), log

    return start


@pytest.fixture(scope="module")
def simulated(oclgrind, tmp_path_factory):
    """Return a case's result, and what Oclgrind complained of: each is run where its test runs."""
    process, log = oclgrind("render", tmp_path_factory.mktemp("oclgrind"))
    read = 0

    def result(case):
        nonlocal read
        print(case, file=process.stdin, flush=True)
        file = process.stdout.readline().rstrip("\n")
        assert file, f"ended with {process.wait(SECONDS)}: see its standard error"
        complaints = log.read_text()[read:]
        read += len(complaints)
        return np.load(file), complaints

    yield result
    process.stdin.close()
    process.wait(SECONDS)
    process.stdout.close()


@pytest.fixture
def complaints(oclgrind):
    """What Oclgrind says of a kernel that is wrong."""

    def of(name):
        process, log = oclgrind(name)
        process.communicate(timeout=SECONDS)
        assert process.returncode == 0
        return log.read_text()

    return of


@pytest.mark.parametrize("case", CASES)
def test_same_result_as_on_the_device_and_no_access_out_of_bounds(case, simulated, renderer):
    result, complaints = simulated(case)
    tolerance = QUANTISED if case in {"storage u8", "evaluate"} else PASS
    np.testing.assert_allclose(result, CASES[case](renderer), rtol=0, atol=tolerance)
    assert complaints == "", complaints[:4000]


def test_an_access_out_of_bounds_is_reported(complaints):
    log = complaints("out-of-bounds")
    assert "Invalid write of size 4 at global memory" in log
    assert "Kernel: out_of_bounds" in log


def test_a_race_is_reported(complaints):
    assert "Read-write data race at global memory" in complaints("race")
