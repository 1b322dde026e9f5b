"""Filters and splines against dense matrices and SciPy."""

import numpy as np
import pytest

import naive
from sixflow.engine.fir import downsample, filter_separable, reflect
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.spline import PAD, gradient_noise, noise_variance, spline_coefficients, spline_weights

DTYPES = [np.float32, np.float64]


def rounding(dtype, scale, operations=32):
    return operations * np.finfo(dtype).eps * scale


@pytest.mark.parametrize("kind", ["even", "odd"])
@pytest.mark.parametrize("size", [2, 3, 7])
def test_reflect(size, kind):
    line = np.random.default_rng(0).normal(size=size)
    padded = np.pad(line, 20, mode="reflect", reflect_type=kind)
    for k in range(-20, size + 20):
        place, sign, first, last = reflect(k, size, kind == "odd")
        assert sign * line[place] + first * line[0] + last * line[-1] == pytest.approx(
            padded[k + 20], abs=1e-12
        )


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 3), (70, 41), (129, 66)])
@pytest.mark.parametrize(("pad", "stride"), [(0, 1), (3, 1), (0, 2), (0, 3)])
def test_filter(dtype, shape, pad, stride):
    rng = np.random.default_rng(1)
    image = rng.normal(size=shape).astype(dtype)
    half = rng.normal(size=6)
    fast = filter_separable(image, half, pad=pad, stride=stride)
    assert fast.dtype == dtype
    scale = np.abs(half).sum() ** 2 * 4 * np.abs(image).max()
    np.testing.assert_allclose(
        fast, naive.filter_separable(image, half, pad, stride), atol=rounding(dtype, scale)
    )


def test_filter_of_non_contiguous_images():
    image = np.random.default_rng(2).normal(size=(40, 60))
    half = np.array([0.5, 0.25])
    for view in (image.T, image[::2, ::-1], image[5:30, 7:31]):
        np.testing.assert_allclose(
            filter_separable(view, half), naive.filter_separable(view, half), atol=1e-14
        )


def test_downsample_keeps_affine_images_inside():
    y, x = np.mgrid[:20, :31].astype(float)
    small = downsample(2 * x - 3 * y)
    assert small.shape == (10, 16)
    # the filter reaches 4 px, 2 of the result's
    np.testing.assert_allclose(small[2:-2, 2:-2], (2 * x - 3 * y)[4:-4:2, 4:-4:2], atol=1e-12)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("shape", [(5, 6), (32, 47), (100, 30)])
def test_coefficients(dtype, degree, shape):
    image = np.random.default_rng(3).normal(size=shape).astype(dtype)
    fast = spline_coefficients(image, degree)
    assert fast.dtype == dtype
    assert fast.shape == (shape[0] + 2 * PAD, shape[1] + 2 * PAD)
    exact = naive.spline_coefficients(image, degree, PAD)
    # the filter is cut at 1e-7 (float32); what is cut off adds up to a few of these
    assert np.abs(fast - exact).max() < rounding(dtype, np.abs(exact).max(), 64)


@pytest.mark.parametrize("degree", [3, 5])
def test_weights_are_the_spline_of_scipy(degree):
    fraction = np.linspace(0, 1, 11)[:-1]
    weights = spline_weights(fraction, degree)
    taps = np.arange(degree + 1) - (degree - 1) // 2
    np.testing.assert_allclose(weights, naive.bspline(fraction[:, None] - taps, degree), atol=1e-14)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-14)


@pytest.mark.parametrize("degree", [3, 5])
def test_interpolation_noise(degree):
    """The polynomial stands for the summed squares of the interpolator's impulse response."""
    a, b, c = noise_variance(degree)
    fraction = np.linspace(0, 1, 21)
    s = fraction * (1 - fraction)
    exact = [naive.interpolation_noise(f, degree) for f in fraction]
    np.testing.assert_allclose(1 + s * (a + s * (b + s * c)), exact, atol=2e-3)


@pytest.mark.parametrize("degree", [3, 5])
def test_gradient_noise_by_simulation(degree):
    """Power of ½D(n₀ + S n₁) over random shifts, within the sampling error of the simulated pixels."""
    rng = np.random.default_rng(4)
    powers = []
    for _ in range(40):
        still, moved = rng.normal(size=(2, 64, 64))
        y, x = np.mgrid[:64, :64] + rng.uniform(0, 1, size=(2, 1, 1))
        mean = (still + naive.interpolate(moved, x, y, degree)) / 2
        powers.append((naive.differentiate(mean, 1)[8:-8, 8:-8] ** 2).mean())
    error = np.std(powers) / np.sqrt(len(powers))
    assert gradient_noise(degree, DERIVATIVE) == pytest.approx(np.mean(powers), abs=4 * error)
