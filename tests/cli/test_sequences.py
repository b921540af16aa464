"""``tfm render --frames``: steady pictures, resuming, several processes, exit codes."""

import errno
import json
import os
import random
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm

KILLS = 10
MANY, FEW = 40, 10
"""Frames after which memory and open files are looked at."""
GROWTH = 3 << 20
"""Bytes that a process may grow by meanwhile: what 30 frames keep for later ones is three times that."""


@pytest.fixture
def smoke(folder):
    """Frames of a small volume that drifts, ``smoke.0001.npy`` to ``smoke.0006.npy``."""
    for frame in range(1, 7):
        np.save(folder / f"smoke.{frame:04d}.npy", np.roll(blobs(), frame, axis=2))
    return "smoke.####.npy"


@pytest.fixture
def sequence(smoke, tiny):
    """Arguments that render them, to two pictures each."""
    return ("render", smoke, "--frames", "1-6", "-o", "a.####.exr", "-o", "a.####.png", *tiny)


def pictures(folder):
    """Bytes of all pictures."""
    return {path.name: path.read_bytes() for path in Path(folder).glob("a.[0-9]*")}


def unfinished(folder):
    """Files that are there only meanwhile."""
    return [path for path in Path(folder).rglob("*") if path.suffix in {".tmp", ".claim"}]


def test_a_still_scene_is_the_same_in_all_frames(cli, folder, cloud, tiny):
    done = cli("render", cloud, "--frames", "1-4", "-o", "a.####.exr", "-o", "a.####.png", *tiny)
    assert done.code == 0, done.err
    for extension in ("exr", "png"):
        assert len({path.read_bytes() for path in folder.glob(f"a.*.{extension}")}) == 1
    assert len(pictures(folder)) == 8


def test_what_a_moving_camera_looks_at_is_read_and_lit_once(cli, folder, cloud, tiny, monkeypatch):
    turning = ("render", cloud, "--turntable", "3", "-o", "a.####.exr", *tiny)
    assert cli(*turning).code == 0
    whole, read, load = pictures(folder), [], tfm.Volume.load
    assert len(set(whole.values())) == 3
    monkeypatch.setattr(tfm.Volume, "load", lambda *of, **how: read.append(of) or load(*of, **how))

    done = cli(*turning, "--json", "a.json")  # all is decided

    assert done.code == 0, done.err
    assert len(read) == 1
    light = [
        frame["seconds"]["light_pass"] for frame in json.loads((folder / "a.json").read_text())["frames"]
    ]
    assert light[0] > 0
    assert light[1:] == [0, 0]
    assert pictures(folder) == whole


def test_one_plan_for_all_of_it(cli, folder, sequence):
    """What machines make that have some of the frames each is what one makes that has them all."""
    assert cli(*sequence, "-q").code == 0
    whole, text = pictures(folder), (folder / "a.plan.toml").read_text()
    for path in folder.glob("a.*"):
        path.unlink()
    shutil.rmtree(folder / ".a.tfm")
    for frames in ("4-6", "1-3"):
        (folder / "a.plan.toml").unlink(missing_ok=True)
        assert cli(*sequence, "--frames", frames, "--plan-frames", "1-6", "-q").code == 0
    assert pictures(folder) == whole
    assert (folder / "a.plan.toml").read_text() == text


def test_why_is_told(cli, sequence):
    done = cli(*sequence, "-v")
    assert "chosen for all frames: --density-scale" in done.err
    assert re.search(r"^# volume\.density_scale = \S+: an optical depth .* densest", done.err, re.MULTILINE)


def test_what_is_done_is_skipped(cli, folder, sequence):
    assert cli(*sequence, "--frames", "1-3").code == 0
    before = {path: path.stat().st_mtime_ns for path in folder.glob("a.*.exr")}
    (folder / "a.0002.png").unlink()
    np.save(folder / "smoke.0003.npy", blobs())
    done = cli(*sequence, "--frames", "1-3", "--plan-frames", "1-3", "--skip-existing")
    assert done.code == 0, done.err
    after = {path: path.stat().st_mtime_ns for path in folder.glob("a.*.exr")}
    assert "frame 2: " in done.err
    assert before[folder / "a.0002.exr"] != after[folder / "a.0002.exr"]
    assert not unfinished(folder)


def test_nothing_is_done_twice(cli, sequence):
    assert cli(*sequence).code == 0
    done = cli(*sequence, "--skip-existing")
    assert re.findall(r"frame (\d): is there", done.err) == list("123456")


def test_one_bad_frame_does_not_stop_the_others(cli, folder, sequence):
    (folder / "smoke.0002.npy").write_bytes(b"")
    (folder / "smoke.0004.npy").unlink()
    done = cli(*sequence, "-q")
    assert done.code == 5
    assert len(pictures(folder)) == 8
    lines = done.err.splitlines()
    assert [line[:13] for line in lines] == ["tfm: frame 2:", "tfm: frame 4:"]
    assert "smoke.0002.npy" in lines[0]
    assert "smoke.0004.npy" in lines[1]


