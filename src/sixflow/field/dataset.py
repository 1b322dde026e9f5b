"""The field: layout of the `xarray.Dataset` that a measurement returns and that files hold.

| variable | dims | unit | meaning |
|---|---|---|---|
| u, v | time, y, x | px | displacement, x to the right and y down |
| divergence, curl, stretch, shear | time, y, x | 1 | the displacement gradient (`sixflow.convention`) |
| covariance | time, y, x, param, param2 | px², px, 1 | covariance of the six, in the order of `param` |
| bias | time, y, x, param | px², 1 | expected square of what the window leaves out of the six; NaN: not estimated |
| residual | time, y, x | 1 | zero-normalised residual: rms difference of the matched windows / rms contrast |
| noise | time, y, x | grey | standard deviation of one frame's noise, from the residual |
| resolution | time, y, x | px | period of a sine displacement that the point attenuates by 10 % |
| flag | time, y, x | – | CF flag_masks, `FLAGS` |
| body | time, y, x | – | number of the body in the mask, 0 where masked; where there are several, or moving masks |
| guess | time, y, x, param | px, 1 | first guess of the six, where a field or a function was given |
| moved_covariance | as covariance | as covariance | the part from the moved frame's noise; where motions are joined |
| measured_from | time | – | number of the frame compared with; where motions are joined |
| frame0, frame1 | time | – | numbers of the reference and the moved frame in the whole recording |
| name0, name1 | time | – | names of their files, where they come from several |
| time0, time1 | time | s or frame | times of the two frames |
| interval | time | s or frame | time between the two frames; NaN if unknown (`field.interval`) |

A point whose flag contains one of `FAILING` is NaN in every measured variable, unless it is `replaced`. Grid points
lie on whole pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.convention import SIX as SIX
from sixflow.convention.flags import FAILING as FAILING
from sixflow.convention.flags import FLAGS as FLAGS

_LONG_NAMES = {
    "u": ("displacement to the right (x)", "px"),
    "v": ("displacement downwards (y)", "px"),
    "divergence": ("divergence u_x + v_y", "1"),
    "curl": ("curl v_x - u_y, clockwise on the screen", "1"),
    "stretch": ("stretch u_x - v_y", "1"),
    "shear": ("engineering shear u_y + v_x", "1"),
    "residual": ("zero-normalised residual", "1"),
    "noise": ("standard deviation of one frame's noise", "grey"),
    "resolution": ("period of a sine displacement that is attenuated by 10 %", "px"),
}

OF_PAIRS = ("time", "time0", "time1", "interval", "frame0", "frame1", "name0", "name1", "measured_from")
"""Coordinates along time."""

Array: TypeAlias = NDArray[Any]


def build_field(
    *,
    six: Array,
    covariance: Array,
    residual: Array,
    noise: Array,
    resolution: Array | None = None,
    bias: Array | None = None,
    flag: Array,
    x: Array,
    y: Array,
    time: Array,
    time_unit: str,
    frame_numbers: Sequence[tuple[int, int]],
    attrs: Mapping[str, Any],
    body: Array | None = None,
    coordinates: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Assemble the dataset described in this module.

    Parameters
    ----------
    six : array, shape (time, y, x, 6)
        The six numbers in the order of `SIX`; NaN where the point failed.
    covariance : array, shape (time, y, x, 6, 6)
    residual, noise, resolution : array, shape (time, y, x)
    bias : array, shape (time, y, x, 6), optional
    flag : int array, shape (time, y, x)
        Kept as uint16; files of version 0.1 hold uint8, which reads the same.
    x, y : int arrays
        Pixel coordinates of the grid columns and rows.
    time : float array
        Time of the reference frame of each pair, in `time_unit` ("s" or "frame").
    frame_numbers : sequence of (int, int)
        Numbers of the reference and moved frame of each pair.
    attrs : mapping
        Settings, version, digest and resolution of the measurement.
    body : int array, shape (time, y, x), optional
        Number of each point's body.
    coordinates : mapping, optional
        Further coordinates along time, as xarray takes them; they go over those made here.
    """
    grid = ("time", "y", "x")
    variables: dict[str, Any] = {
        name: (grid, six[..., k], {"long_name": _LONG_NAMES[name][0], "units": _LONG_NAMES[name][1]})
        for k, name in enumerate(SIX)
    }
    variables["covariance"] = (
        (*grid, "param", "param2"),
        covariance,
        {"long_name": "covariance of the six numbers", "units": "product of the units of param and param2"},
    )
    if bias is not None:
        said = "expected square of what the window leaves out of the six numbers"
        variables["bias"] = (
            (*grid, "param"),
            bias,
            {"long_name": said, "units": "square of the unit of param"},
        )
    for name, values in (("residual", residual), ("noise", noise), ("resolution", resolution)):
        if values is None:
            continue
        variables[name] = (grid, values, {"long_name": _LONG_NAMES[name][0], "units": _LONG_NAMES[name][1]})
    variables["flag"] = (
        grid,
        np.asarray(flag, dtype=np.uint16),
        {
            "long_name": "what happened at the point; 0 is measured with a complete window",
            "flag_masks": np.array(list(FLAGS.values()), dtype=np.uint16),
            "flag_meanings": " ".join(FLAGS),
        },
    )
    if body is not None:
        variables["body"] = (grid, body, {"long_name": "number of the body in the mask, 0 where masked"})
    numbers = np.asarray(frame_numbers, dtype=np.int64).reshape(-1, 2)
    axes = {
        "time": ("time", time, {"long_name": "time of the reference frame", "units": time_unit, "axis": "T"}),
        "y": ("y", y, {"long_name": "row, downwards", "units": "px", "axis": "Y"}),
        "x": ("x", x, {"long_name": "column, to the right", "units": "px", "axis": "X"}),
        "param": ("param", np.array(SIX)),
        "param2": ("param2", np.array(SIX)),
        "frame0": ("time", numbers[:, 0], {"long_name": "number of the reference frame"}),
        "frame1": ("time", numbers[:, 1], {"long_name": "number of the moved frame"}),
    }
    return xr.Dataset(
        variables,
        axes | dict(coordinates or {}),
        {"Conventions": "CF-1.11", "title": "six-parameter optical flow field"} | dict(attrs),
    )
