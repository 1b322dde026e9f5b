"""Consistency: does the map of a point go on into those of its neighbours, or does something end in between?

*Edge.* Two neighbours on opposite sides of a point p, at a distance h, each predict the displacement there, d + G(p − n). In a
smooth field the predictions agree; across a motion edge, and over a structure that is not resolved, they do not. For
d = A sin kx, with the gradient A k, they differ by up to S(kh) h A k, S(q) = 2 (sin q − q cos q)/q ≈ ⅔ q². The distance is the one
at which q = 0.8 for the period that is attenuated by 10 %: half a window, less with sharpening, at least one step. There
S = 0.4; a jump seen through the window makes 0.9. What exceeds

    5 standard errors + floor + 1.5 S(kh) h · (largest gradient of the three, in that direction)

lies across an edge. Four directions are asked: along x, along y, and the diagonals.

A motion that is smooth but finer than the window exceeds it too. It leaves a residual everywhere in the window, a motion edge one
in the pixels of the other motion, which `engine.weigh` has found foreign. So an edge is a disagreement E (in units of the
above) together with a share φ of foreign pixels above the frame's median: E > 1 and φ > 0.03, or E > 0.5 and φ > 0.15, or
E > 0.3 with most pixels about the point itself foreign (φ > 0.5 in a window of half the size: the map is that of the
surroundings). E > 1 alone is a motion that is not resolved.

*Residual.* A window stands out where both its residual and its residual over its contrast are more than 3 times the median of those
one window away: neither brighter light nor lower contrast explains it.

*Gradients.* With m the median of the gradients of the eight neighbours half a window away, ρ the median of their distances from
it and a the largest of their sizes, a point contradicts them where |g − m| > 3 (ρ + 2 standard errors + floor) + 0.5 a. The
last term is what a smooth field may do in half a window: 1 − cos kh = 0.3 of the gradient at the limit of resolution.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.six import GRADIENT_FROM_SIX

ERRORS = 5.0
SMOOTH = 1.5  # times what the finest resolved wave does
PHASE = 0.8  # of the finest resolved wave, rad, over which opposite neighbours stand from the point
FLOOR = 0.1  # px: disagreement that is never held against a point
EDGES = ((1.0, 0.03), (0.5, 0.15))  # disagreement and share of foreign pixels that tell an edge
COVERED = (0.3, 0.5)  # the same about the point itself
STANDS_OUT = 3.0
GRADIENT_FLOOR = 0.005  # of displacement gradients
_DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1))

Array = NDArray[np.float64]


def gradient_variances(covariance: NDArray[Any]) -> Array:
    """Variances of u, v, u_x, u_y, v_x, v_y; shape (6, rows, columns)."""
    spread = np.einsum(
        "ki,...ij,kj->k...", GRADIENT_FROM_SIX, covariance.astype(np.float64), GRADIENT_FROM_SIX
    )
    return np.asarray(np.maximum(spread, 0))


def shifted(values: NDArray[Any], di: int, dj: int) -> NDArray[Any]:
    """Values of the points di columns and dj rows away, NaN beyond the grid; the last two axes are rows and columns."""
    out = np.full_like(values, np.nan)
    rows, columns = values.shape[-2:]
    if abs(dj) < rows and abs(di) < columns:
        here = (slice(max(0, -dj), rows - max(0, dj)), slice(max(0, -di), columns - max(0, di)))
        there = (slice(max(0, dj), rows - max(0, -dj)), slice(max(0, di), columns - max(0, -di)))
        out[(..., *here)] = values[(..., *there)]
    return out


def of_smooth(phase: float) -> float:
    """S(q): disagreement of opposite neighbours over h times the gradient, for a wave of phase q = kh."""
    return 2 * (math.sin(phase) - phase * math.cos(phase)) / phase


def disagreement(maps: NDArray[Any], variances: Array, step: int, period: float) -> NDArray[np.float64]:
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
    for direction in _DIRECTIONS:
        length = math.hypot(*direction)
        reach = max(1, round(PHASE / k / step / length))
        smooth = SMOOTH * of_smooth(min(k * reach * step * length, math.pi))
        di, dj = direction[0] * reach, direction[1] * reach
        hx, hy = di * step, dj * step
        before, after = shifted(maps, -di, -dj), shifted(maps, di, dj)
        errors = shifted(variances, -di, -dj), shifted(variances, di, dj)
        for c in range(2):
            gx, gy = 2 + 2 * c, 3 + 2 * c
            change = [m[gx] * hx + m[gy] * hy for m in (before, maps, after)]
            apart = np.abs(before[c] + change[0] - (after[c] - change[2]))
            variance = sum(e[c] + e[gx] * hx**2 + e[gy] * hy**2 for e in errors)
            allowed = (
                ERRORS * np.sqrt(variance)
                + FLOOR
                + smooth * np.fmax(np.fmax(np.abs(change[0]), np.abs(change[2])), np.abs(change[1]))
            )
            worst = np.fmax(worst, apart / allowed)
    return worst


def curvature(maps: NDArray[Any], step: int, window: float) -> NDArray[np.float64]:
    """By how much neighbours half a window away mispredict a point because the field is curved, px.

    Their maps miss ½h² d''. The gradients of opposite neighbours differ by 2h d'': this is a quarter of h times
    their difference, the largest over components and four directions.

    Parameters
    ----------
    maps, step, window
        As for `gradient_outliers`.

    Returns
    -------
    array, shape (rows, columns), 0 where nothing could be asked
    """
    reach, most = max(1, round(window / 2 / step)), np.zeros(maps.shape[1:])
    for di, dj in _DIRECTIONS:
        change = shifted(maps[2:], di * reach, dj * reach) - shifted(maps[2:], -di * reach, -dj * reach)
        for c in (0, 2):
            most = np.fmax(most, np.abs(change[c] * di + change[c + 1] * dj) * reach * step / 4)
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
    reach = max(1, round(window / step))
    offsets = [(i, j) for j in (-reach, 0, reach) for i in (-reach, 0, reach) if (i, j) != (0, 0)]
    found = np.ones(noise.shape, np.bool_)
    for values in (noise, residual):
        around = np.stack([shifted(values.astype(np.float64), i, j) for i, j in offsets])
        known = np.isfinite(around).sum(axis=0)
        ordered = np.sort(around, axis=0)  # NaN last
        middle = np.take_along_axis(ordered, np.maximum(known - 1, 0)[None] // 2, axis=0)[0]
        with np.errstate(invalid="ignore"):
            found &= (known >= 3) & (values > STANDS_OUT * middle)
    return found


def gradient_outliers(maps: NDArray[Any], variances: Array, step: int, window: float) -> NDArray[np.bool_]:
    """Find points whose displacement gradient contradicts those of their neighbours.

    Parameters
    ----------
    maps, variances, step
        As for `disagreement`.
    window : float
        px; neighbours are half of it away.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    reach = max(1, round(window / 2 / step))
    offsets = [(i, j) for j in (-reach, 0, reach) for i in (-reach, 0, reach) if (i, j) != (0, 0)]
    around = np.stack([shifted(maps[2:], i, j) for i, j in offsets])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # points without neighbours
        middle = np.nanmedian(around, axis=0)
        spread = np.nanmedian(np.abs(around - middle), axis=0)
        largest = np.nanmax(np.abs(around), axis=0)
    enough = np.isfinite(around).sum(axis=0) >= 5
    allowed = 3 * (spread + 2 * np.sqrt(variances[2:]) + GRADIENT_FLOOR) + 0.5 * largest
    with np.errstate(invalid="ignore"):
        return np.asarray((enough & (np.abs(maps[2:] - middle) > allowed)).any(axis=0))
