"""What starting costs: imports, caches, and compilation as it is counted."""

import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest
from scenes import blobs

from tfm_cl.device import program
from tfm_cl.device.program import KernelLibrary, fingerprint, kernels_dir

LIBRARIES = {"matplotlib", "plotly", "blosc", "OpenEXR", "PIL", "scipy", "skimage", "tqdm"}
"""Imported where they are used, and by nothing below."""

SECOND = 10**9
"""In the nanoseconds of OpenCL's events."""


@pytest.fixture
def imports(tmp_path):
    """``imports(code)`` runs it in a new process and returns the top-level modules it imported."""
    np.save(tmp_path / "cloud.npy", blobs())

    def run(code):
        code += "\nimport sys; print('imported', *{name.partition('.')[0] for name in sys.modules})"
        command = [sys.executable, "-W", "error", "-c", code]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        return set(done.stdout.rpartition("imported")[2].split())

    return run


def command_line(*arguments):
    return f"from tfm_cl.cli import main; assert main({arguments!r}) == 0"


def test_importing_the_package_imports_nothing(imports):
    found = imports("import tfm_cl")
    assert "tfm_cl" in found
    assert not found & (LIBRARIES | {"click", "numpy", "pydantic", "pyopencl"})


def test_the_version_needs_click_only(imports):
    assert not imports(command_line("--version")) & (LIBRARIES | {"numpy", "pydantic", "pyopencl"})


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("render", "--help"),
        ("devices", "--help"),
        ("render", "cloud.npy", "--print-config", "-q"),
    ],
    ids=" ".join,
)
def test_what_needs_no_device_imports_no_opencl(imports, arguments):
    assert not imports(command_line(*arguments)) & (LIBRARIES | {"pyopencl"})


def test_rendering_a_png_imports_no_other_library_than_its_writer(imports, tiny_render):
    found = imports(command_line("render", "cloud.npy", "-o", "a.png", "-q", *tiny_render))
    assert "pyopencl" in found
    assert found & LIBRARIES == {"PIL"}


def test_rendering_an_exr_imports_no_other_library_than_its_writer(imports, tiny_render):
    found = imports(command_line("render", "cloud.npy", "-o", "a.exr", "-q", *tiny_render))
    assert found & LIBRARIES == {"OpenEXR"}


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_the_program_leaves_the_other_cores_to_the_device(given, used):
    """OpenBLAS reads its number of threads when NumPy is first imported."""
    code = "import os, sys; from tfm_cl.cli import program; sys.argv = ['tfm', '--version']; program(); "
    code += "print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    environment |= {} if given is None else {"OPENBLAS_NUM_THREADS": given}
    out = subprocess.check_output([sys.executable, "-c", code], env=environment, text=True)
    assert out.splitlines()[-1] == f"{used} False"


@pytest.mark.parametrize("called", ["program", "main"])
def test_only_the_program_looks_for_garbage_less_often(called):
    """The function may be called in a process that has other plans."""
    code = (
        "import gc, sys; from tfm_cl import cli; sys.argv = ['tfm', '--version']; before = gc.get_threshold()"
    )
    code += (
        f"; cli.{called}(); print(before == gc.get_threshold(), cli.COLLECTED_AFTER == gc.get_threshold())"
    )
    found = subprocess.check_output([sys.executable, "-c", code], text=True).splitlines()[-1]
    assert found == {"program": "False True", "main": "True False"}[called]


