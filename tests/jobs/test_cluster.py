"""Jobs on a Dask cluster: what is lost, what is done again, and what is said."""

import os
import time
from pathlib import Path

import pytest
from job_workers import Kept, Recorder, Tracked, recorded, youngest

from tfm_cl.errors import DeviceError, InputError, SceneError
from tfm_cl.jobs import cluster as jobs_cluster
from tfm_cl.jobs.cluster import Cluster

STALE = Path(__file__).with_name("stale_worker.py")


@pytest.mark.slow
def test_a_killed_worker_costs_nothing_but_its_own_job(start_cluster, tmp_path):
    scheduler = start_cluster()
    workers = {process.pid: process for process in (scheduler.add_worker(), scheduler.add_worker())}
    scheduler.wait_for_workers(2)
    names = [f"job{number}" for number in range(8)]
    kept, tracker, killed = Kept(), Tracked(), []

    def finished(job):
        tracker.labels.append(job.label)
        if len(tracker.labels) >= 3 and not killed and (found := youngest(tmp_path)):
            victim, name = found
            workers[victim].kill()
            killed.append(name)

    counted = Tracked()
    counted.finished = finished
    with Cluster(scheduler.address, Recorder) as pool:
        pool.run([kept.job(name, "record", str(tmp_path), name, 1.0) for name in names], counted)

    assert kept.results == {name: name for name in names}
    assert sorted(tracker.labels) == sorted(names)
    lines = [(word, name) for _, word, name in recorded(tmp_path)]
    assert sorted(name for word, name in lines if word == "ended") == sorted(names)
    assert sorted(name for word, name in lines if word == "began") == sorted(names + killed)
    assert len(killed) == 1
    assert {process for process, *_ in recorded(tmp_path)} == set(workers)


@pytest.mark.slow
def test_what_is_done_stays_done(start_cluster, tmp_path):
    """A worker that is lost between the end of a job and the moment when its result is fetched."""
    scheduler, kept, tracker = start_cluster(), Kept(), Tracked()
    worker = scheduler.add_worker()

    def finished(job):
        tracker.labels.append(job.label)
        if job.label == "a":
            until = time.monotonic() + 60
            while youngest(tmp_path) != (worker.pid, "c") and time.monotonic() < until:
                time.sleep(0.05)
            worker.kill()
            scheduler.add_worker()

    counted = Tracked()
    counted.finished = finished
    seconds = {"a": 0.0, "b": 0.5, "c": 3.0}
    with Cluster(scheduler.address, Recorder) as pool:
        pool.run([kept.job(name, "record", str(tmp_path), name, seconds[name]) for name in "abc"], counted)
    assert kept.results == {"a": "a", "b": "b", "c": "c"}
    lines = [(word, name) for _, word, name in recorded(tmp_path)]
    assert sorted(name for word, name in lines if word == "ended") == ["a", "b", "c"]
    assert sorted(name for word, name in lines if word == "began") == ["a", "b", "c", "c"]


@pytest.mark.slow
def test_errors(cluster, tmp_path):
    kept = Kept()
    jobs = [
        kept.job("input", "fail", SceneError("a.toml: one", "a.toml: two")),
        kept.job("device", "fail", DeviceError("no room")),
        kept.job("disk", "fail", OSError(28, "No space left on device")),
        kept.job("unforeseen", "fail", ZeroDivisionError("why")),
        *(kept.job(name, "record", str(tmp_path), name, 0.0) for name in "abc"),
    ]
    with Cluster(cluster.address, Recorder) as pool:
        pool.run(jobs, Tracked())
        pool.run([kept.job("deadly", "end_process")], Tracked())
    assert kept.results == {name: name for name in "abc"}
    assert {name: type(error) for name, error in kept.errors.items()} == {
        "input": SceneError,
        "device": DeviceError,
        "disk": OSError,
        "unforeseen": ZeroDivisionError,
        "deadly": DeviceError,
    }
    assert kept.errors["input"].args == ("a.toml: one", "a.toml: two")
    assert "job_workers.py" in "".join(kept.errors["unforeseen"].__notes__)
    assert str(kept.errors["deadly"]) == (
        "deadly: the workers that did it ended by themselves, perhaps for lack of memory"
    )


