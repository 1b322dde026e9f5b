"""Calibration: what a pixel and a frame interval are worth.

It stands in the settings of a field and in its coordinate `interval`, and changes no measured number.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import xarray as xr

from sixflow.checks import shown
from sixflow.errors import InputError
from sixflow.field.interval import Elapsed, positive, require_seconds, with_frame_interval, with_settings
from sixflow.field.selection import stored_settings


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What a pixel is worth, and the time that each pair took.

    Attributes
    ----------
    pixel_size : float
        Length of one pixel in the object, in `length_unit`.
    length_unit : str
        Unit of length, such as "mm".
    interval : Elapsed
        Time between the two frames of each pair, s.
    """

    pixel_size: float
    length_unit: str
    interval: Elapsed

    @classmethod
    def of(cls, field: xr.Dataset) -> Calibration:
        """Take it from the settings and the times of the field.

        Raises InputError if something is unknown, or is no positive number.
        """
        stored = stored_settings(field)
        size = stored.get("pixel_size")
        if size is None:
            raise InputError(
                "pixel_size is unknown: give pixel_size=..., or set it once with "
                "field.sixflow.calibrate(pixel_size=...)"
            )
        unit = _unit(stored.get("length_unit", "mm"))
        return cls(positive("pixel_size", size), unit, require_seconds(field))


def calibrate(
    field: xr.Dataset,
    *,
    pixel_size: float | None = None,
    length_unit: str | None = None,
    frame_interval: float | None = None,
) -> xr.Dataset:
    """Return a copy of the field with a calibration; what is not given stays as it is."""
    changes: dict[str, Any] = {}
    if pixel_size is not None:
        changes["pixel_size"] = positive("pixel_size", pixel_size)
    if length_unit is not None:
        changes["length_unit"] = _unit(length_unit)
    if frame_interval is not None:
        changes["frame_interval"] = positive("frame_interval", frame_interval)
        field = with_frame_interval(field, changes["frame_interval"])
    return with_settings(field, **changes)


def _unit(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"length_unit={shown(value)}: must name a unit, such as 'mm'")
    return value
