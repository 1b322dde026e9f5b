"""Layout: how a field is cut into chunks, and into batches along time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from sixflow.errors import InputError
from sixflow.field.dataset import FAILING, FLAGS, SIX
from sixflow.field.selection import whole_flags


def checked_field(field: xr.Dataset) -> xr.Dataset:
    """Return the field without leftovers of the file that it may come from.

    Raises InputError if it is no dataset, holds no variable over rows and columns, or flags that are none any
    more.
    """
    if not isinstance(field, xr.Dataset):
        raise InputError(f"field: a {type(field).__name__}; give the xarray.Dataset of a measurement")
    if not any({"y", "x"} <= set(variable.dims) for variable in field.data_vars.values()):
        raise InputError(
            f"field: no variable has the dimensions y and x, "
            f"only {', '.join(map(str, field.dims)) or 'none'}; give the dataset of a measurement"
        )
    if "flag" in field:
        whole_flags(field)
    return field.drop_encoding()


def fill_value(name: str, variable: xr.Variable) -> Any:
    """Return what stands where a store has no value: NaN, failing flags, or a number that no coordinate has.

    A chunk that is missing so reads as points that failed, never as numbers. None for text.

    Examples
    --------
    >>> fill_value("u", xr.Variable("x", np.zeros(2, "f4")))
    np.float32(nan)
    """
    kind, dtype = variable.dtype.kind, variable.dtype
    if kind == "f":  # a bias that is NaN was not estimated; one that is missing may be of any size
        return dtype.type(np.inf if name == "bias" else np.nan)
    if kind not in "iu":
        return None
    most = np.iinfo(dtype).max
    if name == "flag":
        return dtype.type(FLAGS["missing"] if most >= FLAGS["missing"] else FAILING & most)
    if name == "body":
        return dtype.type(0)
    return dtype.type(most if kind == "u" else np.iinfo(dtype).min)


def incomplete_coordinates(field: xr.Dataset) -> list[str]:
    """Return the coordinates of which a part was never written, or is missing.

    Those along time besides `time` itself may be NaN: an interval that is unknown.
    """
    found = []
    for name, coordinate in field.coords.items():
        fill = "" if coordinate.dtype.kind in "UOT" else fill_value(str(name), coordinate.variable)
        values = coordinate.values
        missing = np.isnan(values) if name in field.dims and values.dtype.kind == "f" else values == fill
        if values.dtype.kind in "iufUOT" and coordinate.dims and bool(np.any(missing)):
            found.append(str(name))
    return found


def in_order(field: xr.Dataset) -> xr.Dataset:
    """Return the field with its variables in the usual order, which stores do not keep; others come last."""
    known = (*SIX, "covariance", "bias", "residual", "noise", "resolution", "flag")
    others = sorted(str(name) for name in field.data_vars if name not in known)
    return field[[name for name in known if name in field.data_vars] + others]


def chunk_shape(variable: xr.Variable, time_chunk: int, limit: int) -> tuple[int, ...]:
    """Return chunks of at most `time_chunk` pairs and about `limit` bytes, by splitting time, then rows.

    Parameters
    ----------
    variable : xarray.Variable
        Dims (time, y, x, ...) or fewer.
    time_chunk : int
        Most pairs per chunk, at least 1.
    limit : int
        Bytes aimed at. A single row of one pair may exceed it.

    Examples
    --------
    >>> import numpy as np
    >>> chunk_shape(xr.Variable(("time", "y", "x"), np.zeros((100, 50, 60), "f4")), 16, 2**20)
    (16, 50, 60)
    """
    chunks = {str(dim): max(1, size) for dim, size in variable.sizes.items()}
    if "time" in chunks:
        chunks["time"] = time_chunk
    for dim in ("time", "y"):
        if dim in chunks:
            others = math.prod(chunks.values()) // chunks[dim] * variable.dtype.itemsize
            chunks[dim] = max(1, min(chunks[dim], limit // others))
    return tuple(chunks.values())


def batches(field: xr.Dataset, pairs: int) -> Iterator[xr.Dataset]:
    """Yield parts of a field of at most `pairs` times, read into memory one after the other."""
    if "time" not in field.dims:
        yield field.load()
        return
    for start in range(0, field.sizes["time"], pairs):
        yield field.isel(time=slice(start, start + pairs)).load()
