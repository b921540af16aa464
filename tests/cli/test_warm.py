"""`tfm warm`, and what is said while kernels are compiled."""

import os
import re
import subprocess

import pytest

from tfm_cl.device.kernel_cache import COMPILING


@pytest.fixture
def fresh(folder, program, device_name):
    """``fresh(…)`` runs a command line in a new process whose cache of kernels is a folder of the test's."""
    if device_name:
        pytest.skip("the driver keeps its kernels itself")

    def run(*arguments):
        environment = {**os.environ, "POCL_CACHE_DIR": str(folder / "cache")}
        done = subprocess.run(
            program(*arguments), env=environment, capture_output=True, text=True, check=False, cwd=folder
        )
        assert done.returncode == 0, done.stderr
        return done

    return run


@pytest.mark.slow
def test_what_is_warm_is_not_compiled(fresh, cloud, tiny):
    first = fresh("warm", cloud, *tiny)
    again = fresh("render", cloud, "-o", "a.npy", *tiny)

    told, done = first.stderr.splitlines()
    assert told == f"tfm: {COMPILING}"
    assert re.fullmatch(r"tfm: .+: compiled in \d+\.\d s", done)
    assert COMPILING not in again.stderr


@pytest.mark.slow
def test_a_render_says_that_it_compiles(fresh, cloud, tiny):
    assert fresh("render", cloud, "-o", "a.npy", *tiny).stderr.count(COMPILING) == 1
    quiet = fresh("render", cloud, "-o", "a.npy", "-q", "--basis", "dct", *tiny)
    assert quiet.stderr == ""


def test_without_input_it_is_a_bare_volume(cli, tiny):
    done = cli("warm", *tiny)

    assert done.code == 0
    assert done.out == ""
    assert "compiled in" in done.err


def test_wrong_input_is_refused_before_anything_is_compiled(refused):
    assert "medium.orders" in refused("warm", "--set", "medium.orders=0")
