"""Moments: Gaussian window sums of products of images, computed at the grid points only.

The window is separable. First along the columns, for the grid's rows alone, with the weights w, wY, wY²
(`window.moment_weights`): all pixel columns side by side, which is vector code. Then along the rows,
for the grid's columns alone: every step-th pixel is brought side by side (phases), and the same code
serves. A window that reaches beyond the frame sums what is there: missing weight, not zeros in the
average.

| product | moments | where |
|---|---|---|
| g_x², g_x g_y, g_y² | 1, X, Y, X², XY, Y² each, under w | normal equations, 0 … 17 |
| g_x q, g_y q | 1, X, Y each, under w | normal equations, 18 … 23 |
| r²g_x², r²g_x g_y, r²g_y² | 1, X, Y, X², XY, Y² each, under w² | sandwich, 0 … 17 |
| 1, ∣r∣, r², I₀, I₀² | 1 each, under w | statistics, 0 … 4 |
| 1; u, v | 1, X, Y, X², XY, Y²; 1, X, Y each, under w | affine fit of a displacement, 0 … 11 |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel

_TILE = 256
_NORMAL, _SANDWICH, _STATISTICS, _AFFINE = range(4)


@kernel
def add_weighted(
    lines: NDArray[Any], first: int, count: int, column: int, weights: NDArray[Any], tap: int,
    out: NDArray[Any], at: int, orders: int, place: int, n: int,
) -> None:  # fmt: skip
    """out[at + k, place + x] += Σ_row weights[k, tap + row] · lines[first + row, column + x] for k <
    orders, x < n.

    Four rows at a time, one output and four inputs a loop: with more, the compiler no longer proves
    that they do not overlap, and writes scalar code. Offsets are arguments, and slices are taken of
    single rows, because a slice of a two-dimensional array is not known to be contiguous.

    Parameters
    ----------
    lines : array, shape (…, …)
        `count` rows from `first`, n columns from `column` are used.
    weights : array, shape (≥ orders, taps)
    out : array, shape (…, …)
    """
    fours = count - count % 4
    for row in range(0, fours, 4):
        f0, f1 = lines[first + row][column : column + n], lines[first + row + 1][column : column + n]
        f2, f3 = lines[first + row + 2][column : column + n], lines[first + row + 3][column : column + n]
        for k in range(orders):
            s, w = out[at + k][place : place + n], weights[k][tap + row : tap + row + 4]
            w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
            for x in range(n):
                s[x] += (w0 * f0[x] + w1 * f1[x]) + (w2 * f2[x] + w3 * f3[x])
    for row in range(fours, count):
        f = lines[first + row][column : column + n]
        for k in range(orders):
            s, weight = out[at + k][place : place + n], weights[k, tap + row]
            for x in range(n):
                s[x] += weight * f[x]


@kernel
def _multiply(a: NDArray[Any], b: NDArray[Any], out: NDArray[Any]) -> None:
    for x in range(a.size):
        out[x] = a[x] * b[x]


@kernel
def _phases(line: NDArray[Any], first: int, out: NDArray[Any]) -> None:
    """Bring every step-th pixel side by side: out[phase, m] = line[first + m·step + phase], 0 beyond
    the line.
    """
    step, count = out.shape
    width = line.size
    for phase in range(step):
        target = out[phase]
        x = first + phase
        for m in range(count):
            target[m] = line[x] if 0 <= x < width else 0
            x += step


@kernel
def _order_two(
    columns: NDArray[Any], powers: int, at: int, weights: NDArray[Any], first: int, phases: NDArray[Any],
    sums: NDArray[Any], out: NDArray[Any], place: int,
) -> None:  # fmt: skip
    """Finish the moments 1, X, Y, X², XY, Y² of one product from its column sums with w, wY, …
    wY^(powers − 1).

    The column sums are rows at … of `columns`; the moments go to out[:, place …], out being (grid
    columns, moments).
    """
    step, n, taps = phases.shape[0], out.shape[0], weights.shape[1]
    for power in range(powers):
        _phases(columns[at + power], first, phases)
        sums[:] = 0
        for tap in range(0, taps, step):
            count = min(step, taps - tap)
            add_weighted(phases, 0, count, tap // step, weights, tap, sums, 0, powers - power, 0, n)
        for k in range(powers - power):
            target = place + (power + k) * (power + k + 1) // 2 + power
            for i in range(n):
                out[i, target] = sums[k, i]


@kernel
def _column_sums(
    products: NDArray[Any], orders: NDArray[Any], weights: NDArray[Any], low: int, high: int,
    grid: tuple[int, int, int], start: int, stop: int, tile: int, width: int, columns: NDArray[Any],
) -> None:  # fmt: skip
    """Column sums of one tile of products for the grid rows start … stop.

    `products` is (count, rows, tile width) and holds the pixel rows low … high; `columns` is (grid
    rows, Σ orders, frame width), of which the `width` columns from `tile` are written.
    """
    _, y0, step = grid
    reach = weights.shape[1] // 2
    for j in range(start, stop):
        y = y0 + j * step
        above, below = max(low, y - reach), min(high, y + reach + 1)
        target = columns[j - start]
        at = 0
        for product in range(orders.size):
            for k in range(orders[product]):
                line = target[at + k]
                for x in range(tile, tile + width):
                    line[x] = 0
            add_weighted(
                products[product], above - low, below - above, 0, weights, above - y + reach,
                target, at, orders[product], tile, width,
            )  # fmt: skip
            at += orders[product]


@kernel
def _finish(
    columns: NDArray[Any], orders: NDArray[Any], weights: NDArray[Any], grid: tuple[int, int, int],
    start: int, stop: int, out: NDArray[Any],
) -> None:  # fmt: skip
    """Row sums of all products for the grid rows start … stop."""
    x0, _, step = grid
    n = out.shape[1]
    first = x0 - weights.shape[1] // 2
    phases = np.empty((step, n + weights.shape[1] // step + 1), columns.dtype)
    sums = np.empty((3, n), columns.dtype)
    for j in range(start, stop):
        at, place = 0, 0
        for product in range(orders.size):
            count = orders[product]
            _order_two(columns[j - start], count, at, weights, first, phases, sums, out[j], place)
            at += count
            place += count * (count + 1) // 2


@kernel
def _rows_needed(
    height: int, grid: tuple[int, int, int], reach: int, start: int, stop: int
) -> tuple[int, int]:
    _, y0, step = grid
    return max(0, y0 + start * step - reach), min(height, y0 + (stop - 1) * step + reach + 1)


@kernel
def _fill(
    kind: int, a: NDArray[Any], b: NDArray[Any], c: NDArray[Any], products: NDArray[Any], row: int,
    scratch: NDArray[Any],
) -> None:  # fmt: skip
    """Products of one row of a tile into products[:, row]; a, b, c are the row's pixels of the images of that kind."""
    n = a.size
    if kind == _NORMAL:
        _multiply(a, a, products[0, row])
        _multiply(a, b, products[1, row])
        _multiply(b, b, products[2, row])
        _multiply(a, c, products[3, row])
        _multiply(b, c, products[4, row])
    elif kind == _SANDWICH:
        zero = a.dtype.type(0)
        fx, fy = scratch[0][:n], scratch[1][:n]
        for x in range(n):
            r = c[x] if c[x] == c[x] else zero
            fx[x] = r * a[x]
            fy[x] = r * b[x]
        _multiply(fx, fx, products[0, row])
        _multiply(fx, fy, products[1, row])
        _multiply(fy, fy, products[2, row])
    elif kind == _STATISTICS:
        zero, one = a.dtype.type(0), a.dtype.type(1)
        count, absolute, grey = products[0, row], products[1, row], products[3, row]
        for x in range(n):
            count[x] = one if b[x] == b[x] else zero
        for x in range(n):
            absolute[x] = abs(b[x]) if b[x] == b[x] else zero
        for x in range(n):
            grey[x] = a[x] if b[x] == b[x] else zero
        _multiply(absolute[:n], absolute, products[2, row])
        _multiply(grey[:n], grey, products[4, row])
    else:
        _multiply(a, a, products[0, row])
        _multiply(a, b, products[1, row])
        _multiply(a, c, products[2, row])


