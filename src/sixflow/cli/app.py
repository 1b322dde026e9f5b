"""The program `sixflow`: its commands, and the way from an error to an exit code."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from cyclopts import App

from sixflow.cli.demo import demo
from sixflow.cli.errors import report
from sixflow.cli.info import info
from sixflow.cli.measure import measure
from sixflow.cli.plot import plot

EXAMPLES = {
    "sixflow": (
        "sixflow measure A.tif B.tif -o field.nc",
        "sixflow plot field.nc -o field.png --frame A.tif",
        "sixflow demo",
    ),
    "measure": (
        "sixflow measure A.tif B.tif -o field.nc --window 31 --step 8 --plot field.png",
        "sixflow measure recording.mp4 -o field.zarr --settings settings.toml --mask mask.png",
        "sixflow measure recording.mp4 -o field.zarr --settings settings.toml --mask mask.png --resume",
        "sixflow measure 'run/A_*.tif' -o field.nc --pairs first --lighting gain+offset",
    ),
    "plot": (
        "sixflow plot field.nc -o field.png --frame A.tif",
        "sixflow plot field.zarr -o field.pdf --time 12 --units physical --pixel-size 0.05 --frame-interval 0.001",
    ),
    "info": ("sixflow info recording.mp4", "sixflow info field.nc"),
    "demo": ("sixflow demo", "sixflow demo --output /tmp/vortex --overwrite"),
}
"""Command lines that can be copied; each is shown by the `--help` of its command."""


def build_app() -> App:
    """Return the program with all its commands."""
    app = App(
        name="sixflow",
        help=(
            "Optical flow as a field of six numbers per point, each with its uncertainty: "
            "displacement (u, v), divergence, curl, stretch and shear."
        ),
        help_epilogue=_epilogue("sixflow"),
        version=_version,
        suppress_keyboard_interrupt=False,
    )
    for command in (measure, plot, info, demo):
        app.command(command, help_epilogue=_epilogue(command.__name__))
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program, and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows `sixflow` on the command line; `sys.argv[1:]` if not given.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    _forgive_encoding()
    try:
        build_app()(
            [argument for argument in given if argument != "--debug"],
            exit_on_error=False,
            print_error=False,
            result_action="return_value",
        )
        sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        return report(error, debug)
    return 0


def _version() -> str:
    from sixflow.version import __version__

    return __version__


def _epilogue(command: str) -> str:
    lines = "\n\n".join(f"  {line}" for line in EXAMPLES[command])
    return f"Examples:\n\n{lines}\n\n--debug shows the traceback of an error."


def _forgive_encoding() -> None:
    """Let a terminal that lacks a character show '?' in its place."""
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="replace")
