"""Tables: a field as CSV text, one row per point and time, for spreadsheets and statistics programs.

Lines that start with ``#`` tell version, settings and the meaning of the columns; column names carry the
unit, as in ``u_px``. Standard errors (``u_se_px``), of noise and bias together, and the roots of the biases
(``u_bias_px``) stand beside their values. Points without a value have empty cells.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.field.dataset import FLAGS, OF_PAIRS
from sixflow.field.uncertainty import total_covariance

Array: TypeAlias = NDArray[Any]

_GRID = ("time", "y", "x")


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
        text = value if isinstance(value, str) else json.dumps(np.asarray(value).tolist(), default=str)
        yield f"{name}: {' '.join(text.splitlines())}"
    yield from (f"column {name}: {meaning}" for name, (_, meaning) in columns.items() if meaning)


def _columns(field: xr.Dataset) -> dict[str, tuple[Array, str]]:
    """Return the values of each column, one per point and time, and its meaning."""
    columns = {}
    errors, biases = _standard_errors(field), _biases(field)
    coordinates = [name for name in (*OF_PAIRS, "y", "x") if name in field.coords]
    for name in (*coordinates, *map(str, field.data_vars)):
        variable = field[name].variable
        if set(variable.dims) <= set(_GRID):
            meaning = str(variable.attrs.get("long_name", ""))
            columns[_header(name, variable)] = _flat(variable, field), meaning
        if name in errors:
            columns[_header(f"{name}_se", variable)] = _flat(errors[name], field), f"standard error of {name}"
        if name in biases:
            meaning = f"what the window leaves out of {name}, root of the expected square"
            columns[_header(f"{name}_bias", variable)] = _flat(biases[name], field), meaning
    return columns


def _flat(variable: xr.Variable, field: xr.Dataset) -> Array:
    values: Array = variable.set_dims({dim: field.sizes[dim] for dim in _GRID}).transpose(*_GRID).values
    return _words(values.ravel()) if "flag_masks" in variable.attrs else values.ravel()


def _header(name: str, variable: xr.Variable) -> str:
    unit = variable.attrs.get("units")
    return f"{name}_{unit}" if unit else name


def _standard_errors(field: xr.Dataset) -> dict[str, xr.Variable]:
    """Return the standard errors of noise and bias together, by the name of the number."""
    if "covariance" not in field or "param" not in field.coords:
        return {}
    variable = total_covariance(field).variable
    variances = np.diagonal(variable.values, axis1=-2, axis2=-1)
    variances = np.where(variances >= 0, variances, np.nan)
    names = map(str, field["param"].values)
    return {name: xr.Variable(variable.dims[:-2], np.sqrt(variances[..., k])) for k, name in enumerate(names)}


def _biases(field: xr.Dataset) -> dict[str, xr.Variable]:
    """Return the square roots of the biases, by the name of the number."""
    if "bias" not in field or "param" not in field.coords:
        return {}
    variable = field["bias"].variable.transpose(..., "param")
    names = map(str, field["param"].values)
    roots = np.sqrt(variable.values)
    return {name: xr.Variable(variable.dims[:-1], roots[..., k]) for k, name in enumerate(names)}


def _words(flags: Array) -> Array:
    """Return the meaning of each flag, such as "border|outlier"; "ok" where none is set."""
    values, inverse = np.unique(flags, return_inverse=True)
    words = ["|".join(name for name, bit in FLAGS.items() if int(value) & bit) or "ok" for value in values]
    return np.array(words)[inverse]


def _text(values: Array) -> list[str]:
    """Return numbers with as many digits as tell them from their neighbours, nothing for NaN; words in quotes where
    they need them.
    """
    text: list[str] = values.astype(np.str_).tolist()
    if values.dtype.kind == "U":
        return ['"' + cell.replace('"', '""') + '"' if set(cell) & set(',"\r\n') else cell for cell in text]
    return ["" if cell == "nan" else cell for cell in text] if values.dtype.kind == "f" else text
