"""Jobs on the workers of a Dask cluster, whose scheduler decides who does what, and what is done again.

Files are not sent: workers see the same folders under the same names. Jobs and results are pickled, so a
scheduler and its workers are trusted as this program is.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import re
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tfm_cl import plugins
from tfm_cl._version import __version__
from tfm_cl.errors import CancelledError, DeviceError, InputError, TfmWarning
from tfm_cl.extras import missing
from tfm_cl.interrupts import interrupts_held
from tfm_cl.jobs.futures import Futures, UnfitError, portable, sendable
from tfm_cl.jobs.job import Job

RESOURCE = "device"
"""What a worker declares that owns a device: each job takes one."""

CONNECTED_BY = 5.0
"""Seconds after which a scheduler should have answered."""
JOINED_BY = 10.0
"""Seconds that a scheduler without workers has to get one."""
BACK_BY = 60.0
"""Seconds that it has where all of them were lost: what watches a worker starts it again."""

RETRIES = 2
"""How often a job is done again that fails for other reasons than bad input, perhaps on another worker."""

KEPT_FOR = 60.0
"""Seconds that a worker of the cluster keeps a renderer without work."""

ADDRESS = re.compile(r"((tcp|tls|ucx|ws|wss)://)?(\[[0-9a-fA-F:]+\]|[^\s:/\[\]]+):[0-9]{1,5}")


class Cluster(Futures):
    """Executes jobs on the workers of a Dask cluster, each with a renderer of its own.

    A job is given to a worker that declares the resource `RESOURCE`, if any does, else to any worker. If a
    worker is lost, others do what it was doing.

    Parameters
    ----------
    address
        Of the scheduler, as ``tcp://host:8786``.
    make_worker
        Makes what does the work, in each worker.

    Raises
    ------
    InputError
        Dask is missing, the address is not one, or what makes the worker cannot be sent.
    """

    def __init__(self, address: str, make_worker: Callable[[], Any]) -> None:
        if lack := missing("dask"):
            raise InputError(f"--scheduler {lack}")
        if not ADDRESS.fullmatch(address):
            raise InputError(
                f"scheduler = {address!r}: should be the address of a Dask scheduler, tcp://HOST:8786"
            )
        self._address, self._make_worker = address, sendable(make_worker)
        self._run = uuid.uuid4().hex

    def __enter__(self) -> Self:
        import distributed  # noqa: PLC0415 - takes half a second

        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:
            stack.enter_context(_quiet())
            with interrupts_held(), warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                try:
                    self._client = distributed.Client(  # type: ignore[no-untyped-call]
                        self._address, timeout=CONNECTED_BY, set_as_default=False, name="tfm_cl"
                    )
                except (OSError, ValueError, RuntimeError) as error:
                    raise self._unfit("no Dask scheduler answers there", error) from error
            stack.callback(self._close)
            for warning in told:
                if issubclass(warning.category, distributed.versions.VersionMismatchWarning):
                    _log.warning("%s: %s", self._address, " ".join(str(warning.message).split()))
            self._resources = self._found_resources()
            self._alive = time.monotonic()
            self._stack = stack.pop_all()
        return self

    def _found_resources(self) -> dict[str, float]:
        """Wait for a worker; returns what a job asks of one."""
        try:
            self._client.wait_for_workers(1, timeout=JOINED_BY)
        except TimeoutError as error:
            raise DeviceError(
                f"{self._address}: the scheduler has no workers; start some: dask worker {self._address}"
            ) from error
        declared = any(RESOURCE in worker.get("resources", {}) for worker in self._workers())
        return {RESOURCE: 1} if declared else {}

    def _workers(self) -> list[dict[str, Any]]:
        return list(self._client.scheduler_info(n_workers=-1)["workers"].values())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def _close(self) -> None:
        """Leave; the scheduler then drops what was submitted, and workers notice."""
        with interrupts_held():
            self._client.close(timeout=CONNECTED_BY)  # type: ignore[no-untyped-call]

    def _has_room(self, running: int) -> bool:
        del running
        return True

    def _submitted(self, job: Job) -> Any:
        work = pickle.dumps((self._make_worker, job.method, job.arguments))
        asked = (__version__, self._run, str(Path.cwd()), os.environ.get(plugins.VARIABLE, ""))
        with interrupts_held():
            return self._client.submit(
                _do,
                asked,
                work,
                key=f"tfm_cl-{uuid.uuid4().hex}",
                pure=False,
                retries=RETRIES,
                resources=self._resources or None,
            )

    def _result(self, job: Job, future: Any) -> Any:
        import distributed  # noqa: PLC0415

        self._alive = time.monotonic()
        try:
            if future.status == "error":
                raise self._told(job, future.exception())
            result, error = future.result()
            _Answer(future.key, self._client).forget()
        except distributed.client.FutureCancelledError as lost:
            raise UnfitError(self._unfit("the scheduler is gone, or has dropped the jobs", lost)) from lost
        finally:
            future.release()
        if error is not None:
            raise error
        return result

    def _told(self, job: Job, error: Exception) -> Exception:
        """Return what to raise for an error that Dask hands over."""
        import distributed  # noqa: PLC0415

        if isinstance(error, distributed.KilledWorker):
            return DeviceError(
                f"{job.label}: the workers that did it ended by themselves, perhaps for lack of memory"
            )
        if isinstance(error, ModuleNotFoundError):
            return UnfitError(self._unfit("a worker lacks a module of this program", error))
        return error

    def _look(self, jobs: list[Job]) -> None:
        try:
            workers = [
                worker
                for worker in self._workers()
                if not self._resources or RESOURCE in worker.get("resources", {})
            ]
        except Exception:  # noqa: BLE001 - whatever a connection that breaks leads to
            workers = []
        now = time.monotonic()
        if workers:
            self._alive = now
        elif now - self._alive > BACK_BY:
            raise DeviceError(
                f"{self._address}: has had no workers for {BACK_BY:g} s; {len(jobs)} jobs are not done"
            )

    def _unfit(self, what: str, error: BaseException) -> DeviceError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return DeviceError(f"{self._address}: {what} ({reason})")


_log = logging.getLogger("tfm_cl")
_log.addHandler(logging.NullHandler())  # where it is shown is the program's business


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep what Dask logs of lost connections off the terminal: we say it in one line."""
    log = logging.getLogger("distributed")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(before)


