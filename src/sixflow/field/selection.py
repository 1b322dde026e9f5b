"""Pick from a field: one pair of frames, the size of its frames, the points of a kind."""

from __future__ import annotations

import dataclasses
import json
import operator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.checks import is_number, plain, shown
from sixflow.convention.reference import SHARE
from sixflow.errors import InputError
from sixflow.field.dataset import FAILING, FLAGS, SIX
from sixflow.settings import WIDEST, Settings


def require_field(field: object, name: str = "field") -> xr.Dataset:
    """Return `field` if it is a dataset with the six numbers over y and x; InputError if it is not."""
    if not isinstance(field, xr.Dataset):
        raise InputError(
            f"{name} is a {type(field).__name__}: give the xarray.Dataset that a measurement returns"
        )
    missing = [number for number in SIX if number not in field]
    if missing:
        raise InputError(
            f"{name} lacks {', '.join(missing)}: give the whole dataset that a measurement returns"
        )
    if not {"y", "x"} <= set(field["u"].dims):
        raise InputError(
            f"{name} has the dims {field['u'].dims}: y and x are needed; select with a list or slice, "
            "such as field.isel(x=[3]), which keeps the dim"
        )
    return field


def require_variable(field: xr.Dataset, name: str) -> xr.DataArray:
    """Return a variable of the field; InputError if the field has lost it."""
    if name not in field:
        raise InputError(f"the field has no variable {name!r}: use the dataset as it was measured or read")
    return field[name]


def one_pair(field: xr.Dataset, time: int) -> xr.Dataset:
    """Return the pair of frames at position `time`, dims (y, x) with both coordinates increasing.

    Raises InputError if `time` is no whole number, or there is no such pair.

    Parameters
    ----------
    field : Dataset
        With or without the dim time.
    time : int
        Position along time, from 0; negative positions count from the end.
    """
    count = field.sizes.get("time", 1)
    try:
        if isinstance(time, bool):
            raise TypeError
        position = operator.index(time)
    except TypeError:
        raise InputError(
            f"time={time!r}: must be the position of a pair, a whole number from 0 to {count - 1}"
        ) from None
    if not -count <= position < count:
        raise InputError(f"time={position}: the field has {count} pair(s), positions 0 to {count - 1}")
    pair = field.isel(time=position) if "time" in field.dims else field
    return pair.sortby(["y", "x"]).transpose("y", "x", ...)


def frame_shape(field: xr.Dataset) -> tuple[int, int]:
    """Height and width of the frames, px.

    Raises InputError if the attribute frame_shape is missing or is not two positive whole numbers.
    """
    asked = field.attrs.get("frame_shape")
    sides = [plain(side) for side in asked] if isinstance(asked, list | tuple | np.ndarray) else []
    whole = [int(side) for side in sides if is_number(side) and side == round(side) and 1 <= side <= WIDEST]
    if len(sides) != 2 or len(whole) != 2:
        raise InputError(
            f"attribute frame_shape={shown(asked)}: must be the frames' [height, width] "
            "in px; set field.attrs['frame_shape']"
        )
    return whole[0], whole[1]


def stored_settings(field: xr.Dataset) -> dict[str, Any]:
    """Return the settings in the attributes of a field; an empty mapping where there are none.

    Raises InputError if the attribute is not a JSON object, or holds a value that the setting cannot have.
    """
    text = field.attrs.get("settings", "{}")
    try:
        settings = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        settings = None
    if not isinstance(settings, dict):
        raise InputError(f"attribute settings={shown(text)}: must be a JSON object, as sixflow writes it")
    known = {field.name for field in dataclasses.fields(Settings)}
    try:
        Settings.from_mapping({name: value for name, value in settings.items() if name in known})
    except InputError as error:
        raise InputError(f"attribute settings: {error}") from None
    return settings


def reference_of(field: xr.Dataset) -> str:
    """Frame that the points of a field lie in: "first", "middle" or "second".

    Raises InputError if the settings of the field say something else.
    """
    reference = stored_settings(field).get("reference", "first")
    if reference not in SHARE:
        raise InputError(
            f"attribute settings: reference={reference!r}: must be one of {', '.join(map(repr, SHARE))}"
        )
    return str(reference)


def flagged(field: xr.Dataset, name: str) -> xr.DataArray:
    """Return where a flag is set, bool; InputError if there is no flag of this name."""
    if name not in FLAGS:
        raise InputError(f"flag {name!r}: there is no such flag; there are {', '.join(FLAGS)}")
    found = (whole_flags(field) & FLAGS[name]) != 0
    return found.rename(name).assign_attrs(long_name=f"points flagged {name}")


def whole_flags(field: xr.Dataset) -> xr.DataArray:
    """Return the flags as whole numbers.

    Raises InputError if there are none, or they have been averaged, added or filled, by which they became
    fractions or larger numbers: the bits are lost, and the covariance is none of what the numbers are now.
    """
    flag = require_variable(field, "flag")
    if flag.dtype.kind not in "iu" or (flag.dtype.kind == "u" and flag.dtype.itemsize > 2):
        raise InputError(
            f"the flags of the field are numbers of type {flag.dtype}: bits that were averaged, added or interpolated, "
            "or filled where there were none. Average by field.sixflow.mean('time'); keep the flags of a selection by "
            "field.where(condition).assign(flag=field.flag)"
        )
    return flag.astype(np.int64)


def valid(field: xr.Dataset) -> xr.DataArray:
    """Return where all six numbers stand: none is NaN, each has a variance, and no failing flag is set; bool.

    Raises InputError if the flags are no flags any more (`whole_flags`).
    """
    known = xr.ones_like(field["u"], dtype=bool)
    for name in SIX:
        known = known & field[name].notnull()
    if "flag" in field:
        known = known & ((whole_flags(field) & FAILING) == 0)
    if {"param", "param2"} <= set(getattr(field.get("covariance"), "dims", ())):
        known = known & _has_variances(field["covariance"])
    return known.rename("valid").assign_attrs(long_name="points with six measured numbers")


def _has_variances(covariance: xr.DataArray) -> xr.DataArray:
    """Whether all numbers on the diagonal are finite and not negative."""
    last = covariance.variable.transpose(..., "param", "param2")
    variances = np.diagonal(last.values, axis1=-2, axis2=-1)
    grid = covariance.isel(param=0, param2=0, drop=True).transpose(*last.dims[:-2])
    return grid.copy(data=(np.isfinite(variances) & (variances >= 0)).all(axis=-1))


def masked_and_failed(pair: xr.Dataset) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the points that were not wanted and those that could not be measured; a point is never both."""
    missing = ~valid(pair).values
    masked = flagged(pair, "masked").values if "flag" in pair else np.zeros_like(missing)
    return masked, missing & ~masked


def first_guess(field: xr.Dataset) -> xr.Dataset:
    """Return the first guess that a field was measured with, as a field of the six numbers; see the accessor."""
    if "guess" not in field:
        raise InputError(
            "guess: the field was measured without a field or a function as first guess; "
            "one in numbers stands in its settings"
        )
    guess = field["guess"].isel(time=0) if "time" in field["guess"].dims else field["guess"]
    six = {name: guess.sel(param=name, drop=True) for name in guess["param"].values.tolist()}
    return xr.Dataset(
        {name: part.assign_attrs(units="px" if name in "uv" else "1") for name, part in six.items()}
    )
