"""Evidence: kernels that try the motions of a point and of its neighbours on the pixels beside the point."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.interpolate import Interpolant, scratch_rows, warp_row

EVIDENCE = 3.5
"""Standard deviations of L."""
EXPLAINED = 3.0
"""Standard deviations by which R_n may exceed ν²."""
REJECTED = -8.0
"""L of a motion that is asked no further."""
ERRORS = 5.0
"""Standard errors that two predictions of a displacement may differ by."""
LEFT_TO_STAND = 0.3
"""px: what is finer than the window, and less than that, is left to stand."""
GAP = 1 / 31
"""Windows: pixels nearer to the point belong to the edge of either side."""
MOST_OUTLYING = 100.0
"""Mean squares of noise beyond which a pixel's residual tells nothing more."""
REACH = 2.5
"""Standard deviations of the larger disc."""


@kernel
def _differs(
    maps: NDArray[Any], variances: NDArray[Any], bend: float, j: int, i: int, dj: int, di: int, step: int,
    predicted: NDArray[Any],
) -> bool:  # fmt: skip
    """Whether the neighbour (dj, di) says something else about (j, i); its map there into `predicted`."""
    y, x, hy, hx, found = j + dj, i + di, dj * step, di * step, False
    for c in range(2):
        gx, gy = 2 + 2 * c, 3 + 2 * c
        predicted[c] = maps[c, y, x] - hx * maps[gx, y, x] - hy * maps[gy, y, x]
        predicted[gx], predicted[gy] = maps[gx, y, x], maps[gy, y, x]
        beyond = abs(predicted[c] - maps[c, j, i]) - LEFT_TO_STAND - bend
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
def _compare_row(
    frames: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]],
    share: float, motion: NDArray[Any], x: int, y: int, below: int, light: tuple[float, float],
    scratch: NDArray[Any], out: NDArray[Any],
) -> None:  # fmt: skip
    """Residuals of a motion in the row `below` (x, y), at as many pixels on both sides; NaN where there is none."""
    still, coefficients, valid, moved, moved_valid = frames
    side = out.size
    half, row = side // 2, y + below
    u, v, before, taps = scratch[0], scratch[1], scratch[2], scratch[3:]
    nothing, noise = np.empty(0), (0.0, 0.0, 0.0)
    for part in range(2):  # frame 1, then frame 0
        way = 1 - share if part == 0 else -share
        for a in range(side):
            u[a] = motion[0] + motion[2] * (a - half) + motion[3] * below
            u[a] = x - half + way * u[a]  # the row's pixels count from 0
            v[a] = way * (motion[1] + motion[4] * (a - half) + motion[5] * below)
        if part == 0:
            warp_row(Interpolant(moved, moved_valid, noise), u, v, row, taps, out, nothing)
        elif share > 0:
            warp_row(Interpolant(coefficients, valid, noise), u, v, row, taps, before, nothing)
    for a in range(side):
        column = x + a - half
        if share == 0:
            inside = 0 <= row < still.shape[0] and 0 <= column < still.shape[1]
            if not inside or (valid.size and valid[row, column] == 0):
                before[a] = np.nan
            else:
                before[a] = still[row, column]
        out[a] = (out[a] - light[1]) / light[0] - before[a]