@pytest.mark.slow
def test_names_of_files_mean_what_they_mean_here(cluster, tmp_path, monkeypatch):
    kept = Kept()
    (tmp_path / "here.txt").write_text("found", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with Cluster(cluster.address, Recorder) as pool:
        pool.run([kept.job("a", "where", "here.txt")], Tracked())
        assert kept.results == {"a": "found"}
        monkeypatch.setattr(Path, "cwd", lambda: tmp_path / "elsewhere")
        with pytest.raises(
            DeviceError, match=r"^tcp://.*: has no folder .*elsewhere; workers have to see the"
        ):
            pool.run([kept.job("b", "where", "here.txt")], Tracked())


@pytest.mark.slow
def test_what_nobody_waits_for_stops(cluster, tmp_path):
    class EnoughError(Exception):
        pass

    def interrupt(_job):
        raise EnoughError

    kept, tracker = Kept(), Tracked()
    tracker.finished = interrupt
    jobs = [kept.job(name, "record", str(tmp_path), name, 0.2 if name == "a" else 60.0) for name in "abcd"]
    with pytest.raises(EnoughError), Cluster(cluster.address, Recorder) as pool:
        pool.run(jobs, tracker)
    until = time.monotonic() + 20
    while time.monotonic() < until:
        time.sleep(0.1)
        words = [word for _, word, _ in recorded(tmp_path)]
        if words.count("began") == words.count("ended") + words.count("stopped"):
            break
    assert words.count("stopped") >= 1
    assert words.count("began") == words.count("ended") + words.count("stopped")
    with Cluster(cluster.address, Recorder) as pool:  # the workers are free again
        pool.run([kept.job("e", "record", str(tmp_path), "e", 0.0)], Tracked())


@pytest.mark.slow
def test_workers_of_devices_alone_get_work(start_cluster, tmp_path):
    scheduler, kept = start_cluster(), Kept()
    without = scheduler.add_worker()
    with_device = scheduler.add_worker("--resources", "device=1")
    scheduler.wait_for_workers(2)
    with Cluster(scheduler.address, Recorder) as pool:
        pool.run([kept.job(name, "record", str(tmp_path), name, 0.1) for name in "abcdef"], Tracked())
    assert {process for process, *_ in recorded(tmp_path)} == {with_device.pid}
    assert without.poll() is None


@pytest.mark.slow
def test_a_worker_of_another_version(start_cluster):
    scheduler, kept = start_cluster(), Kept()
    scheduler.add_worker("--preload", STALE)
    told = r"^tcp://\S+: this worker has tfm_cl 0\.0\.1, and \S+ asks it for work; install tfm_cl==\S+ on"
    with pytest.raises(DeviceError, match=told), Cluster(scheduler.address, Recorder) as pool:
        pool.run([kept.job("a", "end_process")], Tracked())
    assert kept.errors == {}  # it is no fault of the job


@pytest.mark.slow
def test_a_scheduler_that_goes_away(start_cluster, tmp_path):
    scheduler, kept = start_cluster(), Kept()
    scheduler.add_worker()

    def kill(_job):
        scheduler.process.kill()

    tracker = Tracked()
    tracker.finished = kill
    jobs = [kept.job(name, "record", str(tmp_path), name, seconds) for name, seconds in (("a", 0), ("b", 60))]
    with (
        pytest.raises(DeviceError, match=r"^tcp://\S+: the scheduler is gone, or has dropped the jobs \("),
        Cluster(scheduler.address, Recorder) as pool,
    ):
        pool.run(jobs, tracker)


@pytest.mark.slow
def test_no_workers_or_none_left(start_cluster, tmp_path, monkeypatch):
    scheduler, kept = start_cluster(), Kept()
    monkeypatch.setattr(jobs_cluster, "JOINED_BY", 0.2)
    monkeypatch.setattr(jobs_cluster, "BACK_BY", 1.0)
    with (
        pytest.raises(
            DeviceError, match=r"^tcp://\S+: the scheduler has no workers; start some: dask worker tcp:"
        ),
        Cluster(scheduler.address, Recorder),
    ):
        pass
    monkeypatch.setattr(jobs_cluster, "JOINED_BY", 60.0)
    worker, tracker = scheduler.add_worker(), Tracked()
    tracker.finished = lambda _job: worker.kill()
    jobs = [kept.job(name, "record", str(tmp_path), name, seconds) for name, seconds in (("a", 0), ("b", 60))]
    with (
        pytest.raises(DeviceError, match=r"^tcp://\S+: has had no workers for 1 s; 1 jobs are not done$"),
        Cluster(scheduler.address, Recorder) as pool,
    ):
        pool.run(jobs, tracker)


def test_no_scheduler(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(jobs_cluster, "CONNECTED_BY", 0.3)
    with (
        pytest.raises(DeviceError, match=r"^127\.0\.0\.1:9: no Dask scheduler answers there \(") as caught,
        Cluster("127.0.0.1:9", Recorder),
    ):
        pass
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "address", ["", "host", "tcp://host", "http://host:1", "tcp://host:8786/", "a b:1", "host:port"]
)
def test_what_is_no_address(address):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=r"should be the address of a Dask scheduler, tcp://HOST:8786$"):
        Cluster(address, Recorder)


def test_what_makes_the_worker_has_to_be_sent():
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="other processes can import"):
        Cluster("tcp://127.0.0.1:9", lambda: os)


def test_what_has_no_work_is_released(monkeypatch):
    class Renderer:
        closed = False

        def close(self):
            self.closed = True

    mine, kept = jobs_cluster._Mine, Renderer()
    for name, value in (("worker", kept), ("run", "some"), ("jobs", 3)):
        monkeypatch.setattr(mine, name, value)
    jobs_cluster._drop_idle(2)  # a third job has begun since
    assert (mine.worker, kept.closed) == (kept, False)
    jobs_cluster._drop_idle(3)
    assert (mine.worker, mine.run, kept.closed) == (None, "", True)
