"""Machine code on disk: used again only for what it was compiled from."""

import os
import subprocess
import sys

import numpy as np
import pytest

from sixflow.engine import codecache, interpolate, pixel
from sixflow.engine.codecache import CodeCache, source_digest
from sixflow.engine.compiler import _KERNELS

LEVEL = 2.0
TABLE = np.arange(3.0)


def inner(x):
    return x + LEVEL


def outer(x):
    return inner(x) + TABLE[0]


def shallow(x):
    return codecache.VERSIONS * x


def made(constant):
    def function(x):
        return constant * x

    return function


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("LEVEL", 3.0),
        ("LEVEL", 2),
        ("TABLE", np.arange(3)),
        ("TABLE", np.arange(3.0) + 1),
        ("inner", lambda x: x - LEVEL),
    ],
)
def test_what_a_kernel_calls_and_reads_counts(monkeypatch, name, value):
    before = source_digest(outer)
    assert source_digest(outer) == before
    monkeypatch.setitem(globals(), name, value)
    assert source_digest(outer) != before


def test_modules_closures_and_options_count(monkeypatch):
    before = source_digest(shallow)
    monkeypatch.setattr(codecache, "VERSIONS", 7)
    assert source_digest(shallow) != before
    assert source_digest(made(1.0)) == source_digest(made(1.0)) != source_digest(made(2.0))
    assert source_digest(inner, "fast") != source_digest(inner)


def test_vector_instructions_count(monkeypatch):
    function = getattr(interpolate._sum_row, "py_func", interpolate._sum_row)
    before = source_digest(function)
    assert source_digest(function) == before
    monkeypatch.setattr(pixel, "_FLAGS", ())
    assert source_digest(function) != before


def test_digests_are_the_same_in_every_process():
    program = (
        "import sixflow.measurement; from sixflow.engine.compiler import _KERNELS as k\n"
        "from sixflow.engine.codecache import source_digest as d; print(*(d(one.py_func) for one in k))"
    )
    import sixflow.measurement  # noqa: F401 - all kernels

    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONHASHSEED": "5"},
    )
    ours = {source_digest(one.py_func) for one in _KERNELS}
    assert set(done.stdout.split()) <= ours


PROGRAM = """
import sys; sys.path.insert(0, {folder!r})
from upper import double
from sixflow.engine.compiler import compiled_now
print(double(3.0), compiled_now())
"""
NEW_TYPES = (
    PROGRAM
    + """
import numpy as np
from sixflow.engine.compiler import kernel
assert "numba.np.arraymath" not in sys.modules
assert double(3) == 6 and isinstance(double(3), int)
@kernel
def total(x):
    return double(x.sum()) + np.linalg.det(np.eye(2))
assert total(np.ones(4)) == 9
"""
)


def run(folder, program=PROGRAM):
    cache = {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program.format(folder=str(folder))],
        capture_output=True, text=True, env=os.environ | cache,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    value, compiled = done.stdout.split()
    return float(value), int(compiled)


def test_edited_callee_in_another_file(tmp_path):
    kernel = "from sixflow.engine.compiler import kernel\n"
    lower, upper = tmp_path / "lower.py", tmp_path / "upper.py"
    lower.write_text(kernel + "@kernel\ndef twice(x):\n    return 2 * x\n")
    upper.write_text(kernel + "from lower import twice\n@kernel\ndef double(x):\n    return twice(x)\n")
    assert run(tmp_path) == (6.0, 2)
    assert run(tmp_path, NEW_TYPES) == (6.0, 0)  # the compiler is loaded late, and whole
    lower.write_text(kernel + "@kernel\ndef twice(x):\n    return 5 * x\n")
    assert run(tmp_path) == (15.0, 2)
    for file in (tmp_path / "cache").rglob("*.nb?"):
        file.write_bytes(b"damaged")
    assert run(tmp_path) == (15.0, 2)


def test_a_function_that_is_not_known_yet_loads_the_compiler(monkeypatch):
    refreshed = []
    context = type("", (), {"refresh": lambda self: refreshed.append(1)})()
    monkeypatch.setattr(codecache.CompileResultCacheImpl, "rebuild", lambda self, context, code: code)
    monkeypatch.setattr(codecache.rtsys, "initialize", lambda context: None)
    stored = object.__new__(codecache.StoredCode)
    assert stored.rebuild(context, (("Py_IncRef", "malloc"), "code")) == "code"
    assert not refreshed
    assert stored.rebuild(context, (("Py_IncRef", "none_of_this_name"), "code")) == "code"
    assert refreshed


def test_a_measurement_with_stored_code_loads_no_compiler():
    """Which loads SciPy's linear algebra, and takes longer than all else."""
    program = (
        "import sys, numpy as np, sixflow\n"
        "a = np.random.default_rng(0).normal(size=(64, 64))\n"
        "sixflow.measure(a, a * (1 + 1e-6), threads=1)\n"
        "from sixflow.engine.compiler import compiled_now\n"
        "print(compiled_now(), *{'scipy.linalg', 'numba.np.arraymath', 'matplotlib', 'zarr', 'av'} & set(sys.modules))"
    )
    run = [sys.executable, "-c", program]
    lines = [subprocess.run(run, capture_output=True, text=True).stdout for _ in range(2)]
    assert lines[1].split() == ["0"], lines


def test_where_no_folder_can_be_written_nothing_is_kept(monkeypatch):
    def nowhere(self, function):
        raise RuntimeError("no locator available")

    monkeypatch.setattr(codecache.FunctionCache, "__init__", nowhere)
    cache = CodeCache(inner, "")
    assert cache.cache_path is None
    assert cache.load_overload((), None) is None
    cache.save_overload((), None)
    assert cache.signatures() == []


def test_few_versions_are_kept(tmp_path, monkeypatch):
    cache = CodeCache(inner, "")
    cache._cache_path = str(tmp_path)
    monkeypatch.setattr(cache, "_impl", type("", (), {"filename_base": "fir.row-12.py311"}), raising=False)
    for number in range(8):
        for ending in ("nbi", "1.nbc"):
            file = tmp_path / f"fir.row-{number}.py311-{number:016x}.{ending}"
            file.touch()
            os.utime(file, (number, number))
    others = [
        "fir.row_two-12.py311-0000000000000000.nbi",
        "fir.row-12.py312-0000000000000000.nbi",
        "fir.row-12.py311.nbi",
    ]
    for name in others:
        (tmp_path / name).touch()
    cache._remove_earlier()
    kept = {name for name in os.listdir(tmp_path) if name not in others}
    assert len(kept) == 2 * codecache.VERSIONS
    assert {name.split("-")[1][0] for name in kept} == {"4", "5", "6", "7"}
    assert set(others) <= set(os.listdir(tmp_path))
