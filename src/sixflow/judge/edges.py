"""Refute: does a motion from beyond the window fit the pixels beside a point better than the point's own?

Beside a motion edge a window follows the side with the stronger texture, or the edge's own contrast, also where its
point lies on the other side. The map is then smooth, its residual small, and no neighbour contradicts it: only the
pixels between the point and the other side do, which are few and faint. Here they are asked alone.

A neighbour n in one of eight directions e, one window or one and a half away, predicts the motion about the point p,
M_n(x) = d_n + G_n (x − n). Its window sees other pixels than that of p. Where it says something else than M_p, both are
tried on the pixels on its side of p, with weights w = exp(−|x − p|²/2s²) · [((x − p)·e − a)/2a] cut to 0 … 1:

    R_k = Σ w min(r_k², 100 ν²)/Σ w,    r_k = I₁(x + M_k) − I₀(x),    ν² = 2 noise²

    L = N/2 · (R_p − R_n)/max(min(R_p, R_n), ν₀²),     N = (Σ w)²/Σ w²

L is the logarithm of the likelihood ratio of n's motion to p's, with what the better of both leaves for noise: the
residual of the whole window, with the edge in it, would hide what the few pixels say. ν₀ is what rounding and
interpolation leave. Where there is noise alone, r_p and r_n share that of frame 0, so that r_p² − r_n² has a variance
of 3 ν⁴, and L one of 3 N/4. The point is refuted where L exceeds 3.5 of its standard deviations, L > 3.5 √(3N)/2, with
s = σ/2 or s = σ/4: with 16 neighbours and two sizes chance does it in about a percent of the points that are asked.
Where n's motion does not explain the pixels either, R_n > ν² (1 + 3 √(2/N)), something else is there, and L says
nothing.

*Smooth motion.* From a window away a curved field is mispredicted by much more than a window's own fit is wrong by:
for the shortest period that is resolved, by up to 1.2 of the amplitude, and by a tenth. So L is negative whatever the
noise. Chance is left where the two maps happen to agree. Therefore n is asked only if, in u or in v,

    |M_n(p) − M_p(p)| > 5 standard errors + 0.3 px + what half a window of curvature makes (`consistency.curvature`),

the last being three times what the window's own fit is wrong by.

*Sequence.* The pixels are asked row by row, from p outwards, until L < −8 in the larger disc and L < 0 in the smaller:
then n's motion is out (Wald's sequential test). In smooth motion one or two rows are enough.

| symbol | name |
|---|---|
| M | `maps` |
| σ | `sigma`, of the window about p |
| a | `GAP` windows: pixels nearer to p belong to the edge of either side |
| noise | `noise`, of one frame; not less than ν₀/√2 |
| ν₀ | `OF_CONTRAST` of frame 0's contrast |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.compiler import kernel
from sixflow.engine.interpolate import Interpolant, scratch_rows, warp_row
from sixflow.engine.spline import DEGREE
from sixflow.engine.threads import over_strips
from sixflow.judge.contradiction import curvature, gradient_variances
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame
from sixflow.refine.passes import OF_CONTRAST
from sixflow.refine.quality import Quality
from sixflow.settings import Settings

DISTANCES = (1.0, 1.5)
"""Of the neighbours, windows."""
EVIDENCE = 3.5
"""Standard deviations of L."""
EXPLAINED = 3.0
"""Standard deviations by which R_n may exceed ν²."""
REJECTED = -8.0
"""L of a motion that is asked no further."""
ERRORS = 5.0
FLOOR = 0.3  # px: what is finer than the window, and less than that, is left to stand
GAP = 1 / 31  # windows
FOREIGN = 100.0
"""Mean squares of noise beyond which a pixel's residual tells nothing more."""
_REACH = 2.5  # standard deviations of the larger disc
_STRIP = 4

Array = NDArray[np.float64]


@kernel
def _differs(
    maps: NDArray[Any], variances: NDArray[Any], bend: float, j: int, i: int, dj: int, di: int, step: int,
    told: NDArray[Any],
) -> bool:  # fmt: skip
    """Whether the neighbour (dj, di) says something else about (j, i); its map there into `told`."""
    y, x, hy, hx, found = j + dj, i + di, dj * step, di * step, False
    for c in range(2):
        gx, gy = 2 + 2 * c, 3 + 2 * c
        told[c] = maps[c, y, x] - hx * maps[gx, y, x] - hy * maps[gy, y, x]
        told[gx], told[gy] = maps[gx, y, x], maps[gy, y, x]
        beyond = abs(told[c] - maps[c, j, i]) - FLOOR - bend
        if beyond > 0:
            variance = variances[c, j, i] + variances[c, y, x]
            variance += hx * hx * variances[gx, y, x] + hy * hy * variances[gy, y, x]
            found = found or beyond > ERRORS * math.sqrt(variance)
    return found


