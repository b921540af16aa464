"""Work on many rays, cut into parts for all cores."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from tfm_cl.interrupts import check_cancelled

if TYPE_CHECKING:
    from collections.abc import Callable

CHUNK = 1 << 14
"""Number of rays that a thread traces at a time: some 6 MB, a few milliseconds."""


def in_chunks(count: int, work: Callable[[slice], None], size: int | None = None) -> None:
    """Call ``work`` for ``count`` things in chunks, on all cores: Embree and NumPy release Python's lock.

    Parameters
    ----------
    size
        Of a chunk; by default `CHUNK`.

    Raises
    ------
    CancelledError
        What the calling thread does was cancelled: chunks that were begun are completed.
    """
    size = size or CHUNK
    parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    workers = min(len(parts), _cores())
    if workers <= 1:
        for part in parts:
            check_cancelled()
            work(part)
        return
    pool = ThreadPoolExecutor(workers, thread_name_prefix="tfm-solids")
    try:
        for future in [pool.submit(work, part) for part in parts]:
            check_cancelled()
            future.result()
    finally:
        pool.shutdown(cancel_futures=True)  # when it is ended, only running chunks are completed


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
