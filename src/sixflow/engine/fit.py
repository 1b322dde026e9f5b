"""Fit: affine fits of a blended displacement under a Gaussian window, from taps on the points of its grid.

The blend is a tensor product, f(x, y) = Σ_ij h_i(x) h_j(y) f_ij + …, h_i the Hermite functions of value and slope at
the points of an axis (`blend`), and so are the window and a rectangle of pixels that count. Under such a product the
fit of c + a (x − p_x) + b (y − p_y) falls apart into one-dimensional means E and regressions S. With m the mean of
x − p_x under the window, not 0 where the rectangle cuts it,

    E f = Σ w f / Σ w,    S f = Σ w (x − p_x − m_x) f / Σ w (x − p_x − m_x)²,
    a = S_x E_y f,    b = E_x S_y f,    c = E_x E_y f − m_x a − m_y b,

all of them sums over a few points along each axis: what is done on the grid costs nothing per pixel.

| symbol | name |
|---|---|
| E, S of h_i, for value and slope | `Taps.weights` |
| m | `Taps.offset` |
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.lines import fill_line
from sixflow.engine.window import CUT

LEAST_LEFT = 1e-6
"""Share of a whole window's variance that is left of one, below which there is no fit."""


class Taps(NamedTuple):
    """How the fit at each point of an axis depends on the points around it.

    Attributes
    ----------
    weights : array, shape (2, 2, taps, points)
        Of E and S; of the value and the slope (per px) of the point `tap − reach` further.
    offset : array, shape (points,)
        m, px.
    """

    weights: NDArray[Any]
    offset: NDArray[Any]