@kernel
def _evidence(
    frames: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]],
    share: float, mine: NDArray[Any], predicted: NDArray[Any], x: int, y: int, light: tuple[float, float],
    ahead: tuple[float, float], sigma: float, gap: float, power: float, floor: float, scratch: NDArray[Any],
    own: NDArray[Any], known: NDArray[Any], other: NDArray[Any],
) -> float:  # fmt: skip
    """The larger L of both discs, in standard deviations, or −inf as soon as n's motion is out.

    `own` (side, side) and `known` (side,) keep the residuals of p's own motion, row by row as they are wanted.
    """
    side = own.shape[0]
    half = side // 2
    sums, ratio, excess = np.zeros((2, 4)), np.zeros(2), np.zeros(2)
    for n in range(side):
        below = (n + 1) // 2 if n % 2 else -(n // 2)
        if below * ahead[1] + half * abs(ahead[0]) <= gap:
            continue
        b = below + half
        if not known[b]:
            _compare_row(frames, share, mine, x, y, below, light, scratch, own[b])
            known[b] = True
        _compare_row(frames, share, predicted, x, y, below, light, scratch, other)
        for a in range(side):
            along = (a - half) * ahead[0] + below * ahead[1]
            if along <= gap or not (own[b, a] == own[b, a] and other[a] == other[a]):
                continue
            near = min((along - gap) / (2 * gap), 1.0)
            large = math.exp(-2 * ((a - half) ** 2 + below**2) / (sigma * sigma))
            for size in range(2):
                w = near * (large if size == 0 else large**4)
                sums[size, 0] += w
                sums[size, 1] += w * w
                sums[size, 2] += w * min(own[b, a] ** 2, MOST_OUTLYING * power)
                sums[size, 3] += w * min(other[a] ** 2, MOST_OUTLYING * power)
        for size in range(2):
            total, squares, left, instead = sums[size]
            if total > 0:
                least = max(min(left, instead), floor * total)
                count = total * total / squares
                ratio[size] = count / 2 * (left - instead) / least
                explained = instead < total * power * (1 + EXPLAINED * math.sqrt(2 / count))
                excess[size] = ratio[size] / (math.sqrt(3 * count) / 2) if explained else -np.inf
        if ratio[0] < REJECTED and ratio[1] < 0:
            return -np.inf
    return max(excess[0], excess[1])


@kernel
def refuted_strip(
    frames: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]],
    maps: NDArray[Any], variances: NDArray[Any], bend: NDArray[Any], noise: NDArray[Any],
    light: NDArray[Any], asked: NDArray[Any], suspects: NDArray[Any], reach: NDArray[Any],
    window: NDArray[Any], grid: tuple[int, int, int], share: float, taps: int, floor: NDArray[Any], start: int,
    stop: int, found: NDArray[Any],
) -> None:  # fmt: skip
    """Try the neighbours' maps on the pixels of both frames; `found` receives who is refuted."""
    rows, columns = suspects.shape
    x0, y0, step = grid
    predicted, mine = np.empty(6), np.empty(6)
    for j in range(start, stop):
        for i in range(columns):
            if not suspects[j, i]:
                continue
            sigma = window[j, i] / math.sqrt(4 * math.pi)
            gap, power = GAP * window[j, i], 2 * noise[j, i] ** 2
            half = math.ceil(REACH * sigma / 2)
            side, px, py = 2 * half + 1, x0 + i * step, y0 + j * step
            own, other, known = np.empty((side, side)), np.empty(side), np.zeros(side, np.bool_)
            scratch = np.empty((3 + scratch_rows(taps), side))
            tone = (1.0, 0.0)
            if light.size:
                tone = (float(light[j, i, 0]), float(light[j, i, 1]))
            for k in range(6):
                mine[k] = maps[k, j, i]
            for ring in range(reach.shape[0]):
                r = reach[ring, j, i]
                for dj in range(-r, r + 1, r):
                    for di in range(-r, r + 1, r):
                        y, x = j + dj, i + di
                        if found[j, i] or y < 0 or x < 0 or y >= rows or x >= columns or not asked[y, x]:
                            continue
                        if not _differs(maps, variances, bend[j, i], j, i, dj, di, step, predicted):
                            continue
                        length = math.hypot(di, dj)
                        ahead = di / length, dj / length
                        clear = _evidence(
                            frames, share, mine, predicted, px, py, tone, ahead, sigma, gap, power, floor[j, i],
                            scratch, own, known, other,
                        )  # fmt: skip
                        found[j, i] = clear > EVIDENCE
