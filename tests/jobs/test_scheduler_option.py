"""``--scheduler``: commands whose work is done by the workers of a Dask cluster."""

import dataclasses
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from job_workers import recorded, youngest
from scenes import blobs

from tfm_cl.render.renderer import Renderer
from tfm_cl.sweep import run as sweep
from tfm_cl.sweep.rows import read_rows

pytestmark = pytest.mark.slow

COUNTED = Path(__file__).with_name("counted_format.py")
SMALL = {"camera.res": [60, 40], "map.res": 16, "map.steps": 20, "march.steps": 20}


@pytest.fixture
def volume(tmp_path):
    path = tmp_path / "cloud.npy"
    np.save(path, blobs())
    return path


def test_a_sweep_has_the_same_rows(cluster, volume, tmp_path, device_name):
    seconds = dict.fromkeys(("seconds_light_pass", "seconds_view_pass", "seconds_reference"), 0.0)
    here, there = (
        sweep.run(
            [volume],
            tmp_path / name,
            partial(Renderer, device_name),
            bases=("dct",),
            coeffs=(2, 3),
            density_weightings=[10.0],
            overrides=SMALL.items(),
            scheduler=scheduler,
        )
        for name, scheduler in (("here", None), ("there", cluster.address))
    )
    assert [dataclasses.replace(row, **seconds) for row in here] == [
        dataclasses.replace(row, **seconds) for row in there
    ]
    assert sorted(path.name for path in (tmp_path / "there").rglob("*")) == sorted(
        path.name for path in (tmp_path / "here").rglob("*")
    )


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")
def test_ctrl_c_ends_a_sweep(cluster, volume, tmp_path, device_name):
    device = ("--device", device_name) if device_name else ()
    sizes = ",".join(map(str, range(64, 464)))
    options = ("--scheduler", cluster.address, "--bases", "dct", "--coeffs", "2", "--no-converged", *device)
    options += ("--res", "64x48", "--steps", "20", "--light-steps", "20", "--map-sizes", sizes)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "tfm_cl", "sweep", volume, "-o", out, *options],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < until:
            if (out / "sweep.jsonl").exists() and len(read_rows(out)) >= 3:
                break
            time.sleep(0.05)
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, err) == (130, "tfm: interrupted\n")
    assert time.monotonic() - sent < 15
    assert 3 <= len(read_rows(out)) < 400
    time.sleep(2)
    left = sorted((out / "images").iterdir())
    time.sleep(2)
    assert sorted((out / "images").iterdir()) == left  # the workers have stopped
    assert not [path for path in left if path.name.startswith(".")]


def test_frames_outlive_a_worker(start_cluster, volume, tmp_path, device_name):
    scheduler = start_cluster()
    workers = {process.pid: process for process in (scheduler.add_worker(), scheduler.add_worker())}
    scheduler.wait_for_workers(2)
    device = ("--device", device_name) if device_name else ()
    out, frames = tmp_path / "out", [f"{number:04d}" for number in range(1, 9)]
    out.mkdir()
    options = ("--scheduler", scheduler.address, "--turntable", "8", "-o", "out/a.####.counted", *device)
    options += ("--plugin", COUNTED, "--res", "16x9", "--map-res", "16", "--steps", "8", "--light-steps", "8")
    process = subprocess.Popen(
        [sys.executable, "-m", "tfm_cl", "render", volume.name, *options],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    killed = []
    while process.poll() is None and not killed:
        if len(recorded(out)) > 6 and (found := youngest(out)):
            victim, frame = found
            workers[victim].kill()
            killed.append(frame)
        time.sleep(0.02)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    lines = [(word, frame) for _, word, frame in recorded(out)]
    ended = sorted(frame for word, frame in lines if word == "ended")
    assert len(ended) == len(set(ended)) == len(frames)
    assert sorted(frame for word, frame in lines if word == "began") == sorted(ended + killed)
    assert len(killed) == 1
    assert {worker for worker, *_ in recorded(out)} == set(workers)
    assert sorted(path.name for path in out.glob("*.counted")) == [f"a.{frame}.counted" for frame in frames]
    told = [line.partition(":")[0] for line in err.splitlines() if line.startswith("frame ")]
    assert sorted(told) == sorted(f"frame {int(frame)}" for frame in frames)
