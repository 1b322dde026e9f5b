"""Derivatives against numerical ones, covariance against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from sixflow import convention as c
from sixflow.convention.derivatives import JACOBIANS, input_dims
from sixflow.convention.derivatives import OF_GRADIENT as OF_GRADIENT_SET
from sixflow.errors import InputError

NAMES = {function.__name__: function for function in JACOBIANS}
PRINCIPAL = {c.principal_values, c.principal_angle, c.max_shear}
OF_GRADIENT = sorted(OF_GRADIENT_SET, key=lambda f: f.__name__)


def inputs(function, shape, scale, seed=0):
    six = c.exp_six(np.random.default_rng(seed).normal(0, scale, (*shape, 6)))
    if input_dims(function, 0) == 1:
        return six
    return c.small_strain(c.gradient(six)) if function in PRINCIPAL else c.gradient(six)


def random_covariance(shape, scale, seed=0):
    A = np.random.default_rng(seed).normal(0, scale, (*shape, 6, 6))
    return A @ A.swapaxes(-1, -2)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scale", [1e-8, 1e-2, 0.3])
def test_closed_forms_against_differences(name, scale):
    function = NAMES[name]
    if function in PRINCIPAL:
        scale = max(scale, 1e-2)  # nearly equal principal values are too curved for the difference quotient
    value = inputs(function, (3, 5), scale)

    def symmetrised(T):
        return function((T + T.swapaxes(-1, -2)) / 2)

    numerical = c.numerical_jacobian(
        symmetrised if function in PRINCIPAL else function, value, dims=input_dims(function, 0)
    )
    seen = c.jacobian(function, value)
    assert seen.shape == numerical.shape
    np.testing.assert_allclose(seen, numerical, rtol=1e-8, atol=1e-8 * np.abs(numerical).max())


def test_derivative_of_hencky_across_the_series():
    """The two branches of ∂β/∂q meet."""
    stretch = np.sqrt(0.03) * 2 * (1 + np.array([-1e-9, 1e-9]))
    six = np.zeros((2, 6))
    six[:, 4], six[:, 5], six[:, 2] = stretch * 0.8, stretch * 0.6, 0
    J = c.jacobian(c.hencky, c.gradient(six))
    np.testing.assert_allclose(J[0], J[1], atol=1e-8)
    np.testing.assert_allclose(J, c.numerical_jacobian(c.hencky, c.gradient(six), dims=2), atol=1e-9)


@pytest.mark.parametrize("short", [1e-2, 1e-5, 1e-9])
def test_derivative_of_the_logarithm_next_to_the_half_turn(short):
    rates = np.array([0.5, 0.2, 0.1, 2 * (np.pi - short), 0.0, 0.0])
    J = c.jacobian(c.log_six, c.exp_six(rates))
    forward = c.jacobian(c.exp_six, rates)
    np.testing.assert_allclose(J @ forward, np.eye(6), atol=1e-6)
    assert abs(J[3, 2]) < 1.5  # a difference quotient across the jump would give millions


def test_numerical_jacobian_of_shapes():
    def outer(x):
        return x[..., :, None] * x[..., None, :]

    x = np.random.default_rng(0).normal(0, 100, (4, 3))
    J = c.numerical_jacobian(outer, x)
    assert J.shape == (4, 3, 3, 3)
    one = np.eye(3)
    expected = np.einsum("im,nj->nijm", one, x) + np.einsum("ni,jm->nijm", x, one)
    np.testing.assert_allclose(J, expected, atol=1e-7)
    np.testing.assert_allclose(c.numerical_jacobian(np.sin, x[0], dims=0), np.cos(x[0]), atol=1e-8)
    assert c.numerical_jacobian(c.gradient, np.zeros((0, 6))).shape == (0, 2, 2, 6)
    with pytest.raises(InputError, match="dims=3: must be from 0 to 2"):
        c.numerical_jacobian(outer, x, dims=3)


@pytest.mark.parametrize("name", NAMES)
def test_monte_carlo(name):
    """Sample covariance of 200,000 draws: 1/√N = 0.0022 of each product of spreads; five of them allowed."""
    function, n = NAMES[name], 200_000
    rng = np.random.default_rng(11)
    six = np.array([1.0, -2.0, 0.2, 0.5, 0.3, -0.2])
    covariance = random_covariance((), 4e-4, 1)
    draws = rng.multivariate_normal(six, covariance, n)
    value = six
    if function in PRINCIPAL:
        value, covariance = c.propagate(c.green_lagrange, six, covariance)
        draws = c.green_lagrange(c.gradient(draws))
    elif function in OF_GRADIENT:
        draws = c.gradient(draws)
    value, spread = c.propagate(function, value, covariance)
    samples = function(draws).reshape(n, -1)
    spread = spread.reshape(samples.shape[1], -1)
    size = np.sqrt(np.diag(spread))
    seen = np.atleast_2d(np.cov(samples.T))
    np.testing.assert_allclose(
        seen / np.outer(size, size), spread / np.outer(size, size), atol=5 * np.sqrt(2 / n)
    )
    np.testing.assert_allclose(samples.mean(0), np.ravel(value), atol=(5 * size / np.sqrt(n)).max() + 1e-5)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3), (0,)])
@pytest.mark.parametrize("name", NAMES)
def test_propagated_shapes_symmetry_and_precision(name, shape):
    function = NAMES[name]
    value = inputs(function, shape, 0.1)
    dims = input_dims(function, 0)
    core = value.shape[value.ndim - dims :]
    n = int(np.prod(core))
    covariance = random_covariance(shape, 0.01)[..., :n, :n].reshape(shape + core + core)
    result, spread = c.propagate(function, value, covariance)
    np.testing.assert_array_equal(result, function(value))
    out = result.shape[len(shape) :]
    assert spread.shape == shape + out + out
    k = int(np.prod(out))
    flat = spread.reshape((*shape, k, k))
    np.testing.assert_array_equal(flat, flat.swapaxes(-1, -2))
    assert (np.linalg.eigvalsh(flat) > -1e-15).all()
    single = c.propagate(function, value.astype(np.float32), covariance.astype(np.float32))
    assert single[0].dtype == single[1].dtype == np.float32
    np.testing.assert_allclose(single[1], spread, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("function", OF_GRADIENT)
def test_a_measure_of_the_gradient_may_be_given_the_six(function):
    six, covariance = inputs(c.log_six, (5,), 0.1), random_covariance((5,), 0.01)
    direct = c.propagate(function, six, covariance)
    steps = c.propagate(function, *c.propagate(c.gradient, six, covariance))
    whole = c.propagate(lambda s: function(c.gradient(s)), six, covariance)
    for a, b, d in zip(direct, steps, whole, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_allclose(a, d, rtol=1e-7, atol=1e-12)


def test_exp_takes_back_what_log_does_to_the_covariance():
    six, covariance = inputs(c.log_six, (20,), 0.3), random_covariance((20,), 0.01)
    rates, spread = c.propagate(c.log_six, six, covariance)
    again, back = c.propagate(c.exp_six, rates, spread)
    np.testing.assert_allclose(again, six, atol=1e-13)
    np.testing.assert_allclose(back, covariance, rtol=1e-7, atol=1e-11)
    again, back = c.propagate(c.inverse_six, *c.propagate(c.inverse_six, six, covariance))
    np.testing.assert_allclose(back, covariance, rtol=1e-11, atol=1e-15)


def test_any_function_and_scalars():
    six, covariance = inputs(c.log_six, (5,), 0.1), random_covariance((5,), 0.01)
    ratio, variance = c.propagate(c.area_ratio, six, covariance)
    root, spread = c.propagate(np.sqrt, ratio, variance)
    np.testing.assert_allclose(root, np.sqrt(ratio))
    np.testing.assert_allclose(spread, variance / (4 * ratio), rtol=1e-9)
    scalar, one = c.propagate(np.sqrt, 4.0, 0.16)
    assert scalar == 2
    np.testing.assert_allclose(one, 0.01, rtol=1e-9)


def test_composition():
    a, b = inputs(c.log_six, (3, 4), 0.2, 1), inputs(c.log_six, (3, 4), 0.2, 2)
    by_a, by_b = c.composition_jacobians(a, b)
    np.testing.assert_allclose(by_a, c.numerical_jacobian(lambda x: c.compose_six(x, b), a), atol=1e-9)
    np.testing.assert_allclose(by_b, c.numerical_jacobian(lambda x: c.compose_six(a, x), b), atol=1e-9)
    cov_a, cov_b = random_covariance((3, 4), 0.01, 3), random_covariance((), 0.01, 4)
    six, covariance = c.propagate_composition(a, cov_a, b, cov_b)
    np.testing.assert_array_equal(six, c.compose_six(a, b))
    expected = by_a @ cov_a @ by_a.swapaxes(-1, -2) + by_b @ cov_b @ by_b.swapaxes(-1, -2)
    np.testing.assert_allclose(covariance, expected, atol=1e-16)
    with pytest.raises(InputError, match=r"second_covariance \(3, 4\)"):
        c.propagate_composition(a, cov_a, b[:2], cov_b)


@pytest.mark.parametrize(
    "function", [c.log_six, c.inverse_six, c.almansi, c.hencky, c.biot, c.rotation_angle]
)
def test_points_without_a_value_have_no_covariance(function):
    six = np.zeros((4, 6))
    six[1] = [0, 0, -2, 0, 0, 0]
    six[2] = np.nan
    covariance = np.broadcast_to(np.eye(6) * 1e-4, (4, 6, 6))
    value, spread = c.propagate(function, six, covariance, invalid="nan")
    for k, lost in enumerate([False, True, True, False]):
        assert np.isnan(value[k]).all() == lost
        assert np.isnan(spread[k]).all() == lost
    with pytest.raises(InputError, match=r"1 of 4 elements"):
        c.propagate(function, six, covariance)


def test_equal_principal_values_have_no_derivative():
    zero = np.zeros((2, 2))
    for function in PRINCIPAL:
        value, spread = c.propagate(function, zero, np.zeros((2, 2, 2, 2)))
        assert (value == 0).all()
        assert np.isnan(spread).all()


def test_wrong_covariances_are_refused():
    six = np.zeros((4, 6))
    for bad in (
        np.eye(6),
        np.zeros((4, 6)),
        np.zeros((3, 6, 6)),
        np.zeros((4, 5, 6)),
        np.zeros((4, 6, 6, 6)),
    ):
        with pytest.raises(InputError, match="covariance of"):
            c.propagate(c.gradient, six, bad)
    with pytest.raises(InputError, match="must keep the leading dimensions"):
        c.propagate(np.sum, six, np.zeros((4, 6, 6)))
    with pytest.raises(InputError, match=r"principal_values takes \(..., 2, 2\)"):
        c.propagate(c.principal_values, six, np.zeros((4, 6, 6)))
    with pytest.raises(InputError, match=r"log_six takes \(..., 6\)"):
        c.propagate(c.log_six, np.zeros((2, 2)), np.zeros((2, 2, 2, 2)))
    with pytest.raises(InputError, match="value of shape"):
        c.jacobian(c.principal_values, six)
