"""`sixflow demo`: a vortex with exact truth, measured, and its errors compared with what was predicted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sixflow.cli.progress import announce_compilation, progress

if TYPE_CHECKING:
    from rich.table import Table

    from sixflow.demo import DemoResult


def demo(
    *,
    output: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("sixflow-demo"),
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Measure a vortex whose six numbers are known exactly, and compare the errors with the predicted ones.

    A recording of particle images is rendered and saved as a TIFF stack, measured, and drawn.

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
        print(f"{path}  {what}")


def describe(result: DemoResult) -> str:
    """Return what was measured, in a few lines."""
    height, width = result.shape
    return (
        f"A vortex carried by a stream: {result.pairs} pairs of {width}×{height} px, {result.points:,} points, "
        f"{100 * result.valid:.1f} % valid.\n"
        f"Time per pair: {1e3 * result.seconds_per_pair:.0f} ms "
        f"({result.points / result.pairs / result.seconds_per_pair:,.0f} points/s)."
    )


def comparison(result: DemoResult) -> Table:
    """Return the errors against the exact truth beside the predicted ones, as a table."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, title="Errors against the exact truth", title_justify="left")
    table.add_column("number", style="bold")
    for heading in ("largest\ntruth", "rms\nerror", "predicted\nstd. error", "ratio", "within\n1 σ", "within\n1.96 σ"):
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
