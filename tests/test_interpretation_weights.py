"""Weights of a region's points: they follow the texture, not the noise of covariances."""

from __future__ import annotations

import numpy as np
import pytest

import sixflow
from interpreted import ERROR, SHAPE, SIGMA, make_field
from sixflow import synth
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.spline import gradient_noise
from sixflow.interpretation import fit_region
from sixflow.interpretation.correlation import noise_share, unknowns_from_six
from sixflow.interpretation.points import select_points
from sixflow.interpretation.weights import precision_around, symmetric_power, weights

X, Y = 8.0 * np.arange(9), 8.0 * np.arange(7)
USED = np.ones((7, 9), bool)
UNIFORM = ERROR**2 * np.diag([1, 0.5, 0.5] * 2)


def estimated(rng, count, freedom=150):
    """Covariances as if each were estimated from `freedom` residuals."""
    drawn = rng.normal(size=(count, freedom, 6)) * np.sqrt(np.diag(UNIFORM))
    return np.einsum("nki,nkj->nij", drawn, drawn) / freedom


def test_weights_of_equal_points_are_their_precision():
    covariance = np.broadcast_to(UNIFORM, (63, 6, 6))
    around = precision_around(covariance, USED, X, Y, SIGMA)
    np.testing.assert_allclose(around, np.linalg.inv(covariance), rtol=1e-12, atol=1e-8)
    np.testing.assert_allclose(weights(covariance, around), around, rtol=1e-12, atol=1e-8)


def test_mean_precision_against_the_sum():
    rng = np.random.default_rng(1)
    used = rng.random(USED.shape) < 0.7
    covariance = estimated(rng, int(used.sum()))
    rows, columns = used.nonzero()
    square = (X[columns] - X[columns][:, None]) ** 2 + (Y[rows] - Y[rows][:, None]) ** 2
    share = np.exp(-square / (4 * SIGMA**2))
    expected = np.einsum("pq,qij->pij", share / share.sum(axis=1, keepdims=True), np.linalg.inv(covariance))
    np.testing.assert_allclose(
        precision_around(covariance, used, X, Y, SIGMA), expected, rtol=1e-9, atol=1e-6
    )


def test_no_combination_has_more_than_twice_its_own_weight():
    rng = np.random.default_rng(2)
    covariance = estimated(rng, 63) * np.exp(rng.normal(0, 2, 63))[:, None, None]
    covariance[20, 0] *= 1e3  # one direction of one point
    covariance[20, :, 0] *= 1e3
    found = weights(covariance, precision_around(covariance, USED, X, Y, SIGMA))
    own = np.linalg.eigvals(found @ covariance).real
    assert own.min() > 0.5 - 1e-6
    assert own.max() < 2 + 1e-6
    np.testing.assert_allclose(found, np.swapaxes(found, 1, 2), rtol=1e-9, atol=1e-3)


def test_noise_of_covariances_is_averaged():
    covariance = estimated(np.random.default_rng(3), 63)
    root = symmetric_power(UNIFORM[None], 0.5)
    own, found = (
        (root @ W @ root).std(axis=0).mean()
        for W in (
            np.linalg.inv(covariance),
            weights(covariance, precision_around(covariance, USED, X, Y, SIGMA)),
        )
    )
    assert found < 0.5 * own


def test_noise_of_covariances_hardly_changes_standard_errors():
    """With the points' own covariances as weights: 3 % too small, for the same noise."""
    field = make_field(lambda x, y: np.zeros((*x.shape, 6)))
    exact = np.diagonal(fit_region(field).eight.covariance)
    back = np.linalg.inv(unknowns_from_six(SIGMA))
    rng, found = np.random.default_rng(4), []
    for _ in range(6):
        noisy = field.copy(deep=True)
        shape = noisy.covariance.shape
        noisy.covariance.values[:] = (back @ estimated(rng, shape[1] * shape[2]) @ back.T).reshape(shape)
        found.append(np.diagonal(fit_region(noisy).eight.covariance))
    np.testing.assert_allclose(np.sqrt(np.mean(found, axis=0) / exact), 1, atol=0.015)


def gradient_power(frame, axis):
    """Mean square of the 8th-order difference, away from the border."""
    terms = [
        c * (np.roll(frame, -k, axis) - np.roll(frame, k, axis)) for k, c in enumerate(DERIVATIVE, start=1)
    ]
    return (sum(terms)[30:-30, 30:-30] ** 2).mean()


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_share_of_noise_from_the_covariances_of_a_field(noise):
    motion = synth.Affine.translation(0.4, 0.3)
    made = synth.pair(synth.Speckle(seed=3), motion, SHAPE, sensor=synth.Sensor(noise=noise, seed=1))
    points = select_points(sixflow.measure(made.frame0, made.frame1, window=31), None, 0, False)
    T = unknowns_from_six(points.sigma)
    found = noise_share(
        np.linalg.inv(T @ points.covariance[points.used] @ T.T), points.sigma, points.gradient_noise
    )
    clean = synth.pair(synth.Speckle(seed=3), motion, SHAPE).frame0
    power = np.mean([gradient_power(clean, axis) for axis in (0, 1)])
    assert found == pytest.approx(gradient_noise(5, DERIVATIVE) * noise**2 / power, rel=0.15)
