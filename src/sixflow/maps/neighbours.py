"""Neighbours: what the maps around a point predict for it.

*Outliers.* The normalised median test of Westerweel and Scarano (2005), extended to affine maps: neighbour n predicts
d_n + G_n(p − n) at the point p, so that a deforming field is no outlier. With the median m of the predictions and the
median ρ of their distances from it, a point is an outlier if

    |d − m| > limit · (ρ + floor)

in u or in v. Neighbours are taken half a window away, where windows begin to see other pixels.

*Filling.* A point without a map takes the mean of its neighbours' predictions, from the edge of each gap inwards.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.neighbours import AGREEMENT, LIMIT, curvature_strip, fill_ring, median_test_strip
from sixflow.engine.threads import over_strips

CURVED = 1.4
"""Times what a curved field makes neighbours mispredict is no contradiction."""
TYPICAL_SHARE = 0.98
_STRIP = 16


def median_outliers(
    maps: NDArray[Any], step: int, window: float, floor: NDArray[Any] | float = AGREEMENT
) -> NDArray[np.bool_]:
    """Find points that contradict their neighbours.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; NaN at failed points, which are neither tested nor asked.
    step : int
        Grid spacing, px.
    window : float
        px; sets how far away the neighbours are asked.
    floor : float or array, shape (rows, columns)
        Tolerance that noise alone deserves, px.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    rows, columns = maps.shape[1:]
    outlier = np.zeros((rows, columns), dtype=np.bool_)
    reach = min(max(1, round(window / 2 / step)), max(1, (min(rows, columns) - 1) // 2))
    levels = np.broadcast_to(np.asarray(floor, dtype=np.float64), outlier.shape).copy()
    over_strips(lambda a, b: median_test_strip(maps, step, reach, levels, a, b, outlier), rows, 16)
    return outlier


def fill_failed(maps: NDArray[Any], step: int) -> NDArray[Any]:
    """Give every failed (NaN) point the mean of its neighbours' affine maps, from the edge of each gap
    inwards.

    For the blend alone, which needs a map everywhere: a failed point is NaN in the result all the same.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    step : int
        Grid spacing, px.

    Returns
    -------
    array of the same shape without NaN; zero motion if nothing is known anywhere
    """
    failed = np.isnan(maps).any(axis=0)
    if not failed.any():
        return maps
    if failed.all():
        return np.zeros_like(maps)
    filled, known = np.where(failed, 0, maps), ~failed
    usual = _usual_gradient(maps, known)
    while not known.all():
        fill_ring(filled, known, step, usual)
    return filled


def _usual_gradient(maps: NDArray[Any], known: NDArray[np.bool_]) -> NDArray[Any]:
    """Median of u_x, u_y, v_x, v_y over the known points, or over a few thousand of them."""
    stride = max(1, math.isqrt(known.size // 2048))
    some = known[::stride, ::stride]
    if not some.any():
        return np.median(maps[2:, known], axis=1)
    return np.median(maps[2:, ::stride, ::stride][:, some], axis=1)


def settle(maps: NDArray[Any], step: int, window: float, *, curved: bool = False) -> NDArray[Any]:
    """Replace points that failed or contradict their neighbours by what the neighbours predict.

    With `curved` what a curved field makes them mispredict is no contradiction: for maps that have nearly settled.
    """
    floor = AGREEMENT + CURVED / LIMIT * curvature(maps, step, window) if curved else AGREEMENT
    outlier = median_outliers(maps, step, window, floor)
    if outlier.any():
        maps = np.where(outlier, np.nan, maps)
    return fill_failed(maps, step)


def typical(left: NDArray[Any], share: float = TYPICAL_SHARE) -> float:
    """What a share of the points does not exceed."""
    known = left[np.isfinite(left)]
    if not known.size:
        return np.inf
    place = share * (known.size - 1)
    first = min(int(place), max(known.size - 2, 0))
    known.partition([first, min(first + 1, known.size - 1)])
    low, high = float(known[first]), float(known[min(first + 1, known.size - 1)])
    return low + (place - first) * (high - low)


def curvature(maps: NDArray[Any], step: int, window: float) -> NDArray[np.float64]:
    """By how much neighbours half a window away mispredict a point because the field is curved, px.

    Their maps miss ½h² d''. The gradients of opposite neighbours differ by 2h d'': this is a quarter of h times
    their difference, the largest over components and four directions.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    step : int
        Grid spacing, px.
    window : float
        px; neighbours are half of it away.

    Returns
    -------
    array, shape (rows, columns), 0 where nothing could be asked
    """
    reach, most = max(1, round(window / 2 / step)), np.zeros(maps.shape[1:])
    over_strips(lambda a, b: curvature_strip(maps, reach, step, a, b, most), maps.shape[1], _STRIP)
    return most