@lru_cache(maxsize=128)
def taps_of(
    origin: float, step: float, count: int, counted: tuple[int, int], sigma: float, dtype: str
) -> Taps:
    """Taps of the points origin + i·step, where the pixels counted[0] … counted[1] (exclusive) count.

    A point with too little of its window left for a fit keeps its value and slope.
    """
    reach = math.ceil(CUT * sigma)
    point = origin + step * np.arange(count)[:, None]
    pixel = np.rint(point) + np.arange(-reach, reach + 1)
    d = pixel - point
    w = np.exp(-(d**2) / (2 * sigma**2)) * ((pixel >= counted[0]) & (pixel < counted[1]))
    with np.errstate(invalid="ignore", divide="ignore"):
        w = w / w.sum(axis=1)[:, None]
        m = (w * d).sum(axis=1)
        variance = (w * (d - m[:, None]) ** 2).sum(axis=1)
        slope = w * (d - m[:, None]) / variance[:, None]
    known = variance > LEAST_LEFT * sigma**2
    node, basis = _hermite_of((pixel - origin) / step, step, count)
    far = math.ceil((reach + 1) / step) + 1
    place = node - np.arange(count)[:, None] + far  # of the point before each pixel, among the taps
    weights = np.zeros((2, 2, 2 * far + 1, count))
    column = np.broadcast_to(np.arange(count)[:, None], place.shape)
    for k, functional in enumerate((w, slope)):
        shares = np.where(known[:, None], functional, 0.0)
        for part in range(4):  # value and slope of the point before, of the point after
            np.add.at(weights[k, part % 2], (place + part // 2, column), shares * basis[part])
        weights[k, k, far, ~known] = 1.0
    return Taps(weights.astype(dtype), np.where(known, m, 0.0).astype(dtype))


def _hermite_of(
    place: NDArray[Any], step: float, count: int
) -> tuple[NDArray[np.int64], tuple[NDArray[np.float64], ...]]:
    """Point before every place, in steps, and the interpolant's weights there and after it; straight lines beyond."""
    inside = np.clip(place, 0, count - 1)
    node = np.clip(np.floor(inside), 0, max(count - 2, 0))
    t, beyond = inside - node, (place - inside) * step
    a, b = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * step
    c, d = t**2 * (3 - 2 * t), t**2 * (t - 1) * step
    return node.astype(np.int64), (a, b + beyond * (t == 0), c, d + beyond * (t == 1))


@inner
def _twist_row(maps: NDArray[Any], c: int, j: int, step: float, out: NDArray[Any]) -> None:
    """Mixed derivative of row j, as `blend.twist_of`."""
    rows, columns = maps.shape[1:]
    kind = maps.dtype.type
    along, across = maps[2 + 2 * c], maps[3 + 2 * c]
    share = kind(1 / (2 * step))
    half, three, four = kind(0.5), kind(1.5), kind(2)
    fill_line(out, 0, columns, 0.0)
    if rows == 2:
        for i in range(columns):
            out[i] += share * (along[1, i] - along[0, i])
    elif rows > 2 and 0 < j < rows - 1:
        below, above = along[j + 1], along[j - 1]
        for i in range(columns):
            out[i] += share * half * (below[i] - above[i])
    elif rows > 2:
        inward = 1 if j == 0 else -1
        sign = share * kind(inward)
        here, next_, third = along[j], along[j + inward], along[j + 2 * inward]
        for i in range(columns):
            out[i] += sign * (four * next_[i] - three * here[i] - half * third[i])
    line = across[j]
    if columns == 2:
        for i in range(2):
            out[i] += share * (line[1] - line[0])
    elif columns > 2:
        for i in range(1, columns - 1):
            out[i] += share * half * (line[i + 1] - line[i - 1])
        end = columns - 1
        out[0] += share * (four * line[1] - three * line[0] - half * line[2])
        out[end] -= share * (four * line[end - 1] - three * line[end] - half * line[end - 2])


@inner
def _add_down(planes: NDArray[Any], weights: NDArray[Any], j: int, out: NDArray[Any]) -> None:
    """Out += Σ over the taps of row j of weight times row of a plane."""
    rows, columns = planes.shape
    taps = weights.shape[0]
    far = taps // 2
    first, last = max(0, far - j), min(taps, rows + far - j)
    t = first
    while t + 3 < last:
        f0, f1, f2, f3 = (
            planes[j + t - far], planes[j + t + 1 - far], planes[j + t + 2 - far], planes[j + t + 3 - far],
        )  # fmt: skip
        w0, w1, w2, w3 = weights[t, j], weights[t + 1, j], weights[t + 2, j], weights[t + 3, j]
        for i in range(columns):
            out[i] += (w0 * f0[i] + w1 * f1[i]) + (w2 * f2[i] + w3 * f3[i])
        t += 4
    while t < last:
        f, w = planes[j + t - far], weights[t, j]
        for i in range(columns):
            out[i] += w * f[i]
        t += 1


@inner
def _add_across(line: NDArray[Any], weights: NDArray[Any], out: NDArray[Any]) -> None:
    """out[i] += Σ_t weights[t, i] line[i + t]; the line goes on by half the taps on both sides."""
    taps, n = weights.shape
    t = 0
    while t + 1 < taps:
        f0, f1 = line[t : t + n], line[t + 1 : t + 1 + n]
        w0, w1 = weights[t], weights[t + 1]
        for i in range(n):
            out[i] += w0[i] * f0[i] + w1[i] * f1[i]
        t += 2
    while t < taps:
        f, w = line[t : t + n], weights[t]
        for i in range(n):
            out[i] += w[i] * f[i]
        t += 1


@kernel
def twist_strip(maps: NDArray[Any], step: float, start: int, stop: int, out: NDArray[Any]) -> None:
    """Mixed derivatives u_xy, v_xy of the grid rows start … stop; out of shape (2, rows, columns)."""
    for j in range(start, stop):
        for c in range(2):
            _twist_row(maps, c, j, step, out[c, j])


@kernel
def fit_strip(
    maps: NDArray[Any], twist: NDArray[Any], axes: tuple[Taps, Taps], step: tuple[NDArray[Any], NDArray[Any]],
    before: NDArray[Any], rows: tuple[int, int], out: NDArray[Any], totals: NDArray[Any],
) -> None:  # fmt: skip
    """A step of a recurrence at the grid rows first … last (exclusive): out = a fit + b maps + c before.

    Parameters
    ----------
    maps, twist : arrays, shape (6, rows, columns) and (2, rows, columns)
    axes : (Taps, Taps)
        Of the rows and of the columns.
    step : arrays of shape (3,) and (sums,)
        a, b and c; and how much of `out` each of the totals is to have.
    before : array like `maps`
    rows : (int, int)
    out : array like `maps`
    totals : array, shape (sums, 6, rows, columns)
        Added to.
    """
    columns, (down, across), (shares, parts) = maps.shape[2], axes, step
    far, kind = across.weights.shape[2] // 2, maps.dtype
    lines, m_x = np.zeros((4, columns + 2 * far), kind), across.offset
    for j in range(rows[0], rows[1]):
        m_y = down.offset[j]
        for c in range(2):
            value, slope_x, slope_y = maps[c], maps[2 + 2 * c], maps[3 + 2 * c]
            for k in range(2):  # E and S along y, of the value and of the slope along x
                one, other = lines[k], lines[2 + k]
                fill_line(one, far, far + columns, 0.0)
                _add_down(value, down.weights[k, 0], j, one[far : far + columns])
                _add_down(slope_y, down.weights[k, 1], j, one[far : far + columns])
                fill_line(other, far, far + columns, 0.0)
                _add_down(slope_x, down.weights[k, 0], j, other[far : far + columns])
                _add_down(twist[c], down.weights[k, 1], j, other[far : far + columns])
            mean, along, below = out[c, j], out[2 + 2 * c, j], out[3 + 2 * c, j]
            for target, k, kind_x in ((mean, 0, 0), (along, 0, 1), (below, 1, 0)):
                fill_line(target, 0, columns, 0.0)
                _add_across(lines[k], across.weights[kind_x, 0], target)
                _add_across(lines[2 + k], across.weights[kind_x, 1], target)
            for i in range(columns):
                mean[i] -= m_x[i] * along[i] + m_y * below[i]
        for p in range(6):
            target, here, last = out[p, j], maps[p, j], before[p, j]
            for i in range(columns):
                target[i] = shares[0] * target[i] + shares[1] * here[i] + shares[2] * last[i]
            for n in range(parts.size):
                total, part = totals[n, p, j], parts[n]
                for i in range(columns):
                    total[i] += part * target[i]
