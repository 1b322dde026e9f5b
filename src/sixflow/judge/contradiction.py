"""Consistency: does the map of a point go on into those of its neighbours, or does something end in between?

*Edge.* Two neighbours on opposite sides of a point p, at a distance h, each predict the displacement there, d + G(p −
n). In a smooth field the predictions agree; across a motion edge, and over a structure that is not resolved, they do
not. For d = A sin kx, with the gradient A k, they differ by up to S(kh) h A k, S(q) = 2 (sin q − q cos q)/q ≈ ⅔ q².
The distance is the one at which q = 0.8 for the period that is attenuated by 10 %: half a window, less with
sharpening, at least one step. There S = 0.4; a jump seen through the window makes 0.9. What exceeds

    5 standard errors + floor + 1.5 S(kh) h · (largest gradient of the three, in that direction)

lies across an edge. Four directions are asked: along x, along y, and the diagonals.

A motion that is smooth but finer than the window exceeds it too. It leaves a residual everywhere in the window, a
motion edge one in the pixels of the other motion, which `engine.weigh` has found foreign. So an edge is a
disagreement E (in units of the above) together with a share φ of foreign pixels above the frame's median: E > 1 and φ
> 0.03, or E > 0.5 and φ > 0.15, or E > 0.3 with most pixels about the point itself foreign (φ > 0.5 in a window of
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

from sixflow.engine.compiler import kernel
from sixflow.engine.threads import over_strips

ERRORS = 5.0
SMOOTH = 1.5  # times what the finest resolved wave does
PHASE = 0.8  # of the finest resolved wave, rad, over which opposite neighbours stand from the point
FLOOR = 0.1  # px: disagreement that is never held against a point
EDGES = ((1.0, 0.03), (0.5, 0.15))  # disagreement and share of foreign pixels that tell an edge
COVERED = (0.3, 0.5)  # the same about the point itself
STANDS_OUT, LEAST_RESIDUAL = 3.0, 0.1  # times the neighbours' median; of a zero-normalised residual
GRADIENT_FLOOR = 0.005  # of displacement gradients
_DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1))
_STRIP = 16

Array = NDArray[np.float64]


@kernel
def _variances_strip(covariance: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    for j in range(start, stop):
        for i in range(out.shape[2]):
            C = covariance[j, i]
            along, across = (C[2, 2] + C[4, 4]) / 4, (C[5, 5] + C[3, 3]) / 4
            out[0, j, i], out[1, j, i] = max(C[0, 0], 0.0), max(C[1, 1], 0.0)
            out[2, j, i], out[5, j, i] = max(along + C[2, 4] / 2, 0.0), max(along - C[2, 4] / 2, 0.0)
            out[3, j, i], out[4, j, i] = max(across - C[3, 5] / 2, 0.0), max(across + C[3, 5] / 2, 0.0)


def gradient_variances(covariance: NDArray[Any]) -> Array:
    """Variances of u, v, u_x, u_y, v_x, v_y from the covariance of the six; shape (6, rows, columns)."""
    out = np.empty((6, *covariance.shape[:2]))
    over_strips(lambda a, b: _variances_strip(covariance, a, b, out), out.shape[1], _STRIP)
    return out


def of_smooth(phase: float) -> float:
    """S(q): disagreement of opposite neighbours over h times the gradient, for a wave of phase q = kh."""
    return 2 * (math.sin(phase) - phase * math.cos(phase)) / phase


@kernel
def _apart_strip(
    maps: NDArray[Any], variances: NDArray[Any], di: int, dj: int, step: int, smooth: float, start: int,
    stop: int, worst: NDArray[Any],
) -> None:  # fmt: skip
    """Raise `worst` to the disagreement of the neighbours (di, dj) columns and rows away on both sides."""
    rows, columns = maps.shape[1:]
    hx, hy = di * step, dj * step
    for j in range(max(start, abs(dj)), min(stop, rows - abs(dj))):
        for i in range(abs(di), columns - abs(di)):
            for c in range(2):
                gx, gy = 2 + 2 * c, 3 + 2 * c
                before = maps[gx, j - dj, i - di] * hx + maps[gy, j - dj, i - di] * hy
                after = maps[gx, j + dj, i + di] * hx + maps[gy, j + dj, i + di] * hy
                here = maps[gx, j, i] * hx + maps[gy, j, i] * hy
                apart = abs(maps[c, j - dj, i - di] + before - maps[c, j + dj, i + di] + after)
                slope = max(abs(before), abs(after))
                if abs(here) > slope:
                    slope = abs(here)
                floor = FLOOR + smooth * slope
                if not apart > worst[j, i] * floor:  # no noise would make it less
                    continue
                variance = variances[c, j - dj, i - di] + variances[c, j + dj, i + di]
                variance += hx * hx * (variances[gx, j - dj, i - di] + variances[gx, j + dj, i + di])
                variance += hy * hy * (variances[gy, j - dj, i - di] + variances[gy, j + dj, i + di])
                ratio = apart / (ERRORS * math.sqrt(variance) + floor)
                if ratio > worst[j, i]:
                    worst[j, i] = ratio


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
            lambda a, b, di=di, dj=dj, smooth=smooth: _apart_strip(  # type: ignore[misc]
                maps, variances, di, dj, step, smooth, a, b, worst
            ),
            maps.shape[1],
            _STRIP,
        )
    return worst


@kernel
def _curved_strip(
    maps: NDArray[Any], reach: int, step: int, start: int, stop: int, most: NDArray[Any]
) -> None:
    rows, columns = maps.shape[1:]
    for j in range(start, stop):
        for i in range(columns):
            for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
                x, y = di * reach, dj * reach
                if min(j - y, j + y, i - x) < 0 or max(j - y, j + y) >= rows or i + x >= columns:
                    continue
                for c in (2, 4):
                    along = (maps[c, j + y, i + x] - maps[c, j - y, i - x]) * di
                    across = (maps[c + 1, j + y, i + x] - maps[c + 1, j - y, i - x]) * dj
                    bent = abs(along + across) * reach * step / 4
                    if bent > most[j, i]:
                        most[j, i] = bent


def curvature(maps: NDArray[Any], step: int, window: float) -> Array:
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
    over_strips(lambda a, b: _curved_strip(maps, reach, step, a, b, most), maps.shape[1], _STRIP)
    return most


def at_edge(
    apart: NDArray[Any], foreign: NDArray[Any] | None, foreign_centre: NDArray[Any] | None
) -> NDArray[np.bool_]:
    """Find points whose window lies across a motion edge.

    Parameters
    ----------
    apart : array, shape (rows, columns)
        From `disagreement`.
    foreign, foreign_centre : arrays of the same shape, or None
        As in `passes.Quality`. None where pixels were not weighed: an edge is then not told from a motion that is not
        resolved.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    if foreign is None or foreign_centre is None:
        return np.zeros(apart.shape, np.bool_)
    found = np.zeros(apart.shape, np.bool_)
    share, centre = (np.nan_to_num(part - np.nanmedian(part)) for part in (foreign, foreign_centre))
    for least_apart, least_share in EDGES:
        found |= (apart > least_apart) & (share > least_share)
    return found | ((apart > COVERED[0]) & (centre > COVERED[1]))


