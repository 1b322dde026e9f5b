"""Strips of rows on a pool of threads: fixed strips, so that results do not depend on the number of processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

T = TypeVar("T")


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
    """Call `task(start, stop)` for every strip of `height` rows, on all processors; return when all are done.

    The calling thread works too, and every thread takes the next strip when it is free: one wake-up a call.
    """
    strips = [(start, min(start + height, rows)) for start in range(0, rows, height)]
    remaining = iter(strips)  # its next() is atomic

    def work() -> None:
        for start, stop in remaining:
            task(start, stop)

    helpers = min(worker_count(), len(strips)) - 1
    done = [_pool(os.getpid()).submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        wait(done)
    for future in done:
        future.result()


@cache
def _other_pool(process: int) -> ThreadPoolExecutor:
    """For tasks that last: strips must not wait behind them."""
    return ThreadPoolExecutor(2, thread_name_prefix="sixflow-beside")


def beside(task: Callable[[], T]) -> Future[T]:
    """Begin a task that does not hold the interpreter, such as a digest, beside what the caller does next."""
    return _other_pool(os.getpid()).submit(task)