@kernel
def _suspects_strip(
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
                        if abs(apart_u) > FLOOR or abs(apart_v) > FLOOR:
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
    share: float, mine: NDArray[Any], told: NDArray[Any], x: int, y: int, light: tuple[float, float],
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
        _compare_row(frames, share, told, x, y, below, light, scratch, other)
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
                sums[size, 2] += w * min(own[b, a] ** 2, FOREIGN * power)
                sums[size, 3] += w * min(other[a] ** 2, FOREIGN * power)
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
def _refuted_strip(
    frames: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]],
    maps: NDArray[Any], variances: NDArray[Any], bend: NDArray[Any], noise: NDArray[Any],
    light: NDArray[Any], asked: NDArray[Any], suspects: NDArray[Any], reach: NDArray[Any],
    window: NDArray[Any], grid: tuple[int, int, int], share: float, taps: int, floor: float, start: int, stop: int,
    found: NDArray[Any],
) -> None:  # fmt: skip
    """Try the neighbours' maps on the pixels of both frames; `found` receives who is refuted."""
    rows, columns = suspects.shape
    x0, y0, step = grid
    told, mine = np.empty(6), np.empty(6)
    for j in range(start, stop):
        for i in range(columns):
            if not suspects[j, i]:
                continue
            sigma = window[j, i] / math.sqrt(4 * math.pi)
            gap, power = GAP * window[j, i], 2 * noise[j, i] ** 2
            half = math.ceil(_REACH * sigma / 2)
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
                        if not _differs(maps, variances, bend[j, i], j, i, dj, di, step, told):
                            continue
                        length = math.hypot(di, dj)
                        ahead = di / length, dj / length
                        clear = _evidence(
                            frames, share, mine, told, px, py, tone, ahead, sigma, gap, power, floor, scratch,
                            own, known, other,
                        )  # fmt: skip
                        found[j, i] = clear > EVIDENCE


def _near(marked: NDArray[np.bool_], window: NDArray[Any], step: int) -> NDArray[np.bool_]:
    """Points within half a window of the marked ones."""
    if not marked.any():
        return marked
    reach = max(1, round(float(np.median(window[marked])) / 2 / step))
    return np.asarray(scipy.ndimage.maximum_filter(marked, 2 * reach + 1), dtype=np.bool_)


def refuted(
    still: Frame,
    moved: Frame,
    grid: Grid,
    maps: NDArray[Any],
    quality: Quality,
    flag: NDArray[np.uint16],
    window: NDArray[Any],
    settings: Settings,
) -> NDArray[np.bool_]:
    """Find points whose neighbours' motion fits the pixels on their side better than the point's own.

    Parameters
    ----------
    still, moved : Frame
        As they were compared.
    grid : Grid
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y, told where `settings.reference` says.
    quality : Quality
    flag : uint16 array, shape (rows, columns)
        Points that failed are not judged, nor those within half a window of what is said to be unresolved: there the
        fit is known to be wrong. Points at edges are asked for their motion, others that failed are not.
    window : array, shape (rows, columns)
        Window of each point, px.
    settings : Settings

    Returns
    -------
    bool array, shape (rows, columns)

    Examples
    --------
    `sixflow.measure` flags such points as `edge`. In a smooth field there are none:

    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.convention.flags import FLAGS
    >>> flow = synth.CellularVortices(amplitude=1.0, period=160.0)
    >>> made = synth.pair(synth.Speckle(), flow, (128, 128), sensor=synth.Sensor(noise=2))
    >>> int((sixflow.measure(made.frame0, made.frame1).flag.values & FLAGS["edge"]).sum())
    0
    """
    found = np.zeros(grid.shape, np.bool_)
    judged = ((flag & FAILING) == 0) & ~_near(flag & FLAGS["unresolved"] != 0, window, grid.step)
    asked = (flag & (FAILING - FLAGS["edge"])) == 0
    windows = np.nan_to_num(window, nan=float(grid.step)) / grid.step
    reach = np.stack([np.maximum(1, np.rint(part * windows)).astype(np.int64) for part in DISTANCES])
    suspects = np.zeros(grid.shape, np.bool_)
    over_strips(
        lambda a, b: _suspects_strip(maps, asked, judged, reach, grid.step, a, b, suspects),
        grid.rows,
        4 * _STRIP,
    )
    if not suspects.any():
        return found
    variances = gradient_variances(quality.covariance)
    bend = curvature(np.where(asked, maps, np.nan), grid.step, float(np.median(window[suspects])))
    degree, share = DEGREE[settings.interpolation], SHARE[settings.reference]
    none = np.empty((0, 0), still.image.dtype)
    frames = (
        still.image,
        still.coefficients(degree) if share else none,
        still.interpolable() if share else still.valid,
        moved.coefficients(degree),
        moved.interpolable(),
    )
    light = np.empty((0, 0, 2)) if quality.light is None else np.asarray(quality.light, np.float64)
    least = OF_CONTRAST / math.sqrt(2) * float(still.image[::4, ::4].std())
    noise = np.maximum(quality.noise, least)
    over_strips(
        lambda a, b: _refuted_strip(
            frames, maps, variances, bend, noise, light, asked, suspects, reach, window,
            grid.origin_and_step, share, degree + 1, 2 * least**2, a, b, found,
        ),
        grid.rows,
        _STRIP,
    )  # fmt: skip
    return found
