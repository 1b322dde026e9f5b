"""Evidence: kernels that ask the pixels beside a point which motion they follow.

A pixel with the residual r, whose variance noise and the fit let expect to be s², costs a motion

    c = min(r²/2s², C)

nats: the logarithm of its likelihood, but a pixel that follows neither of two motions decides nothing between them, and
none says more alone than C, the evidence that the rate of false alarms asks for (`sixflow.chance`).

    s² = 2 noise² + e² |g|²

e is the displacement that no fit resolves, px. Residuals are scaled as in `sweep`: noise makes r² = 2 noise². What a
window is known to leave out, b px, costs min(b² |g|²/2s², C), which needs no other motion to be explained. How well a
pixel can tell two motions apart, t = min((r − r′)²/2s², C), is how far what they show of the moved frame differs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.interpolate import Interpolant, scratch_rows, warp_row


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


class Cost(NamedTuple):
    """What the pixels cost the motion as it is known; arrays of shape (height, width).

    Attributes
    ----------
    cost : array
        c; 0 where a pixel has no partner.
    power : array
        s²; 0 where a pixel has no partner.
    explained : array
        What the cost holds of what windows leave out.
    residual : array
        r; NaN where a pixel has no partner.
    most : float
        C.
    """

    cost: NDArray[Any]
    power: NDArray[Any]
    explained: NDArray[Any]
    residual: NDArray[Any]
    most: float


class Other(NamedTuple):
    """Another motion about the points of a grid, and how it is compared.

    Attributes
    ----------
    maps : array, shape (6, rows, columns)
    light : array, shape (rows, columns, 2), or of size 0
        Gain and offset.
    grid : (int, int, int)
        x0, y0, step.
    taps : int
        Of the splines, along one axis.
    """

    maps: NDArray[Any]
    light: NDArray[Any]
    grid: tuple[int, int, int]
    taps: int


@kernel
def _nearest(place: int, first: int, step: int, count: int) -> int:
    """Grid row or column that a pixel row or column is nearest to."""
    return min(max((place - first + step // 2) // step, 0), count - 1)


@kernel
def cost_strip(
    gradient_x: NDArray[Any], gradient_y: NDArray[Any], noise: NDArray[Any], bias: NDArray[Any], least: float,
    grid: tuple[int, int, int], start: int, stop: int, made: Cost,
) -> None:  # fmt: skip
    """Cost of the rows start … stop.

    Parameters
    ----------
    gradient_x, gradient_y : arrays, shape (height, width)
    noise, bias : arrays, shape (rows, columns)
        2 noise² and b² about the points of a grid.
    least : float
        e².
    grid : (int, int, int)
        x0, y0, step.
    made : Cost
        Cost, power and what is explained are written.
    """
    residual = made.residual
    (x0, y0, step), (rows, columns) = grid, noise.shape
    for y in range(start, stop):
        j = _nearest(y, y0, step, rows)
        for x in range(residual.shape[1]):
            r = residual[y, x]
            if r != r:
                made.cost[y, x], made.power[y, x], made.explained[y, x] = 0, 0, 0
                continue
            i = _nearest(x, x0, step, columns)
            square = gradient_x[y, x] * gradient_x[y, x] + gradient_y[y, x] * gradient_y[y, x]
            power = noise[j, i] + least * square
            made.power[y, x] = power
            made.cost[y, x] = min(r * r / (2 * power), made.most) if power > 0 else 0
            made.explained[y, x] = min(bias[j, i] * square / (2 * power), made.most) if power > 0 else 0


@kernel
def differing_strip(
    maps: NDArray[Any], variances: NDArray[Any], bend: NDArray[Any], asked: NDArray[Any], judged: NDArray[Any],
    reach: NDArray[Any], step: int, limit: float, start: int, stop: int, found: NDArray[Any],
) -> None:  # fmt: skip
    """Which neighbours predict another motion for the points of grid rows start … stop.

    Parameters
    ----------
    maps, variances : arrays, shape (6, rows, columns)
    bend : array, shape (rows, columns)
        By how much curvature makes neighbours mispredict a point, px.
    asked, judged : bool arrays of the same shape
        Whose motion is told, and to whom.
    reach : int array, shape (rings, rows, columns)
        Distance of the neighbours, grid points.
    limit : float
        Standard errors.
    found : bool array, shape (8 · rings, rows, columns)
        Receives who differs, by ring and direction (`DIRECTIONS`).
    """
    rows, columns = judged.shape
    for j in range(start, stop):
        for i in range(columns):
            if not judged[j, i]:
                continue
            for ring in range(reach.shape[0]):
                for n in range(8):
                    hi, hj = DIRECTIONS[n][0] * reach[ring, j, i], DIRECTIONS[n][1] * reach[ring, j, i]
                    y, x = j + hj, i + hi
                    if y < 0 or x < 0 or y >= rows or x >= columns or not asked[y, x]:
                        continue
                    hx, hy = hi * step, hj * step
                    for c in range(2):
                        gx, gy = 2 + 2 * c, 3 + 2 * c
                        told = maps[c, y, x] - hx * maps[gx, y, x] - hy * maps[gy, y, x]
                        beyond = max(abs(told - maps[c, j, i]) - bend[j, i], 0.0)
                        if beyond * beyond > limit * limit * variances[c, j, i]:
                            variance = variances[c, j, i] + variances[c, y, x]
                            variance += hx * hx * variances[gx, y, x] + hy * hy * variances[gy, y, x]
                            if beyond * beyond > limit * limit * variance:
                                found[8 * ring + n, j, i] = True


DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""(column, row) of the eight neighbours."""


