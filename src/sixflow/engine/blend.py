"""Blend: one dense displacement from the local affine maps of a grid.

Every grid point p carries a local affine map d + G(x − p). Between the points the displacement is the
bicubic Hermite interpolant of d and G, with the mixed derivative from central differences of G. It
agrees with value and gradient at every grid point, reproduces affine maps exactly and smooth fields to
fourth order in the step, so that a fine displacement is not damped by the blend. Beyond the outermost
points it goes on along straight lines. `hermite` is the same interpolant for any place, in NumPy.

| symbol | name |
|---|---|
| (d, G) | maps: planes u, v, u_x, u_y, v_x, v_y |
| ∂²U/∂x∂y | twist: planes u_xy, v_xy |
| p | column x0 + i·step, row y0 + j·step |
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel


def twist_of(maps: NDArray[Any], step: float) -> NDArray[Any]:
    """Mixed second derivatives u_xy, v_xy at the grid points: mean of ∂u_x/∂y and ∂u_y/∂x by central
    differences.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    step : float
        Grid spacing, px.

    Returns
    -------
    array, shape (2, rows, columns), 1/px; 0 where the grid has a single row or column
    """
    return (_slopes(maps[[2, 4]], -2) + _slopes(maps[[3, 5]], -1)) / (2 * step)


def _slopes(planes: NDArray[Any], axis: int) -> NDArray[Any]:
    """Differences per grid point: central, at the edges one-sided, both of second order
    (`hermite.slopes_along`, without NaN).
    """
    planes = np.moveaxis(planes, axis, -1)
    slopes = np.zeros_like(planes)
    if planes.shape[-1] > 2:
        slopes[..., 1:-1] = (planes[..., 2:] - planes[..., :-2]) / 2
        slopes[..., 0] = 2 * planes[..., 1] - 1.5 * planes[..., 0] - 0.5 * planes[..., 2]
        slopes[..., -1] = 1.5 * planes[..., -1] - 2 * planes[..., -2] + 0.5 * planes[..., -3]
    elif planes.shape[-1] == 2:
        slopes[:] = planes[..., 1:] - planes[..., :1]
    return np.moveaxis(slopes, -1, axis)


@inner
def hermite(t: float) -> tuple[float, float, float, float]:
    """Weights of (value, slope, next value, next slope) at t ∈ [0, 1]; slopes per unit of t."""
    return (1 + 2 * t) * (1 - t) * (1 - t), t * (1 - t) * (1 - t), t * t * (3 - 2 * t), t * t * (t - 1)


@kernel
def blend_row(
    value: NDArray[Any],
    slope_x: NDArray[Any],
    slope_y: NDArray[Any],
    twist: NDArray[Any],
    x0: int,
    y0: int,
    step: int,
    y: int,
    basis: NDArray[Any],
    line: NDArray[Any],
    out: NDArray[Any],
) -> None:
    """One component of the dense displacement along pixel row y.

    `value`, `slope_x`, `slope_y` and `twist` are planes (rows, columns) of one component; `basis` is
    from `hermite_basis`; `line` is scratch of shape (2, columns); `out` has one element per pixel of
    the row.
    """
    rows, columns = value.shape
    j = (y - y0) // step
    if y < y0 or rows == 1 or j >= rows - 1:
        j = min(max(j, 0), rows - 1)
        beyond = y - (y0 + j * step)
        for i in range(columns):
            line[0, i] = value[j, i] + beyond * slope_y[j, i]
            line[1, i] = step * (slope_x[j, i] + beyond * twist[j, i])
    else:
        a, b, c, d = hermite((y - y0 - j * step) / step)
        b, d = b * step, d * step
        for i in range(columns):
            line[0, i] = a * value[j, i] + b * slope_y[j, i] + c * value[j + 1, i] + d * slope_y[j + 1, i]
            line[1, i] = step * (
                a * slope_x[j, i] + b * twist[j, i] + c * slope_x[j + 1, i] + d * twist[j + 1, i]
            )
    expand_row(line[0], line[1], x0, step, basis, out)


@inner
def expand_row(
    value: NDArray[Any], slope: NDArray[Any], x0: int, step: int, basis: NDArray[Any], out: NDArray[Any]
) -> None:
    """Hermite interpolant along a row, from values and slopes (times the step) at the columns x0 + i·step."""
    columns, width = value.size, out.size
    first, last = min(x0, width), min(x0 + (columns - 1) * step, width)
    for x in range(first):
        out[x] = value[0] + (x - x0) / step * slope[0]
    w0, w1, w2, w3 = basis[0], basis[1], basis[2], basis[3]
    for i in range(columns - 1):
        low = x0 + i * step
        target = out[low : min(low + step, width)]
        a0, b0, a1, b1 = value[i], slope[i], value[i + 1], slope[i + 1]
        for t in range(target.size):
            target[t] = (w0[t] * a0 + w1[t] * b0) + (w2[t] * a1 + w3[t] * b1)
    end = columns - 1
    for x in range(last, width):
        out[x] = value[end] + (x - x0 - end * step) / step * slope[end]


class Blender(NamedTuple):
    """The two rows of a grid around a pixel row, expanded to all its pixels: work space of `blend_line`.

    Attributes
    ----------
    held : int array, shape (2,)
        The grid rows that are in `lines`, the even and the odd one; −1 for none.
    lines : array, shape (2, 2, 2, width)
        By even or odd, u or v, the displacement or its slope along y.
    basis, slopes : arrays, shape (4, step), (columns,)
    """

    held: NDArray[np.int64]
    lines: NDArray[Any]
    basis: NDArray[Any]
    slopes: NDArray[Any]


@inner
def blender(maps: NDArray[Any], step: int, width: int) -> Blender:
    """Work space of `blend_line` for rows of so many pixels."""
    basis = np.empty((4, step), maps.dtype)
    hermite_basis(step, basis)
    held = np.empty(2, np.int64)
    held[0] = held[1] = -1
    return Blender(held, np.empty((2, 2, 2, width), maps.dtype), basis, np.empty(maps.shape[2], maps.dtype))


@inner
def _hold(
    maps: NDArray[Any], twist: NDArray[Any], grid: tuple[int, int, int], row: int, work: Blender
) -> None:
    """Expand a row of the grid, unless that has been done."""
    x0, _, step = grid
    place = row % 2
    if work.held[place] == row:
        return
    work.held[place] = row
    slopes = work.slopes
    for c in range(2):
        for part in range(2):
            value = maps[c, row] if part == 0 else maps[3 + 2 * c, row]
            slope = maps[2 + 2 * c, row] if part == 0 else twist[c, row]
            for i in range(slopes.size):
                slopes[i] = slope[i] * step
            expand_row(value, slopes, x0, step, work.basis, work.lines[place, c, part])


@inner
def blend_line(
    maps: NDArray[Any], twist: NDArray[Any], grid: tuple[int, int, int], y: int, component: int, work: Blender,
    out: NDArray[Any],
) -> None:  # fmt: skip
    """Component 0 (u) or 1 (v) of the dense displacement along pixel row y.

    The interpolant is `blend_row`'s, along x first: rows of the grid are expanded once for all pixel rows around them.
    """
    _, y0, step = grid
    rows, kind = maps.shape[1], maps.dtype.type
    j = (y - y0) // step
    outside = y < y0 or rows == 1 or j >= rows - 1
    if outside:
        j = min(max(j, 0), rows - 1)
    after = j if outside else j + 1
    _hold(maps, twist, grid, j, work)
    _hold(maps, twist, grid, after, work)
    a, b, c, d = kind(1), kind(y - (y0 + j * step)), kind(0), kind(0)
    if not outside:
        w = hermite((y - y0 - j * step) / step)
        a, b, c, d = kind(w[0]), kind(w[1] * step), kind(w[2]), kind(w[3] * step)
    above, below = work.lines[j % 2, component], work.lines[after % 2, component]
    f0, s0, f1, s1 = above[0], above[1], below[0], below[1]
    for x in range(out.size):
        out[x] = (a * f0[x] + b * s0[x]) + (c * f1[x] + d * s1[x])


@kernel
def hermite_basis(step: int, basis: NDArray[Any]) -> None:
    """Weights of `hermite` at the `step` pixels of a cell, shape (4, step)."""
    for t in range(step):
        basis[0, t], basis[1, t], basis[2, t], basis[3, t] = hermite(t / step)


@kernel
def blend_strip(
    maps: NDArray[Any],
    twist: NDArray[Any],
    x0: int,
    y0: int,
    step: int,
    start: int,
    stop: int,
    u: NDArray[Any],
    v: NDArray[Any],
) -> None:
    """Dense displacement of the rows start … stop into u and v, shape (height, width)."""
    basis = np.empty((4, step), maps.dtype)
    line = np.empty((2, maps.shape[2]), maps.dtype)
    hermite_basis(step, basis)
    for y in range(start, stop):
        blend_row(maps[0], maps[2], maps[3], twist[0], x0, y0, step, y, basis, line, u[y])
        blend_row(maps[1], maps[4], maps[5], twist[1], x0, y0, step, y, basis, line, v[y])


@kernel
def resample_strip(
    maps: NDArray[Any],
    twist: NDArray[Any],
    grid: tuple[int, int, int],
    target: tuple[float, float, float],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Value and gradient of the blend at the points of another grid, rows start … stop of `out`, shape
    (6, rows, columns).

    `target` is (first column, first row, spacing) in pixels of the grid's own frame; nothing lies far
    beyond the grid.
    """
    x0, y0, step = grid
    rows, columns = maps.shape[1:]
    for j in range(start, stop):
        row, b, db = _cell(target[1] + j * target[2] - y0, step, rows)
        below = min(row + 1, rows - 1)
        for i in range(out.shape[2]):
            column, a, da = _cell(target[0] + i * target[2] - x0, step, columns)
            beside = min(column + 1, columns - 1)
            for k in range(2):
                value, slope_x, slope_y = maps[k], maps[2 + 2 * k], maps[3 + 2 * k]
                total, along, across = 0.0, 0.0, 0.0
                for n in range(4):
                    y, x = (row if n < 2 else below), (column if n % 2 == 0 else beside)
                    f, fx, fy, fxy = value[y, x], slope_x[y, x], slope_y[y, x], twist[k, y, x]
                    p, q = 2 * (n // 2), 2 * (n % 2)
                    low = a[q] * f + a[q + 1] * fx
                    high = a[q] * fy + a[q + 1] * fxy
                    total += b[p] * low + b[p + 1] * high
                    across += db[p] * low + db[p + 1] * high
                    along += b[p] * (da[q] * f + da[q + 1] * fx) + b[p + 1] * (da[q] * fy + da[q + 1] * fxy)
                out[k, j, i], out[2 + 2 * k, j, i], out[3 + 2 * k, j, i] = total, along, across


@inner
def _cell(
    offset: float, step: int, count: int
) -> tuple[int, tuple[float, float, float, float], tuple[float, float, float, float]]:
    """Node before an offset from the first node, Hermite weights there and their derivatives; slopes
    per pixel.

    Beyond the nodes the straight line through the last.
    """
    end = (count - 1) * step
    inside = min(max(offset, 0.0), end)
    node = min(int(inside // step), max(count - 2, 0))
    t = inside / step - node
    a, b, c, d = hermite(t)
    slope = (6 * t * (t - 1) / step, (1 - t) * (1 - 3 * t), 6 * t * (1 - t) / step, t * (3 * t - 2))
    beyond = offset - inside
    value = (
        a + beyond * slope[0],
        step * b + beyond * slope[1],
        c + beyond * slope[2],
        step * d + beyond * slope[3],
    )
    return node, value, slope
