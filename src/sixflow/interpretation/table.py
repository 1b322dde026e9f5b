"""Table: the interpretations of the pairs of a field, one after the other.

Rows are pairs, columns are the numbers of `interpret`, each with its standard error and unit.
"""

from __future__ import annotations

import collections
import re
from typing import Any

import numpy as np
import xarray as xr

from sixflow.errors import InputError, MeasurementError
from sixflow.field.calibration import calibrate
from sixflow.field.dataset import OF_PAIRS
from sixflow.field.interval import positive
from sixflow.field.selection import require_field
from sixflow.interpretation.estimate import Estimate, Interpretation
from sixflow.interpretation.interpret import interpret
from sixflow.interpretation.points import select_points
from sixflow.interpretation.region import LEAST, RegionFit
from sixflow.scenes import Camera

_SMALL = re.compile(r"(?<=[a-z])(?=[A-Z])")  # between the words of a class's name


def interpret_all(
    field: xr.Dataset,
    camera: Camera,
    region: Any = None,
    *,
    frame_interval: float | None = None,
    **known: Any,
) -> xr.Dataset:
    """Interpret every pair of a field, as a table.

    Parameters
    ----------
    field, camera, region, frame_interval
        As for `interpret`.
    **known
        The other arguments of `interpret`, which hold for all pairs; not `time`.

    Returns
    -------
    xarray.Dataset
        Dims (time). For every number a variable such as `time_to_contact.time` with its unit, and one with
        `.standard_error` appended; `region.points`; the times and frames of the pairs as coordinates. NaN where a pair
        has too few points, as with a bad frame, or does not move as a plane could; the attribute `notes` says which.
        `.to_dataframe()` makes it a table for pandas.

    Raises
    ------
    InputError
        If an argument cannot be used, or no pair has enough points.
    MeasurementError
        If no pair moves in a way that a plane could.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> made = synth.sequence(synth.Speckle(), synth.Affine.zoom(1.01, centre=(64, 64)), (128, 128), 3)
    >>> field = sixflow.measure_sequence(made.frames, frame_interval=0.04)
    >>> table = interpret_all(field, Camera(focal=400, centre=(64, 64)), (32, 32, 96, 96), heading=(0, 0, 1))
    >>> print(table["time_to_contact.time"].round().values, table["time_to_contact.time"].attrs["units"])
    [4. 4.] s
    """
    if "time" in known:
        raise InputError(f"time={known['time']!r}: all pairs are interpreted; interpret(…, time=…) takes one")
    field = require_field(field)
    if frame_interval is not None:
        field = calibrate(field, frame_interval=positive("frame_interval", frame_interval))
    if "time" not in field.dims:
        field = field.expand_dims("time")
    rows: list[dict[str, Estimate]] = []
    failures: list[tuple[int, Exception]] = []
    for time in range(field.sizes["time"]):
        try:
            rows.append(_row(interpret(field, camera, region, time=time, **known)))
        except (InputError, MeasurementError) as error:
            if isinstance(error, InputError) and _has_points(field, region, time, known):
                raise
            failures.append((time, error))
            rows.append({})
    if len(failures) == len(rows):
        raise failures[0][1]
    return _dataset(field, rows, failures)


def _has_points(field: xr.Dataset, region: Any, time: int, known: dict[str, Any]) -> bool:
    """Whether a pair has enough points for a fit, so that what was refused is an argument."""
    least = LEAST.get(known.get("coefficients", "eight"), 0)
    return select_points(field, region, time, known.get("border", False)).count >= least


def _row(found: tuple[Interpretation, ...]) -> dict[str, Estimate]:
    """All numbers of one pair as "kind.name"; of two solutions, the second is numbered."""
    row: dict[str, Estimate] = {"region.points": Estimate(getattr(found[0], "points", 0), 0.0)}
    seen: collections.Counter[str] = collections.Counter()
    for one in found:
        kind = "region" if isinstance(one, RegionFit) else _SMALL.sub("_", type(one).__name__).lower()
        seen[kind] += 1
        kind += f"_{seen[kind]}" * (seen[kind] > 1)
        row |= {f"{kind}.{name}": estimate for name, estimate in one.estimates.items()}
    return row


def _dataset(
    field: xr.Dataset, rows: list[dict[str, Estimate]], failures: list[tuple[int, Exception]]
) -> xr.Dataset:
    names = dict.fromkeys(name for row in rows for name in row)
    missing = Estimate(np.nan, np.nan)
    variables = {}
    for name in names:
        found = [row.get(name, missing) for row in rows]
        attrs = {"units": next(row[name].unit for row in rows if name in row)}
        variables[name] = "time", np.array([one.value for one in found]), attrs
        if name != "region.points":
            variables[f"{name}.standard_error"] = (
                "time",
                np.array([one.standard_error for one in found]),
                attrs,
            )
    coordinates = {
        name: field[name].expand_dims(time=field.sizes["time"]) if not field[name].dims else field[name]
        for name in OF_PAIRS
        if name in field.coords
    }
    notes = "\n".join(f"pair {time}: {error}" for time, error in failures)
    return xr.Dataset(variables, coordinates, {"notes": notes} if notes else {})
