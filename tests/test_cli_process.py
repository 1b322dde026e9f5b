"""The command line as a process of its own: pipes, terminals, Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
import tifffile
import xarray as xr

from sixflow.cli import main
from sixflow.cli.progress import is_shown, progress
from sixflow.engine.compiler import needs_compiling
from test_cli import QUICK, load, make_frames, place  # noqa: F401

SIXFLOW = [sys.executable, "-W", "error", "-c", "import sys; from sixflow.cli import main; sys.exit(main())"]
INSTALLED = [os.path.join(os.path.dirname(sys.executable), "sixflow")]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and terminals of POSIX")


def run(*arguments):
    return subprocess.run([*SIXFLOW, *arguments], capture_output=True, text=True, timeout=100)


def test_pipe_shows_no_progress(place):  # noqa: F811
    done = run("measure", "recording.tif", "-o", "field.nc", *QUICK)
    assert done.returncode == 0
    assert done.stderr == ""
    assert done.stdout.startswith("field.nc: 3 pairs, 48 points")
    assert "\x1b" not in done.stdout


def test_exit_code_reaches_the_shell(place):  # noqa: F811
    done = subprocess.run([*INSTALLED, "info", "none.tif"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("sixflow: error: none.tif: no such file")


def test_reader_that_closes_the_pipe_is_no_error(place):  # noqa: F811
    process = subprocess.Popen(
        [*SIXFLOW, "info", "recording.tif"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()
    process.wait()


def on_terminal(*arguments):
    """Run with a terminal for stderr, and return what it showed."""
    import pty

    parent, child = pty.openpty()
    process = subprocess.Popen([*SIXFLOW, *arguments], stdout=subprocess.DEVNULL, stderr=child)
    os.close(child)
    shown = b""
    try:
        while data := os.read(parent, 65536):
            shown += data
    except OSError:  # how Linux tells the end
        pass
    os.close(parent)
    assert process.wait() == 0
    return shown.decode()


def test_terminal_shows_progress(place, monkeypatch):  # noqa: F811
    monkeypatch.setenv("TERM", "xterm")
    tifffile.imwrite("long.tif", make_frames(12), photometric="minisblack")
    shown = on_terminal("measure", "long.tif", "-o", "field.nc", *QUICK)
    assert "11/11" in shown
    assert "pairs/s" in shown
    assert "left" in shown


def test_quiet_shows_no_progress(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert is_shown(quiet=False)
    assert not is_shown(quiet=True)
    with progress(3, quiet=True) as advance:
        advance()
    assert capsys.readouterr().err == ""


def heed_interrupts():
    """What a shell does not give to its background jobs, these tests among them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def start(*arguments):
    """Start a recording, and return its process once the first pairs are safe."""
    process = subprocess.Popen(
        [*SIXFLOW, "measure", "long.tif", "-o", "field.nc", *QUICK, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    for _ in range(5000):
        if os.path.exists("field.nc.partial/progress.json") or process.poll() is not None:
            return process
        time.sleep(0.01)
    raise TimeoutError


def test_interrupted_recording_goes_on(place, capsys):  # noqa: F811
    tifffile.imwrite("long.tif", make_frames(60), photometric="minisblack")
    process = start()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    first, second = err.splitlines()
    assert first == "sixflow: interrupted"
    assert "pairs are complete in field.nc.partial; continue with" in second
    assert "--resume" in second
    assert not os.path.exists("field.nc")

    command = ["measure", "long.tif", "-o", "field.nc", *QUICK]
    assert main(command) == 2
    assert "unfinished recording; continue it with" in capsys.readouterr().err
    assert main([*command, "--resume", "--sharpen", "1"]) == 2
    assert "the recording began with settings" in capsys.readouterr().err
    assert main(["measure", "A.tif", "B.tif", "-o", "field.nc", "--resume", *QUICK]) == 2
    assert "the recording began with frames" in capsys.readouterr().err

    assert main([*command, "--resume"]) == 0
    out = capsys.readouterr().out
    assert "field.nc: 59 pairs, " in out
    assert " of them now, " in out
    assert main(["measure", "long.tif", "-o", "whole.nc", *QUICK]) == 0
    xr.testing.assert_identical(load("field.nc"), load("whole.nc"))
    assert not os.path.exists("field.nc.partial")


def test_interruption_before_the_first_batch_leaves_nothing(place):  # noqa: F811
    code = (
        "import sixflow.measurement as m; from sixflow.cli import main; import sys\n"
        "def stop(*a, **k):\n    raise KeyboardInterrupt\n"
        "m.iterate_sequence = stop\nsys.exit(main(['measure', 'recording.tif', '-o', 'field.nc']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "sixflow: interrupted; the output was not written\n"
    assert sorted(os.listdir()) == ["A.tif", "B.tif", "recording.tif"]


# Compiling


def test_first_run_needs_compiling(tmp_path):
    code = (
        "import sys\nfrom sixflow.cli.progress import announce_compilation\n"
        "sys.stderr.isatty = lambda: True\nannounce_compilation('float32')\n"
        "from sixflow.engine.compiler import needs_compiling\n"
        "print(needs_compiling('float32'), needs_compiling('float64'))"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.stdout == "True True\n"
    assert done.stderr == (
        "sixflow: compiling kernels (first run only, up to a minute; `sixflow warm-up` does it beforehand) …\n"
    )


@pytest.mark.parametrize("float64", [False, True])
def test_later_runs_do_not(float64):
    from sixflow import measure

    measure(*make_frames(2), window=21, step=16, float64=float64)
    assert not needs_compiling("float64" if float64 else "float32")


@pytest.mark.parametrize("closing", [">&-", ">&- 2>&-", "2>&-", "| true", "2>&1 | true", "> /dev/full"])
def test_commands_without_streams(place, closing):  # noqa: F811
    """Streams that are closed, that nobody reads, or that take no more: no traceback, whatever the command."""
    program = f"{sys.executable} -W error -c 'import sys; from sixflow.cli import main; sys.exit(main())'"
    for command in ("info recording.tif", "--help"):
        done = subprocess.run(
            f"({program} {command} {closing})",
            shell=True,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        assert "Traceback" not in done.stderr
        assert "Exception ignored" not in done.stderr
        assert bool(done.stderr) == ("full" in closing)
        assert done.returncode == ("full" in closing)


def test_program_without_standard_streams(place, monkeypatch):  # noqa: F811
    closed = open(os.devnull, "w")  # noqa: SIM115 - closed at once
    closed.close()
    for stream in (None, closed):
        with monkeypatch.context() as patch:
            for name in ("stdout", "stderr"):
                patch.setattr(sys, name, stream)
            codes = main(["info", "recording.tif"]), main(["info", "none.tif"])
            unchanged = sys.stdout is stream
        assert codes == (0, 2)
        assert unchanged


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_output_in_other_alphabets(place, encoding):  # noqa: F811
    done = subprocess.run(
        [*SIXFLOW, "info", "recording.tif"],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": f"{encoding}:strict"},
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"px" in done.stdout.decode(encoding).encode()
