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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.hermite import slopes_along


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
    slopes_x, slopes_y = maps[[2, 4]], maps[[3, 5]]
    nodes_x, nodes_y = (step * np.arange(size, dtype=maps.dtype) for size in maps.shape[:0:-1])
    return (slopes_along(slopes_x, nodes_y, -2) + slopes_along(slopes_y, nodes_x, -1)) / 2


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
