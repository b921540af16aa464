"""Kernels take their arguments by the names of their own signature."""

from types import SimpleNamespace

import numpy as np
import pytest

from tfm_cl.device.program import kernel_name
from tfm_cl.errors import KernelBuildError

KERNEL = """
__kernel void echo(__global float *found, int number, float part, int4 window, float2 pair)
{
  if (get_global_id(0) > 0)
    return;
  found[0] = (float)number;
  found[1] = part;
  found[2] = (float)window.w;
  found[3] = pair.y;
}
"""
GIVEN = {"number": -3, "part": 0.25, "window": (1, 2, 3, 4), "pair": (0.5, 7.5)}


@pytest.fixture
def echo(launcher, tmp_path):
    """Kernel that answers what it was given."""
    (tmp_path / "echo.cl").write_text(KERNEL, encoding="utf-8")
    return launcher.kernels.kernel("echo", str(tmp_path / "echo.cl"))


def test_a_kernel_knows_its_signature(echo):
    assert echo.parameters == {
        "found": "float*",
        "number": "int",
        "part": "float",
        "window": "int4",
        "pair": "float2",
    }


def test_warnings_of_the_tests_kernels_are_errors(launcher, tmp_path):
    text = "__kernel void doubtful(__global int *x) { __global float *y = x; y[0] = 1; }\n"
    (tmp_path / "doubtful.cl").write_text(text, encoding="utf-8")

    with pytest.raises(KernelBuildError, match="incompatible pointer types"):
        launcher.kernels.kernel("doubtful", str(tmp_path / "doubtful.cl"))


def test_a_probe_that_does_not_compile_is_told(launcher):
    with pytest.raises(KernelBuildError, match="a probe of the compiler does not compile on this device"):
        kernel_name(launcher.context, "nonsense", ())


def test_arguments_in_any_order(launcher, echo):
    found = launcher.empty("found", 16)

    launcher.run(echo, (1,), {**dict(reversed(GIVEN.items())), "found": found})

    assert launcher.download(found, (4,), np.float32).tolist() == [-3, 0.25, 4, 7.5]


def test_a_launch_as_large_as_one_before_has_nothing_new_to_keep(launcher, echo, monkeypatch):
    kept = []
    monkeypatch.setattr(echo, "_kept", SimpleNamespace(keep=lambda: kept.append(1)))
    found = launcher.empty("found", 16)
    for size, expected in ((1, 1), (1, 1), (1000, 2), (1001, 2), (1, 2)):
        launcher.run(echo, (size,), {**GIVEN, "found": found})
        assert len(kept) == expected


@pytest.mark.parametrize(
    ("without", "with_", "message"),
    [
        ("part", {}, "echo: missing: part; unknown: none"),
        ("found", {"fuond": 1}, "echo: missing: found; unknown: fuond"),
        (None, {"steps": 8, "res": 2}, "echo: missing: none; unknown: steps, res"),
    ],
)
def test_missing_and_unknown_arguments_are_refused(launcher, echo, without, with_, message):
    given = {**GIVEN, "found": launcher.empty("found", 16), **with_}
    given.pop(without, None)

    with pytest.raises(TypeError) as error:
        launcher.run(echo, (1,), given)

    assert str(error.value) == message


def test_windows_come_from_the_launcher(launcher, echo):
    given = {**GIVEN, "found": launcher.empty("found", 16)}

    with pytest.raises(TypeError, match="missing: window"):
        launcher.run(echo, (1,), {name: value for name, value in given.items() if name != "window"})
    given.pop("window")
    launcher.run_windows(echo, (0, 0, 5, 9), 1, given)

    assert launcher.download(given["found"], (4,), np.float32)[2] == 9
