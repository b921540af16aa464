"""Every kernel compiled by Clang for CPUs that are not at hand, with as many lanes as their registers have.

Clang warns where a vector is passed or returned by value that is wider than a register: how depends on what
it takes the processor for, and the driver's built-in functions may have been compiled for another.
"""

import os
import shutil
import subprocess

import pytest
from oracles.clang_header import HeaderOnce
from oracles.kernel_variants import PROGRAMS, kernel_variants

from tfm_cl.device.program import kernels_dir, source

TARGETS = {
    "x86-64-v2": ("--target=x86_64-linux-gnu", "-march=x86-64-v2"),
    "x86-64-v3": ("--target=x86_64-linux-gnu", "-march=x86-64-v3"),
    "x86-64-v4": ("--target=x86_64-linux-gnu", "-march=x86-64-v4"),
    "aarch64": ("--target=aarch64-linux-gnu",),
}
WIDEST = {"x86-64-v2": 4, "x86-64-v3": 8, "x86-64-v4": 16, "aarch64": 4}
"""Floats of a register: the lanes that `tfm_cl.device.launch.lanes_of` prefers there."""
LANGUAGE = ("-x", "cl", "-cl-std=CL1.2", "-cl-no-stdinc", "-Wall", "-Werror")
OUTPUT = ("-emit-llvm", "-c", "-o", "/dev/null")

# One ray has no vectors, and is compiled for GPUs; fewer than the widest are passed like these. Vectors are
# as wide as each target's registers, and every choice is there by itself: how a function passes its vectors
# does not depend on a second one, and any two together are compiled for GPUs. An optimiser's warnings are
# asked for where registers are widest. (aarch64 has a test of its own, and four lanes, like x86-64-v2.)
EVERY = [("x86-64-v3", "-O0"), ("x86-64-v4", "-O2")]


@pytest.fixture(scope="module")
def complaints(tmp_path_factory):
    """``complaints(target, text, optimisation)`` is what Clang has to say of a program."""
    clang = shutil.which(os.environ.get("TFM_CLANG", "clang"))
    if clang is None:
        pytest.skip("no compiler for other CPUs: install clang, or set TFM_CLANG")
    header = HeaderOnce(clang, tmp_path_factory.mktemp("headers"))

    def of(target, text, optimisation="-O0"):
        options = (*TARGETS[target], *LANGUAGE, optimisation)
        command = [clang, *options, *header(*options), *OUTPUT, "-I", str(kernels_dir()), "-"]
        done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)
        return done.stderr

    return of


@pytest.mark.quick("aarch64-scatter_pass.cl")
@pytest.mark.parametrize("entry", PROGRAMS)
@pytest.mark.parametrize("target", ["aarch64"])  # its lanes are those that the device at hand seldom has
def test_each_choice_compiles_without_a_warning(target, entry, complaints):
    for label, file, headers, defines in kernel_variants(WIDEST[target], few=True):
        if file == entry:
            assert complaints(target, source(file, headers, defines)) == "", label


@pytest.mark.slow
@pytest.mark.parametrize("entry", PROGRAMS)
@pytest.mark.parametrize(("target", "optimisation"), EVERY)
def test_compiles_without_a_warning(target, optimisation, entry, complaints):
    for label, file, headers, defines in kernel_variants(WIDEST[target], few=True):
        if file == entry:
            assert complaints(target, source(file, headers, defines), optimisation) == "", label


@pytest.mark.parametrize("optimisation", ["-O0", "-O2"])
@pytest.mark.parametrize(("target", "too_wide"), [("x86-64-v2", 8), ("x86-64-v3", 16)])
def test_vectors_wider_than_a_register_are_found(target, too_wide, optimisation, complaints):
    program = f"""
    static float{too_wide} twice(float{too_wide} x) {{ return x + x; }}
    __kernel void planted(__global float{too_wide} *x) {{ x[0] = twice(x[0]); }}
    """

    assert "changes the ABI" in complaints(target, program, optimisation)
