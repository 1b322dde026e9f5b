"""Blend: one dense displacement from the local affine maps of a grid.

Every grid point p carries a local affine map d + G(x − p). Between the points the displacement is the bicubic Hermite
interpolant of d and G, with the mixed derivative from central differences of G. It agrees with value and gradient at every grid point, reproduces
affine maps exactly and smooth fields to fourth order in the step, so that a fine displacement is not damped by the blend.
Beyond the outermost points, the nearest point's affine map goes on.

| symbol | name |
|---|---|
| (d, G) | maps: planes u, v, u_x, u_y, v_x, v_y |
| ∂²U/∂x∂y | twist: planes u_xy, v_xy |
| p | column x0 + i·step, row y0 + j·step |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel


def twist_of(maps: NDArray[Any], step: float) -> NDArray[Any]:
    """Mixed second derivatives u_xy, v_xy at the grid points: mean of ∂u_x/∂y and ∂u_y/∂x by central differences.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    step : float
        Grid spacing, px.

    Returns
    -------
    array, shape (2, rows, columns), 1/px; 0 where the grid has a single row or column
    """
    twist = np.zeros((2, *maps.shape[1:]), maps.dtype)
    for k in range(2):
        for plane, axis in ((maps[3 + 2 * k], 1), (maps[2 + 2 * k], 0)):
            if plane.shape[axis] > 1:
                twist[k] += np.gradient(plane, step, axis=axis) / 2
    return twist


@kernel
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

    `value`, `slope_x`, `slope_y` and `twist` are planes (rows, columns) of one component; `basis` is from `hermite_basis`; `line` is
    scratch of shape (2, columns); `out` has one element per pixel of the row.
    """
    rows, columns = value.shape
    j = (y - y0) // step
    if y < y0 or rows == 1 or j >= rows - 1:
        j = min(max(j, 0), rows - 1)
        beyond = y - (y0 + j * step)
        for i in range(columns):
            line[0, i] = value[j, i] + beyond * slope_y[j, i]
            line[1, i] = step * slope_x[j, i]
    else:
        a, b, c, d = hermite((y - y0 - j * step) / step)
        b, d = b * step, d * step
        for i in range(columns):
            line[0, i] = a * value[j, i] + b * slope_y[j, i] + c * value[j + 1, i] + d * slope_y[j + 1, i]
            line[1, i] = step * (a * slope_x[j, i] + b * twist[j, i] + c * slope_x[j + 1, i] + d * twist[j + 1, i])
    width = out.size
    first, last = min(x0, width), min(x0 + (columns - 1) * step, width)
    for x in range(first):
        out[x] = line[0, 0] + (x - x0) / step * line[1, 0]
    value, slope = line[0], line[1]
    w0, w1, w2, w3 = basis[0], basis[1], basis[2], basis[3]
    for i in range(columns - 1):
        low = x0 + i * step
        target = out[low : min(low + step, width)]
        a0, b0, a1, b1 = value[i], slope[i], value[i + 1], slope[i + 1]
        for t in range(target.size):
            target[t] = (w0[t] * a0 + w1[t] * b0) + (w2[t] * a1 + w3[t] * b1)
    end = columns - 1
    for x in range(last, width):
        out[x] = line[0, end] + (x - x0 - end * step) / step * line[1, end]


@kernel
def hermite_basis(step: int, basis: NDArray[Any]) -> None:
    """Weights of `hermite` at the `step` pixels of a cell, shape (4, step)."""
    for t in range(step):
        basis[0, t], basis[1, t], basis[2, t], basis[3, t] = hermite(t / step)


def evaluate(maps: NDArray[Any], x0: float, y0: float, step: float, x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """Displacement and gradient of the blend at any points.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y at the grid points.
    x0, y0, step : float
        First column and row of the grid and its spacing, px.
    x, y : arrays that broadcast together
        Where, px.

    Returns
    -------
    float64 array, shape (6, *points)
        u, v, u_x, u_y, v_x, v_y; NaN where a surrounding grid point is NaN.

    Examples
    --------
    >>> maps = np.zeros((6, 2, 2)); maps[2] = 0.01; maps[0] = [[0, 0.08], [0, 0.08]]
    >>> evaluate(maps, 0, 0, 8, np.array(5.0), np.array(3.0))[[0, 2]].round(6).tolist()
    [0.05, 0.01]
    """
    x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    rows, columns = maps.shape[1:]
    # the nearest point on or between grid lines; what lies beyond it is affine
    inner_x = np.clip(x, x0, x0 + (columns - 1) * step)
    inner_y = np.clip(y, y0, y0 + (rows - 1) * step)
    i = np.clip(((inner_x - x0) // step).astype(np.int64), 0, max(columns - 2, 0))
    j = np.clip(((inner_y - y0) // step).astype(np.int64), 0, max(rows - 2, 0))
    next_i, next_j = np.minimum(i + 1, columns - 1), np.minimum(j + 1, rows - 1)
    along, across = _basis((inner_x - x0) / step - i, step), _basis((inner_y - y0) / step - j, step)
    maps64 = maps.astype(np.float64, copy=False)
    twist = twist_of(maps64, step)
    out = np.zeros((6, *x.shape))
    for component in range(2):
        planes = (maps64[component], maps64[2 + 2 * component], maps64[3 + 2 * component], twist[component])
        for row, (hv, hs) in ((j, (0, 1)), (next_j, (2, 3))):
            for column, (kv, ks) in ((i, (0, 1)), (next_i, (2, 3))):
                value, slope_x, slope_y, mixed = (plane[row, column] for plane in planes)
                for target, dx, dy in ((component, 0, 0), (2 + 2 * component, 1, 0), (3 + 2 * component, 0, 1)):
                    a, b = along[dx], across[dy]
                    out[target] += b[hv] * (a[kv] * value + a[ks] * slope_x) + b[hs] * (a[kv] * slope_y + a[ks] * mixed)
    for component in range(2):
        out[component] += out[2 + 2 * component] * (x - inner_x) + out[3 + 2 * component] * (y - inner_y)
    return out


def _basis(t: NDArray[Any], step: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Hermite weights of (value, slope, next value, next slope) and their derivatives, slopes per pixel."""
    value = np.stack([(1 + 2 * t) * (1 - t) ** 2, step * t * (1 - t) ** 2, t * t * (3 - 2 * t), step * t * t * (t - 1)])
    slope = np.stack([6 * t * (t - 1) / step, (1 - t) * (1 - 3 * t), 6 * t * (1 - t) / step, t * (3 * t - 2)])
    return value, slope
