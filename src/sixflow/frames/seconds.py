"""Seconds: what counts as the times of frames, in seconds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError

Real = NDArray[np.float64]


def in_seconds(times: Any, name: str) -> tuple[Real, tuple[str, ...]]:
    """Times in seconds, growing, and what is to be said about them: dates count from the first.

    Raises InputError if they are no times, one of them is missing, or they do not grow.

    Examples
    --------
    >>> in_seconds(np.array(["2026-01-01T00:00:00.0", "2026-01-01T00:00:00.5"], "M8[ms]"), "times")
    (array([0. , 0.5]), ('times are seconds since 2026-01-01T00:00:00.000',))
    >>> in_seconds([0, 1, 1], "times")
    Traceback (most recent call last):
    sixflow.errors.InputError: times: frame 2 has 1, as frame 1 has: two frames cannot be at one time; give each its own
    """
    values = np.asarray(list(times) if isinstance(times, Iterator) else times)
    if values.ndim != 1:
        raise InputError(f"{name}: has shape {values.shape}; give one time per frame, shape (n,)")
    notes: tuple[str, ...] = ()
    if values.dtype.kind in "iuf":
        seconds = values.astype(np.float64)
    elif values.dtype.kind in "mM":
        seconds = _from_numpy(values)
        if values.dtype.kind == "M" and len(values):
            notes = (f"times are seconds since {values[0]}",)
    elif values.dtype.kind == "O":
        seconds, notes = _from_objects(values, name)
    else:
        raise _no_times(values, name)
    _require_growing(seconds, values, name)
    return seconds, notes


def _from_numpy(values: NDArray[Any]) -> Real:
    """Dates since the first of them, or durations; NaN where a value is missing."""
    unit, _ = np.datetime_data(values.dtype)
    if unit == "generic":
        return np.full(len(values), np.nan)
    if values.dtype.kind == "M":
        if unit in ("Y", "M"):
            values = values.astype("M8[D]")
        values = values - values[:1]
    elif unit in ("Y", "M"):
        return np.full(len(values), np.nan)  # no certain number of seconds
    return np.asarray(values / np.timedelta64(1, "s"), dtype=np.float64)


def _from_objects(values: NDArray[Any], name: str) -> tuple[Real, tuple[str, ...]]:
    """Python's dates, durations, and numbers of any kind."""
    notes: tuple[str, ...] = ()
    differences = list(values)
    if values.size and hasattr(values[0], "isoformat"):
        notes = (f"times are seconds since {values[0].isoformat()}",)
        try:
            differences = [value - values[0] for value in values]
        except TypeError:
            raise _no_times(values, name) from None
    seconds = []
    for value in differences:
        try:
            seconds.append(float(value.total_seconds() if hasattr(value, "total_seconds") else value))
        except (TypeError, ValueError):
            raise _no_times(values, name) from None
    return np.array(seconds), notes


def _no_times(values: NDArray[Any], name: str) -> InputError:
    kinds = ", ".join(sorted({type(value).__name__ for value in values.tolist()}))
    return InputError(
        f"{name}: holds {kinds}, such as {values.tolist()[0]!r}; give seconds, or datetime64 or timedelta64, one per "
        "frame"
    )


def _require_growing(seconds: Real, values: NDArray[Any], name: str) -> None:
    missing = np.flatnonzero(~np.isfinite(seconds))
    if missing.size:
        raise InputError(
            f"{name}: frame {missing[0]} has {values[missing[0]]}, which is no time; give a finite time for each frame"
        )
    wrong = np.flatnonzero(np.diff(seconds) <= 0)
    if not wrong.size:
        return
    k = int(wrong[0])
    if seconds[k + 1] == seconds[k]:
        raise InputError(
            f"{name}: frame {k + 1} has {values[k + 1]}, as frame {k} has: two frames cannot be at one time; "
            "give each its own"
        )
    raise InputError(
        f"{name}: frame {k + 1} has {values[k + 1]}, after {values[k]} of frame {k}: times grow from frame to frame; "
        "sort the frames by time"
    )
