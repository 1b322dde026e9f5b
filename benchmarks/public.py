"""Public benchmark cases, with peers in the same run: errors, flags, resolution, bias, coverage, time.

    SIXFLOW_BENCHMARKS=FOLDER python benchmarks/public.py               all cases, a few minutes on two cores
    python benchmarks/public.py piv_cai star                            cases whose names contain one of the words
    python benchmarks/public.py --no-peers --try window=21,sharpen=4    ours alone, with one more column
    python benchmarks/public.py --figures FOLDER --markdown FILE        figures, and the page of the documentation

The images are not part of the project; docs/public.md says where they come from and what a folder of cases holds.
Peers are run where they are installed (`pip install 'sixflow[benchmarks]'`).
"""

from __future__ import annotations

import argparse
import os
import tomllib
from pathlib import Path
from typing import Any

import sixflow
from cases import console
from public_cases.case import CaseError, find_cases, read_cases
from public_cases.figures import draw_figures
from public_cases.ours import BY_EXPERIMENT, COLUMNS, UNIFORM, spelled, warm_up
from public_cases.page import write_page
from public_cases.peers import installed_peers
from public_cases.run import run_case
from public_cases.tables import all_tables
from sixflow.engine.threads import worker_count

VARIABLE = "SIXFLOW_BENCHMARKS"


def settings_column(text: str) -> tuple[str, dict[str, Any]]:
    """Read "window=21,method=eigenfilter" as a column of that name.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is no list of settings, or a setting is out of range.
    """
    options: dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = part.strip().partition("=")
        if not equals:
            raise argparse.ArgumentTypeError(f"{part!r}: must be setting=value, such as window=21")
        try:
            options[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            options[name] = value
    try:
        sixflow.Settings.from_mapping(options)
    except sixflow.InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text, options


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="name", help="cases whose names contain one of these; all if none"
    )
    parser.add_argument(
        "--try", dest="tried", action="append", default=[], type=settings_column, metavar="SETTINGS",
        help="one more column of ours, such as window=21,sharpen=4; may be given again",
    )  # fmt: skip
    parser.add_argument("--no-peers", action="store_true", help="ours alone")
    parser.add_argument(
        "--figures", type=Path, metavar="FOLDER", help="draw one figure per set of cases there"
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the page of the documentation")
    arguments = parser.parse_args()
    folder = os.environ.get(VARIABLE)
    try:
        chosen = find_cases(folder, arguments.names)
        run(chosen, Path(folder or ""), arguments)
    except CaseError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


def run(chosen: list[Path], root: Path, arguments: argparse.Namespace) -> None:
    extra = dict(arguments.tried)
    peers = {} if arguments.no_peers else installed_peers()
    ours = (*COLUMNS, "by experiment", UNIFORM, *extra)
    console.print(
        f"sixflow {sixflow.__version__}, {worker_count()} processors; peers: {', '.join(peers) or 'none'}"
    )
    for name, options in BY_EXPERIMENT.items():
        console.print(f"by experiment, {name}: {spelled(options)}")
    warm_up(extra)
    results = {}
    for done, case in enumerate(read_cases(chosen, root), start=1):
        console.print(f"{done}/{len(chosen)} {case.name}")
        results[case.name] = run_case(case, peers, extra)
    tables = list(all_tables(results, ours, (*ours, *peers)))
    console.print()
    for table in tables:
        table.show()
    figures = draw_figures(results, ours, tuple(peers), arguments.figures) if arguments.figures else {}
    if arguments.markdown:
        write_page(arguments.markdown, tables, figures, arguments.figures, extra)


if __name__ == "__main__":
    main()
