"""The points of a region of a field: positions, numbers, covariances, and how their errors are correlated."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.checks import numbers
from sixflow.engine.lowpass import lowpass_noise
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.spline import DEGREE, gradient_noise
from sixflow.engine.window import attenuation_period, window_sigma
from sixflow.errors import InputError
from sixflow.field.dataset import FLAGS, SIX
from sixflow.field.derived import on_first_frame
from sixflow.field.interval import elapsed
from sixflow.field.selection import (
    frame_shape,
    one_pair,
    reference_of,
    require_field,
    require_variable,
    stored_settings,
    valid,
)
from sixflow.field.uncertainty import known_bias
from sixflow.plan import SHARPEN

Array = NDArray[Any]
Region = tuple[float, float, float, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Points:
    """Points of a grid; arrays over its rows and columns.

    Attributes
    ----------
    x, y : arrays, shape (columns,), (rows,)
        px.
    used : bool array, shape (rows, columns)
    six : array, shape (rows, columns, 6)
    covariance : array, shape (rows, columns, 6, 6)
        Of the noise.
    bias : array, shape (rows, columns, 6, 6)
        Second moments of what the windows leave out; 0 where not estimated.
    period : float
        That a point attenuates by 10 %, px: the median; 0 where it is not known.
    sigma : float
        Standard deviation of the window, px.
    sharpen : int
        Sharpening passes.
    gradient_noise : float
        Power that unit noise of the frames adds to their gradients; 0 for methods other than least squares.
    region : (float, float, float, float)
        x0, y0, x1, y1, px.
    interval : float or None
        Time between the two frames, s; None if no times are known.
    frames : float
        The same in frame intervals of the recording, where no times are known; 1 otherwise.
    tally : str
        How many there are and why the others are not used, in words.
    """

    x: Array
    y: Array
    used: NDArray[np.bool_]
    six: Array
    covariance: Array
    bias: Array
    period: float
    sigma: float
    sharpen: int
    gradient_noise: float
    region: Region
    interval: float | None
    frames: float
    tally: str

    @property
    def count(self) -> int:
        """How many points are used."""
        return int(self.used.sum())


def select_points(field: xr.Dataset, region: Any, time: int, border: bool) -> Points:
    """Return the points of a region; InputError if the field or the region cannot be used.

    Parameters
    ----------
    field : Dataset
    region : (x0, y0, x1, y1) or None
        px, borders included; None for the whole frame.
    time : int
        Position of the pair along time.
    border : bool
        Also points whose window reaches beyond the frame or the mask.
    """
    whole = require_field(field)
    pair = one_pair(whole, time)
    if not isinstance(border, bool):
        raise InputError(f"border={border!r}: must be True or False")
    covariance = require_variable(pair, "covariance").transpose("y", "x", "param", "param2")
    sigma, sharpen, noise = _window(whole)
    passed = elapsed(pair)
    took = float(passed.values)
    rows, columns = frame_shape(whole)
    limits = _limits(region, rows, columns)
    inside = pair.sel(x=slice(limits[0], limits[2]), y=slice(limits[1], limits[3]))
    known = valid(inside).values
    spread = covariance.sel(x=inside.x, y=inside.y).values.astype(np.float64)
    six = np.stack([inside[name].values for name in SIX], axis=-1).astype(np.float64)
    # times count from frame 0, whatever frame the points lie in
    reference, bias = reference_of(whole), known_bias(inside)
    unresolved = np.zeros_like(spread)
    if bias is not None:
        squares = bias.transpose("y", "x", "param").values.astype(np.float64)
        unresolved = on_first_frame(six, squares[..., None] * np.eye(6), reference)[1]
    six, spread = on_first_frame(six, spread, reference)
    known &= np.isfinite(spread + unresolved).all(axis=(-1, -2))
    cut = np.zeros_like(known)
    if "flag" in inside and not border:
        cut = known & ((inside["flag"].values.astype(np.int64) & FLAGS["border"]) != 0)
    used = known & ~cut
    tally = f"{int(used.sum())} of {used.size} points of the region can be used"
    reasons = [
        f"{count} {what}"
        for count, what in ((int((~known).sum()), "failed"), (int(cut.sum()), "with a cut window"))
        if count
    ]
    tally += f" ({', '.join(reasons)})" if reasons else ""
    return Points(
        inside.x.values.astype(np.float64),
        inside.y.values.astype(np.float64),
        used,
        np.where(used[..., None], six, 0.0),
        np.where(used[..., None, None], spread, np.eye(6)),
        np.where(used[..., None, None], unresolved, 0.0),
        _period(inside, used),
        sigma,
        sharpen,
        noise,
        limits,
        took if passed.unit == "s" else None,
        1.0 if passed.unit == "s" else took,
        tally,
    )


def _period(inside: xr.Dataset, used: NDArray[np.bool_]) -> float:
    """Median of the periods that the points attenuate by 10 %; 0 where it is not known."""
    if "resolution" not in inside:
        return 0.0
    periods = inside["resolution"].transpose("y", "x").values[used]
    periods = periods[np.isfinite(periods)]
    return float(np.median(periods)) if periods.size else 0.0


def _window(field: xr.Dataset) -> tuple[float, int, float]:
    settings = stored_settings(field)
    window, sharpen = settings.get("window"), settings.get("sharpen", 0)
    if window == "auto":  # one window for all, the median
        sharpen = sharpen or SHARPEN
        window = field.attrs.get("effective_window")
        if window is None and "resolution" in field:  # of a recording whose pairs differ
            period = float(field["resolution"].median())
            window = period / attenuation_period(window_sigma(1.0), sharpen)
    if not isinstance(window, int | float) or not window > 0 or not isinstance(sharpen, int) or sharpen < 0:
        raise InputError(
            f"attribute settings: window={window!r}, sharpen={sharpen!r}; the window tells how errors are correlated; "
            "use the field as it was measured or read"
        )
    noise = 0.0
    if settings.get("method", "least_squares") == "least_squares":
        degree = DEGREE.get(str(settings.get("interpolation")), DEGREE["quintic"])
        lowpass = float(settings.get("lowpass", 0.0))
        noise = gradient_noise(degree, DERIVATIVE, lowpass=lowpass) * lowpass_noise(lowpass)
    return window_sigma(float(window)), sharpen, noise


def _limits(region: Any, rows: int, columns: int) -> Region:
    if region is None:
        return 0.0, 0.0, columns - 1.0, rows - 1.0
    x0, y0, x1, y1 = numbers("region", region, 4, "x0, y0, x1, y1 in px")
    if not (x0 < x1 and y0 < y1):
        raise InputError(f"region={region!r}: must be x0, y0, x1, y1 with x0 < x1 and y0 < y1")
    if x1 < 0 or y1 < 0 or x0 > columns - 1 or y0 > rows - 1:
        raise InputError(
            f"region={region!r}: lies outside the frame of {columns}×{rows} px; x runs from 0 to {columns - 1}, "
            f"y from 0 to {rows - 1}"
        )
    return x0, y0, x1, y1
