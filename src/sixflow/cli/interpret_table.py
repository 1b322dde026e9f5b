"""`sixflow interpret --all`: the results of all pairs of a field, as tables and as CSV."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sixflow.cli.errors import say
from sixflow.errors import FieldFileError

if TYPE_CHECKING:
    import xarray as xr

ERROR = ".standard_error"


def checked(path: Path, overwrite: bool) -> Path:
    """Return where a table can be written; FieldFileError if it cannot, or is no .csv file."""
    from sixflow.write import check_output

    if path.suffix.lower() != ".csv":
        raise FieldFileError(f"{path}: a table of all pairs is written as .csv; change the suffix")
    return check_output(path, overwrite)


def print_tables(table: xr.Dataset, name: str) -> None:
    """Write a table for each interpretation: a row for each pair, with its frames, their times, and the numbers.

    Parameters
    ----------
    table : Dataset
        Of `interpret_all`.
    name : str
        Of the field.
    """
    count = table.sizes["time"]
    print(f"{name}: {count} pair{'s' * (count != 1)}")
    kinds = dict.fromkeys(str(column).partition(".")[0] for column in table.data_vars)
    first = _first_columns(table)
    for kind in kinds:
        columns = [*first]
        for column in map(str, table.data_vars):
            if column.startswith(f"{kind}.") and not column.endswith(ERROR):
                columns.append([_header(table, column, kind), *_cells(table, column)])
        print(f"\n{kind.replace('_', ' ')}")
        widths = [max(map(len, column)) for column in columns]
        for row in zip(*columns, strict=True):
            print(
                "  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            )
    _say_notes(table)


def write_csv(table: xr.Dataset, path: Path, overwrite: bool) -> None:
    """Write all columns with their units, in radians, empty where there is no number."""
    from sixflow.write.target import staged_output

    columns = {}
    for name in (*table.coords, *table.data_vars):
        unit = table[name].attrs.get("units", "1")
        columns[f"{name}_{unit}" if unit != "1" else str(name)] = table[name].values.tolist()
    with staged_output(path, overwrite) as partial, partial.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        for row in zip(*columns.values(), strict=True):
            file.write(",".join(_plain(value) for value in row) + "\n")
    _say_notes(table)
    print(path)


def _first_columns(table: xr.Dataset) -> list[list[str]]:
    """The number of the pair, its frames, and when they were taken."""
    columns = [["pair", *map(str, range(table.sizes["time"]))]]
    if "frame0" in table.coords and "frame1" in table.coords:
        frames = zip(table["frame0"].values, table["frame1"].values, strict=True)
        columns.append(["frames", *(f"{first}–{second}" for first, second in frames)])
    if "time0" in table.coords and table["time0"].attrs.get("units") == "s":
        for header, name in (("from (s)", "time0"), ("to (s)", "time1")):
            columns.append([header, *(f"{time:.6g}" for time in table[name].values)])
    return columns


def _header(table: xr.Dataset, column: str, kind: str) -> str:
    name, unit = column.removeprefix(f"{kind}.").replace("_", " "), _unit(table, column)
    return name if unit == "1" else f"{name} ({unit})"


def _unit(table: xr.Dataset, column: str) -> str:
    """Angles are printed in degrees; their rates stay in radians."""
    unit = str(table[column].attrs.get("units", "1"))
    return "°" if unit == "rad" else unit


def _cells(table: xr.Dataset, column: str) -> list[str]:
    scale = math.degrees(1.0) if _unit(table, column) == "°" else 1.0
    values = (scale * table[column].values).tolist()
    if column + ERROR not in table:
        return ["" if math.isnan(value) else f"{value:g}" for value in values]
    errors = (scale * table[column + ERROR].values).tolist()
    return [_written(value, error) for value, error in zip(values, errors, strict=True)]


def _written(value: float, error: float) -> str:
    """A number with its error, to the digits that the error leaves."""
    if math.isnan(value) and math.isnan(error):
        return "–"
    if math.isinf(value):
        return "unbounded"
    if not (math.isfinite(value) and math.isfinite(error)):
        return "undetermined"
    if error == 0:
        return f"{value:.4g}"
    digits = 1 - math.floor(math.log10(error))
    if not 0 <= digits <= 12:
        return f"{value:.4g} ± {error:.2g}"
    return f"{round(value, digits) + 0.0:.{digits}f} ± {error:.{digits}f}"


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\r\n') else text


def _say_notes(table: xr.Dataset) -> None:
    for note in str(table.attrs.get("notes", "")).splitlines():
        say(f"note: {note}")
