"""`sixflow demo`: a vortex with exact truth, measured, and its errors compared with what was predicted."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from sixflow.cli.flags import Output, Switch
from sixflow.cli.progress import announce_compilation, progress
from sixflow.cli.settings_flags import flag

if TYPE_CHECKING:
    from rich.table import Table

    from sixflow.demo import DemoResult


def demo(
    *,
    output: Output = Path("sixflow-demo"),
    overwrite: Switch = False,
) -> None:
    """Measure a vortex whose six numbers are known exactly, and compare the errors with the predicted ones.

    A recording is rendered and saved as a TIFF stack, measured, and drawn.

    Parameters
    ----------
    output
        Folder for frames, field and pictures; it is made if need be.
    overwrite
        Replace what an earlier demo wrote there.
    """
    from rich.console import Console

    from sixflow.demo import PAIRS, run_demo

    announce_compilation("float32")
    with progress(PAIRS) as advance:
        result = run_demo(output.expanduser(), overwrite=overwrite, progress=advance)
    console = Console(highlight=False)
    console.print(describe(result), end="\n\n")
    console.print(comparison(result), end="\n\n")
    for path, what in result.files.items():
        print(f"{path}: {what}")
    print(f"\nMeasure it again, with settings of your own:\n  {command_line(result)}")


def describe(result: DemoResult) -> str:
    """Return what was measured, in a few lines."""
    height, width = result.shape
    rate = result.points / result.pairs / result.seconds_per_pair
    return (
        f"A vortex carried by a stream: {result.pairs} pairs of {width}×{height} px\n"
        f"{result.points:,} points, {100 * result.valid:.1f} % valid, "
        f"{1e3 * result.seconds_per_pair:.0f} ms per pair ({rate:,.0f} points/s)"
    )


def command_line(result: DemoResult) -> str:
    """Return the command that measures the frames of the demo as the demo did."""
    frames = next(iter(result.files))
    changed = {
        field.name: value
        for field in dataclasses.fields(result.settings)
        if (value := getattr(result.settings, field.name)) != field.default
    }
    flags = " ".join(f"{flag(name)} {value:g}" for name, value in changed.items())
    return f"sixflow measure {shlex.quote(str(frames))} -o {shlex.quote(str(frames.with_name('other.nc')))} {flags}"


def comparison(result: DemoResult) -> Table:
    """Return the errors against the exact truth beside the predicted ones, as a table."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, title="errors against the exact truth", title_justify="left")
    table.add_column("number", style="bold")
    for heading in (
        "largest\ntruth",
        "rms\nerror",
        "predicted\nstd. error",
        "ratio",
        "within\n1 σ",
        "within\n1.96 σ",
    ):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for row in result.rows:
        table.add_row(
            row.name,
            f"{row.largest:.3g}",
            f"{row.rms_error:.2g}",
            f"{row.rms_predicted:.2g}",
            f"{row.ratio:.2f}",
            f"{100 * row.coverage_68:.0f} %",
            f"{100 * row.coverage_95:.0f} %",
            row.unit,
        )
    table.add_section()
    table.add_row("ideal", "", "", "", "1.00", "68 %", "95 %", "", style="dim")
    return table
