"""Progress: a bar with rate and time left on a terminal, and silence in a pipe."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from sixflow.cli.errors import say


def is_shown(quiet: bool) -> bool:
    """Tell whether progress is shown: only where somebody may be watching."""
    return not quiet and sys.stderr.isatty()


@contextlib.contextmanager
def progress(
    total: int, done: int = 0, *, title: str = "measuring", unit: str = "pairs", quiet: bool = False
) -> Iterator[Callable[[], None]]:
    """Show a bar over pairs of frames, or other things, and give the function that advances it by one.

    Parameters
    ----------
    total : int
        Number of pairs.
    done : int
        Pairs that were complete before.
    title, unit : str
        What is being done, and to what.
    quiet : bool
        Show nothing. Nor is anything shown where stderr is no terminal.
    """
    if not is_shown(quiet):
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft
    from rich.text import Text

    class Rate(ProgressColumn):
        """Things per second."""

        def render(self, task: Any) -> Text:
            return Text(f"{task.speed:.3g} {unit}/s" if task.speed else "", style="progress.data.speed")

    columns = (
        TextColumn(title),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        Rate(),
        TimeLeft(),
        TextColumn("left"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total, completed=done)
        yield lambda: bar.advance(task)


def announce_compilation(dtype: str, *, quiet: bool = False) -> None:
    """Say so if the next measurement has to compile the kernels first.

    Parameters
    ----------
    dtype : {"float32", "float64"}
        Type that the measurement computes in.
    quiet : bool
        As for `progress`.
    """
    from sixflow import measurement  # noqa: F401 - makes all kernels known
    from sixflow.engine.compiler import needs_compiling

    if is_shown(quiet) and needs_compiling(dtype):
        say("compiling kernels (first run only, up to a minute; `sixflow warm-up` does it beforehand) …")
