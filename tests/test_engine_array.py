"""Kernels of an operator array against direct sums, position by position."""

import numpy as np
import pytest

import naive
from sixflow.engine.array import fold_strip, pool_strip, product_strip
from sixflow.maps.grid import Grid

DTYPES = [np.float32, np.float64]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    ("shape", "spacing", "radius"),
    [((33, 47), 5, 3), ((20, 31), 8, 6), ((9, 30), 1, 2), ((7, 5), 40, 12), ((1, 1), 3, 1)],
)
def test_folded_patches(dtype, shape, spacing, radius):
    image = np.random.default_rng(1).normal(size=shape).astype(dtype)
    lattice = Grid.over(shape, spacing)
    padded, half = np.pad(image, radius), (2 * radius + 1) ** 2 // 2 + 1
    for start in range(0, lattice.rows, 3):
        stop = min(start + 3, lattice.rows)
        plus, minus = np.full((2, (stop - start) * lattice.columns, half), 7, dtype)
        fold_strip(padded, lattice.origin_and_step, lattice.columns, radius, start, stop, plus, minus)
        for k, (j, i) in enumerate(np.ndindex(stop - start, lattice.columns)):
            sums, differences = naive.folded(image, lattice.x[i], lattice.y[start + j], radius)
            np.testing.assert_array_equal(plus[k], sums)
            np.testing.assert_array_equal(minus[k], differences)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    "delta", [(0, 0), (1, 0), (0, 1), (1, -1), (-2, 1), (0, -3), (5, 0), (0, 4), (-9, 9)]
)
def test_products_with_a_neighbour(dtype, delta):
    rows, columns, m = 4, 5, 37
    a, b = np.random.default_rng(2).normal(size=(2, rows * columns, 6, m)).astype(dtype)
    out = np.full((rows, columns, 6, 6), 7.0)
    for start in range(0, rows, 3):
        product_strip(a, b, (rows, columns), delta, start, min(start + 3, rows), out)
    for j, i in np.ndindex(rows, columns):
        y, x = j + delta[1], i + delta[0]
        if not (0 <= y < rows and 0 <= x < columns):
            np.testing.assert_array_equal(out[j, i], 0)
            continue
        here, there = (part[k].astype(float) for part, k in ((a, j * columns + i), (b, y * columns + x)))
        rounding = m * np.finfo(dtype).eps * (abs(here) @ abs(there).T)
        assert (abs(out[j, i] - here @ there.T) <= rounding).all()


def taps(rng, points, positions, count):
    """Random weights and distances of `count` positions for every point, some beyond the lattice."""
    weight, distance = rng.random((points, count)), rng.normal(size=(points, count))
    first = rng.integers(0, positions, points)
    return np.stack([weight * distance**k for k in range(3)]), first, weight, distance


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    ("lattice", "grid", "count"),
    [((5, 7), (4, 6), (3, 4)), ((1, 1), (3, 2), (1, 1)), ((2, 9), (1, 5), (5, 9))],
)
def test_pooled_matrices(dtype, lattice, grid, count):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(*lattice, 36)).astype(dtype)  # of any matrices, symmetric or not
    along_y, first_y, w_y, d_y = taps(rng, grid[0], lattice[0], count[0])
    along_x, first_x, w_x, d_x = taps(rng, grid[1], lattice[1], count[1])
    out = np.full((*grid, 6, 6), 7.0)
    for start in range(0, grid[0], 2):
        pool_strip(values, along_x, first_x, along_y, first_y, start, min(start + 2, grid[0]), out)
    for j, i in np.ndindex(*grid):
        exact = np.zeros((6, 6))
        for b, a in np.ndindex(count[0], count[1]):
            y, x = first_y[j] + b, first_x[i] + a
            if y < lattice[0] and x < lattice[1]:
                M = naive.shifted(d_x[i, a], d_y[j, b])
                exact += w_y[j, b] * w_x[i, a] * M.T @ values[y, x].reshape(6, 6).astype(float) @ M
        np.testing.assert_allclose(out[j, i], exact, atol=1e-12 * (1 + abs(exact).max()))
