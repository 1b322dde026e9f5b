"""Threads: as many as are asked for, never more, and the same numbers with any."""

import multiprocessing
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from xarray.testing import assert_identical

from measured import SMALL, ideal
from sixflow import InputError, iterate_sequence, measure, measure_sequence
from sixflow.engine import threads


@pytest.fixture
def begun(monkeypatch):
    """Names of the threads that are started from here on; those that wait for work already are not used."""
    names = []
    start = threading.Thread.start

    def counted(self):
        names.append(self.name)
        start(self)

    monkeypatch.setattr(threading.Thread, "start", counted)
    threads._helpers.cache_clear()
    return names


@pytest.fixture(autouse=True)
def no_limit(monkeypatch):
    monkeypatch.delenv(threads.VARIABLE, raising=False)


@pytest.fixture(scope="module")
def made():
    return ideal("speckle", size=160, six=SMALL)


EIGENFILTER = {"method": "eigenfilter", "step": 20}


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"lighting": "gain+offset", "sharpen": 1},
        {"lighting": "local", "step": 3},
        EIGENFILTER,
        EIGENFILTER | {"lighting": "gain+offset", "sharpen": 1},
    ],
)
def test_the_same_bits_with_any_number(made, options):
    one, two, three = (measure(made.frame0, made.frame1, threads=n, **options) for n in (1, 2, 3))
    assert_identical(one, two)
    assert_identical(one, three)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_never_more_than_asked_for(made, begun, count):
    frames = [made.frame0, made.frame1, made.frame0]
    measure(made.frame0, made.frame1, threads=count)
    measure_sequence(frames, threads=count)
    list(iterate_sequence(frames, threads=np.int64(count)))
    assert len(begun) == count - 1


def test_the_environment_and_who_wins(made, begun, monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, "1")
    assert threads.worker_count() == 1
    measure(made.frame0, made.frame1)
    assert begun == []
    assert threads.limited(3).run(threads.worker_count) == 3
    monkeypatch.setenv(threads.VARIABLE, "")
    assert threads.worker_count() >= 1


@pytest.mark.parametrize("count", [0, -1, 1.5, "2", True])
def test_numbers_that_are_none(made, count):
    with pytest.raises(InputError, match=r"threads=.*: must be a whole number of threads, at least 1"):
        measure(made.frame0, made.frame1, threads=count)
    with pytest.raises(InputError, match="threads="):
        next(iterate_sequence([made.frame0, made.frame1], threads=count))


@pytest.mark.parametrize("text", ["0", "many", "1.5"])
def test_an_environment_that_is_none(made, monkeypatch, text):
    monkeypatch.setenv(threads.VARIABLE, text)
    with pytest.raises(InputError, match=f"SIXFLOW_THREADS='?{text}'?: must be a whole number"):
        measure_sequence([made.frame0, made.frame1])
    measure(made.frame0, made.frame1, threads=1)


def test_a_number_ends_with_its_call(made):
    before = threads.worker_count()
    fields = iterate_sequence([made.frame0, made.frame1, made.frame0], threads=before + 1)
    next(fields)
    assert threads.worker_count() == before
    next(fields)
    assert threads.worker_count() == before


def test_calls_at_once_keep_their_numbers(made):
    """Each call hands its number down, and nobody else's."""
    alone = measure(made.frame0, made.frame1, threads=1)
    together = threading.Barrier(3)

    def call(count):
        together.wait()
        seen = {threads.limited(count).run(threads.worker_count) for _ in range(100)}
        return seen, measure(made.frame0, made.frame1, threads=count)

    with ThreadPoolExecutor(3) as pool:
        for count, (seen, field) in zip((1, 2, 3), pool.map(call, (1, 2, 3)), strict=True):
            assert seen == {count}
            assert_identical(field, alone)


def test_strips_of_calls_at_once():
    """Calls that share their helpers get all of their own strips, and only those."""

    def call(number):
        taken = np.zeros(200, int)
        for _ in range(50):
            threads.over_strips(lambda a, b: taken.__setitem__(slice(a, b), taken[a:b] + number), 200, 3)
        return taken

    def limited_call(number):
        return threads.limited(2).run(call, number)

    with ThreadPoolExecutor(4) as pool:
        for number, taken in enumerate(pool.map(limited_call, range(1, 9)), start=1):
            assert_array_equal(taken, 50 * number)


def test_beside_hands_on_what_it_returns_and_raises():
    for count in (1, 2):
        run = threads.limited(count).run
        assert run(threads.beside, lambda: 7).result() == 7
        with pytest.raises(ZeroDivisionError):
            run(threads.beside, lambda: 1 / 0).result()


def test_what_a_helper_raises_is_raised():
    caller, begun = threading.get_ident(), threading.Event()

    def task(start, stop):
        if threading.get_ident() != caller:
            begun.set()
            raise ValueError("of a helper")
        begun.wait(10)

    with pytest.raises(ValueError, match="of a helper"):
        threads.limited(2).run(threads.over_strips, task, 20, 1)


def _in_child(frames, connection):
    connection.send(measure(*frames, threads=2).u.values)
    connection.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")  # this is what is tested
def test_a_forked_process_has_helpers_of_its_own(made):
    frames = made.frame0, made.frame1
    field = measure(*frames, threads=2)
    receiver, sender = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_in_child, args=(frames, sender))
    child.start()
    assert receiver.poll(60)
    assert_array_equal(receiver.recv(), field.u.values)
    child.join(10)
    assert child.exitcode == 0