@kernel
def _window_sums(
    kind: int, a: NDArray[Any], b: NDArray[Any], c: NDArray[Any], orders: NDArray[Any], weights: NDArray[Any],
    grid: tuple[int, int, int], start: int, stop: int, out: NDArray[Any],
) -> None:  # fmt: skip
    """Moments of all products of one kind for the grid rows start … stop; `orders`: powers of Y of each product."""
    height, width = a.shape
    low, high = _rows_needed(height, grid, weights.shape[1] // 2, start, stop)
    columns = np.empty((stop - start, orders.sum(), width), a.dtype)
    products = np.empty((orders.size, high - low, min(_TILE, width)), a.dtype)
    scratch = np.empty((2, min(_TILE, width)), a.dtype)
    for tile in range(0, width, _TILE):
        end = min(tile + _TILE, width)
        for y in range(low, high):
            _fill(kind, a[y][tile:end], b[y][tile:end], c[y][tile:end], products, y - low, scratch)
        _column_sums(products, orders, weights, low, high, grid, start, stop, tile, end - tile, columns)
    _finish(columns, orders, weights, grid, start, stop, out)


def moments_strip(
    gradient_x: NDArray[Any],
    gradient_y: NDArray[Any],
    right: NDArray[Any],
    weights: NDArray[Any],
    grid: tuple[int, int, int],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Moments of the normal equations for the grid rows start … stop.

    Parameters
    ----------
    gradient_x, gradient_y, right : arrays, shape (height, width)
        From `warp`; 0 where a pixel has no partner.
    weights : array, shape (3, 2 reach + 1)
        From `window.moment_weights`.
    grid : (x0, y0, step)
    out : array, shape (grid rows, grid columns, 24)
    """
    orders = np.array([3, 3, 3, 2, 2])
    _window_sums(_NORMAL, gradient_x, gradient_y, right, orders, weights, grid, start, stop, out)


def sandwich_strip(
    gradient_x: NDArray[Any],
    gradient_y: NDArray[Any],
    residual: NDArray[Any],
    weights: NDArray[Any],
    grid: tuple[int, int, int],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Moments of the sandwich for the grid rows start … stop; `weights` are those of w², out is (rows, columns, 18)."""
    orders = np.array([3, 3, 3])
    _window_sums(_SANDWICH, gradient_x, gradient_y, residual, orders, weights, grid, start, stop, out)


def statistics_strip(
    image: NDArray[Any],
    residual: NDArray[Any],
    weights: NDArray[Any],
    grid: tuple[int, int, int],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Window sums of 1, |r|, r², I, I² over the pixels that have a partner; out is (rows, columns, 5)."""
    orders = np.array([1, 1, 1, 1, 1])
    _window_sums(_STATISTICS, image, residual, residual, orders, weights, grid, start, stop, out)


def affine_moments_strip(
    valid: NDArray[Any],
    u: NDArray[Any],
    v: NDArray[Any],
    weights: NDArray[Any],
    grid: tuple[int, int, int],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Window sums of 1 (six moments), u and v (moments 1, X, Y each) where valid is 1, grid rows start … stop.

    Parameters
    ----------
    valid, u, v : arrays, shape (height, width)
        `valid` is 1 or 0.
    weights : array, shape (3, 2 reach + 1)
    grid : (x0, y0, step)
    out : array, shape (grid rows, grid columns, 12)
    """
    orders = np.array([3, 2, 2])
    _window_sums(_AFFINE, valid, u, v, orders, weights, grid, start, stop, out)
