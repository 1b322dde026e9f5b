"""`sixflow warm-up`: compiles what is missing, says where it is, and does nothing twice."""

import pytest
from numba.core.caching import NullCache

from sixflow import Settings
from sixflow.cli import main
from sixflow.cli.warm_up import OTHERS, PLAIN
from sixflow.engine import compiler


def test_a_second_call_has_nothing_to_do(capsys):
    for _ in range(2):
        assert main(["warm-up"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    last = out.splitlines()[-1]
    assert last.startswith("nothing to compile: all is there; machine code is kept in /")
    assert not compiler.needs_compiling()
    assert main(["warm-up", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("everything", [False, True])
def test_what_was_compiled_is_counted(monkeypatch, capsys, everything):
    counts = iter([3, 10])
    monkeypatch.setattr(compiler, "compiled_now", lambda: next(counts))
    monkeypatch.setattr("sixflow.cli.warm_up._measure", lambda everything: asked.append(everything))
    asked = []
    assert main(["warm-up", *["--all"] * everything]) == 0
    assert asked == [everything]
    assert capsys.readouterr().out.startswith("7 kernels compiled in ")


def test_where_nothing_can_be_kept(monkeypatch, capsys):
    monkeypatch.setattr(compiler, "folders", list)
    monkeypatch.setattr("sixflow.cli.warm_up._measure", lambda everything: None)
    assert main(["warm-up"]) == 0
    out, err = capsys.readouterr()
    assert out == "nothing to compile: all is there\n"
    assert "set NUMBA_CACHE_DIR" in err


def test_all_its_settings_are_settings():
    for settings in (*PLAIN, *OTHERS):
        Settings(**settings)


def test_every_kernel_that_is_compiled_is_heard_of():
    @compiler.kernel
    def twice(x):
        return 2 * x

    twice._cache = NullCache()  # what an earlier run has kept would not be compiled
    heard = []
    with compiler.watched(lambda: heard.append(1)):
        assert twice(2.0) + twice(3.0) == 10
    twice(1)
    assert len(heard) == 1
    compiler._KERNELS.pop()
