"""Every kernel compiled for NVIDIA and AMD GPUs by Clang, as no GPU is at hand.

The built-in functions come from libclc and are linked, so that what is left undefined is a fault. Vendors'
compilers are Clang's relatives: what it refuses, they may refuse as well.
"""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
from oracles.clang_header import HeaderOnce
from oracles.kernel_variants import PROGRAMS, kernel_variants, pairwise, singly

from tfm_cl.device.program import kernels_dir, source

LIBCLC = (Path("/usr/lib/clc"), Path("/usr/share/clc"))
"""Where Debian and others put it."""
GPU_LANES = 1
VARIANTS = {label: program for label, *program in kernel_variants(GPU_LANES)}
"""Any two choices together: the front end reads them in a tenth of the time of assembly."""
FEW = {label: program for label, *program in kernel_variants(GPU_LANES, few=True)}
"""Every choice by itself; AMD's back end takes twice as long as NVIDIA's, and gets every second."""
BRICKS = next(label for label in VARIANTS if label.startswith("bricks.cl"))

LANGUAGE = ("-x", "cl", "-cl-std=CL1.2", "-cl-no-stdinc", "-Wall", "-Werror")
"""Clang 14 includes its short header by default, whose vload_half asks for an extension; the full one's,
like OpenCL 1.2's, does not."""
NO_EXTENSION = ("-Xclang", "-cl-ext=-all")


@dataclass(frozen=True)
class Target:
    """A kind of GPU, and what to look for in its assembly; group 1 of a pattern is a name."""

    options: tuple[str, ...]
    libclc: str
    entry: re.Pattern[str]
    function: re.Pattern[str]
    """Starts a function, or other data."""
    reference: re.Pattern[str]
    """Names what may be defined elsewhere."""
    double: re.Pattern[str]
    trap: re.Pattern[str]


TARGETS = {
    "nvptx64": Target(
        options=("--target=nvptx64--nvidiacl", "-march=sm_60"),
        libclc="nvptx64--nvidiacl.bc",
        entry=re.compile(r"^\.visible \.entry (\w+)\(", re.MULTILINE),
        function=re.compile(r"^(?:\.visible |\.weak )?\.(?:entry|func)\s+(?:\(.*?\) )?(\w+)"),
        reference=re.compile(r"^\.extern .*\b([A-Za-z_]\w*)(?:\[\d*\])?;?$", re.MULTILINE),
        double=re.compile(r"\.f64\b"),
        trap=re.compile(r"\btrap;"),
    ),
    "amdgcn": Target(
        options=("--target=amdgcn--amdhsa", "-mcpu=gfx900", "-nogpulib"),
        libclc="amdgcn--amdhsa.bc",
        entry=re.compile(r"^\s*\.amdhsa_kernel (\w+)$", re.MULTILINE),
        function=re.compile(r"^([\w.$]+):"),
        reference=re.compile(r"\b([\w.$]+)@(?:rel|abs|got)", re.MULTILINE),
        double=re.compile(r"\bv_\w*f64"),
        trap=re.compile(r"\bs_trap\b"),
    ),
}


class Clang:
    """Compiles program texts, from a folder of kernels."""

    def __init__(self, program: str, libclc: Path, header: HeaderOnce):
        self._program = program
        self._libclc = libclc
        self._header = header

    def kernels(self, text, folder):
        """Names of the text's kernels, by its preprocessor."""
        done = self._run(*TARGETS["nvptx64"].options, *LANGUAGE, "-E", "-P", text=text, folder=folder)
        assert done.returncode == 0, done.stderr
        return set(re.findall(r"\b__kernel\b[^;{}]*?\bvoid\s+(\w+)\s*\(", done.stdout))

    def complaints(self, text, folder):
        """What OpenCL C 1.2 without any optional feature or extension does not allow."""
        options = (*TARGETS["nvptx64"].options, *LANGUAGE, *NO_EXTENSION)
        return self._run(*options, *self._header(*options), "-fsyntax-only", text=text, folder=folder).stderr

    def assembly(self, target, text, folder):
        """(assembly, complaints), with the extensions of the target: GPUs take double precision."""
        options = (*target.options, *LANGUAGE, "-O2")
        library = ("-Xclang", "-mlink-builtin-bitcode", "-Xclang", str(self._libclc / target.libclc))
        done = self._run(*options, *self._header(*options), *library, "-S", text=text, folder=folder)
        return done.stdout, done.stderr

    def _run(self, *options, text, folder):
        command = [self._program, *options, "-I", str(folder), "-o", "-", "-"]
        return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)


def faults(target, assembly, kernels):
    """Return one line a fault, that names the function."""
    found = [f"{name}: is no entry" for name in sorted(kernels - set(target.entry.findall(assembly)))]
    defined, function = set(), ""
    for line in assembly.splitlines():
        if start := target.function.match(line):
            function = start[1]
            defined.add(function)
        if target.double.search(line):
            found.append(f"{function}: computes in double precision: {line.strip()}")
        if target.trap.search(line):
            found.append(f"{function}: traps")
    undefined = set(target.reference.findall(assembly)) - defined
    return found + [f"{name}: is not defined; is it inline and not static?" for name in sorted(undefined)]


