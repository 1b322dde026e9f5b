"""The polynomials of sharpening: what they promise, and that nothing that keeps it has less noise."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.optimize import minimize

from sixflow.engine.response import DEGREE, powers, quotient, resolved, response
from sixflow.engine.window import sharpening_noise

COUNTS = range(1, 17)
M = (1 - np.cos(np.linspace(0, np.pi, 2001))) / 2


@pytest.mark.parametrize("sharpen", COUNTS)
def test_no_overshoot_and_the_resolution_of_repeated_corrections(sharpen):
    T = response(M, sharpen)
    assert T[0] == 0
    assert T[-1] == pytest.approx(1, abs=1e-12)
    assert np.diff(T).min() > -1e-5
    assert response(1 - 0.1 ** (1 / (sharpen + 1)), sharpen) == pytest.approx(0.9, abs=1e-5)


@pytest.mark.parametrize("sharpen", COUNTS)
def test_pass_band_is_flat(sharpen):
    kind = min(sharpen, 2)
    edge, edge_of_kind = (-np.log(resolved(n)) for n in (sharpen, kind))
    x = np.linspace(0, 1, 500)
    floor = 1 - (1 - np.exp(-x * edge_of_kind)) ** (kind + 1)
    assert (response(np.exp(-x * edge), sharpen) - floor).min() > -2e-4


@pytest.mark.parametrize("sharpen", [0, 1, 4, 16])
def test_powers(sharpen):
    np.testing.assert_allclose(
        np.polynomial.polynomial.polyval(M, powers(sharpen)), response(M, sharpen), atol=1e-8
    )


@pytest.mark.parametrize("sharpen", COUNTS)
def test_less_noise_than_repeated_corrections(sharpen):
    x = np.linspace(0, 60, 60001)
    power = (1 - (1 - np.exp(-x)) ** (sharpen + 1)) ** 2
    repeated = np.sqrt([2 * np.trapezoid(power, x), 4 * np.trapezoid(x * power, x)])
    assert (np.array(sharpening_noise(sharpen)) < repeated).all()
    assert response(1e-9, sharpen) / 1e-9 < sharpen + 1 + 1e-6


@pytest.mark.parametrize("sharpen", [1, 4])
def test_optimum(sharpen):
    """The constrained optimum, found anew, has the noise of the table."""
    kind = min(sharpen, 2)
    edge, edge_of_kind = (-np.log(resolved(n)) for n in (sharpen, kind))

    def basis(whole):
        return whole[:, None] * chebyshev.chebvander(2 * whole - 1, DEGREE - 1)

    nodes = (1 - np.cos(np.pi * (np.arange(2000) + 0.5) / 2000)) / 2
    weight = np.sqrt(nodes * (1 - nodes)) * np.pi / 2000 / nodes  # dM/M = dx
    B = basis(nodes)
    H = (B * (weight / (2 * edge) - weight * np.log(nodes) / (2 * edge**2))[:, None]).T @ B
    rising = np.diff(basis(M[::8]), axis=0)
    share = np.linspace(0.04, 1, 49)[:-1] ** 2
    band = basis(np.exp(-share * edge))
    floor = 1 - (1 - np.exp(-share * edge_of_kind)) ** (kind + 1)
    ends, values = basis(np.array([resolved(sharpen), 1.0])), np.array([0.9, 1.0])
    found = minimize(
        lambda q: q @ H @ q,
        quotient(sharpen),
        jac=lambda q: 2 * H @ q,
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
        constraints=[
            {"type": "eq", "fun": lambda q: ends @ q - values, "jac": lambda q: ends},
            {"type": "ineq", "fun": lambda q: rising @ q, "jac": lambda q: rising},
            {"type": "ineq", "fun": lambda q: band @ q - floor, "jac": lambda q: band},
        ],
    )
    assert quotient(sharpen) @ H @ quotient(sharpen) == pytest.approx(found.fun, rel=2e-3)
