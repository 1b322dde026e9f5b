"""Averages over time, with flags and covariances that are those of a mean.

At every point the mean is taken of the pairs that are valid there, N of them; `pairs` tells how many.

The error of a pair is that of its two frames, and pairs that share a frame share its error. With the covariance
C of a pair, the part M of it that is from the moved frame's noise (`moved_covariance`; half of C where the field has
none), and R = C − M from the reference frame's, the covariance of the mean is

    (1/N²) Σ over reference frames r  n_r Σ R_i  +  (1/N²) Σ over moved frames m  n_m Σ M_i,

where n_r valid pairs have the reference frame r, and n_m the moved frame m: errors of a frame that pairs share are
taken to be the same. For pairs that share no frame this is C/N. For pairs from one first frame it tends to R, however
many there are.

A frame that is moved in one pair and reference in the next errs against itself, so that in consecutive pairs most of
the noise cancels: as long as the motion is small beside the window, the variance of their mean is nearer to C/N² than
to C/N. This is left out; the standard errors of such means are then too large, never too small.

What a window leaves out does not change from pair to pair in a steady flow, and does not average out: the bias of the
mean is the mean of the pairs' (the square of a mean is at most the mean of the squares).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.checks import shown
from sixflow.errors import InputError
from sixflow.field.dataset import SIX
from sixflow.field.selection import valid, whole_flags

Array = NDArray[Any]

_GRID = ("time", "y", "x")
_SAME = ("frame0", "frame1", "interval", "name0", "name1", "measured_from")
"""Coordinates of a pair that stand where all pairs have the same."""


def mean_over_time(field: xr.Dataset, dim: str = "time") -> xr.Dataset:
    """Return the mean field of all its pairs, dims (y, x); see `SixflowAccessor.mean`."""
    if dim != "time":
        raise InputError(
            f"dim={shown(dim)}: fields are averaged over 'time' only; of a region, sixflow.interpretation gives more "
            "than a mean, and neighbouring points share their errors"
        )
    if "time" not in field.dims or not field.sizes["time"]:
        raise InputError("the field has no dim 'time' with pairs to average: give the field of a recording")
    known = valid(field).transpose(*_GRID).values
    count = known.sum(axis=0)
    used = known / np.maximum(count, 1)
    variables: dict[str, Any] = {}
    for name in SIX:
        variables[name] = _described(field[name], _mean(field[name], used, count))
    variables |= {
        name: _described(field[name], values) for name, values in _covariances(field, known).items()
    }
    if "bias" in field:
        variables["bias"] = _described(field["bias"], _mean_bias(field["bias"], known))
    for name in ("residual", "noise", "resolution"):
        if name in field:
            squared = name == "noise"
            values = _mean(field[name] ** 2 if squared else field[name], used, count)
            variables[name] = _described(field[name], np.sqrt(values) if squared else values)
    if "flag" in field:
        variables["flag"] = (("y", "x"), _flags(field, known, count), field["flag"].attrs)
    if "body" in field:
        body = field["body"].transpose(*_GRID).values
        variables["body"] = (
            ("y", "x"),
            np.where((body == body[0]).all(axis=0), body[0], 0),
            field["body"].attrs,
        )
    variables["pairs"] = (("y", "x"), count, {"long_name": "number of pairs that the mean is of"})
    return xr.Dataset(variables, _coordinates(field), _attributes(field))


def _mean(variable: xr.DataArray, used: Array, count: Array) -> Array:
    """Mean of what is used; NaN where that is nothing."""
    values = np.where(used > 0, variable.transpose(*_GRID).values.astype(np.float64), 0.0)
    return np.where(count > 0, (values * used).sum(axis=0), np.nan).astype(variable.dtype)


def _mean_bias(bias: xr.DataArray, known: Array) -> Array:
    """Mean of the biases of the pairs that are used and have one; NaN where there is none."""
    values = bias.transpose(*_GRID, "param").values
    told = known[..., None] & ~np.isnan(values)
    count = told.sum(axis=0)
    total = np.where(told, values, 0.0).astype(np.float64).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(bias.dtype)


def _described(variable: xr.DataArray, values: Array) -> tuple[tuple[str, ...], Array, dict[str, Any]]:
    """Values of a mean with the attributes of what was averaged, and the mark of CF for a mean."""
    dims = ("y", "x", "param", "param2")[: values.ndim]  # of a bias the first three
    return dims, values, variable.attrs | {"cell_methods": "time: mean"}


def _covariances(field: xr.Dataset, known: Array) -> dict[str, Array]:
    """Covariance of the mean, and the part from the moved frames where the pairs tell it."""
    if "covariance" not in field:
        return {}
    order = (*_GRID, "param", "param2")
    whole = np.where(
        known[..., None, None], field["covariance"].transpose(*order).values.astype(np.float64), 0.0
    )
    moved = whole / 2
    if "moved_covariance" in field:
        moved = np.where(known[..., None, None], field["moved_covariance"].transpose(*order).values, 0.0)
    count = known.sum(axis=0)
    parts = []
    for part, frame in ((whole - moved, "frame0"), (moved, "frame1")):
        numbers = field[frame].values if frame in field.coords else np.zeros(len(known), dtype=np.int64)
        total = np.zeros(part.shape[1:])
        for number in np.unique(numbers):
            same = numbers == number
            total += known[same].sum(axis=0)[..., None, None] * part[same].sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            parts.append(np.where(count[..., None, None] > 0, total / (count**2)[..., None, None], np.nan))
    dtype = field["covariance"].dtype
    found = {"covariance": (parts[0] + parts[1]).astype(dtype)}
    return found | ({"moved_covariance": parts[1].astype(dtype)} if "moved_covariance" in field else {})


def _flags(field: xr.Dataset, known: Array, count: Array) -> Array:
    """Bits of the pairs that the mean is of; where there is none, those of all pairs."""
    flags = whole_flags(field).transpose(*_GRID).values
    used: Array = np.bitwise_or.reduce(np.where(known, flags, 0), axis=0)
    found: Array = np.where(count > 0, used, np.bitwise_or.reduce(flags, axis=0))
    return found.astype(field["flag"].dtype)


def _coordinates(field: xr.Dataset) -> dict[Any, Any]:
    """The grid; the mean of the times; of what tells one pair from another, what all have in common."""
    coordinates: dict[Any, Any] = {name: c for name, c in field.coords.items() if "time" not in c.dims}
    for name in _SAME:
        if name in field.coords and "time" in field[name].dims:
            values = field[name].values
            if (values == values[0]).all():
                coordinates[name] = field[name].isel(time=0, drop=True)
    time = field.coords.get("time")
    if time is not None and time.dtype.kind in "iuf":
        attrs = time.attrs | {"long_name": "mean of the times of the pairs", "cell_methods": "time: mean"}
        coordinates["time"] = ((), float(time.values.astype(np.float64).mean()), attrs)
    return coordinates


def _attributes(field: xr.Dataset) -> dict[Any, Any]:
    pairs = field.sizes["time"]
    note = f"mean of {pairs} pair{'s' * (pairs != 1)}"
    if {"frame0", "frame1"} <= set(field.coords):
        note += f", frames {int(field['frame0'].min())} to {int(field['frame1'].max())}"
    notes = [line for line in str(field.attrs.get("notes", "")).splitlines() if line]
    return field.attrs | {"notes": "\n".join([*notes, note])}
