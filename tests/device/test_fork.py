"""Processes forked from one that renders: OpenCL does not survive that, and they are told so at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")

PROGRAM = """
import multiprocessing, os, sys
import tfm_cl as tfm
from tfm_cl.device.device import list_devices
from scenes import make_scene

def make_another():
    with tfm.Renderer(DEVICE, lanes=1):
        pass

def use(queue, what):
    try:
        what()
    except tfm.DeviceError as error:
        queue.put(str(error))
    else:
        queue.put("it worked")

scene, device = make_scene(), DEVICE
with tfm.Renderer(device, build_options=('-Werror',), lanes=1) as renderer:
    image = renderer.render(scene).image
    (light_map,) = renderer.build_maps(scene)
    fork = multiprocessing.get_context("fork")
    for what in (
        lambda: renderer.render(scene), lambda: renderer.build_maps(scene), lambda: light_map.coefficients,
        list_devices, make_another,
    ):
        queue = fork.SimpleQueue()
        child = fork.Process(target=use, args=(queue, what))
        child.start()
        print(queue.get(), flush=True)
        child.join()
        assert child.exitcode == 0
    assert (renderer.render(scene).image == image).all()
    if os.fork() == 0:
        sys.exit(7)  # leaves the renderer behind, as any block
    assert os.waitstatus_to_exitcode(os.wait()[1]) == 7
    assert (renderer.render(scene).image == image).all()
"""


def test_a_forked_process_gets_a_clear_error(device_name):
    program = PROGRAM.replace("DEVICE", repr(device_name))
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", program],
        cwd=Path(__file__).resolve().parents[1],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert len(lines) == 5
    for line in lines:
        assert "start processes with spawn: multiprocessing.get_context('spawn')" in line
