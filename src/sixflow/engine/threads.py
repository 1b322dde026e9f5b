"""Strips of rows on a few threads: fixed strips, so that results do not depend on the number of threads.

How many threads a call may use is, in this order: the argument `threads` of the public call, which `limited` hands
down through the context; the environment variable `SIXFLOW_THREADS`; the number of processors of the process. The
calling thread is one of them, and one alone starts no other. Calls from several threads at once each keep their own
number; those of one number share its helpers.
"""

from __future__ import annotations

import contextlib
import contextvars
import operator
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from functools import cache
from typing import TypeVar

from sixflow.errors import InputError

T = TypeVar("T")

VARIABLE = "SIXFLOW_THREADS"
"""The environment variable that limits the threads of every call."""

_asked: contextvars.ContextVar[int | None] = contextvars.ContextVar("sixflow threads", default=None)


def worker_count() -> int:
    """Return how many threads a call may use here, the calling one included.

    Raises
    ------
    InputError
        If `SIXFLOW_THREADS` is no whole number of at least 1.
    """
    asked = _asked.get()
    if asked is not None:
        return asked
    text = os.environ.get(VARIABLE, "").strip()
    if text:
        return _whole(f"the environment variable {VARIABLE}", int(text) if text.isdecimal() else text)
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # not every system can tell
        return os.cpu_count() or 1


def limited(threads: int | None) -> contextvars.Context:
    """Return a context in which calls use so many threads: run them by its `run`.

    Parameters
    ----------
    threads : int or None
        At least 1, the calling thread included; None leaves it to the environment.

    Raises
    ------
    InputError
        If this, or else the environment variable, is no such number.

    Examples
    --------
    >>> limited(3).run(worker_count)
    3
    """
    context = contextvars.copy_context()
    context.run(_asked.set, worker_count() if threads is None else _whole("threads", threads))
    return context


def each_in(context: contextvars.Context, values: Iterable[T]) -> Iterator[T]:
    """Yield what an iterable yields, whose own code runs in a context, and that of whoever iterates does not."""
    iterator = iter(values)
    end = object()
    while (value := context.run(next, iterator, end)) is not end:
        yield value  # type: ignore[misc]


def _whole(name: str, value: object) -> int:
    count = 0
    if not isinstance(value, bool):
        with contextlib.suppress(TypeError):
            count = operator.index(value)  # type: ignore[arg-type]
    if count < 1:
        raise InputError(
            f"{name}={value!r}: must be a whole number of threads, at least 1; leave it out for one per processor"
        )
    return count


def over_strips(task: Callable[[int, int], None], rows: int, height: int) -> None:
    """Call `task(start, stop)` for every strip of `height` rows, on several threads; return when all are done.

    The calling thread works too, and every thread takes the next strip when it is free. A helper that has not begun
    when the last strip is taken is not waited for.
    """
    strips = [(start, min(start + height, rows)) for start in range(0, rows, height)]
    count = min(worker_count(), len(strips))
    if count < 2:
        for start, stop in strips:
            task(start, stop)
        return
    shared = _Shared(task, strips)
    helpers = _helpers(os.getpid(), worker_count() - 1)
    for _ in range(count - 1):
        helpers.begin(shared.help)
    shared.finish()


def beside(task: Callable[[], T]) -> Future[T]:
    """Begin a task that does not hold the interpreter, such as a digest, beside what the caller does next.

    One thread alone does it at once.
    """
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(task())
        except BaseException as error:
            future.set_exception(error)

    count = worker_count()
    if count < 2:
        run()
    else:
        _helpers(os.getpid(), count - 1).begin(run)
    return future


class _Shared:
    """Strips that several threads share."""

    def __init__(self, task: Callable[[int, int], None], strips: list[tuple[int, int]]) -> None:
        self._task: Callable[[int, int], None] | None = task
        self._remaining = iter(strips)  # its next() is atomic
        self._change, self._left = threading.Lock(), threading.Lock()
        self._helping, self._closed = 0, False
        self._error: BaseException | None = None

    def help(self) -> None:
        """Take strips, unless the caller has finished; an error is left for the caller to raise."""
        with self._change:
            if self._closed:
                return
            self._helping += 1
        try:
            self._work()
        except BaseException as error:
            self._error = error
        with self._change:
            self._helping -= 1
            if self._closed and not self._helping:
                self._left.release()

    def finish(self) -> None:
        """Take strips until none is left, wait for those that others have begun, and raise their error."""
        self._left.acquire()
        try:
            self._work()
        finally:
            with self._change:
                self._closed = True
                waits = self._helping > 0
            if waits:
                self._left.acquire()
            self._task = None  # the queue may hold this a little longer, which need not hold the frames
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        task = self._task
        assert task is not None
        for start, stop in self._remaining:
            task(start, stop)


class _Helpers:
    """Threads that wait for tasks; each is started when it is first needed.

    A pool of futures takes ten times as long to begin a task, which small frames would feel at every one of their
    hundred calls.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._tasks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._change = threading.Lock()
        self._threads: list[threading.Thread] = []

    def begin(self, task: Callable[[], None]) -> None:
        """Hand a task, which raises nothing, to the next thread that is free."""
        self._tasks.put(task)
        if len(self._threads) < self._size:
            with self._change:
                if len(self._threads) < self._size:
                    number = len(self._threads) + 1
                    thread = threading.Thread(target=self._serve, name=f"sixflow-{number}", daemon=True)
                    self._threads.append(thread)
                    thread.start()

    def _serve(self) -> None:
        while True:
            task = self._tasks.get()
            task()
            del task


@cache
def _helpers(process: int, size: int) -> _Helpers:
    """Those of one process and number: a forked child must not wait for its parent's threads."""
    return _Helpers(size)
