"""Jobs on a Dask cluster: what is lost, what is done again, and what is said."""

import pytest
from job_workers import Recorder, recorded

from tfm_cl.jobs.cluster import Cluster
from tfm_cl.jobs.job import Job


class Tracked:
    """Counts what is finished."""

    def __init__(self):
        self.labels = []

    def finished(self, job):
        self.labels.append(job.label)


@pytest.mark.slow
def test_a_killed_worker_costs_nothing_but_its_own_job(scheduler, tmp_path):
    workers = {process.pid: process for process in (scheduler.add_worker(), scheduler.add_worker())}
    names = [f"job{number}" for number in range(12)]
    results, killed = [], []

    def done(_job, result):
        results.append(result)
        if len(results) == 4:
            open_jobs = {}
            for process, word, name in recorded(tmp_path):
                open_jobs[process] = name if word == "began" else None
            victim, name = next((process, name) for process, name in open_jobs.items() if name)
            workers[victim].kill()
            killed.append(name)
        return []

    jobs = [Job("record", (str(tmp_path), name, 0.4), name, 1.0, done) for name in names]
    tracker = Tracked()
    with Cluster(scheduler.address, Recorder) as pool:
        pool.run(jobs, tracker)

    assert sorted(results) == sorted(tracker.labels) == sorted(names)
    lines = [(word, name) for _, word, name in recorded(tmp_path)]
    assert sorted(name for word, name in lines if word == "ended") == sorted(names)
    began = [name for word, name in lines if word == "began"]
    assert sorted(began) == sorted(names + killed)
    assert len({process for process, *_ in recorded(tmp_path)}) == 2
