"""Jobs here and in other processes: order, errors, and processes that end."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from job_workers import Kept, Recorder, Tracked, recorded

from tfm_cl.errors import DeviceError, SceneError
from tfm_cl.jobs import processes
from tfm_cl.jobs.here import Here
from tfm_cl.jobs.processes import Processes


@pytest.fixture(params=["here", "processes"])
def pool(request):
    return Here(contextlib.nullcontext(Recorder())) if request.param == "here" else Processes(Recorder, 2)


def test_one_that_fails_does_not_stop_the_rest(pool, tmp_path):
    kept, tracker = Kept(), Tracked()
    error = SceneError("a.toml: one", "a.toml: two")
    jobs = [kept.job("bad", "fail", error)]
    jobs += [kept.job(name, "record", str(tmp_path), name, 0.0) for name in "abc"]
    with pool:
        pool.run(jobs, tracker)
    assert kept.results == {name: name for name in "abc"}
    assert {name: (type(found), found.args) for name, found in kept.errors.items()} == {
        "bad": (SceneError, error.args)
    }
    assert sorted(tracker.labels) == ["a", "b", "bad", "c"]


def test_jobs_follow_jobs(pool, tmp_path):
    kept, tracker = Kept(), Tracked()
    second = kept.job("second", "record", str(tmp_path), "second", 0.0)
    first = kept.job("first", "record", str(tmp_path), "first", 0.0)
    first = type(first)(**vars(first) | {"done": lambda _job, _result: [second]})
    with pool:
        pool.run([first], tracker)
        assert tracker.labels == ["first", "second"]


@pytest.mark.slow
def test_what_is_large_goes_through_files_that_do_not_stay():
    kept, count = Kept(), 3 * processes.LARGEST_SENT
    with Processes(Recorder, 1) as pool:
        pool.run([kept.job("large", "large", count, bytes(count))], Tracked())
        assert not list(pool._scratch.path.glob("*.sent"))
    assert kept.results == {"large": (b"x" * count, count)}


def test_one_that_ends_its_process_is_told_from_its_neighbours(tmp_path):
    kept = Kept()
    jobs = [kept.job("deadly", "end_process")]
    jobs += [kept.job(name, "record", str(tmp_path), name, 0.2) for name in "abcd"]
    with Processes(Recorder, 2) as pool:
        pool.run(jobs, Tracked())
    assert kept.results == {name: name for name in "abcd"}
    assert str(kept.errors["deadly"]).startswith(
        "deadly: a process ended by itself, perhaps for lack of memory"
    )
    ended = sorted(name for _, word, name in recorded(tmp_path) if word == "ended")
    assert ended == ["a", "b", "c", "d"]
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_a_process_that_is_killed_with_nothing_to_do(tmp_path):
    kept = Kept()
    with Processes(Recorder, 1) as pool:
        pool.run([kept.job("a", "record", str(tmp_path), "a", 0.0)], Tracked())
        (child,) = multiprocessing.active_children()
        child.kill()
        child.join()
        pool.run([kept.job("b", "record", str(tmp_path), "b", 0.0)], Tracked())
    assert kept.results == {"a": "a", "b": "b"}


@pytest.mark.slow
def test_the_first_error_ends_everything_at_once(tmp_path):
    kept, began = Kept(), time.monotonic()
    jobs = [kept.job("long", "record", str(tmp_path), "long", 600.0)]
    jobs += [kept.job("bad", "fail", DeviceError("no"), fatal=True)]
    with pytest.raises(DeviceError, match=r"^no$"), Processes(Recorder, 2) as pool:
        pool.run(jobs, Tracked())
    assert time.monotonic() - began < 60
    assert multiprocessing.active_children() == []


PARENT = """
import sys
from job_workers import Kept, Recorder, Tracked
from tfm_cl.jobs.processes import Processes
if __name__ == "__main__":
    with Processes(Recorder, 1) as pool:
        pool.run([Kept().job("long", "record", sys.argv[1], "long", 600.0)], Tracked())
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")
def test_processes_end_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    with subprocess.Popen([sys.executable, script, tmp_path], env=environment) as parent:
        until = time.monotonic() + 60
        while not recorded(tmp_path) and time.monotonic() < until:
            time.sleep(0.05)
        ((child, _, _),) = recorded(tmp_path)
        parent.send_signal(signal.SIGKILL)
    until = time.monotonic() + 30
    while _is_there(child) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _is_there(child)


def _is_there(process):
    """Whether a process lives; one that has ended but that nobody waits for does not."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{process}/stat")
    return not state.exists() or state.read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
