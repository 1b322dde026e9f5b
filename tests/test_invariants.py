"""Invariants: how they turn with the axes, what they mean, and coverage of their standard errors."""

from __future__ import annotations

import numpy as np
import pytest

from sixflow import convention, invariants
from sixflow.errors import InputError
from sixflow.groups import NUMBER_PER_COEFFICIENT, PROJECTIVE
from sixflow.invariants import WEIGHTS, deformation, kanatani, size_and_direction, turn_axes, turning_matrix

RNG = np.random.default_rng(0)
NUMBERS = RNG.normal(size=(4, 5, 8))
ANGLES = np.array([0.0, 0.3, -1.2, np.pi / 2, np.pi, 4.0])


def covariances(shape, count, size=1.0):
    root = np.random.default_rng(1).normal(0, size, (*shape, count, count))
    return root @ root.swapaxes(-1, -2)


class TestTurning:
    @pytest.mark.parametrize("angle", ANGLES)
    def test_law_of_the_weights(self, angle):
        """z' = e^{−inθ} z: Eagleson, §2."""
        before, after = kanatani(NUMBERS), kanatani(turn_axes(NUMBERS, angle))
        for name, weight in WEIGHTS.items():
            want = np.exp(-1j * weight * angle) * getattr(before, name)
            np.testing.assert_allclose(getattr(after, name), want, rtol=0, atol=1e-15 * 8, err_msg=name)

    @pytest.mark.parametrize("angle", ANGLES)
    def test_law_follows_from_the_turned_field(self, angle):
        """The vector field in the new coordinates x' = R(−θ) x, against its numbers in the old ones."""
        tau, turned = NUMBERS / NUMBER_PER_COEFFICIENT, turn_axes(NUMBERS, angle) / NUMBER_PER_COEFFICIENT
        c, s = np.cos(angle), np.sin(angle)
        to_new = np.array([[c, s], [-s, c]])
        points = RNG.normal(size=(4, 5, 2))
        np.testing.assert_allclose(
            PROJECTIVE.field(turned, points @ to_new.T),
            PROJECTIVE.field(tau, points) @ to_new.T,
            rtol=0,
            atol=1e-13,
        )

    @pytest.mark.parametrize("angle", ANGLES)
    def test_it_is_the_adjoint_of_the_rotation(self, angle):
        new_from_old = PROJECTIVE.exp(-angle * np.eye(8)[3])
        want = NUMBER_PER_COEFFICIENT[:, None] * PROJECTIVE.adjoint(new_from_old) / NUMBER_PER_COEFFICIENT
        np.testing.assert_allclose(turning_matrix(angle, 8), want, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(turning_matrix(angle), turning_matrix(angle, 8)[:6, :6])

    def test_gradient_turns_as_a_tensor(self):
        six, angle = NUMBERS[..., :6], 0.7
        R = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        want = R @ convention.gradient(six) @ R.T
        np.testing.assert_allclose(convention.gradient(turn_axes(six, angle)), want, rtol=0, atol=1e-14)

    def test_turns_add_up_and_can_be_taken_back(self):
        twice = turn_axes(turn_axes(NUMBERS, 0.4), 1.1)
        np.testing.assert_allclose(twice, turn_axes(NUMBERS, 1.5), rtol=0, atol=1e-14)
        np.testing.assert_allclose(turn_axes(twice, -1.5), NUMBERS, rtol=0, atol=1e-14)
        J = turning_matrix(ANGLES, 8)
        np.testing.assert_allclose(
            J @ J.swapaxes(-1, -2), np.broadcast_to(np.eye(8), J.shape), rtol=0, atol=1e-15
        )

    @pytest.mark.parametrize("count", [6, 8])
    def test_covariance_turns_along(self, count):
        C, numbers = covariances((5,), count), NUMBERS[..., :count]
        turned, spread = turn_axes(numbers, ANGLES[1], C)
        assert spread.shape == C.shape
        _, want = convention.propagate(
            lambda n: turn_axes(n, ANGLES[1]), numbers, np.broadcast_to(C, (4, 5, count, count))
        )
        np.testing.assert_allclose(
            np.broadcast_to(spread, want.shape), want, rtol=0, atol=1e-8 * np.abs(C).max()
        )
        # what is invariant keeps its error
        size = size_and_direction("S", numbers, C), size_and_direction("S", turned, spread)
        np.testing.assert_allclose(size[0].size, size[1].size, rtol=1e-14)
        np.testing.assert_allclose(size[0].standard_errors, size[1].standard_errors, rtol=1e-10)

    def test_y_up_takes_the_conjugate(self):
        before, after = kanatani(NUMBERS[..., :6]), kanatani(convention.to_y_up(NUMBERS[..., :6]))
        for name in ("U0", "T", "S"):
            np.testing.assert_array_equal(getattr(after, name), np.conj(getattr(before, name)))
        np.testing.assert_array_equal(after.R, -before.R)
        assert after.K is None

    def test_angles_are_broadcast(self):
        turned = turn_axes(NUMBERS[:, :1], np.linspace(0, 1, 7))
        assert turned.shape == (4, 7, 8)
        np.testing.assert_array_equal(turned[2, 3], turn_axes(NUMBERS[2, 0], np.linspace(0, 1, 7)[3]))


class TestKanatani:
    def test_from_the_eight(self):
        """Eagleson, §2: T = A + D, R = C − B, S = (A − D) + i(B + C), K = E + iF."""
        eight = RNG.normal(size=(7, 8))
        u0, v0, A, B, C, D, E, F = eight.T
        found = kanatani(invariants.numbers_from_eight(eight))
        for name, want in (("U0", u0 + 1j * v0), ("T", A + D), ("R", C - B), ("K", E + 1j * F)):
            np.testing.assert_allclose(getattr(found, name), want, rtol=0, atol=1e-15, err_msg=name)
        np.testing.assert_allclose(found.S, (A - D) + 1j * (B + C), rtol=0, atol=1e-15)

    def test_covariance_of_the_eight(self):
        eight, C = RNG.normal(size=(7, 8)), covariances((7,), 8)
        numbers, spread = invariants.numbers_from_eight(eight, C)
        np.testing.assert_array_equal(numbers, invariants.numbers_from_eight(eight))
        _, want = convention.propagate(invariants.numbers_from_eight, eight, C)
        np.testing.assert_allclose(spread, want, rtol=0, atol=1e-8)
        np.testing.assert_allclose(spread[:, 2, 2], (C[:, 2, 2] + C[:, 5, 5] + 2 * C[:, 2, 5]), rtol=1e-12)


class TestDeformation:
    def test_parts_add_up(self):
        six = NUMBERS[..., :6]
        parts = invariants.gradient_parts(six)
        np.testing.assert_allclose(sum(parts), convention.gradient(six), rtol=0, atol=1e-15)
        np.testing.assert_allclose(parts.curl, -parts.curl.swapaxes(-1, -2), rtol=0, atol=0)
        np.testing.assert_allclose(np.trace(parts.deformation, axis1=-2, axis2=-1), 0, rtol=0, atol=0)
        found = deformation(six)
        m, a = found.magnitude / 2, 2 * found.axis
        want = np.stack([m * np.cos(a), m * np.sin(a), m * np.sin(a), -m * np.cos(a)], axis=-1)
        np.testing.assert_allclose(parts.deformation.reshape(4, 5, 4), want, rtol=0, atol=1e-14)

    def test_axis_is_that_of_greatest_extension(self):
        six = NUMBERS[..., :6]
        found = deformation(six)
        strain = convention.small_strain(convention.gradient(six))
        np.testing.assert_allclose(found.axis, convention.principal_angle(strain), rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.magnitude, convention.max_shear(strain), rtol=1e-14)
        along = np.stack([np.cos(found.axis), np.sin(found.axis)], axis=-1)
        longer = np.einsum("...i,...ij,...j->...", along, strain, along)
        np.testing.assert_allclose(longer, (found.divergence + found.magnitude) / 2, rtol=0, atol=1e-14)

    @pytest.mark.parametrize("angle", ANGLES)
    def test_turned_axes(self, angle):
        before, after = deformation(NUMBERS[..., :6]), deformation(turn_axes(NUMBERS[..., :6], angle))
        for name in ("divergence", "curl", "magnitude"):
            np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=1e-13, err_msg=name)
        turned = np.exp(2j * after.axis) - np.exp(2j * (before.axis - angle))
        np.testing.assert_allclose(np.abs(turned), 0, rtol=0, atol=1e-13)
        assert (np.abs(after.axis) <= np.pi / 2).all()

    def test_jacobian(self):
        six = NUMBERS[..., :6]
        stacked = lambda n: np.stack(deformation(n)[:4], axis=-1)  # noqa: E731
        want = convention.numerical_jacobian(stacked, six)
        np.testing.assert_allclose(invariants.deformation_jacobian(six), want, rtol=0, atol=1e-7)
        C = covariances((5,), 6)
        J = invariants.deformation_jacobian(six)
        np.testing.assert_allclose(
            deformation(six, C).covariance, J @ C @ J.swapaxes(-1, -2), rtol=1e-12, atol=1e-12
        )

    @pytest.mark.parametrize("name", ["U0", "S", "K"])
    def test_size_and_direction(self, name):
        C = covariances((5,), 8)
        found = size_and_direction(name, NUMBERS, C)
        z = getattr(kanatani(NUMBERS), name)
        np.testing.assert_allclose(
            found.size * np.exp(1j * WEIGHTS[name] * found.direction), z, rtol=0, atol=1e-14
        )
        both = lambda n: np.stack(size_and_direction(name, n)[:2], axis=-1)  # noqa: E731
        J = convention.numerical_jacobian(both, NUMBERS)
        want = J @ C @ J.swapaxes(-1, -2)
        np.testing.assert_allclose(found.covariance, want, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(found.standard_errors**2, np.diagonal(want, axis1=-2, axis2=-1), rtol=1e-6)
        assert size_and_direction(name, NUMBERS).standard_errors is None

    def test_size_of_the_shear_is_the_deformation(self):
        C = covariances((5,), 6)
        one, other = size_and_direction("S", NUMBERS[..., :6], C), deformation(NUMBERS[..., :6], C)
        np.testing.assert_array_equal(one.size, other.magnitude)
        np.testing.assert_array_equal(one.direction, other.axis)
        np.testing.assert_allclose(one.covariance, other.covariance[..., 2:, 2:], rtol=1e-13)


class TestErrors:
    def test_coverage_of_the_standard_errors(self):
        """10 standard errors from zero, the first order holds to a few percent: unit spread of standardised errors."""
        rng = np.random.default_rng(3)
        C = covariances((), 6, 0.004)
        six = np.array([0.3, 0.1, 0.02, 0.01, 0.0, 0.0])
        six[4:] = 10 * np.sqrt(C[[4, 5], [4, 5]].max()) * np.array([0.6, -0.8])
        count = 40_000
        seen = deformation(rng.multivariate_normal(six, C, count), C)
        true = np.array(deformation(six)[:4])
        error = np.stack(seen[:4], axis=-1) - true
        standardised = error / np.sqrt(np.diag(deformation(six, C).covariance))
        np.testing.assert_allclose(standardised.std(axis=0), 1, rtol=0, atol=4 / np.sqrt(2 * count) + 0.02)
        # and the mean of the squared size, which is exact at any distance
        rise = (seen.magnitude**2).mean() - true[2] ** 2
        np.testing.assert_allclose(rise, C[4, 4] + C[5, 5], rtol=0.1)

    def test_errors_at_zero(self):
        C = covariances((3,), 6)
        found = deformation(np.zeros((3, 6)), C)
        np.testing.assert_array_equal(found.magnitude, 0)
        np.testing.assert_array_equal(found.axis, 0)
        np.testing.assert_array_equal(found.standard_errors[:, 3], np.inf)
        np.testing.assert_allclose(found.covariance[:, :2, :2], C[:, 2:4, 2:4], rtol=1e-15)
        largest = np.linalg.eigvalsh(C[:, 4:, 4:])[:, -1]
        np.testing.assert_allclose(found.covariance[:, 2, 2], largest, rtol=1e-13)
        assert np.isnan(found.covariance[:, 2, [0, 1, 3]]).all()
        assert np.isnan(found.covariance[:, 3, :3]).all()
        assert np.isnan(invariants.deformation_jacobian(np.zeros(6))[2:, 4:]).all()

    def test_error_at_zero_is_the_largest_of_all_directions(self):
        C = covariances((), 6)
        around = np.linspace(0, 2 * np.pi, 721)
        near = np.zeros((721, 6))
        near[:, 4], near[:, 5] = 1e-9 * np.cos(around), 1e-9 * np.sin(around)
        errors = deformation(near, C).standard_errors
        at_zero = deformation(np.zeros(6), C).standard_errors
        np.testing.assert_allclose(errors[:, 2].max(), at_zero[2], rtol=1e-4)
        assert (errors[:, 3] > 1e8 * np.sqrt(np.linalg.eigvalsh(C[4:, 4:])[0])).all()

    def test_only_the_undetermined_points_are_affected(self):
        six, C = NUMBERS[0, :, :6].copy(), covariances((5,), 6)
        six[2, 4:] = 0, -0.0
        found = deformation(six, C)
        np.testing.assert_array_equal(
            np.isinf(found.standard_errors[:, 3]), [False, False, True, False, False]
        )
        assert found.axis[2] == 0
        assert np.isfinite(found.covariance[[0, 1, 3, 4]]).all()

    def test_nan_stays_nan_silently(self):
        six = np.zeros((2, 6))
        six[:, 4], six[0] = 0.1, np.nan
        found = deformation(six, np.broadcast_to(np.eye(6), (2, 6, 6)))
        assert np.isnan(found.covariance[0, 2:]).all()
        assert np.isnan(found.magnitude[0])
        assert np.isfinite(found.standard_errors[1]).all()
        assert np.isnan(turn_axes(six, 0.1)[0]).all()


def test_refusals():
    for function in (kanatani, lambda n: turn_axes(n, 0.1), lambda n: size_and_direction("U0", n)):
        with pytest.raises(
            InputError, match=r"numbers of shape \(7,\): the last dimension must be 6, for u, v"
        ):
            function(np.zeros(7))
    with pytest.raises(InputError, match="numbers of dtype complex128"):
        kanatani(np.zeros(6) * 1j)
    with pytest.raises(
        InputError, match="name='T': must be 'U0', 'S' or 'K'; T and R are numbers without direction"
    ):
        size_and_direction("T", np.zeros(6))
    with pytest.raises(InputError, match=r"name='K': numbers of shape \(6,\) hold only the six"):
        size_and_direction("K", np.zeros(6))
    with pytest.raises(
        InputError, match=r"covariance of shape \(8, 8\): the last dimensions must be \(6, 6\)"
    ):
        deformation(np.zeros(6), np.eye(8))
    with pytest.raises(InputError, match=r"covariance of shape \(6,\)"):
        turn_axes(np.zeros(6), 0.1, np.ones(6))
    with pytest.raises(InputError, match="count=7: must be 6, or 8"):
        turning_matrix(0.1, 7)
    with pytest.raises(InputError, match="angle"):
        turning_matrix("left")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"numbers \(3,\), angle \(2,\)"):
        turn_axes(np.zeros((3, 6)), [0.1, 0.2])
    with pytest.raises(InputError, match=r"six \(3,\), covariance \(2,\)"):
        deformation(np.zeros((3, 6)), np.zeros((2, 6, 6)))
    with pytest.raises(InputError, match=r"eight of shape \(6,\): the last dimension must be 8, for u0, v0"):
        invariants.numbers_from_eight(np.zeros(6))
    with pytest.raises(InputError, match="the six numbers"):
        invariants.gradient_parts(np.zeros(8))
