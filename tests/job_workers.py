"""Workers for jobs of other processes, which import them from here."""

import contextlib
import os
import time
from pathlib import Path

from tfm_cl.jobs.job import Job


class Recorder:
    """Writes down what it does: a line when a job begins, and one when it ends."""

    def record(self, folder, name, seconds, progress):
        log = Path(folder) / f"{os.getpid()}.log"
        with log.open("a", encoding="utf-8") as file:
            print("began", name, file=file, flush=True)
            try:
                until = time.monotonic() + seconds
                while time.monotonic() < until:
                    progress("waiting", 0.5)
                    time.sleep(0.02)
            except BaseException:
                print("stopped", name, file=file, flush=True)
                raise
            print("ended", name, file=file, flush=True)
        return name

    def fail(self, error, _progress):
        raise error

    def end_process(self, _progress):
        os._exit(1)

    def large(self, count, data, _progress):
        return b"x" * count, len(data)

    def where(self, path, _progress):
        return Path(path).read_text(encoding="utf-8")


def youngest(folder):
    """The process and name of the job that began last and has not ended; None without one."""
    for log in sorted(Path(folder).glob("*.log"), key=lambda path: path.stat().st_mtime_ns, reverse=True):
        word, _, name = log.read_text(encoding="utf-8").rstrip("\n").rpartition("\n")[2].partition(" ")
        if word == "began":
            return int(log.stem), name
    return None


def recorded(folder):
    """What all processes wrote down: (process, word, name), each process's in order."""
    return [
        (int(log.stem), *line.split())
        for log in sorted(Path(folder).glob("*.log"))
        for line in log.read_text(encoding="utf-8").splitlines()
    ]


class Tracked:
    """Counts what is finished."""

    def __init__(self):
        self.labels = []

    @contextlib.contextmanager
    def step(self, job):
        yield lambda _stage, _fraction: None
        self.finished(job)

    def finished(self, job):
        self.labels.append(job.label)


class Kept:
    """Makes jobs, and keeps what becomes of them."""

    def __init__(self):
        self.results, self.errors = {}, {}

    def job(self, label, method, *arguments, fatal=False):
        return Job(method, arguments, label, 1.0, self._done, None if fatal else self._failed)

    def _done(self, job, result):
        self.results[job.label] = result
        return []

    def _failed(self, job, error):
        self.errors[job.label] = error
        return []
