"""`sixflow operators`: what the command draws, where, and what it refuses."""

from __future__ import annotations

import subprocess
import sys

import pytest

from sixflow.cli import main
from sixflow.gallery import PAGE, writing


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return an empty folder, made the current one, for a gallery of one figure at a low resolution."""
    monkeypatch.setattr(writing, "CATALOGUE", writing.CATALOGUE[3:4])
    monkeypatch.setattr(writing, "DPI", 40)
    monkeypatch.setattr(writing, "PAGE_DPI", 30)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_default_folder_and_its_lines(place, capsys):
    assert main(["operators"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    folder = place / "sixflow-operators"
    assert names(folder) == ["figure-05-x-translation.png", PAGE]
    lines = out.splitlines()
    assert lines[0] == (
        "sixflow-operators/figure-05-x-translation.png: Figure 5: Even and odd x-translation operators"
    )
    assert lines[-1] == "sixflow-operators/operators.html: all of them on one page, with captions"


def test_folder_and_format(place):
    assert main(["operators", "-o", "deep/er", "--format", "svg"]) == 0
    assert names(place / "deep" / "er") == ["figure-05-x-translation.svg", PAGE]


def test_overwrite(place, capsys):
    assert main(["operators", "--output", "x"]) == 0
    before = {path: path.stat().st_mtime_ns for path in (place / "x").iterdir()}
    assert main(["operators", "--output", "x"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(
        "sixflow: error: x: holds figure-05-x-translation.png and 1 more already; replace them with"
    )
    assert len(err.splitlines()) == 1
    assert {path: path.stat().st_mtime_ns for path in (place / "x").iterdir()} == before
    assert main(["operators", "--output", "x", "--overwrite"]) == 0
    assert all(path.stat().st_mtime_ns > time for path, time in before.items())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--format", "gif"], "png"),
        (["--output", "file"], "file: cannot be made"),
        (["--outptu", "x"], "Did you mean"),
        (["x"], "See sixflow operators --help"),
    ],
)
def test_bad_input_is_2_and_leaves_nothing(place, capsys, arguments, text):
    (place / "file").write_text("mine")
    assert main(["operators", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("sixflow: error: ")
    assert text in err
    assert names(place) == ["file"]


def test_interruption_is_130_and_leaves_nothing(place, capsys, monkeypatch):
    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(writing, "make_page", stop)
    assert main(["operators"]) == 130
    assert "the output was not written" in capsys.readouterr().err
    assert names(place) == []


def test_help_loads_nothing_heavy():
    heavy = "{'numpy', 'matplotlib', 'xarray', 'scipy', 'numba', 'sixflow.gallery'}"
    code = f"import sys; from sixflow.cli import main; main(['operators', '--help']); print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
    assert "--overwrite" in done.stdout
