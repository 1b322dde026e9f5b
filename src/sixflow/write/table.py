"""Tables: a field as CSV text, one row per point and time, for spreadsheets and statistics programs.

Lines that start with ``#`` tell version, settings and the meaning of the columns; column names carry the unit, as
in ``u_px``. Standard errors (``u_se_px``) stand beside their values. Points without a value have empty cells.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.field.dataset import FLAGS

Array: TypeAlias = NDArray[Any]


def write(path: Path, parts: Iterator[xr.Dataset]) -> None:
    """Write the parts of a field, which follow each other in time, to a new file."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        is_first = True
        for part in parts:
            columns = _columns(part if "time" in part.dims else part.expand_dims("time"))
            if is_first:
                file.writelines(f"# {line}\n" for line in _comments(part, columns))
                file.write(",".join(columns) + "\n")
                is_first = False
            cells = [_text(values) for values, _ in columns.values()]
            file.writelines(",".join(row) + "\n" for row in zip(*cells, strict=True))


def _comments(field: xr.Dataset, columns: dict[str, tuple[Array, str]]) -> Iterator[str]:
    for name, value in field.attrs.items():
        text = value if isinstance(value, str) else json.dumps(value, default=str)
        yield f"{name}: {' '.join(text.splitlines())}"
    yield from (f"column {name}: {meaning}" for name, (_, meaning) in columns.items() if meaning)


def _columns(field: xr.Dataset) -> dict[str, tuple[Array, str]]:
    """Return the flattened values and the meaning of each column."""
    grid = ("time", "y", "x")
    shape = tuple(field.sizes[dim] for dim in grid)
    columns = {}
    coordinates = [name for name in ("time", "frame0", "frame1", "y", "x") if name in field.coords]
    for name in (*coordinates, *field.data_vars):
        variable = field[name]
        if set(variable.dims) <= set(grid):
            values = variable.broadcast_like(field[["y", "x", "time"]]).transpose(*grid).values
            columns[_header(str(name), variable)] = values.reshape(-1), str(
                variable.attrs.get("long_name", "")
            )
        if name in _standard_errors(field):
            error = _standard_errors(field)[str(name)].transpose(*grid).values.reshape(shape)
            columns[_header(f"{name}_se", variable)] = error.reshape(-1), f"standard error of {name}"
    return columns
