"""The check of a GPU: what it compares and when it fails; here with one lane on the tests' own device."""

import importlib.util
import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.device.device import choose_device, list_devices
from tfm_cl.errors import KernelBuildError, NoDeviceError

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "gpu_check.py"


@pytest.fixture(scope="module")
def gpu_check():
    spec = importlib.util.spec_from_file_location("gpu_check", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["gpu_check"] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    yield module
    del sys.modules["gpu_check"]


def run_script(*arguments, **environment):
    command = [SCRIPT.with_suffix(".sh"), *map(str, arguments)]
    return subprocess.run(
        command,
        env=os.environ | {"PYTHON": sys.executable, "PYTHONWARNINGS": "error"} | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_a_device_agrees_with_itself(tmp_path, device_name):
    np.savez(tmp_path / "blobs.npz", density=blobs((20, 18, 22)))
    name = choose_device(device_name).name.strip()
    scenes = ["fog in a sphere", "basis nodes", "evaluate"]
    run = run_script(
        *(name, "--lanes", 1, "--res", "32x18", "--repeats", 1, "-o", tmp_path / "out"),
        *("--volumes", tmp_path / "blobs.npz", "--scenes", *scenes),
    )
    assert run.returncode == 0, run.stderr
    assert name in run.stderr.splitlines()[0]  # the list of devices
    report = json.loads((tmp_path / "out" / "gpu_check.json").read_text(encoding="utf-8"))
    assert report["machine"]["lanes"] == 1
    assert [picture["name"] for picture in report["pictures"]] == ["blobs, tfm", "blobs, dual", *scenes]
    assert all(picture["rmse"] <= report["tolerances"]["rmse"] for picture in report["pictures"])
    (frame,) = report["frames"]
    seconds = [frame["figures"][f"{name}_seconds"]["median"] for name in ("light", "view", "dual")]
    assert min(seconds) > 0
    assert frame["figures"]["dual_over_frame"]["median"] == pytest.approx(seconds[2] / sum(seconds[:2]))
    text = (tmp_path / "out" / "gpu_check.md").read_text(encoding="utf-8")
    assert text == run.stdout
    assert f"| blobs | {seconds[0]:.4g} | {seconds[1]:.4g} |" in text
    assert "5 of 5 pictures" in text


def test_the_first_gpu_is_taken(gpu_check, monkeypatch):
    cpu = replace(list_devices()[0], kind="CPU")
    gpus = [replace(cpu, name=name, kind="GPU", default=False) for name in ("one", "two")]
    monkeypatch.setattr(gpu_check, "list_devices", lambda: [cpu, *gpus])
    assert gpu_check.find_device(None).name == "one"
    assert gpu_check.find_cpu() == cpu
    monkeypatch.setattr(gpu_check, "list_devices", lambda: gpus)
    with pytest.raises(NoDeviceError, match="no OpenCL device of a CPU to compare with"):
        gpu_check.find_cpu()


def test_without_a_gpu_one_line_says_so(gpu_check, monkeypatch, capsys, tmp_path):
    cpu = replace(list_devices()[0], name="some processor", kind="CPU")
    monkeypatch.setattr(gpu_check, "list_devices", lambda: [cpu])
    assert gpu_check.main(["-o", str(tmp_path)]) == 3
    out, err = capsys.readouterr()
    assert err.startswith("gpu_check.py: no GPU among the OpenCL devices, but '")
    assert "some processor'; install its driver's OpenCL" in err
    assert (out, err.count("\n")) == ("", 1)
    assert not list(tmp_path.iterdir())


def test_without_python_one_line_says_so():
    run = run_script(PYTHON="/nonexistent/python")
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (2, "", 1)
    assert "/nonexistent/python is missing" in run.stderr


def test_every_scene_is_there(gpu_check):
    assert len(gpu_check.scenes()) == len(gpu_check.SCENES) + len(gpu_check.BASES)


@pytest.mark.parametrize(
    ("change", "good"), [(1.0, True), (1.0005, True), (1.002, False), (math.nan, False), (math.inf, False)]
)
def test_what_is_the_same_picture(gpu_check, rng, change, good):
    picture = rng.random((24, 32, 4), np.float32)
    for measure in (gpu_check.difference, gpu_check.whole_difference):
        makers = iter((picture * np.float32(change), picture))
        found = gpu_check.compared("a", lambda _, of=makers: next(of), None, None, measure)
        assert found.good == good


def test_an_edge_that_moves_is_another_picture(gpu_check):
    picture = np.zeros((64, 64, 3), np.float32)
    picture[:, :32] = 1.0
    moved = picture.copy()
    moved[20:44, 32] = 1.0
    _, ssim = gpu_check.whole_difference(moved, picture)
    assert ssim < gpu_check.LEAST_SSIM


def test_what_a_device_refuses_is_told_and_fails(gpu_check):
    def refuse(_):
        raise KernelBuildError("light_pass.cl does not compile\non this device")

    found = gpu_check.compared("a", refuse, None, None, gpu_check.difference)
    assert not found.good
    assert "| a |  |  | light_pass.cl does not compile on this device |" in gpu_check.picture_row(found)
