"""Interval: the time between the two frames of each pair, by which every rate of a field is divided.

A field carries it as its coordinate `interval` along time, in "s", or in "frame" where no time is known; NaN where
frames may be missing between the two. What is selected, joined or stored takes it along. Where the coordinate has been
dropped, the attribute `interval` tells it, if it is the same for all pairs of the field; otherwise rates are refused.

Fields of version 0.1, and those made by hand, have neither: theirs is the stored frame interval times the number of
frames from `frame0` to `frame1`, or that number of frames.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.checks import A_SCALE, is_scale, plain, shown
from sixflow.errors import InputError
from sixflow.field.selection import stored_settings
from sixflow.frames.times import AGREEMENT

VARIES = "varies"
"""What the attribute `interval` says of pairs that do not all have the same."""

_ROUNDING = 1e-9
"""Share of an interval that differences of times in double precision may leave, as of times of day in seconds."""


@dataclasses.dataclass(frozen=True)
class Elapsed:
    """The time between the two frames of each pair.

    Attributes
    ----------
    values : DataArray, dims (time) or ()
    unit : {"s", "frame"}
    """

    values: xr.DataArray
    unit: str

    def over(self, dims: tuple[Any, ...]) -> NDArray[np.float64]:
        """The values as an array that can be divided by one of these dims."""
        return np.asarray(self.values.variable.set_dims(dims).values, dtype=np.float64)


def elapsed(field: xr.Dataset) -> Elapsed:
    """Return the time between the two frames of each pair of a field, or of one pair.

    Raises InputError if the field had it, and has lost it.

    Examples
    --------
    >>> pairs = {"frame0": ("time", [0, 0]), "frame1": ("time", [1, 2])}
    >>> elapsed(xr.Dataset(coords=pairs)).values.values
    array([1., 2.])
    >>> elapsed(xr.Dataset(coords=pairs, attrs={"settings": '{"frame_interval": 0.04}'})).values.values
    array([0.04, 0.08])
    """
    if "interval" in field.variables:
        unit = field["interval"].attrs.get("units")
        if unit not in ("s", "frame"):
            raise InputError(f"coordinate interval: has the units {unit!r}; they must be 's' or 'frame'")
        _require_own(field)
        return Elapsed(field["interval"], unit)
    if "interval" in field.attrs or "pairs" in field.attrs:  # measured with times
        return _as_stated(str(field.attrs.get("interval", VARIES)))
    apart = frames_apart(field)
    stored = stored_settings(field).get("frame_interval")
    if stored is None:
        return Elapsed(apart, "frame")
    return Elapsed(apart * positive("frame_interval", stored), "s")


def statement(values: Any, unit: str) -> str:
    """What the attribute `interval` says of pairs.

    Examples
    --------
    >>> statement([0.04, 0.04], "s"), statement([1, 2], "frame")
    ('0.04 s', 'varies')
    """
    numbers = np.asarray(values, dtype=np.float64).ravel()
    return common([f"{float(number)!r} {unit}" for number in numbers]) if numbers.size else VARIES


def common(statements: Sequence[str]) -> str:
    """What the attribute `interval` of several fields says of all of them together, rounding apart.

    Examples
    --------
    >>> common(["0.1 s", "0.09999999999999998 s"]), common(["0.1 s", "0.1 frame"])
    ('0.1 s', 'varies')
    """
    parts = [text.partition(" ") for text in dict.fromkeys(statements)]
    if len({unit for _, _, unit in parts}) > 1 or VARIES in statements:
        return VARIES
    numbers = np.array([float(number) for number, _, _ in parts])
    alike = np.allclose(numbers, numbers[0], rtol=_ROUNDING, atol=0, equal_nan=True)
    return statements[0] if alike else VARIES


def frames_apart(field: xr.Dataset) -> xr.DataArray:
    """Number of frame intervals from the first to the second frame of each pair."""
    if field.attrs.get("pairs") != "double" and {"frame0", "frame1"} <= set(field.variables):
        return (field["frame1"] - field["frame0"]).astype(np.float64)
    like = field["frame1"] if "frame1" in field.variables else xr.DataArray(0.0)
    return xr.ones_like(like, dtype=np.float64)


def with_frame_interval(field: xr.Dataset, frame_interval: float) -> xr.Dataset:
    """Return the field with the intervals of its pairs from the time between successive frames.

    Raises InputError if it contradicts the times that the frames have.

    Parameters
    ----------
    field : Dataset
    frame_interval : float
        s, above 0. Of double frames, the time between the two frames of a pair.
    """
    known, before = elapsed(field), stored_settings(field).get("frame_interval")
    apart = frames_apart(field)
    if known.unit == "s" and not _follows(known, apart, before):
        _require_agreement(field, known, apart * frame_interval, frame_interval)
        return field
    if known.unit == "frame":
        values = xr.where(
            np.isnan(known.values), np.nan, apart if "frame1" in field.variables else known.values
        )
        values, scale = values * frame_interval, frame_interval
    else:
        scale = frame_interval / float(before or 1.0)
        values = known.values * scale
    attrs = {"long_name": "time between the two frames", "units": "s"}
    changed = {"interval": (values.dims, values.values, attrs)}
    if field.attrs.get("pairs") != "double" and bool(np.isfinite(values).all()):
        for name in ("time", "time0", "time1"):
            if name in field.variables and field[name].attrs.get("units") == known.unit:
                times = field[name]
                changed[name] = (times.dims, times.values * scale, times.attrs | {"units": "s"})
    return field.assign_coords(changed).assign_attrs(interval=statement(values, "s"))


def require_seconds(field: xr.Dataset) -> Elapsed:
    """Return the time between the two frames of each pair, s; InputError if it is unknown."""
    known = elapsed(field)
    if known.unit != "s":
        raise InputError(
            "frame_interval is unknown: no times of the frames are known; give frame_interval=..., or set it once with "
            "field.sixflow.calibrate(frame_interval=...)"
        )
    return known


def positive(name: str, value: Any) -> float:
    """Return a positive number; InputError if it is none."""
    value = plain(value)
    if not is_scale(value):
        raise InputError(f"{name}={shown(value)}: must be {A_SCALE}")
    return float(value)


def with_settings(field: xr.Dataset, **changes: Any) -> xr.Dataset:
    """Return the field with some of its stored settings changed."""
    return field.assign_attrs(settings=json.dumps(stored_settings(field) | changes))


def _require_own(field: xr.Dataset) -> None:
    """Refuse the interval of one pair in the place of all: what joining single pairs with coords="minimal" leaves."""
    several = field.sizes.get("time", 1) > 1
    if several and not any(
        "time" in field[name].dims for name in ("interval", "time1") if name in field.variables
    ):
        raise InputError(
            "coordinate interval: the pairs of the field have one for all, as they have one time1; join single pairs "
            'with xr.concat(…, coords="different")'
        )


def _as_stated(text: str) -> Elapsed:
    number, _, unit = text.partition(" ")
    try:
        return Elapsed(xr.DataArray(float(number)), unit)
    except ValueError:
        raise InputError(
            "interval: the field has lost the times of its pairs, which are not all the same; select without "
            "drop=True, or keep the coordinate 'interval'"
        ) from None


def _follows(known: Elapsed, apart: xr.DataArray, frame_interval: Any) -> bool:
    """Whether the times between frames are what a stored frame interval says, and nothing besides."""
    if frame_interval is None:
        return False
    ratio = known.values / positive("frame_interval", frame_interval)
    if ratio.ndim == 0 and apart.ndim == 0 and "frame1" not in known.values.coords:
        apart = ratio.round()  # the frames' numbers have been lost with the times
    return bool((np.isnan(ratio) | (np.abs(ratio - apart) <= 1e-6 * apart)).all())


def _require_agreement(
    field: xr.Dataset, known: Elapsed, expected: xr.DataArray, frame_interval: float
) -> None:
    apart = np.abs(known.values - expected) > AGREEMENT * expected
    if bool(apart.any()):
        value = float(known.values.values[np.asarray(apart)].ravel()[0])
        raise InputError(
            f"frame_interval={frame_interval!r}: contradicts the times of the frames, by which a pair of the field "
            f"spans {value:.6g} s; leave it out"
        )
