"""Groups acting on images: operators, their brackets, and how they are carried along. Derivatives by differences."""

from __future__ import annotations

import numpy as np
import pytest

from sixflow.groups import EIGHT, GROUPS, PROJECTIVE, Group, coefficients_from_eight, eight_from_coefficients
from sixflow.groups.planar_flow import COEFFICIENTS_FROM_EIGHT, EIGHT_FROM_COEFFICIENTS

each = pytest.mark.parametrize("group", GROUPS.values(), ids=str)
POINTS = np.random.default_rng(0).uniform(-0.8, 0.8, (30, 2))


def image(points):
    x, y = points[..., 0], points[..., 1]
    return np.sin(1.3 * x + 0.4) * np.cos(0.7 * y - 0.2) + 0.3 * x * y


def gradient(function, points, h=1e-4):
    """Differences of fourth order: rounding 1e-12, truncation 1e-16 times the fifth derivative."""
    columns = []
    for step in h * np.eye(2):
        rise = 8 * (function(points + step) - function(points - step))
        columns.append((rise - function(points + 2 * step) + function(points - 2 * step)) / (12 * h))
    return np.stack(columns, axis=-1)


def operator(group, tau):
    """L as an operator: function → function."""
    return lambda function: lambda points: group.apply(tau, gradient(function, points), points)


def motions(group, count, size=0.5, seed=1):
    return np.random.default_rng(seed).normal(0, size, (count, group.dimension))


@each
class TestOperators:
    def test_velocity_of_the_trajectory_is_the_field(self, group: Group):
        h = 1e-5
        for tau in motions(group, 5):
            ahead, behind = (group.act(group.exp(s * h * tau), POINTS) for s in (1, -1))
            np.testing.assert_allclose(
                (ahead - behind) / (2 * h), group.field(tau, POINTS), rtol=0, atol=1e-8
            )

    def test_field_is_linear(self, group: Group):
        a, b = motions(group, 2)
        total = group.field(a, POINTS) + 2 * group.field(b, POINTS)
        np.testing.assert_allclose(group.field(a + 2 * b, POINTS), total, rtol=0, atol=1e-14)

    def test_apply_is_the_derivative_along_the_motion(self, group: Group):
        h = 1e-5
        for tau in motions(group, 5):
            ahead, behind = (image(group.act(group.exp(s * h * tau), POINTS)) for s in (1, -1))
            found = group.apply(tau, gradient(image, POINTS), POINTS)
            np.testing.assert_allclose((ahead - behind) / (2 * h), found, rtol=0, atol=1e-8)

    def test_brackets_of_operators_have_the_opposite_sign(self, group: Group):
        """L_X L_Y − L_Y L_X = −L_[X, Y]."""
        basis = np.eye(group.dimension)
        for i in range(group.dimension):
            for j in range(i):
                X, Y = operator(group, basis[i]), operator(group, basis[j])
                numeric = X(Y(image))(POINTS) - Y(X(image))(POINTS)
                want = -operator(group, group.bracket(basis[i], basis[j]))(image)(POINTS)
                np.testing.assert_allclose(numeric, want, rtol=0, atol=1e-7)

    def test_images_that_are_carried_along(self, group: Group):
        """(M·I)(x) = I(M⁻¹x): M₂·(M₁·I) = (M₂M₁)·I, and exp(εX)·I = I − ε L_X I."""
        first, second = (group.exp(tau) for tau in motions(group, 2, 0.1))
        carry = lambda M, seen: lambda points: seen(group.act(group.inverse(M), points))  # noqa: E731
        twice, once = carry(second, carry(first, image)), carry(group.compose(second, first), image)
        np.testing.assert_allclose(twice(POINTS), once(POINTS), rtol=0, atol=1e-13)
        tau, small = motions(group, 1)[0], 1e-5
        moved = carry(group.exp(small * tau), image)(POINTS) - carry(group.exp(-small * tau), image)(POINTS)
        np.testing.assert_allclose(
            moved / (2 * small), -operator(group, tau)(image)(POINTS), rtol=0, atol=1e-8
        )

    def test_operators_that_are_carried_along(self, group: Group):
        """M·(L_X (M⁻¹·I)) = L_Y I with Y = Ad_M X."""
        M = group.exp(motions(group, 1, 0.2, seed=3)[0])
        for tau in np.eye(group.dimension):
            back = lambda points: image(group.act(M, points))  # noqa: E731
            seen = operator(group, tau)(back)(group.act(group.inverse(M), POINTS))
            want = operator(group, group.adjoint(M) @ tau)(image)(POINTS)
            np.testing.assert_allclose(seen, want, rtol=0, atol=1e-9)

    def test_fields_that_are_carried_along(self, group: Group):
        """The field of Ad_M X at Mx is that of X at x, carried by the derivative of M."""
        M = group.exp(motions(group, 1, 0.2, seed=4)[0])
        tau = motions(group, 1)[0]
        J = np.stack([gradient(lambda p, k=k: group.act(M, p)[..., k], POINTS) for k in range(2)], axis=-2)
        carried = np.einsum("...jk,...k->...j", J, group.field(tau, POINTS))
        found = group.field(group.adjoint(M) @ tau, group.act(M, POINTS))
        np.testing.assert_allclose(found, carried, rtol=0, atol=1e-10)


class TestPlanarFlow:
    def test_field_is_kanatanis(self):
        """Eagleson, eq. (2)."""
        eight = np.random.default_rng(0).normal(size=(20, 8))
        u0, v0, A, B, C, D, E, F = eight.T
        x, y = np.random.default_rng(1).normal(0, 3, (2, 20))
        u = u0 + A * x + B * y + (E * x + F * y) * x
        v = v0 + C * x + D * y + (E * x + F * y) * y
        found = PROJECTIVE.field(coefficients_from_eight(eight), np.stack([x, y], axis=-1))
        np.testing.assert_allclose(found, np.stack([u, v], axis=-1), rtol=0, atol=1e-12)

    def test_round_trip(self):
        eight = np.random.default_rng(0).normal(size=(4, 5, 8))
        np.testing.assert_allclose(
            eight_from_coefficients(coefficients_from_eight(eight)), eight, rtol=0, atol=1e-15
        )
        np.testing.assert_array_equal(COEFFICIENTS_FROM_EIGHT @ EIGHT_FROM_COEFFICIENTS, np.eye(8))
        assert EIGHT == ("u0", "v0", "A", "B", "C", "D", "E", "F")

    def test_finite_flow_of_a_plane_is_a_homography(self):
        """Integrate the field by Runge and Kutta's rule: its solution is the exponential."""
        tau = coefficients_from_eight([0.3, -0.2, 0.1, 0.3, -0.2, 0.15, 0.2, -0.1])
        points, steps = POINTS.copy(), 200
        for _ in range(steps):
            k1 = PROJECTIVE.field(tau, points)
            k2 = PROJECTIVE.field(tau, points + k1 / (2 * steps))
            k3 = PROJECTIVE.field(tau, points + k2 / (2 * steps))
            k4 = PROJECTIVE.field(tau, points + k3 / steps)
            points += (k1 + 2 * k2 + 2 * k3 + k4) / (6 * steps)
        np.testing.assert_allclose(PROJECTIVE.act(PROJECTIVE.exp(tau), POINTS), points, rtol=0, atol=1e-10)
