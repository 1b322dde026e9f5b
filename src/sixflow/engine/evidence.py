"""Evidence: kernels that try the motions of a point and of its neighbours on the pixels beside the point."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.contradiction import ERRORS
from sixflow.engine.interpolate import Interpolant, scratch_rows, warp_row

EVIDENCE = 3.5
"""Standard deviations of L."""
EXPLAINED = 3.0
"""Standard deviations by which R_n may exceed ν²."""
REJECTED = -8.0
"""L of a motion that is asked no further."""
LEFT_TO_STAND = 0.3
"""px: what is finer than the window, and less than that, is left to stand."""
GAP = 1 / 31
"""Windows: pixels nearer to the point belong to the edge of either side."""
MOST_OUTLYING = 100.0
"""Mean squares of noise beyond which a pixel's residual tells nothing more."""
REACH = 2.5
"""Standard deviations of the larger disc."""


class Compared(NamedTuple):
    """Two frames.

    Attributes
    ----------
    still : array, shape (height, width)
        Frame 0 at its own pixels.
    before, after : Interpolant
        Frame 0 between its pixels, asked where `share` is not 0; its `valid` holds in any case. Frame 1.
    share : float
        Of the way from frame 0 to frame 1 at which motions are expressed.
    """

    still: NDArray[Any]
    before: Interpolant
    after: Interpolant
    share: float


class Points(NamedTuple):
    """What is known at the points of a grid; arrays of shape (rows, columns), if nothing else is said.

    Attributes
    ----------
    maps, variances : arrays, shape (6, rows, columns)
    bend : array
        By how much curvature makes neighbours mispredict a point, px.
    noise, floor : array
        Standard deviation of one frame's noise; least mean square residual.
    light : array, shape (rows, columns, 2), or (0, 0, 2) for none
        Gain and offset.
    asked, suspects : bool array
        Points whose motion is tried on others, and points that are tried.
    reach : int array, shape (rings, rows, columns)
        Distance of the neighbours, grid points.
    window : array
        px.
    grid : (x0, y0, step)
    """

    maps: NDArray[Any]
    variances: NDArray[Any]
    bend: NDArray[Any]
    noise: NDArray[Any]
    floor: NDArray[Any]
    light: NDArray[Any]
    asked: NDArray[Any]
    suspects: NDArray[Any]
    reach: NDArray[Any]
    window: NDArray[Any]
    grid: tuple[int, int, int]


class _Spot(NamedTuple):
    """A point that is tried: pixel and map, gain and offset, σ, gap, noise power and floor of its window; the residuals
    of its own map, row by row as they are wanted, and work space.
    """

    x: int
    y: int
    map: NDArray[Any]
    light: tuple[float, float]
    sigma: float
    gap: float
    power: float
    floor: float
    own: NDArray[Any]
    known: NDArray[Any]
    other: NDArray[Any]
    scratch: NDArray[Any]


@kernel
def _differs(points: Points, at: tuple[int, int], offset: tuple[int, int], predicted: NDArray[Any]) -> bool:
    """Whether the neighbour at an offset predicts another motion for a point; its map there into `predicted`."""
    maps, variances, (j, i), (dj, di) = points.maps, points.variances, at, offset
    y, x, hy, hx, found = j + dj, i + di, dj * points.grid[2], di * points.grid[2], False
    for c in range(2):
        gx, gy = 2 + 2 * c, 3 + 2 * c
        predicted[c] = maps[c, y, x] - hx * maps[gx, y, x] - hy * maps[gy, y, x]
        predicted[gx], predicted[gy] = maps[gx, y, x], maps[gy, y, x]
        beyond = abs(predicted[c] - maps[c, j, i]) - LEFT_TO_STAND - points.bend[j, i]
        if beyond > 0:
            variance = variances[c, j, i] + variances[c, y, x]
            variance += hx * hx * variances[gx, y, x] + hy * hy * variances[gy, y, x]
            found = found or beyond > ERRORS * math.sqrt(variance)
    return found


@kernel
def suspects_strip(
    maps: NDArray[Any], asked: NDArray[Any], judged: NDArray[Any], reach: NDArray[Any], step: int,
    start: int, stop: int, found: NDArray[Any],
) -> None:  # fmt: skip
    """Points about which any neighbour says something else, were there no noise and no curvature."""
    rows, columns = judged.shape
    u, u_x, u_y, v, v_x, v_y = maps[0], maps[2], maps[3], maps[1], maps[4], maps[5]
    for j in range(start, stop):
        for i in range(columns):
            if not judged[j, i]:
                continue
            for ring in range(reach.shape[0]):
                r = reach[ring, j, i]
                for dj in range(-r, r + 1, r):
                    for di in range(-r, r + 1, r):
                        y, x = j + dj, i + di
                        if y < 0 or x < 0 or y >= rows or x >= columns or not asked[y, x]:
                            continue
                        hx, hy = di * step, dj * step
                        apart_u = u[y, x] - hx * u_x[y, x] - hy * u_y[y, x] - u[j, i]
                        apart_v = v[y, x] - hx * v_x[y, x] - hy * v_y[y, x] - v[j, i]
                        if abs(apart_u) > LEFT_TO_STAND or abs(apart_v) > LEFT_TO_STAND:
                            found[j, i] = True


