"""Do the error bars hold, and are the points given that can be measured? With the default call, on every kind of image.

    python benchmarks/honest.py                          synthetic cases; with SIXFLOW_BENCHMARKS=FOLDER public ones too
    python benchmarks/honest.py vortex piv_cai/DNS real  those whose names begin so
    python benchmarks/honest.py --limit 1                one member of every kind: quick
    python benchmarks/honest.py --window 31 --set sharpen=2 --cases

Three tables. *With truth*: words as in `honesty.measures`; every given point is counted, at borders and where
the flag is `unresolved` too, with the standard errors that `field.sixflow.standard_error` states. *Unrelated frames*:
points given by chance. *Real particle pairs*: beside plain correlation in squares of 32 px (`honesty.correlation`), of
what it can measure. Time is processor time.

docs/public.md says where the public images come from and what a folder of cases holds.
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import sixflow
from honesty.measures import HEADER, REAL_HEADER, Tally, beside_correlation, count, count_unrelated, measure
from honesty.real import real
from honesty.scenes import Maker, public, synthetic
from honesty.unrelated import unrelated
from public import VARIABLE, settings_column
from public_cases.case import CaseError
from sixflow.cli.warm_up import warm_up

console = Console(width=170)


def chosen(
    cases: Iterator[tuple[str, Maker]], wanted: list[str], limit: int | None
) -> Iterator[tuple[str, Maker]]:
    """Cases whose names begin with one of the words, at most `limit` of each kind (the name less its last part)."""
    seen: dict[str, int] = defaultdict(int)
    for name, make in cases:
        kind = name.rpartition("/")[0]
        if (not wanted or name.startswith(tuple(wanted))) and (limit is None or seen[kind] < limit):
            seen[kind] += 1
            yield name, make


def show(title: str, header: tuple[str, ...], rows: list[list[str]]) -> None:
    """Print a table, if it has rows."""
    if not rows:
        return
    table = Table(title=title, title_justify="left", title_style="bold", padding=(0, 1))
    for k, name in enumerate(header):
        table.add_column(name, justify="right" if k else "left", no_wrap=k == 0)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def with_truth(cases: Iterator[tuple[str, Maker]], options: dict[str, Any], apart: bool) -> None:
    rows: dict[str, Tally] = defaultdict(Tally)
    for name, make in cases:
        scene = make()
        count(rows[name if apart else scene.row], scene, options)
    show("With truth", HEADER, [[name, *tally.row()] for name, tally in rows.items()])


def by_chance(cases: Iterator[tuple[str, Maker]], options: dict[str, Any]) -> None:
    rows: dict[str, Any] = defaultdict(lambda: np.zeros(5))
    for _, make in cases:
        scene = make()
        rows[scene.row] = rows[scene.row] + count_unrelated(scene, options)
    cells = [
        [
            name,
            f"{n:.0f}",
            f"{1e4 * given / n:.2f}",
            f"{1e4 * clean / n:.2f}",
            f"{seconds / (pixels / 1e6):.2f}",
        ]
        for name, (n, given, clean, seconds, pixels) in rows.items()
    ]
    show("Unrelated frames", ("frames", "points", "given of 10⁴", "unflagged of 10⁴", "s/Mpx"), cells)


def _window(text: str) -> float | str:
    """A window of the command line."""
    try:
        return text if text == "auto" else float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: a number of pixels, or auto") from error


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="name", help="beginnings of the names of cases; all if none"
    )
    parser.add_argument("--window", type=_window, help="window, px, or auto; the default if not given")
    parser.add_argument("--set", dest="settings", type=settings_column, metavar="SETTINGS",
                        help="further settings, such as sharpen=2,step=4")  # fmt: skip
    parser.add_argument("--limit", type=int, help="at most so many members of each kind")
    parser.add_argument("--cases", action="store_true", help="a row for each case, none added up")
    arguments = parser.parse_args()
    options: dict[str, Any] = dict(arguments.settings[1]) if arguments.settings else {}
    if arguments.window is not None:
        options["window"] = arguments.window
    folder = os.environ.get(VARIABLE, "")
    console.print(
        f"sixflow {sixflow.__version__}, settings: {options or 'default'}; public cases: {folder or 'none'}"
    )
    try:
        of_folder = [*public(folder)] if folder else []
    except CaseError as error:
        parser.error(str(error))
    real_pairs = [*real(folder)] if folder else []
    every = [name for name, _ in (*synthetic(), *of_folder, *unrelated(), *real_pairs)]
    for name in arguments.names:
        if not any(case.startswith(name) for case in every):
            parser.error(
                f"no case begins with {name!r}; there are {', '.join(sorted({n.partition('/')[0] for n in every}))}"
            )
    warm_up(quiet=True)
    measure(dict(synthetic())["vortex/0.5/1"](), options)  # no case pays for compiling and loading

    def pick(cases: Iterator[tuple[str, Maker]]) -> Iterator[tuple[str, Maker]]:
        return chosen(cases, arguments.names, arguments.limit)

    with_truth(pick(synthetic()), options, arguments.cases)
    with_truth(pick(iter(of_folder)), options, arguments.cases)
    by_chance(pick(unrelated()), options)
    rows = [[name, *beside_correlation(make(), options)] for name, make in pick(iter(real_pairs))]
    show("Real particle pairs", REAL_HEADER, rows)


if __name__ == "__main__":
    main()
