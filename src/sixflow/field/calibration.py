"""Calibration: what a pixel and a frame interval are worth.

It stands in the settings of a field and changes no measured number.
"""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import xarray as xr

from sixflow.errors import InputError
from sixflow.field.selection import stored_settings
from sixflow.values import A_SCALE, is_scale, plain, shown


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What a pixel and a frame are worth.

    Attributes
    ----------
    pixel_size : float
        Length of one pixel in the object, in `length_unit`.
    length_unit : str
        Unit of length, such as "mm".
    frame_interval : float
        Time between the two frames of a pair, s.
    """

    pixel_size: float
    length_unit: str
    frame_interval: float

    @classmethod
    def of(
        cls,
        field: xr.Dataset,
        *,
        pixel_size: float | None = None,
        length_unit: str | None = None,
        frame_interval: float | None = None,
    ) -> Calibration:
        """Take what is not given from the settings of the field, the interval also from its time stamps.

        Raises
        ------
        InputError
            If something is neither given nor known, or is no positive number.
        """
        stored = stored_settings(field)
        size = _positive("pixel_size", stored.get("pixel_size") if pixel_size is None else pixel_size)
        unit = _unit(stored.get("length_unit", "mm") if length_unit is None else length_unit)
        interval = known_interval(field) if frame_interval is None else frame_interval
        return cls(size, unit, _positive("frame_interval", interval))


def known_interval(field: xr.Dataset) -> float | None:
    """Time between the two frames, s: from the settings, or from even time stamps; None if unknown."""
    stored = stored_settings(field).get("frame_interval")
    if stored is not None:
        return _positive("frame_interval", stored)
    if field.sizes.get("time", 1) < 2 or field["time"].attrs.get("units") != "s":
        return None
    gaps = field["frame1"].values - field["frame0"].values
    if np.ptp(gaps) != 0:  # every pair has an interval of its own
        return None
    intervals = np.diff(field["time"].values) / np.diff(field["frame0"].values) * gaps[:-1]
    even = np.ptp(intervals) <= 0.01 * np.abs(intervals).min()
    return float(np.median(intervals)) if even else None


def calibrate(
    field: xr.Dataset,
    *,
    pixel_size: float | None = None,
    length_unit: str | None = None,
    frame_interval: float | None = None,
) -> xr.Dataset:
    """Return a copy of the field with a calibration in its settings; what is not given stays as it is."""
    settings = stored_settings(field)
    if pixel_size is not None:
        settings["pixel_size"] = _positive("pixel_size", pixel_size)
    if length_unit is not None:
        settings["length_unit"] = _unit(length_unit)
    if frame_interval is not None:
        settings["frame_interval"] = _positive("frame_interval", frame_interval)
    return field.assign_attrs(settings=json.dumps(settings))


def _positive(name: str, value: Any) -> float:
    if value is None:
        raise InputError(
            f"{name} is unknown: give {name}=..., or set it once with field.sixflow.calibrate({name}=...)"
        )
    value = plain(value)
    if not is_scale(value):
        raise InputError(f"{name}={shown(value)}: must be {A_SCALE}")
    return float(value)


def _unit(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"length_unit={shown(value)}: must name a unit, such as 'mm'")
    return value
