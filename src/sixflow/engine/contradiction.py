"""Contradiction: kernels that ask whether the motion of a grid point goes on into that of its neighbours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.engine.compiler import kernel
from sixflow.engine.neighbours import AGREEMENT, median, neighbours

QUESTIONS = 8
"""Two components in four directions."""
ERRORS = normal_limit(QUESTIONS)
"""Standard errors that two predictions of a displacement may differ by."""
STANDS_OUT, LEAST_RESIDUAL = 3.0, 0.1
"""Times the neighbours' median; of a zero-normalised residual."""
GRADIENT_AGREEMENT = 0.005
"""Difference of displacement gradients that is never held against a point."""


@kernel
def variances_strip(covariance: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    """Variances of u, v, u_x, u_y, v_x, v_y from the covariance of the six, grid rows start … stop."""
    for j in range(start, stop):
        for i in range(out.shape[2]):
            C = covariance[j, i]
            along, across = (C[2, 2] + C[4, 4]) / 4, (C[5, 5] + C[3, 3]) / 4
            out[0, j, i], out[1, j, i] = max(C[0, 0], 0.0), max(C[1, 1], 0.0)
            out[2, j, i], out[5, j, i] = max(along + C[2, 4] / 2, 0.0), max(along - C[2, 4] / 2, 0.0)
            out[3, j, i], out[4, j, i] = max(across - C[3, 5] / 2, 0.0), max(across + C[3, 5] / 2, 0.0)


@kernel
def disagreement_strip(
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
                floor = AGREEMENT + smooth * slope
                if not apart > worst[j, i] * floor:  # no noise would make it less
                    continue
                variance = variances[c, j - dj, i - di] + variances[c, j + dj, i + di]
                variance += hx * hx * (variances[gx, j - dj, i - di] + variances[gx, j + dj, i + di])
                variance += hy * hy * (variances[gy, j - dj, i - di] + variances[gy, j + dj, i + di])
                ratio = apart / (ERRORS * math.sqrt(variance) + floor)
                if ratio > worst[j, i]:
                    worst[j, i] = ratio


@kernel
def apart_strip(
    maps: NDArray[Any],
    variances: NDArray[Any],
    reach: int,
    step: int,
    start: int,
    stop: int,
    apart: NDArray[Any],
) -> None:
    """Median of the squared distances between a point's displacement and what its neighbours predict, with the
    variance of each; NaN where fewer than three are known.
    """
    rows, columns = maps.shape[1:]
    around = np.empty(8)
    for j in range(start, stop):
        for i in range(columns):
            count = 0
            for dj in range(-reach, reach + 1, reach):
                for di in range(-reach, reach + 1, reach):
                    y, x = j + dj, i + di
                    if (dj == 0 and di == 0) or y < 0 or x < 0 or y >= rows or x >= columns:
                        continue
                    square, hx, hy = 0.0, di * step, dj * step
                    for c in range(2):
                        gx, gy = 2 + 2 * c, 3 + 2 * c
                        predicted = maps[c, y, x] - maps[gx, y, x] * hx - maps[gy, y, x] * hy
                        square += (predicted - maps[c, j, i]) ** 2 + variances[c, j, i]
                    if square == square:
                        around[count] = square
                        count += 1
            apart[j, i] = median(around, count) if count >= 3 else np.nan


@kernel
def stands_out_strip(
    noise: NDArray[Any], residual: NDArray[Any], reach: int, start: int, stop: int, found: NDArray[Any]
) -> None:
    """Windows whose residual is far above that of the windows around, grid rows start … stop."""
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


@kernel
def gradient_outliers_strip(
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
            if not abs(here - slope) > 3 * GRADIENT_AGREEMENT + abs(here) / 2:
                continue
            tolerance = 2 * math.sqrt(variance[j, i]) + GRADIENT_AGREEMENT
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
