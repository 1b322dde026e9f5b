"""The window's weights, its resolution and the noise of sharpening; strips on threads."""

import numpy as np
import pytest
from scipy.integrate import quad

from sixflow.engine import threads
from sixflow.engine.response import response
from sixflow.engine.window import CUT, attenuation_period, moment_weights, sharpening_noise, window_sigma


@pytest.mark.parametrize("window", [5, 12.5, 31, 61])
def test_weights(window):
    sigma = window_sigma(window)
    table = moment_weights(sigma)
    x = np.arange(table.shape[1]) - table.shape[1] // 2
    assert x[-1] >= CUT * sigma
    assert table[0].sum() == pytest.approx(1, abs=1e-3)
    assert (table[0] * x**2).sum() == pytest.approx(sigma**2, rel=1e-2)
    np.testing.assert_allclose(table[1], table[0] * x / sigma, atol=1e-16)
    np.testing.assert_allclose(table[2], table[0] * (x / sigma) ** 2, atol=1e-16)
    # the effective area (Σw)²/Σw² is that of a square of side `window`
    assert 1 / (table[0] ** 2).sum() == pytest.approx(window, rel=2e-3)


def test_squared_weights():
    once, squared = moment_weights(4.0), moment_weights(4.0, power=2)
    margin = (once.shape[1] - squared.shape[1]) // 2
    assert margin > 0
    np.testing.assert_allclose(squared[0], once[0, margin:-margin] ** 2)
    np.testing.assert_allclose(squared[2], once[0, margin:-margin] * once[2, margin:-margin], atol=1e-18)


@pytest.mark.parametrize("sharpen", [0, 1, 2, 5, 16])
def test_attenuation_period(sharpen):
    period = attenuation_period(9.0, sharpen)
    M = np.exp(-((2 * np.pi / period * 9.0) ** 2) / 2)
    assert response(M, sharpen) == pytest.approx(0.9)
    assert 1 - (1 - M) ** (sharpen + 1) == pytest.approx(0.9, abs=1e-5)  # as repeated corrections


@pytest.mark.parametrize("sharpen", [0, 1, 2, 5, 16])
def test_sharpening_noise(sharpen):
    displacement, gradient = sharpening_noise(sharpen)
    assert displacement == pytest.approx(
        np.sqrt(2 * quad(lambda x: response(np.exp(-x), sharpen) ** 2, 0, 60)[0]), rel=1e-5
    )
    assert gradient == pytest.approx(
        np.sqrt(4 * quad(lambda x: x * response(np.exp(-x), sharpen) ** 2, 0, 60)[0]), rel=1e-5
    )


@pytest.mark.parametrize("workers", [1, 2])
def test_strips_cover_every_row_once(monkeypatch, workers):
    monkeypatch.setattr(threads, "worker_count", lambda: workers)
    for rows, height in [(1, 64), (64, 64), (65, 64), (200, 7)]:
        seen = np.zeros(rows, int)

        def task(start, stop, seen=seen, height=height):
            assert 0 < stop - start <= height
            seen[start:stop] += 1

        threads.over_strips(task, rows, height)
        np.testing.assert_array_equal(seen, 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_strip_is_raised(monkeypatch, workers):
    monkeypatch.setattr(threads, "worker_count", lambda: workers)

    def task(start, stop):
        if start == 4:
            raise ValueError("strip 4")

    with pytest.raises(ValueError, match="strip 4"):
        threads.over_strips(task, 10, 2)