@kernel
def _compare(
    frames: Compared, motion: NDArray[Any], light: tuple[float, float], place: tuple[int, int, int],
    scratch: NDArray[Any], out: NDArray[Any],
) -> None:  # fmt: skip
    """Residuals of one map about a point, in the pixels of a row from (column, row); the third of `place` is the
    point's distance to the left of the first one, and `motion` is that at the row.
    """
    share, still, count = frames.share, frames.still, out.size
    first, row, ahead = place
    u, v, before, noise, noise_before, taps = (
        scratch[0], scratch[1], scratch[2], scratch[3], scratch[4], scratch[5:],
    )  # fmt: skip
    valid = frames.before.valid
    for part in range(2):  # frame 1, then frame 0
        way = 1 - share if part == 0 else -share
        for a in range(count):
            u[a] = first + way * (motion[0] + motion[2] * (a + ahead))  # the row's pixels count from 0
            v[a] = way * (motion[1] + motion[4] * (a + ahead))
        if part == 0:
            warp_row(frames.after, u, v, row, taps, out, noise)
        elif share > 0:
            warp_row(frames.before, u, v, row, taps, before, noise_before)
    for a in range(count):
        if share == 0:
            before[a], noise_before[a] = still[row, first + a], 1
            if valid.size and valid[row, first + a] == 0:
                before[a] = np.nan
        r = (out[a] - light[1]) / light[0] - before[a]
        out[a] = r * math.sqrt(2 / (noise[a] / (light[0] * light[0]) + noise_before[a]))


@kernel
def _other_row(
    frames: Compared, other: Other, j: int, i: int, y: int, scratch: NDArray[Any], line: NDArray[Any]
) -> tuple[int, int]:
    """Residuals of the other motion in row y of a point's cell into `line`; its first column, and how many."""
    x0, y0, step = other.grid
    first, below, motion = x0 + i * step - step // 2, y - (y0 + j * step), np.empty(6)
    left, right = max(first, 0), min(first + step, frames.still.shape[1])
    tone = (1.0, 0.0)
    if other.light.size:
        tone = (float(other.light[j, i, 0]), float(other.light[j, i, 1]))
    for c in range(2):
        motion[c] = other.maps[c, j, i] + other.maps[3 + 2 * c, j, i] * below
        motion[2 + 2 * c] = other.maps[2 + 2 * c, j, i]
    count = right - left
    _compare(frames, motion, tone, (left, y, left - (x0 + i * step)), scratch[:, :count], line[:count])
    return left, count


@kernel
def _rows_of(other: Other, j: int, height: int) -> tuple[int, int]:
    """First and last (exclusive) row of the cells of a grid row."""
    top = other.grid[1] + j * other.grid[2] - other.grid[2] // 2
    return max(top, 0), min(top + other.grid[2], height)


