"""Array: kernels for an array of operators that stand on a lattice of positions (`sixflow.eigenfilters`).

| kernel | what it does |
|---|---|
| `fold_strip` | patches about the positions, folded about their centre |
| `product_strip` | A Bᵀ of every position with itself or a neighbour |
| `pool_strip` | Σ_q w M(d)ᵀ V_q M(d) about every grid point |

They are the loops of `eigenfilters.projection` and `eigenfilters.pool`, where the mathematics stands.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel


@kernel
def fold_strip(
    image: NDArray[Any],
    place: tuple[int, int, int],
    columns: int,
    radius: int,
    start: int,
    stop: int,
    plus: NDArray[Any],
    minus: NDArray[Any],
) -> None:
    """p(o) + p(−o) and p(o) − p(−o) of the patches of lattice rows start … stop.

    Parameters
    ----------
    image : array, shape (height + 2 radius, width + 2 radius)
        Padded by the radius.
    place : (int, int, int)
        x0, y0, spacing of the lattice, in the frame.
    columns : int
        Of the lattice.
    radius : int
    plus, minus : arrays, shape (positions, n²//2 + 1)
        Row by row (y, then x) up to the centre pixel; position (start, 0) comes first.
    """
    x0, y0, spacing = place
    n = 2 * radius + 1
    for j in range(start, stop):
        top = y0 + j * spacing
        for i in range(columns):
            left = x0 + i * spacing
            position = (j - start) * columns + i
            sums, differences = plus[position], minus[position]
            at = 0
            for row in range(radius + 1):
                upper, lower = image[top + row], image[top + n - 1 - row]
                last = left + n - 1
                for k in range(n if row < radius else radius + 1):
                    a, b = upper[left + k], lower[last - k]
                    sums[at + k] = a + b
                    differences[at + k] = a - b
                at += n


@kernel
def product_strip(
    a: NDArray[Any],
    b: NDArray[Any],
    shape: tuple[int, int],
    delta: tuple[int, int],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """A_q B_{q+δ}ᵀ of the lattice rows start … stop; 0 where q + δ is not on the lattice.

    Parameters
    ----------
    a, b : arrays, shape (positions, 6, m)
    shape : (int, int)
        Rows and columns of the lattice.
    delta : (int, int)
        δ_x, δ_y in spacings.
    out : float64 array, shape (rows, columns, 6, 6)
    """
    rows, columns = shape
    m = a.shape[2]
    for j in range(start, stop):
        for i in range(columns):
            y, x = j + delta[1], i + delta[0]
            if y < 0 or x < 0 or y >= rows or x >= columns:
                for k in range(6):
                    for n in range(6):
                        out[j, i, k, n] = 0
                continue
            here, there = a[j * columns + i], b[y * columns + x]
            for k in range(6):
                for n in range(6):
                    left, right = here[k], there[n]
                    total = left[0] * right[0]
                    for s in range(1, m):
                        total += left[s] * right[s]
                    out[j, i, k, n] = total


@kernel
def pool_strip(
    values: NDArray[Any],
    along_x: NDArray[Any],
    first_x: NDArray[Any],
    along_y: NDArray[Any],
    first_y: NDArray[Any],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Σ_q w M(d)ᵀ V_q M(d) about the points of the grid rows start … stop.

    Parameters
    ----------
    values : array, shape (lattice rows, lattice columns, 36)
        V_q, row by row.
    along_x, along_y : arrays, shape (3, points, taps)
        Weight times d⁰, d¹, d² of the positions near every grid column and row.
    first_x, first_y : int arrays, shape (points,)
        The first of them on the lattice; taps beyond the lattice have weight 0.
    out : float64 array, shape (grid rows, grid columns, 6, 6)
    """
    rows, columns = values.shape[:2]
    gathered = np.empty((3, columns, 36))
    sums = np.empty((6, 36))
    for j in range(start, stop):
        gathered[:] = 0
        for tap in range(along_y.shape[2]):
            y = first_y[j] + tap
            if y >= rows:
                break
            line = values[y]
            for power in range(3):
                weight, target = along_y[power, j, tap], gathered[power]
                for x in range(columns):
                    source, sink = line[x], target[x]
                    for k in range(36):
                        sink[k] += weight * source[k]
        for i in range(along_x.shape[1]):
            sums[:] = 0
            for tap in range(along_x.shape[2]):
                x = first_x[i] + tap
                if x >= columns:
                    break
                w0, w1, w2 = along_x[0, i, tap], along_x[1, i, tap], along_x[2, i, tap]
                g0, g1, g2 = gathered[0, x], gathered[1, x], gathered[2, x]
                for k in range(36):
                    sums[0, k] += w0 * g0[k]
                    sums[1, k] += w1 * g0[k]
                    sums[2, k] += w0 * g1[k]
                    sums[3, k] += w2 * g0[k]
                    sums[4, k] += w1 * g1[k]
                    sums[5, k] += w0 * g2[k]
            point = out[j, i]
            for k in range(6):
                for n in range(6):
                    point[k, n] = sums[0, 6 * k + n]
            _shift(sums, point)


@kernel
def _shift(sums: NDArray[Any], point: NDArray[Any]) -> None:
    """Add the terms of M(d)ᵀ V M(d) with d_x, d_y and their products to V.

    `sums` holds Σ w d_x^a d_y^b V for (a, b) = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2).
    """
    for top in range(0, 6, 3):
        for side in range(0, 6, 3):
            for k in range(3):
                for left in range(1, 3):  # a row of d: it takes the row of the constant
                    point[top + left, side + k] += sums[left, 6 * top + side + k]
                    point[side + k, top + left] += sums[left, 6 * (side + k) + top]
            for left in range(1, 3):
                for right in range(1, 3):
                    point[top + left, side + right] += sums[1 + left + right, 6 * top + side]
