"""Consistency: does the map of a point go on into those of its neighbours, or does something end in between?

*Edge.* Two neighbours on opposite sides of a point p, at a distance h, each predict the displacement there, d + G(p −
n). In a smooth field the predictions agree; across a motion edge, and over a structure that is not resolved, they do
not. For d = A sin kx, with the gradient A k, they differ by up to S(kh) h A k, S(q) = 2 (sin q − q cos q)/q ≈ ⅔ q².
The distance is the one at which q = 0.8 for the period that is attenuated by 10 %: half a window, less with
sharpening, at least one step. There S = 0.4; a jump seen through the window makes 0.9. What exceeds

    z standard errors + floor + 1.5 S(kh) h · (largest gradient of the three, in that direction)

lies across an edge. Four directions are asked: along x, along y, and the diagonals; z is `normal_limit` of these
questions.

A motion that is smooth but finer than the window exceeds it too. It leaves a residual everywhere in the window, a
motion edge one in the pixels of the other motion, which `engine.weigh` has found outlying. So an edge is a
disagreement E (in units of the above) together with a share φ of outlying pixels above the frame's median: E > 1 and φ
> 0.03, or E > 0.5 and φ > 0.15, or E > 0.3 with most pixels about the point itself outlying (φ > 0.5 in a window of
half the size: the map is that of the surroundings). E > 1 alone is a motion that is not resolved.

*Residual.* A window stands out where both its residual and its residual over its contrast are more than 3 times the
median of those one window away: neither brighter light nor lower contrast explains it. Below 0.1 of
the contrast it never does.

*Gradients.* With m the median of the gradients of the eight neighbours at the distance h, ρ the median of their
distances from it and a the largest of their sizes, and f the difference of the displacements of two opposite
neighbours over 2h, a point contradicts its neighbours where both

    |g − m| > 3 (ρ + 2 standard errors + floor) + 0.5 a    and    |g − f| > 3 (2 standard errors + floor) + 0.5 |g|.

The last terms are what a smooth field may do: of a wave g − m = (1 − cos kh) g and g − f = (1 − sin kh/kh) g at most.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.contradiction import (
    disagreement_strip,
    gradient_outliers_strip,
    stands_out_strip,
    variances_strip,
)
from sixflow.engine.threads import over_strips

SMOOTH = 1.5  # times what the finest resolved wave does
PHASE = 0.8  # of the finest resolved wave, rad, over which opposite neighbours stand from the point
EDGES = ((1.0, 0.03), (0.5, 0.15))  # disagreement and share of outlying pixels that tell an edge
COVERED = (0.3, 0.5)  # the same about the point itself
_DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1))
_STRIP = 16

Array = NDArray[np.float64]


def gradient_variances(covariance: NDArray[Any], bias: NDArray[Any] | None = None) -> Array:
    """Variances of u, v, u_x, u_y, v_x, v_y from the covariance of the six; shape (6, rows, columns).

    With `bias`, shape (rows, columns, 6), its expected squares are in them.
    """
    out = np.empty((6, *covariance.shape[:2]))
    over_strips(lambda a, b: variances_strip(covariance, a, b, out), out.shape[1], _STRIP)
    if bias is not None:
        u, v, divergence, curl, stretch, shear = np.moveaxis(np.nan_to_num(bias), -1, 0)
        along, across = (divergence + stretch) / 4, (shear + curl) / 4
        out += np.stack([u, v, along, across, across, along])
    return out


def of_smooth(phase: float) -> float:
    """S(q): disagreement of opposite neighbours over h times the gradient, for a wave of phase q = kh."""
    return 2 * (math.sin(phase) - phase * math.cos(phase)) / phase


def disagreement(maps: NDArray[Any], variances: Array, step: int, period: float) -> Array:
    """How far opposite neighbours disagree about a point, over what a smooth field and noise may do.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; NaN at points that are not to be asked.
    variances : array of the same shape
        As from `gradient_variances`.
    step : int
        Grid spacing, px.
    period : float
        Shortest period that is resolved, px.

    Returns
    -------
    array, shape (rows, columns)
        The largest ratio over components and directions; above 1 lies an edge. 0 where nothing could be asked.
    """
    worst, k = np.zeros(maps.shape[1:]), 2 * math.pi / period
    for column, row in _DIRECTIONS:
        length = math.hypot(column, row)
        reach = max(1, round(PHASE / k / step / length))
        smooth = SMOOTH * of_smooth(min(k * reach * step * length, math.pi))
        di, dj = column * reach, row * reach
        over_strips(
            lambda a, b, di=di, dj=dj, smooth=smooth: disagreement_strip(  # type: ignore[misc]
                maps, variances, di, dj, step, smooth, a, b, worst
            ),
            maps.shape[1],
            _STRIP,
        )
    return worst


def at_edge(
    apart: NDArray[Any], outlying: NDArray[Any] | None, outlying_centre: NDArray[Any] | None
) -> NDArray[np.bool_]:
    """Find points whose window lies across a motion edge.

    Parameters
    ----------
    apart : array, shape (rows, columns)
        From `disagreement`.
    outlying, outlying_centre : arrays of the same shape, or None
        As in `WindowStatistics`. None where pixels were not weighed: an edge cannot then be distinguished from a motion
        that is not resolved.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    if outlying is None or outlying_centre is None:
        return np.zeros(apart.shape, np.bool_)
    found = np.zeros(apart.shape, np.bool_)
    share, centre = (np.nan_to_num(part - np.nanmedian(part)) for part in (outlying, outlying_centre))
    for least_apart, least_share in EDGES:
        found |= (apart > least_apart) & (share > least_share)
    return found | ((apart > COVERED[0]) & (centre > COVERED[1]))


def stands_out(noise: NDArray[Any], residual: NDArray[Any], step: int, window: float) -> NDArray[np.bool_]:
    """Find windows whose residual is far above that of the windows around.

    Parameters
    ----------
    noise, residual : arrays, shape (rows, columns)
        Residual in grey, and over the window's contrast.
    step : int
        Grid spacing, px.
    window : float
        px.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    reach, found = max(1, round(window / step)), np.zeros(noise.shape, np.bool_)
    over_strips(lambda a, b: stands_out_strip(noise, residual, reach, a, b, found), noise.shape[0], _STRIP)
    return found


def gradient_outliers(maps: NDArray[Any], variances: Array, step: int, period: float) -> NDArray[np.bool_]:
    """Find points whose displacement gradient contradicts their neighbours.

    Parameters
    ----------
    maps, variances, step, period
        As for `disagreement`.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    found = np.zeros(maps.shape[1:], np.bool_)
    reach = max(1, round(PHASE * period / (2 * math.pi) / step))
    for k, direction in ((2, (1, 0)), (3, (0, 1)), (4, (1, 0)), (5, (0, 1))):
        parts = maps[k], variances[k], maps[k // 2 - 1]
        over_strips(
            lambda a, b, parts=parts, along=direction: gradient_outliers_strip(  # type: ignore[misc, call-arg]
                *parts, along, reach, step, a, b, found
            ),
            maps.shape[1],
            _STRIP,
        )
    return found