# ----------------------------------------------------------------------------- in the workers


class _Mine:
    """What this worker of the cluster works with: one renderer, for one job at a time."""

    turn = threading.Lock()
    run = ""
    worker: Any = None
    jobs = 0
    """Begun since this process began."""


class _Answer:
    """What came of a job, kept by the scheduler until it is fetched: its worker may be lost before that."""

    def __init__(self, key: Any, client: Any) -> None:
        import distributed  # noqa: PLC0415 - the others have it not

        untyped: Any = distributed
        self._is_there, self._answer = untyped.Event(key, client), untyped.Variable(key, client)

    def get(self) -> Any:
        """Return it; None where there is none."""
        return pickle.loads(self._answer.get()) if self._is_there.is_set() else None  # noqa: S301

    def keep(self, answer: Any) -> None:
        """Keep it."""
        self._answer.set(pickle.dumps(answer))
        self._is_there.set()

    def forget(self) -> None:
        """Keep it no longer."""
        self._is_there.clear()
        self._answer.delete()


def _do(asked: tuple[str, str, str, str], work: bytes) -> tuple[Any, Exception | None]:
    """Do a job; returns its result, or an error that would be the same elsewhere. Other errors are raised."""
    from distributed import get_client, get_worker  # noqa: PLC0415

    with _Mine.turn:
        kept = _Answer(get_worker().get_current_task(), get_client())
        answer: tuple[Any, Exception | None] | None = kept.get()
        if answer is None:
            answer = _done(asked, work)
            if not isinstance(answer[1], CancelledError):
                kept.keep(answer)
        return answer


def _done(asked: tuple[str, str, str, str], work: bytes) -> tuple[Any, Exception | None]:
    """Do it now, in this thread's turn."""
    version, run, folder, plugin_files = asked
    _Mine.jobs += 1
    try:
        here = _place()
        _check_version(version, here)
        watched = _Watched()
        watched("", 0.0)
        with _in_folder(folder, here):
            return _worker_of(run, work, plugin_files, watched), None
    except (InputError, CancelledError, UnfitError) as error:
        return None, portable(error)
    except Exception as error:  # noqa: BLE001 - raised again, as what can be sent
        raise portable(error) from None
    finally:
        later = threading.Timer(KEPT_FOR, _drop_idle, [_Mine.jobs])
        later.daemon = True
        later.start()


def _check_version(version: str, here: str) -> None:
    if version != __version__:
        raise UnfitError(
            DeviceError(
                f"{here}: this worker has tfm_cl {__version__}, and {version} asks it for work; install "
                f"tfm_cl=={version} on every worker"
            )
        )


def _worker_of(run: str, work: bytes, plugin_files: str, progress: Callable[[str, float], None]) -> Any:
    warnings.simplefilter("ignore", TfmWarning)  # nobody would read them here
    os.environ[plugins.VARIABLE] = plugin_files
    for path in filter(None, plugin_files.split(os.pathsep)):
        plugins.load_plugin(path)
    make_worker, method, arguments = pickle.loads(work)  # noqa: S301 - the scheduler is trusted
    if _Mine.run != run:
        _drop()
        _Mine.worker = pickle.loads(make_worker)()  # noqa: S301
        _Mine.run = run
    return getattr(_Mine.worker, method)(*arguments, progress)


def _drop() -> None:
    """Release the device's memory."""
    worker, _Mine.worker, _Mine.run = _Mine.worker, None, ""
    close = getattr(worker, "close", None)
    if close is not None:
        close()


def _drop_idle(jobs: int) -> None:
    """Do so if no job has begun since that one, whatever became of who asked for it."""
    with _Mine.turn:
        if _Mine.jobs == jobs:
            _drop()


class _Watched:
    """Progress of a job that ends the job if nobody waits for it any more."""

    def __init__(self) -> None:
        from distributed import get_worker  # noqa: PLC0415 - the others have it not

        worker = get_worker()
        self._tasks, self._key = worker.state.tasks, worker.get_current_task()

    def __call__(self, stage: str, fraction: float) -> None:
        del stage, fraction
        task = self._tasks.get(self._key)
        if task is None or task.state == "cancelled":
            raise CancelledError("nobody waits for this job any more")


def _place() -> str:
    from distributed import get_worker  # noqa: PLC0415

    return str(get_worker().address)


@contextlib.contextmanager
def _in_folder(folder: str, here: str) -> Iterator[None]:
    """Be in the folder that names of files are relative to."""
    if not Path(folder).is_dir():
        raise UnfitError(
            DeviceError(
                f"{here}: has no folder {folder}; workers have to see the same files under the same names"
            )
        )
    with contextlib.chdir(folder):
        yield
