"""Normal equations and covariance against NumPy's linear algebra and numerical integrals."""

import numpy as np
import pytest

import naive
from sixflow.engine.solve import (
    FEEDBACK_STEP,
    covariance_strip,
    explained_strip,
    noise_feedback,
    solve_strip,
    texture_strip,
)
from sixflow.maps.grid import Grid

SIGMA = 4.5
GRID = Grid.over((40, 150), 8)


@pytest.fixture(scope="module")
def normal():
    """Moments of random images, 5 × 19 points: more than one group of points worked on side by side."""
    gx, gy, q = np.random.default_rng(1).normal(size=(3, 40, 150))
    products = [gx * gx, gx * gy, gy * gy, gx * q, gy * q]
    return naive.moments(products, [3, 3, 3, 2, 2], SIGMA, GRID.origin_and_step, GRID.shape)


def points():
    return list(np.ndindex(*GRID.shape))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_solution(normal, dtype):
    moments = normal.astype(dtype)
    fast = np.full((6, *GRID.shape), 7.0)
    for start in range(GRID.rows):
        solve_strip(moments, SIGMA, start, start + 1, fast)
    for j, i in points():
        theta = np.linalg.solve(naive.symmetric(moments[j, i]), moments[j, i, 18:].astype(float))
        np.testing.assert_allclose(fast[:, j, i], naive.maps_of(theta, SIGMA), rtol=1e-9, atol=1e-12)


def test_solution_is_the_least_squares_fit_of_the_window(normal):
    """The moments, put together, are the weighted regression of q on the six columns of the Jacobian."""
    gx, gy, q = np.random.default_rng(1).normal(size=(3, 40, 150))
    fast = np.empty((6, *GRID.shape))
    solve_strip(normal, SIGMA, 0, GRID.rows, fast)
    for j, i, w, X, Y in naive.each_window(SIGMA, q.shape, GRID.origin_and_step, GRID.shape):
        J = naive.jacobian(gx, gy, X, Y).reshape(6, -1)
        root = np.sqrt(w).ravel()
        theta = np.linalg.lstsq((J * root).T, root * q.ravel(), rcond=None)[0]
        np.testing.assert_allclose(fast[:, j, i], naive.maps_of(theta, SIGMA), rtol=1e-8, atol=1e-11)


def test_singular_equations_give_nan():
    moments = np.zeros((1, 4, 24))
    rng = np.random.default_rng(2)
    gx, q = rng.normal(size=(2, 40, 40))
    grid = (20, 20, 8)
    one_way = naive.moments([gx * gx, 0 * gx, 0 * gx, gx * q, 0 * q], [3, 3, 3, 2, 2], SIGMA, grid, (1, 1))[
        0, 0
    ]
    oblique = naive.moments(
        [gx * gx, gx * gx, gx * gx, gx * q, gx * q], [3, 3, 3, 2, 2], SIGMA, grid, (1, 1)
    )[0, 0]
    gy = rng.normal(size=(40, 40))
    sound = naive.moments([gx * gx, gx * gy, gy * gy, gx * q, gy * q], [3, 3, 3, 2, 2], SIGMA, grid, (1, 1))[
        0, 0
    ]
    moments[0, 1], moments[0, 2], moments[0, 3] = one_way, oblique, sound
    out = np.empty((6, 1, 4))
    solve_strip(moments, SIGMA, 0, 1, out)
    assert np.isnan(out[:, 0, :3]).any(axis=0).all()
    assert np.isfinite(out[:, 0, 3]).all()


def test_explained(normal):
    update = np.random.default_rng(3).normal(size=(6, *GRID.shape))
    fast = np.empty(GRID.shape)
    explained_strip(normal, update, SIGMA, 0, GRID.rows, fast)
    for j, i in points():
        theta = naive.unknowns_of(update[:, j, i], SIGMA)
        assert fast[j, i] == pytest.approx(theta @ naive.symmetric(normal[j, i]) @ theta, rel=1e-9)


def test_texture(normal):
    gamma = np.random.default_rng(4).uniform(0, 1.2, GRID.shape)
    gamma[0] = 0
    texture, rho = np.empty(GRID.shape), np.empty(GRID.shape)
    texture_strip(normal, gamma, 0, GRID.rows, texture, rho)
    for j, i in points():
        weakest, share = naive.texture(normal[j, i], gamma[j, i])
        assert texture[j, i] == pytest.approx(weakest, rel=1e-9)
        assert rho[j, i] == pytest.approx(share, rel=1e-9)
    assert (texture > 0).any()
    assert (texture == 0).any()


def test_noise_feedback():
    table = noise_feedback()
    for entry in (0, 1, 37, 100, 250, 400):
        np.testing.assert_allclose(table[:, entry], naive.feedback(entry * FEEDBACK_STEP), rtol=1e-5)
    np.testing.assert_allclose(table[:, 0], 1, rtol=1e-5)
    assert (np.diff(table, axis=1) < 0).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_covariance(normal, dtype):
    rng = np.random.default_rng(5)
    gx, gy, r = rng.normal(size=(3, 40, 150))
    products = [r * r * gx * gx, r * r * gx * gy, r * r * gy * gy]
    sandwich = naive.moments(products, [3, 3, 3], SIGMA, GRID.origin_and_step, GRID.shape, power=2).astype(
        dtype
    )
    gamma = rng.uniform(0, 0.15, GRID.shape)
    rho = FEEDBACK_STEP * (rng.integers(-100, 600, GRID.shape) + 0.5)
    transform = naive.six_transform(SIGMA)
    fast = np.empty((*GRID.shape, 6, 6), dtype)
    moments = normal.astype(dtype)
    covariance_strip(moments, sandwich, gamma, rho, noise_feedback(), transform, 0, GRID.rows, fast)
    for j, i in points():
        entry = np.floor(np.clip(rho[j, i], 0, 4) / FEEDBACK_STEP) * FEEDBACK_STEP
        exact = naive.covariance(moments[j, i], sandwich[j, i], gamma[j, i], entry, transform)
        spread = np.sqrt(np.diagonal(exact))
        limit = 1e-4 + 8 * np.finfo(dtype).eps
        np.testing.assert_allclose(
            fast[j, i] / np.outer(spread, spread), exact / np.outer(spread, spread), atol=limit
        )
        np.testing.assert_array_equal(fast[j, i], fast[j, i].T)


def test_no_covariance_without_texture_above_the_noise(normal):
    fast = np.empty((*GRID.shape, 6, 6))
    gamma, rho = np.full(GRID.shape, 1e3), np.full(GRID.shape, -1.0)
    arguments = normal, normal[..., :18], gamma, rho, noise_feedback(), naive.six_transform(SIGMA)
    covariance_strip(*arguments, 0, GRID.rows, fast)
    assert np.isnan(fast).all()
