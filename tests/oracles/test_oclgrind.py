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

QUANTISED = 5e-4
"""8-bit coefficients: where a value lies between two steps, the devices' rounding may choose another."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def oclgrind(tmp_path_factory):
    """Run ``oclgrind_run.py`` with some arguments; returns what Oclgrind complained of."""
    chosen = os.environ.get("TFM_OCLGRIND_PYTHON")
    python = Path(chosen or REPOSITORY / ".venv-oclgrind" / "bin" / "python")
    if not python.is_file():
        if chosen:
            pytest.fail(f"TFM_OCLGRIND_PYTHON: there is no {python}")
        pytest.skip(f"no Oclgrind: there is no {python}; set TFM_OCLGRIND_PYTHON")

    def run(*arguments):
        log = tmp_path_factory.mktemp("oclgrind") / "log"
        environment = os.environ | {
            "PYTHONPATH": str(REPOSITORY),
            "PYOPENCL_NO_CACHE": "1",
            "OCLGRIND_DATA_RACES": "1",
            "OCLGRIND_UNIFORM_WRITES": "1",
            "OCLGRIND_LOG": str(log),
        }
        done = subprocess.run(
            [python, SCRIPT, *arguments],
            env=environment,
            capture_output=True,
            text=True,
            timeout=500,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return log.read_text()

    return run


@pytest.fixture(scope="module")
def simulated(oclgrind, tmp_path_factory):
    """(what Oclgrind complained of, its results by name)."""
    out = tmp_path_factory.mktemp("oclgrind") / "results.npz"
    log = oclgrind("render", out)
    with np.load(out) as results:
        return log, dict(results)


def test_no_access_out_of_bounds_and_no_race(simulated):
    log, _ = simulated
    assert log == "", log[:4000]


@pytest.mark.parametrize("case", CASES)
def test_same_result_as_on_the_device(case, simulated, renderer):
    _, results = simulated
    tolerance = QUANTISED if case in {"storage u8", "evaluate"} else PASS
    np.testing.assert_allclose(results[case], CASES[case](renderer), rtol=0, atol=tolerance)


def test_an_access_out_of_bounds_is_reported(oclgrind):
    log = oclgrind("out-of-bounds")
    assert "Invalid write of size 4 at global memory" in log
    assert "Kernel: out_of_bounds" in log


def test_a_race_is_reported(oclgrind):
    assert "Read-write data race at global memory" in oclgrind("race")