@kernel
def gain_strip(
    frames: Compared, own: Cost, other: Other, wanted: NDArray[Any], start: int, stop: int, saved: NDArray[Any],
    told: NDArray[Any],
) -> None:  # fmt: skip
    """What other motions save the pixels, and t; grid rows start … stop.

    Saved is c of the known motion, less what of it is explained, less c of the other.

    Parameters
    ----------
    frames : Compared
    own : Cost
    other : Other
    wanted : bool array, shape (rows, columns)
        Points whose cells, the pixels nearest to them, are compared.
    saved, told : arrays, shape (height, width)
        Receive both in the cells that are wanted, but where a pixel has no partner.
    """
    scratch, line = np.empty((5 + scratch_rows(other.taps), other.grid[2])), np.empty(other.grid[2])
    for j in range(start, stop):
        top, bottom = _rows_of(other, j, own.cost.shape[0])
        for i in range(wanted.shape[1]):
            if not wanted[j, i]:
                continue
            for y in range(top, bottom):
                left, count = _other_row(frames, other, j, i, y, scratch, line)
                for a in range(count):
                    power, r = own.power[y, left + a], line[a]
                    if power > 0 and r == r:
                        own_cost = own.cost[y, left + a] - own.explained[y, left + a]
                        saved[y, left + a] = own_cost - min(r * r / (2 * power), own.most)
                        apart = r - own.residual[y, left + a]
                        told[y, left + a] = min(apart * apart / (2 * power), own.most)


@kernel
def out_strip(
    frames: Compared, own: Cost, other: Other, start: int, stop: int, tried: NDArray[Any]
) -> None:  # fmt: skip
    """Take out, of the points of grid rows start … stop that are tried, those whose cells cost
    the other motion more.

    Two rows of the cell, a quarter from its top and from its bottom, are enough where they cost C more (Wald).

    Parameters
    ----------
    frames : Compared
    own : Cost
    other : Other
    tried : bool array, shape (rows, columns)
        Written.
    """
    scratch, line = np.empty((5 + scratch_rows(other.taps), other.grid[2])), np.empty(other.grid[2])
    for j in range(start, stop):
        top, bottom = _rows_of(other, j, own.cost.shape[0])
        for i in range(tried.shape[1]):
            if not tried[j, i]:
                continue
            more, quarter = 0.0, (bottom - top) // 4
            for y in (top + quarter, bottom - 1 - quarter):
                left, count = _other_row(frames, other, j, i, y, scratch, line)
                for a in range(count):
                    power, r = own.power[y, left + a], line[a]
                    if power > 0 and r == r:
                        own_cost = own.cost[y, left + a] - own.explained[y, left + a]
                        more += min(r * r / (2 * power), own.most) - own_cost
            tried[j, i] = more < own.most


@kernel
def mean_strip(
    images: NDArray[Any], half: NDArray[Any], grid: tuple[int, int, int], wanted: NDArray[Any], start: int,
    stop: int, means: NDArray[Any],
) -> None:  # fmt: skip
    """Means of images in the discs about those points of grid rows start … stop that are wanted.

    Parameters
    ----------
    images : array, shape (images, height, width)
    half : array
        Weights of pixels along an axis by their distance from the point.
    wanted : bool array, shape (rows, columns)
    means : array, shape (images, rows, columns)
        Receives the means; as it was elsewhere.
    """
    (x0, y0, step), reach = grid, half.size - 1
    count, height, width = images.shape
    sums = np.empty(count)
    for j in range(start, stop):
        for i in range(wanted.shape[1]):
            if not wanted[j, i]:
                continue
            row, column, total = y0 + j * step, x0 + i * step, 0.0
            sums[:] = 0
            for y in range(max(row - reach, 0), min(row + reach + 1, height)):
                for x in range(max(column - reach, 0), min(column + reach + 1, width)):
                    weight = half[abs(y - row)] * half[abs(x - column)]
                    total += weight
                    for k in range(count):
                        sums[k] += weight * images[k, y, x]
            for k in range(count):
                means[k, j, i] = sums[k] / total