@pytest.fixture(scope="module")
def clang(tmp_path_factory):
    chosen = os.environ.get("TFM_CLANG")
    program = shutil.which(chosen or "clang")
    libclc = next((folder for folder in LIBCLC if (folder / TARGETS["nvptx64"].libclc).is_file()), None)
    if program is None or libclc is None:
        lacking = f"there is no {chosen or 'clang'}" if program is None else f"no libclc in {LIBCLC[0]}"
        if chosen:
            pytest.fail(f"TFM_CLANG: {lacking}")
        pytest.skip(f"no compiler for GPUs: {lacking}; install clang and libclc, or set TFM_CLANG")
    return Clang(program, libclc, HeaderOnce(program, tmp_path_factory.mktemp("headers")))


@pytest.fixture(params=TARGETS)
def target(request):
    return TARGETS[request.param]


def test_every_kernel_file_has_a_variant():
    files = {str(path.relative_to(kernels_dir())) for path in kernels_dir().rglob("*.cl")}

    assert {entry for entry, _, _ in VARIANTS.values()} == files


def test_any_two_choices_meet_in_a_variant():
    cases = pairwise({"a": (1, 2), "b": (3, 4), "c": (5, 6)})
    pairs = {(case[x], case[y]) for case in cases for x, y in ("ab", "ac", "bc")}

    assert pairs == {(x, y) for x in (1, 2) for y in (3, 4, 5, 6)} | {(x, y) for x in (3, 4) for y in (5, 6)}
    assert len(cases) == 4
    assert pairwise({"a": (1, 2)}) == [{"a": 1}, {"a": 2}]
    assert singly({"a": (1, 2), "b": (3, 4, 5)}) == [{"a": 1, "b": 3}, {"a": 2, "b": 4}, {"a": 1, "b": 5}]


@pytest.mark.slow
@pytest.mark.parametrize("entry", PROGRAMS)
def test_is_plain_opencl_1_2(entry, clang):
    for label, (file, headers, defines) in VARIANTS.items():
        if file == entry:
            assert clang.complaints(source(file, headers, defines), kernels_dir()) == "", label


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "label"),
    [*(("nvptx64", label) for label in FEW), *(("amdgcn", label) for label in list(FEW)[::2])],
)
def test_compiles_without_double_precision(name, label, clang):
    target, text = TARGETS[name], source(*FEW[label])
    assembly, complaints = clang.assembly(target, text, kernels_dir())
    kernels = clang.kernels(text, kernels_dir())

    assert complaints == ""
    assert kernels
    assert faults(target, assembly, kernels) == []


@pytest.fixture
def plant(tmp_path):
    """Return a program's text and a folder of kernels in which its file has a few more lines."""

    def plant(lines):
        folder = shutil.copytree(kernels_dir(), tmp_path / "kernels")
        entry, headers, defines = VARIANTS[BRICKS]
        with (folder / entry).open("a", encoding="utf-8") as file:
            file.write(lines)
        text = source(entry, headers, defines).replace(str(kernels_dir()), str(folder))
        return text, folder

    return plant


def test_a_double_literal_is_found(plant, target, clang):
    text, folder = plant("__kernel void planted(__global float *x) { x[0] = 0.1 * x[0]; }\n")
    assembly, complaints = clang.assembly(target, text, folder)
    found = faults(target, assembly, {"fill_records", "planted"})

    assert complaints == ""
    assert found
    assert all(fault.startswith("planted: computes in double precision") for fault in found)
    assert "double precision constant requires cl_khr_fp64" in clang.complaints(text, folder)


@pytest.mark.parametrize("name", ["unheard_of", "work_group_reduce_add"])
def test_a_function_that_opencl_1_2_lacks_is_found(name, plant, target, clang):
    text, folder = plant(f"__kernel void planted(__global float *x) {{ x[0] = {name}(x[0]); }}\n")
    assembly, complaints = clang.assembly(target, text, folder)

    assert assembly == ""
    assert f"implicit declaration of function '{name}'" in complaints
    assert f"implicit declaration of function '{name}'" in clang.complaints(text, folder)


def test_a_function_without_a_definition_is_found(plant, target, clang):
    text, folder = plant(
        "float unheard_of(float);\n__kernel void planted(__global float *x) { x[0] = unheard_of(x[0]); }\n"
    )
    assembly, _ = clang.assembly(target, text, folder)

    assert faults(target, assembly, {"planted"}) == [
        "unheard_of: is not defined; is it inline and not static?"
    ]


def test_a_trap_and_a_missing_entry_are_found(plant, target, clang):
    text, folder = plant("__kernel void planted(__global float *x) { x[0] = 1.0f; __builtin_trap(); }\n")
    assembly, _ = clang.assembly(target, text, folder)

    assert clang.kernels(text, folder) == {"fill_records", "planted"}
    assert faults(target, assembly, {"planted", "absent"}) == ["absent: is no entry", "planted: traps"]


def test_an_extension_is_found(plant, clang):
    lines = "__kernel void planted(__global half *x) { x[0] = x[0] * x[1]; }\n"

    assert "half" in clang.complaints(*plant(lines))
