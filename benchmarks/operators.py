"""The operators of the paper, measured: what was claimed, and what is found.

    python benchmarks/operators.py                      all tables, about fifteen minutes on two cores
    python benchmarks/operators.py efficiency noise     some of them
    python benchmarks/operators.py --quick              all, with fewer repetitions
    python benchmarks/operators.py --figures FOLDER     the curves as pictures, too

| table | question |
|---|---|
| own-law | does each operator alone measure its own deformation? |
| selectivity | does it keep quiet at the others? |
| efficiency | how near to the physical limit are all jointly, and are the errors honest? |
| light | does a change of light move the six? |
| noise | how do the methods go down from 40 dB to −6 dB? |
| capture | how large a motion is found? |
| karhunen | is the bank near the Karhunen–Loève basis? |
| speed | what does it cost? |
"""

from __future__ import annotations

import argparse
import importlib
import inspect
from pathlib import Path

TABLES = {
    "own-law": "own_law",
    "selectivity": "selectivity",
    "efficiency": "efficiency",
    "light": "light",
    "noise": "noise",
    "capture": "capture",
    "karhunen": "karhunen",
    "speed": "speed",
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", metavar="table", help=f"any of {', '.join(TABLES)}; all if none")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw the curves there")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.tables) - set(TABLES))
    if unknown:
        parser.error(f"no such table: {', '.join(unknown)}; there are {', '.join(TABLES)}")
    if arguments.figures is not None:
        arguments.figures.mkdir(parents=True, exist_ok=True)
    for name in arguments.tables or TABLES:
        table = importlib.import_module(f"operator_tables.{TABLES[name]}").table
        options = {"folder": arguments.figures} if "folder" in inspect.signature(table).parameters else {}
        table(quick=arguments.quick, **options)


if __name__ == "__main__":
    main()