@pytest.fixture
def tiny_render(device_name):
    """Options that render in no time, on the tests' device."""
    device = ("--device", device_name) if device_name else ()
    return ("--res", "16x8", "--map-res", "16", "--steps", "8", "--light-steps", "8", *device)


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A copy of the kernels, in use, with a kernel ``answer`` that tells the number in ``answer.h``."""
    folder = tmp_path / "kernels"
    shutil.copytree(kernels_dir(), folder)
    (folder / "answer.h").write_text("#define ANSWER 1\n", encoding="utf-8")
    (folder / "answer.cl").write_text(
        '#include "answer.h"\nkernel void answer(global int *found) { *found = ANSWER; }\n', encoding="utf-8"
    )
    monkeypatch.setattr(program, "kernels_dir", lambda: folder)
    return folder


def answer(launcher, library):
    kernel = library.kernel("answer", "answer.cl")
    found = launcher.empty("the answer", 4)
    kernel(launcher.queue, (1,), (1,), found).wait()
    return int(launcher.download(found, (1,), np.int32)[0])


def test_an_edited_header_is_compiled_again(launcher, kernels):
    for number in (1, 2, 1):
        (kernels / "answer.h").write_text(f"#define ANSWER {number}\n", encoding="utf-8")
        assert answer(launcher, KernelLibrary(launcher.context)) == number


def test_the_text_that_drivers_know_a_program_by_tells_of_every_edit(launcher, kernels, monkeypatch):
    texts = []

    class Recorded(cl.Program):
        def __init__(self, context, text):
            texts.append(text)
            super().__init__(context, text)

    monkeypatch.setattr(cl, "Program", Recorded)
    for number in (1, 2, 1):
        (kernels / "answer.h").write_text(f"#define ANSWER {number}\n", encoding="utf-8")
        answer(launcher, KernelLibrary(launcher.context))
    assert texts[0] == texts[2] != texts[1]


def test_one_library_reads_the_sources_once(launcher, kernels, monkeypatch):
    read = []
    monkeypatch.setattr(program, "fingerprint", lambda folder: read.append(folder) or "digest")
    library = KernelLibrary(launcher.context)
    for number in (1, 2):
        library.kernel("answer", "answer.cl", defines={"TFM_NUMBER": number})
    assert read == [kernels]


def test_every_source_counts_in_the_fingerprint(kernels):
    seen = {fingerprint(kernels)}
    sources = [path for path in kernels.rglob("*") if path.suffix in {".cl", ".h"}]
    for path in sources:
        path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
        seen.add(fingerprint(kernels))
    sources[0].rename(sources[0].with_stem("renamed"))
    seen.add(fingerprint(kernels))
    assert len(seen) == len(sources) + 2


def test_what_a_driver_compiles_at_a_launch_is_counted(launcher, kernels):
    # A number of its own makes a program that no cache holds.
    (kernels / "answer.h").write_text(f"#define ANSWER {os.getpid()}\n", encoding="utf-8")
    library = KernelLibrary(launcher.context)
    library.kernel("answer", "answer.cl")
    built = library.seconds
    event = library.kernel("answer", "answer.cl")(launcher.queue, (1,), (1,), launcher.empty("the answer", 4))
    event.wait()
    waited = (event.profile.start - event.profile.queued) * 1e-9
    assert library.seconds - built == pytest.approx(waited)


def finished(queued, start, end):
    profile = SimpleNamespace(queued=queued, start=start, end=end)
    return SimpleNamespace(command_execution_status=cl.command_execution_status.COMPLETE, profile=profile)


def test_launches_before_it_are_not_compilation():
    clock = program._LaunchClock()
    clock.add(finished(0, 3 * SECOND, 7 * SECOND))  # three seconds to start
    clock.add(finished(1 * SECOND, 8 * SECOND, 9 * SECOND))  # waits for the first, then one second
    clock.add(finished(2 * SECOND, 9 * SECOND, 9 * SECOND))
    assert clock.seconds == pytest.approx(4.0)
    assert clock.seconds == pytest.approx(4.0)  # counted once


def test_a_launch_counts_when_it_is_finished():
    clock, launch = program._LaunchClock(), finished(0, 2 * SECOND, 3 * SECOND)
    launch.command_execution_status = cl.command_execution_status.RUNNING
    clock.add(launch)
    assert clock.seconds == 0
    launch.command_execution_status = cl.command_execution_status.COMPLETE
    assert clock.seconds == pytest.approx(2.0)


@pytest.mark.usefixtures("kernels")
def test_a_queue_without_times_counts_nothing(launcher):
    library = KernelLibrary(launcher.context)
    kernel = library.kernel("answer", "answer.cl")
    built = library.seconds
    kernel(cl.CommandQueue(launcher.context), (1,), (1,), launcher.empty("the answer", 4)).wait()
    assert library.seconds == built
