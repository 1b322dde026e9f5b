"""Strips of rows on a pool of threads: fixed strips, so that results do not depend on the number of processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache


def worker_count() -> int:
    """Return how many processors this process may use."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not every system can tell
        return os.cpu_count() or 1


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """One pool per process: a forked child must not wait for its parent's threads."""
    return ThreadPoolExecutor(worker_count(), thread_name_prefix="sixflow")


def over_strips(task: Callable[[int, int], None], rows: int, height: int) -> None:
    """Call `task(start, stop)` for every strip of `height` rows, on all processors; return when all are done."""
    strips = [(start, min(start + height, rows)) for start in range(0, rows, height)]
    if len(strips) == 1 or worker_count() == 1:
        for start, stop in strips:
            task(start, stop)
        return
    for done in [_pool(os.getpid()).submit(task, start, stop) for start, stop in strips]:
        done.result()
