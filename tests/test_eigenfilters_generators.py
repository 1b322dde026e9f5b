"""Generators: fields, trajectories against Eagleson's eq. (4) and SciPy's exponential, brackets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.linalg import expm

from sixflow import convention
from sixflow.eigenfilters.generators import (
    BY_NAME,
    L_B,
    Generator,
    L_b,
    L_r,
    L_s,
    L_t,
    L_x,
    L_y,
    as_generator,
    bracket,
    commute,
)
from sixflow.errors import InputError

ALL = (L_x, L_y, L_s, L_r, L_b, L_B)
EXP, COS, SIN, COSH, SINH = np.exp, np.cos, np.sin, np.cosh, np.sinh
TRAJECTORIES = {
    "L_x": lambda t, x, y: (x + t, y),
    "L_y": lambda t, x, y: (x, y + t),
    "L_s": lambda t, x, y: (x * EXP(t), y * EXP(t)),
    "L_r": lambda t, x, y: (x * COS(t) - y * SIN(t), x * SIN(t) + y * COS(t)),
    "L_b": lambda t, x, y: (x * EXP(t), y * EXP(-t)),
    "L_B": lambda t, x, y: (x * COSH(t) + y * SINH(t), x * SINH(t) + y * COSH(t)),
}
FIELDS = {
    "L_x": lambda x, y: (1 + 0 * x, 0 * y),
    "L_y": lambda x, y: (0 * x, 1 + 0 * y),
    "L_s": lambda x, y: (x, y),
    "L_r": lambda x, y: (-y, x),
    "L_b": lambda x, y: (x, -y),
    "L_B": lambda x, y: (y, x),
}
BRACKETS = {  # those of the 15 pairs that are not 0
    ("L_x", "L_s"): {"L_x": 1},
    ("L_y", "L_s"): {"L_y": 1},
    ("L_x", "L_r"): {"L_y": 1},
    ("L_y", "L_r"): {"L_x": -1},
    ("L_x", "L_b"): {"L_x": 1},
    ("L_y", "L_b"): {"L_y": -1},
    ("L_x", "L_B"): {"L_y": 1},
    ("L_y", "L_B"): {"L_x": 1},
    ("L_r", "L_b"): {"L_B": -2},
    ("L_r", "L_B"): {"L_b": 2},
    ("L_b", "L_B"): {"L_r": 2},
}
points = np.random.default_rng(5).normal(0, 10, (2, 40))
each = pytest.mark.parametrize("generator", ALL, ids=lambda g: g.symbol)


def test_names_and_order_are_those_of_the_convention():
    assert tuple(g.name for g in ALL) == convention.SIX
    assert tuple(g.symbol for g in ALL) == convention.GENERATOR_NAMES
    assert [g.index for g in ALL] == list(range(6))
    assert len(BY_NAME) == 12
    assert all(BY_NAME[g.name] is BY_NAME[g.symbol] is as_generator(g) is g for g in ALL)


@each
class TestGenerator:
    def test_field(self, generator: Generator):
        np.testing.assert_array_equal(generator.field(*points), FIELDS[generator.symbol](*points))

    def test_divergence_of_the_field(self, generator: Generator):
        (x, y), h = points, 0.5
        numeric = generator.field(x + h, y)[0] - generator.field(x - h, y)[0]
        numeric = (numeric + generator.field(x, y + h)[1] - generator.field(x, y - h)[1]) / (2 * h)
        np.testing.assert_allclose(numeric, generator.divergence, atol=1e-13)

    def test_trajectory(self, generator: Generator):
        tau = np.linspace(-1.5, 1.5, 7)[:, None]
        got = generator.flow(tau, *points)
        want = np.broadcast_arrays(*TRAJECTORIES[generator.symbol](tau, *points), tau + points[0])[:2]
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)

    def test_trajectory_is_the_exponential_of_the_matrix(self, generator: Generator):
        moved = expm(0.7 * generator.matrix) @ np.vstack([points, np.ones(points.shape[1])])
        np.testing.assert_allclose(generator.flow(0.7, *points), moved[:2], rtol=0, atol=1e-12)

    def test_group(self, generator: Generator):
        twice = generator.flow(0.4, *generator.flow(-1.1, *points))
        np.testing.assert_allclose(twice, generator.flow(-0.7, *points), rtol=0, atol=1e-12)

    def test_velocity_of_the_trajectory_is_the_field(self, generator: Generator):
        h = 1e-5
        ahead, behind = np.array(generator.flow(h, *points)), np.array(generator.flow(-h, *points))
        np.testing.assert_allclose((ahead - behind) / (2 * h), generator.field(*points), rtol=0, atol=1e-8)

    def test_apply_is_the_derivative_along_the_trajectory(self, generator: Generator):
        x, y, h = *points / 10, 1e-5
        derivative = generator.apply(np.cos(x) * y, np.sin(x), x, y)
        ahead, behind = (np.sin(a) * b for a, b in (generator.flow(h, x, y), generator.flow(-h, x, y)))
        np.testing.assert_allclose((ahead - behind) / (2 * h), derivative, rtol=0, atol=1e-8)

    def test_single_precision_stays_single(self, generator: Generator):
        x, y = points.astype(np.float32)
        moved = (*generator.field(x, y), *generator.flow(np.float32(0.1), x, y), generator.apply(x, y, x, y))
        assert all(a.dtype == np.float32 for a in moved)


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(ALL, 2)))
def test_brackets(first: Generator, second: Generator):
    want = np.zeros(6)
    for symbol, c in BRACKETS.get((first.symbol, second.symbol), {}).items():
        want[BY_NAME[symbol].index] = c
    np.testing.assert_array_equal(bracket(first, second), want)
    np.testing.assert_array_equal(bracket(second.name, first.symbol), -want)
    assert commute(first, second) is ((first.symbol, second.symbol) not in BRACKETS)


def test_bracket_is_that_of_the_operators():
    """On an image whose derivatives are known: L₁(L₂ I) − L₂(L₁ I), derivatives by differences."""
    x, y, h = *points / 10, 1e-4

    def along(generator, function):
        return lambda x, y: (
            (function(*generator.flow(h, x, y)) - function(*generator.flow(-h, x, y))) / (2 * h)
        )

    def image(x, y):
        return np.sin(x) * np.cos(0.5 * y + 0.2)

    for first, second in itertools.combinations(ALL, 2):
        numeric = along(first, along(second, image))(x, y) - along(second, along(first, image))(x, y)
        terms = [c * along(g, image)(x, y) for c, g in zip(bracket(first, second), ALL, strict=True)]
        np.testing.assert_allclose(numeric, sum(terms), rtol=0, atol=1e-6)


def test_time_balances_the_six():
    assert commute(L_t, L_s)
    assert commute("curl", L_t)
    assert L_t.flow(0.5, 2.0) == 2.5
    x, y = points / 10
    tau = 1e-3
    image = lambda x, y: np.sin(x) * np.cos(y)  # noqa: E731
    for g in ALL:
        before = image(*g.flow(-tau, x, y))  # frame 1 at x shows what frame 0 had at exp(−τL) x
        gradient = np.cos(x) * np.cos(y), -np.sin(x) * np.sin(y)
        balance = L_t.apply(image(x, y), before) + tau * g.apply(*gradient, x, y)
        np.testing.assert_allclose(balance, 0, atol=20 * tau**2)


def test_refusals():
    with pytest.raises(InputError, match="generator='dilation': must be one of u, L_x"):
        as_generator("dilation")
    with pytest.raises(InputError, match="first='L_t': L_t is a derivative in time"):
        bracket("L_t", L_x)
    with pytest.raises(InputError, match="second=3: must be one of"):
        commute(L_x, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="leading shapes"):
        L_s.field(np.zeros(3), np.zeros(4))
    with pytest.raises(InputError, match="tau of dtype complex128"):
        L_s.flow(1j, 0.0, 0.0)
    with pytest.raises(InputError, match="gradient_x"):
        L_s.apply(np.zeros(3), 0.0, np.zeros(4), 0.0)
    with pytest.raises(InputError, match="frame1"):
        L_t.apply(np.zeros(3), np.zeros(4))
