"""Window moments against direct sums over every pixel of every window."""

import numpy as np
import pytest

import naive
from sixflow.engine.taps import affine_moments_strip, moments_strip, sandwich_strip, statistics_strip
from sixflow.engine.window import moment_weights
from sixflow.maps.grid import Grid

DTYPES = [np.float32, np.float64]
# steps that divide nothing, windows wider than the frame, frames wider than a tile of 256 columns
CASES = [((33, 47), 5, 3.3), ((20, 31), 8, 6.0), ((31, 20), 1, 1.5), ((14, 270), 16, 2.7), ((9, 9), 40, 5.0)]


def strips(kernel, images, sigma, grid, count, dtype, power=1, height=3):
    weights = moment_weights(sigma, power=power).astype(dtype)
    out = np.full((*grid.shape, count), 7, dtype)
    for start in range(0, grid.rows, height):
        kernel(*images, weights, grid.origin_and_step, start, min(start + height, grid.rows), out)
    return out


def images(shape, dtype, count=3):
    return list(np.random.default_rng(1).normal(size=(count, *shape)).astype(dtype))


def assert_close(fast, products, orders, sigma, grid, dtype, power=1):
    """To within the rounding of sums of the terms' sizes."""
    products = [p.astype(float) for p in products]
    exact = naive.moments(products, orders, sigma, grid.origin_and_step, grid.shape, power)
    size = naive.moments([abs(p) for p in products], orders, sigma, grid.origin_and_step, grid.shape, power)
    # every moment of one product is bounded by the mass under the window times the largest X², Y²
    bound = 13 * np.abs(size).max()
    np.testing.assert_allclose(fast, exact, atol=16 * np.finfo(dtype).eps * bound, rtol=0)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_normal_equations(dtype, shape, step, sigma):
    grid = Grid.over(shape, step)
    gx, gy, q = images(shape, dtype)
    fast = strips(moments_strip, (gx, gy, q), sigma, grid, 24, dtype)
    assert_close(fast, [gx * gx, gx * gy, gy * gy, gx * q, gy * q], [3, 3, 3, 2, 2], sigma, grid, dtype)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_sandwich(dtype, shape, step, sigma):
    grid = Grid.over(shape, step)
    gx, gy, r = images(shape, dtype)
    r[np.random.default_rng(2).random(shape) < 0.1] = np.nan
    fast = strips(sandwich_strip, (gx, gy, r), sigma, grid, 18, dtype, power=2)
    r2 = np.nan_to_num(r) ** 2
    assert_close(fast, [r2 * gx * gx, r2 * gx * gy, r2 * gy * gy], [3, 3, 3], sigma, grid, dtype, power=2)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_statistics(dtype, shape, step, sigma):
    grid = Grid.over(shape, step)
    grey, r, _ = images(shape, dtype)
    r[np.random.default_rng(2).random(shape) < 0.1] = np.nan
    known, r0 = np.isfinite(r).astype(dtype), np.nan_to_num(r)
    fast = strips(statistics_strip, (grey, r), sigma, grid, 5, dtype)
    products = [known, abs(r0), r0 * r0, known * grey, known * grey * grey]
    assert_close(fast, products, [1] * 5, sigma, grid, dtype)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_affine_fit_of_a_displacement(dtype, shape, step, sigma):
    grid = Grid.over(shape, step)
    u, v, _ = images(shape, dtype)
    valid = (np.random.default_rng(2).random(shape) > 0.1).astype(dtype)
    fast = strips(affine_moments_strip, (valid, u, v), sigma, grid, 12, dtype)
    assert_close(fast, [valid, valid * u, valid * v], [3, 2, 2], sigma, grid, dtype)


def test_strips_do_not_matter():
    grid = Grid.over((60, 40), 4)
    arrays = images((60, 40), np.float32)
    one = strips(moments_strip, arrays, 4.2, grid, 24, np.float32, height=100)
    for height in (1, 2, 7):
        np.testing.assert_array_equal(
            strips(moments_strip, arrays, 4.2, grid, 24, np.float32, height=height), one
        )


def test_nothing_under_the_window():
    grid = Grid.over((20, 20), 8)
    zero, nan = np.zeros((20, 20)), np.full((20, 20), np.nan)
    assert not strips(moments_strip, (zero, zero, zero), 3.0, grid, 24, np.float64).any()
    assert not strips(statistics_strip, (zero, nan), 3.0, grid, 5, np.float64).any()


def test_statistics_ignore_what_has_no_partner():
    grid = Grid.over((33, 47), 5)
    grey, r, _ = images((33, 47), np.float64)
    r[np.random.default_rng(2).random((33, 47)) < 0.1] = np.nan
    plain = strips(statistics_strip, (grey, r), 3.3, grid, 5, np.float64)
    grey[np.isnan(r)] = np.nan
    np.testing.assert_array_equal(strips(statistics_strip, (grey, r), 3.3, grid, 5, np.float64), plain)
