"""DataArray: recordings as xarray has them, with named dimensions and coordinates.

The time coordinate gives the times of the frames, the spacing of x and y the size of a pixel where their units are
lengths.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.labelled import Labelled, codes_of_names
from sixflow.frames.metadata import Metadata
from sixflow.frames.units import length, seconds_in

Array: TypeAlias = NDArray[Any]

_EVEN = 1e-3
"""Share of a step by which the steps of an even coordinate may differ."""


def is_data_array(thing: Any) -> bool:
    """Tell an xarray.DataArray, without importing xarray."""
    return all(hasattr(thing, name) for name in ("dims", "coords", "isel", "values"))


def labelled(array: Any, name: str = "frames") -> Labelled:
    """Return a DataArray as an array whose axes have letters.

    Raises InputError if rows and columns are not clear, or its times cannot be used.

    Parameters
    ----------
    array : xarray.DataArray
        Its dimensions are named, such as time, y and x, in any order.
    name : str
        For messages.
    """
    codes = codes_of_names([str(dim) for dim in array.dims], array.shape, name)
    dims = dict(zip(codes, array.dims, strict=True))
    notes: list[str] = []
    times = _times(array.coords[dims["T"]], notes) if "T" in dims and dims["T"] in array.coords else None
    names = {
        code: tuple(str(label) for label in array.coords[dims[code]].values)
        for code in "CZP"
        if code in dims and dims[code] in array.coords
    }
    return Labelled(array, codes, names, times, _metadata(array, dims, times), tuple(notes), array.chunks)


def _times(coordinate: Any, notes: list[str]) -> Array | None:
    """Times in s from a coordinate; None where it only counts."""
    values = np.asarray(coordinate.values)
    if values.dtype.kind in "mM":
        if np.isnat(values).any():
            raise InputError(
                f"{coordinate.name}: the times of the frames have gaps (NaT); give one for each frame"
            )
        return (
            (values - values[0]) / np.timedelta64(1, "s")
            if values.dtype.kind == "M"
            else values / np.timedelta64(1, "s")
        )
    if values.dtype.kind not in "iuf":
        notes.append(f"the coordinate {coordinate.name!r} holds no times: the time of the frames is unknown")
        return None
    unit = (
        str(coordinate.attrs.get("units", coordinate.attrs.get("unit", ""))).partition(" since ")[0].strip()
    )
    scale = seconds_in(unit)
    if scale is not None:
        return values * scale
    if unit:
        notes.append(f"the coordinate {coordinate.name!r} has the unit {unit!r}, which is no time")
        return None
    if np.array_equal(values, np.arange(values.size)):
        return None  # numbers of frames
    notes.append(f"the coordinate {coordinate.name!r} states no unit: it is taken for seconds")
    return values.astype(float)


def _metadata(array: Any, dims: dict[str, Any], times: Array | None) -> Metadata:
    sizes: dict[str, tuple[float, str, float]] = {}
    for code in "XY":
        if dims[code] not in array.coords:
            continue
        coordinate = array.coords[dims[code]]
        step = _step(np.asarray(coordinate.values))
        unit = length(coordinate.attrs.get("units", coordinate.attrs.get("unit")))
        if step is not None and unit is not None:
            sizes[code] = step, *unit
    if "X" not in sizes:
        return Metadata(frame_interval=_step(times) if times is not None else None)
    size, name, metres = sizes["X"]
    aspect = 1.0
    if "Y" in sizes and np.isfinite(metres) and np.isfinite(sizes["Y"][2]):
        aspect = sizes["Y"][0] * sizes["Y"][2] / (size * metres)
    return Metadata(size, name, _step(times) if times is not None else None, aspect)


def _step(values: Array) -> float | None:
    """The step of an even coordinate; None of any other."""
    if values.ndim != 1 or values.size < 2 or values.dtype.kind not in "iuf":
        return None
    steps = np.diff(values.astype(float))
    mean = float(steps.mean())
    return abs(mean) if mean and np.isfinite(mean) and np.ptp(steps) <= _EVEN * abs(mean) else None