@kernel
def _compare_row(frames: Compared, spot: _Spot, motion: NDArray[Any], below: int, out: NDArray[Any]) -> None:
    """Residuals of a motion in the row `below` a point, at as many pixels on both sides; NaN where there is none."""
    share, side, still, scratch = frames.share, out.size, frames.still, spot.scratch
    half, row = side // 2, spot.y + below
    u, v, before, taps = scratch[0], scratch[1], scratch[2], scratch[3:]
    nothing, valid = np.empty(0), frames.before.valid
    for part in range(2):  # frame 1, then frame 0
        way = 1 - share if part == 0 else -share
        for a in range(side):
            u[a] = motion[0] + motion[2] * (a - half) + motion[3] * below
            u[a] = spot.x - half + way * u[a]  # the row's pixels count from 0
            v[a] = way * (motion[1] + motion[4] * (a - half) + motion[5] * below)
        if part == 0:
            warp_row(frames.after, u, v, row, taps, out, nothing)
        elif share > 0:
            warp_row(frames.before, u, v, row, taps, before, nothing)
    for a in range(side):
        column = spot.x + a - half
        if share == 0:
            inside = 0 <= row < still.shape[0] and 0 <= column < still.shape[1]
            if not inside or (valid.size and valid[row, column] == 0):
                before[a] = np.nan
            else:
                before[a] = still[row, column]
        out[a] = (out[a] - spot.light[1]) / spot.light[0] - before[a]


@kernel
def _evidence(frames: Compared, spot: _Spot, predicted: NDArray[Any], ahead: tuple[float, float]) -> float:
    """The larger L of both discs, in standard deviations, or −inf as soon as the predicted motion is out.

    The pixels that are asked lie in the direction `ahead` (x, y) of the point.
    """
    own, known, other, gap, power = spot.own, spot.known, spot.other, spot.gap, spot.power
    side = own.shape[0]
    half = side // 2
    sums, ratio, excess = np.zeros((2, 4)), np.zeros(2), np.zeros(2)
    for n in range(side):
        below = (n + 1) // 2 if n % 2 else -(n // 2)
        if below * ahead[1] + half * abs(ahead[0]) <= gap:
            continue
        b = below + half
        if not known[b]:
            _compare_row(frames, spot, spot.map, below, own[b])
            known[b] = True
        _compare_row(frames, spot, predicted, below, other)
        for a in range(side):
            along = (a - half) * ahead[0] + below * ahead[1]
            if along <= gap or not (own[b, a] == own[b, a] and other[a] == other[a]):
                continue
            near = min((along - gap) / (2 * gap), 1.0)
            large = math.exp(-2 * ((a - half) ** 2 + below**2) / (spot.sigma * spot.sigma))
            for size in range(2):
                w = near * (large if size == 0 else large**4)
                sums[size, 0] += w
                sums[size, 1] += w * w
                sums[size, 2] += w * min(own[b, a] ** 2, MOST_OUTLYING * power)
                sums[size, 3] += w * min(other[a] ** 2, MOST_OUTLYING * power)
        for size in range(2):
            total, squares, left, instead = sums[size]
            if total > 0:
                least = max(min(left, instead), spot.floor * total)
                count = total * total / squares
                ratio[size] = count / 2 * (left - instead) / least
                explained = instead < total * power * (1 + EXPLAINED * math.sqrt(2 / count))
                excess[size] = ratio[size] / (math.sqrt(3 * count) / 2) if explained else -np.inf
        if ratio[0] < REJECTED and ratio[1] < 0:
            return -np.inf
    return max(excess[0], excess[1])


@kernel
def _spot(points: Points, j: int, i: int, taps: int) -> _Spot:
    """A point of the grid, with work space for splines of so many taps."""
    window, (x0, y0, step) = points.window[j, i], points.grid
    sigma = window / math.sqrt(4 * math.pi)
    side = 2 * math.ceil(REACH * sigma / 2) + 1
    tone = (1.0, 0.0)
    if points.light.size:
        tone = (float(points.light[j, i, 0]), float(points.light[j, i, 1]))
    own_map = np.empty(6)
    for k in range(6):
        own_map[k] = points.maps[k, j, i]
    return _Spot(
        x0 + i * step, y0 + j * step, own_map, tone, sigma, GAP * window, 2 * points.noise[j, i] ** 2,
        points.floor[j, i], np.empty((side, side)), np.zeros(side, np.bool_), np.empty(side),
        np.empty((3 + scratch_rows(taps), side)),
    )  # fmt: skip


@kernel
def refuted_strip(
    frames: Compared, points: Points, taps: int, start: int, stop: int, found: NDArray[Any]
) -> None:
    """Try the neighbours' maps on the pixels of both frames, grid rows start … stop.

    Parameters
    ----------
    frames : Compared
    points : Points
    taps : int
        Of the splines, along one axis.
    found : bool array, shape (rows, columns)
        Receives who is refuted.
    """
    rows, columns = points.suspects.shape
    predicted = np.empty(6)
    for j in range(start, stop):
        for i in range(columns):
            if not points.suspects[j, i]:
                continue
            spot = _spot(points, j, i, taps)
            for ring in range(points.reach.shape[0]):
                r = points.reach[ring, j, i]
                for dj in range(-r, r + 1, r):
                    for di in range(-r, r + 1, r):
                        y, x = j + dj, i + di
                        if (
                            found[j, i]
                            or y < 0
                            or x < 0
                            or y >= rows
                            or x >= columns
                            or not points.asked[y, x]
                        ):
                            continue
                        if _differs(points, (j, i), (dj, di), predicted):
                            length = math.hypot(di, dj)
                            ahead = di / length, dj / length
                            found[j, i] = _evidence(frames, spot, predicted, ahead) > EVIDENCE