def test_none_that_can_be_read(cli, folder, sequence):
    for path in folder.glob("smoke.*"):
        path.unlink()
    done = cli(*sequence)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "smoke.0001.npy" in done.err


def test_a_full_disk(cli, folder, sequence, monkeypatch):
    flush = os.fsync

    def full(descriptor):
        if (folder / "a.0002.png").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    done = cli(*sequence, "-q", "--skip-existing")
    assert done.code == 5
    failed, left = done.err.splitlines()
    assert "cannot be written (No space left on device)" in failed
    assert re.fullmatch(r"tfm: \d frames were not made: nothing can be written", left)
    assert not unfinished(folder)


def test_no_room_for_records(refused, folder, sequence):
    (folder / ".a.tfm").write_text("")
    assert ".a.tfm: cannot be written" in refused(*sequence)


@pytest.mark.parametrize("flags", [["--skip-existing"], ["--jobs", "2"], ["--plan-frames", "1-9"]])
def test_what_is_of_several_frames_only(refused, cloud, flags):
    assert "is of several frames: say which with --frames" in refused("render", cloud, "-o", "a.png", *flags)


def test_ranges_that_are_none(refused, sequence):
    assert "--plan-frames: 'x'" in refused(*sequence, "--plan-frames", "x")


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts open files as Linux shows them")
def test_memory_and_open_files_are_level(cli, folder, tiny):
    """In one process: what each frame needs is given back."""
    for frame in range(1, MANY + 1):
        np.save(folder / f"smoke.{frame:04d}.npy", blobs() + frame / MANY)

    def used():
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE"), len([*Path("/proc/self/fd").iterdir()])

    def render(last):
        arguments = ("render", "smoke.####.npy", "--frames", f"1-{last}", "-o", "a.####.exr", "-q", *tiny)
        assert cli(*arguments, "--plan-frames", f"1-{MANY}").code == 0
        return used()

    render(FEW)
    memory, files = render(FEW)
    after, files_after = render(MANY)
    assert files_after == files
    assert after - memory < GROWTH


@pytest.fixture
def start(program, folder, sequence):
    """Start a process that renders the frames to a folder of its own, or to one that others share."""

    def start(name, *more):
        (folder / name).mkdir(exist_ok=True)
        arguments = [str(folder / item) if "smoke" in item else item for item in sequence]
        return subprocess.Popen(
            program(*arguments, *more), cwd=folder / name, stderr=subprocess.PIPE, text=True
        )

    return start


def finish(process):
    """Wait for a process that must succeed; returns what it told."""
    error = process.communicate()[1]
    assert process.returncode == 0, error
    return error


@pytest.mark.slow
def test_killed_at_random_moments(start, folder):
    finish(start("whole"))
    moments = random.Random(20110218)  # noqa: S311 - the same in each run
    for _ in range(KILLS):
        process = start("killed", "--skip-existing")
        try:
            process.communicate(timeout=moments.uniform(0.3, 3.0))
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
    finish(start("killed", "--skip-existing"))
    assert pictures(folder / "killed") == pictures(folder / "whole")
    assert len(pictures(folder / "killed")) == 12
    assert not unfinished(folder / "killed")


@pytest.mark.slow
def test_two_processes_share_a_folder(start, folder):
    """No frame is made twice, both end with all of them, and a third, of several processes, finds them."""
    both = [start("shared", "--skip-existing") for _ in range(2)]
    told = [finish(process) for process in both]
    made = [frame for text in told for frame in re.findall(r"^frame (\d): \d", text, re.MULTILINE)]
    assert sorted(made) == list("123456")
    assert len(pictures(folder / "shared")) == 12
    assert not unfinished(folder / "shared")


@pytest.mark.slow
def test_jobs_make_the_same(start, folder):
    for process in (start("one"), start("several", "--jobs", "2")):
        finish(process)
    assert pictures(folder / "several") == pictures(folder / "one")
    assert finish(start("several", "--jobs", "2", "--skip-existing")).count("is there") == 6


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")
@pytest.mark.parametrize(
    ("jobs", "number", "code"),
    [
        ("1", signal.SIGINT, 130),
        ("2", signal.SIGINT, 130),
        ("1", signal.SIGTERM, 143),
        ("2", signal.SIGTERM, 143),
    ],
)
def test_ended_by_a_signal(start, folder, jobs, number, code):
    process = start("ended", "--skip-existing", "--jobs", jobs)
    deadline = time.monotonic() + 120
    while not list((folder / "ended").glob("a.*.png")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(number)
    error = process.communicate(timeout=60)[1]
    assert process.returncode in {0, code}, error  # 0: it had just ended
    assert "Traceback" not in error
    assert not unfinished(folder / "ended")