@kernel
def median(values: NDArray[Any], count: int) -> float:
    """Median of the first `count` values, which are sorted in place."""
    for k in range(1, count):
        value = values[k]
        n = k
        while n > 0 and values[n - 1] > value:
            values[n] = values[n - 1]
            n -= 1
        values[n] = value
    middle = count // 2
    return values[middle] if count % 2 else (values[middle - 1] + values[middle]) / 2


@kernel
def neighbours(values: NDArray[Any], j: int, i: int, reach: int, out: NDArray[Any]) -> int:
    """Known values of the eight points `reach` away, into `out`; returns how many."""
    rows, columns = values.shape
    count = 0
    for y in range(j - reach, j + reach + 1, reach):
        for x in range(i - reach, i + reach + 1, reach):
            if y < 0 or x < 0 or y >= rows or x >= columns or (y == j and x == i):
                continue
            value = values[y, x]
            if value == value:
                out[count] = value
                count += 1
    return count


@kernel
def _stands_out_strip(
    noise: NDArray[Any], residual: NDArray[Any], reach: int, start: int, stop: int, found: NDArray[Any]
) -> None:
    around = np.empty(8)
    for j in range(start, stop):
        for i in range(noise.shape[1]):
            found[j, i] = False
            if not residual[j, i] > LEAST_RESIDUAL:
                continue
            count = neighbours(noise, j, i, reach, around)
            if count >= 3 and noise[j, i] > STANDS_OUT * median(around, count):
                count = neighbours(residual, j, i, reach, around)
                found[j, i] = count >= 3 and residual[j, i] > STANDS_OUT * median(around, count)


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
    over_strips(lambda a, b: _stands_out_strip(noise, residual, reach, a, b, found), noise.shape[0], _STRIP)
    return found


@kernel
def _gradient_strip(
    gradient: NDArray[Any],
    variance: NDArray[Any],
    value: NDArray[Any],
    direction: tuple[int, int],
    reach: int,
    step: int,
    start: int,
    stop: int,
    found: NDArray[Any],
) -> None:
    """`value` is the displacement that `gradient` is the slope of, along `direction` (columns, rows)."""
    around = np.empty(8)
    rows, columns = gradient.shape
    x, y = direction[0] * reach, direction[1] * reach
    for j in range(max(start, y), min(stop, rows - y)):
        for i in range(x, columns - x):
            here = gradient[j, i]
            slope = (value[j + y, i + x] - value[j - y, i - x]) / (2 * reach * step)
            if not abs(here - slope) > 3 * GRADIENT_FLOOR + abs(here) / 2:
                continue
            tolerance = 2 * math.sqrt(variance[j, i]) + GRADIENT_FLOOR
            if not abs(here - slope) > 3 * tolerance + abs(here) / 2:
                continue
            count = neighbours(gradient, j, i, reach, around)
            if count < 5:
                continue
            middle, largest = median(around, count), 0.0
            for k in range(count):
                largest = max(largest, abs(around[k]))
                around[k] = abs(around[k] - middle)
            spread = median(around, count)
            if abs(here - middle) > 3 * (spread + tolerance) + largest / 2:
                found[j, i] = True


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
            lambda a, b, parts=parts, along=direction: _gradient_strip(  # type: ignore[misc, call-arg]
                *parts, along, reach, step, a, b, found
            ),
            maps.shape[1],
            _STRIP,
        )
    return found
