"""The field in physical units and, if wanted, with y up.

| name | formula | unit |
|---|---|---|
| velocity_x, velocity_y | (u, v) · pixel_size / interval | length/s |
| divergence_rate, vorticity, stretch_rate, shear_rate | last four of log(I + G) / interval | 1/s |

The interval is the pair's own, from the first of its frames to the second. The velocities are means over it, as
everywhere in velocimetry. The rates are those of the steady flow that makes the displacement gradient in this time: a
rotating body has its true angular velocity, half the vorticity, however far it turns between two frames.
"""

from __future__ import annotations

from typing import Any

import xarray as xr

from sixflow.convention import to_y_up
from sixflow.field.calibration import Calibration
from sixflow.field.dataset import SIX
from sixflow.field.derived import derive, derived_error, six

PHYSICAL_NAMES = {
    "u": "velocity_x",
    "v": "velocity_y",
    "divergence": "divergence_rate",
    "curl": "vorticity",
    "stretch": "stretch_rate",
    "shear": "shear_rate",
}
"""Names of the six in physical units."""


def to_physical(field: xr.Dataset, calibration: Calibration, *, y_up: bool = False) -> xr.Dataset:
    """Return velocities and rates with standard errors, over coordinates in units of length.

    Parameters
    ----------
    field : Dataset
        As measured, in px.
    calibration : Calibration
        What a pixel and the pairs' intervals are worth.
    y_up : bool
        Let y grow upwards: the y coordinates and the signs of v, curl and shear are turned, the order of the
        rows is kept.
    """
    size, unit = calibration.pixel_size, calibration.length_unit
    if y_up:
        field = turn_up(field)
    variables: dict[str, Any] = {}
    for name, physical in PHYSICAL_NAMES.items():
        for error in (False, True) if "covariance" in field else (False,):
            if name in ("u", "v"):
                data = derived_error(field, name) if error else field[name]
                data = data.copy(data=data.values * (size / calibration.interval.over(data.dims)))
                data = data.assign_attrs(long_name=f"velocity along {physical[-1]}", units=f"{unit}/s")
            else:
                data = (derived_error if error else derive)(field, physical)
            if error:
                data = data.assign_attrs(long_name=f"standard error of {physical}")
            variables[physical + "_standard_error" * error] = data.drop_vars(
                ["param", "param2"], errors="ignore"
            )
    if "flag" in field:
        variables["flag"] = field["flag"]
    result = xr.Dataset(variables, attrs=field.attrs)
    directions = {"x": ("to the right", 1), "y": ("upwards", -1) if y_up else ("downwards", 1)}
    return result.assign_coords(
        {
            axis: (
                axis,
                field[axis].values * (size * sign),
                field[axis].attrs | {"long_name": f"{axis}, {direction}", "units": unit},
            )
            for axis, (direction, sign) in directions.items()
        }
    )


def turn_up(field: xr.Dataset) -> xr.Dataset:
    """Return the field with the signs of v, curl, shear and their covariances for y upwards.

    Rows and coordinates stay as they are.
    """
    numbers = six(field)
    changed: dict[str, xr.DataArray] = {}
    if "covariance" in field:
        covariance = field["covariance"].transpose(*numbers.dims, "param2")
        turned, spread = to_y_up(numbers.values, covariance.values)
        changed["covariance"] = covariance.copy(data=spread)
    else:
        turned = to_y_up(numbers.values)
    for k, name in enumerate(SIX):
        changed[name] = field[name].transpose(*numbers.dims[:-1]).copy(data=turned[..., k])
    return field.assign(changed)
