"""The program `sixflow`: its commands, and the way from an error to an exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from cyclopts import App

from sixflow.cli.demo import demo
from sixflow.cli.errors import FAILED, report
from sixflow.cli.info import info
from sixflow.cli.interpret import interpret
from sixflow.cli.measure import measure
from sixflow.cli.operators import operators
from sixflow.cli.plot import plot
from sixflow.cli.streams import flushed, usable_streams
from sixflow.cli.warm_up import warm_up

USAGE = {
    "measure": "sixflow measure FRAMES... -o FIELD [OPTIONS]",
    "plot": "sixflow plot FIELD -o PICTURE [OPTIONS]",
    "info": "sixflow info FILE",
    "interpret": "sixflow interpret FIELD --focal PX [OPTIONS]",
    "demo": "sixflow demo [OPTIONS]",
    "operators": "sixflow operators [OPTIONS]",
    "warm-up": "sixflow warm-up [OPTIONS]",
}

EXAMPLES = {
    "sixflow": """
  sixflow demo
  sixflow measure A.tif B.tif -o field.nc
  sixflow plot field.nc -o field.png --frame A.tif
""",
    "measure": """
  sixflow measure A.tif B.tif -o field.nc --window 41 --plot field.png
  sixflow measure recording.mp4 -o field.zarr --mask mask.png
  sixflow measure recording.mp4 -o field.zarr --mask mask.png --resume
  sixflow measure 'run/A_*.tif' -o field.nc --settings settings.toml
  sixflow measure run -o field.nc --pairs first --lighting gain+offset
""",
    "plot": """
  sixflow plot field.nc -o field.png --frame A.tif
  sixflow plot field.zarr -o field.pdf --frame recording.mp4 --time 12
  sixflow plot field.nc -o rates.png --units physical --y-up \\
      --pixel-size 0.05 --frame-interval 0.001
""",
    "info": """
  sixflow info recording.mp4
  sixflow info field.nc
""",
    "interpret": """
  sixflow interpret field.nc --focal 800
  sixflow interpret field.nc --focal 800 --region 40,40,280,200 \\
      --heading 0,0,1 --frame-interval 0.04
  sixflow interpret field.zarr --focal 800 --time 12 --height 30
  sixflow interpret field.zarr --focal 800 -o contact.csv
""",
    "demo": """
  sixflow demo
  sixflow demo --output vortex --overwrite
""",
    "warm-up": """
  sixflow warm-up
  sixflow warm-up --all
""",
    "operators": """
  sixflow operators
  sixflow operators --output gallery --format pdf
""",
}
"""Command lines that can be copied, short enough not to be wrapped; each `--help` shows its own."""


def build_app() -> App:
    """Return the program with all its commands."""
    app = App(
        name="sixflow",
        help=(
            "Optical flow as a field of six numbers per point, each with its uncertainty: "
            "displacement (u, v), divergence, curl, stretch and shear."
        ),
        help_epilogue=_epilogue("sixflow"),
        help_format="plaintext",
        version=_version,
        suppress_keyboard_interrupt=False,
    )
    commands: tuple[Callable[..., int | None], ...] = (
        measure,
        plot,
        info,
        interpret,
        demo,
        operators,
        warm_up,
    )
    for place, command in enumerate(commands):
        name = command.__name__.replace("_", "-")
        app.command(
            command, name=name, help_epilogue=_epilogue(name), usage=f"Usage: {USAGE[name]}", sort_key=place
        )
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program, and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows `sixflow` on the command line; `sys.argv[1:]` if not given.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    with usable_streams():
        code = _run([argument for argument in given if argument != "--debug"], "--debug" in given)
        broken = flushed(sys.stdout)
        if code == 0 and broken is not None:
            code = report(broken)
        flushed(sys.stderr)
    return code


def _run(arguments: list[str], debug: bool) -> int:
    try:
        code = build_app()(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except SystemExit as end:  # by which rich ends where nobody reads its output
        return end.code if isinstance(end.code, int) else FAILED
    except (Exception, KeyboardInterrupt) as error:
        return report(error, debug)
    return code if isinstance(code, int) else 0


def _version() -> str:
    from sixflow.version import __version__

    return __version__


def _epilogue(command: str) -> str:
    return f"Examples:\n{EXAMPLES[command]}\n--debug, with any command, shows the traceback of an error."
