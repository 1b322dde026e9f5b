"""Group axioms, and exponential and logarithm against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, logm

from sixflow import convention as c
from sixflow.errors import InputError

SHAPES = [(), (7,), (3, 4), (0,)]
SCALES = [1e-12, 1e-6, 1e-3, 0.1, 1.0]  # of rates: near the identity, and large


def random_rates(shape, scale, seed):
    """Rates within the principal logarithm: the rotation stays below a half turn."""
    rates = np.random.default_rng(seed).normal(0, scale, (*shape, 6))
    rates[..., 3] = np.clip(rates[..., 3], -6.2, 6.2)
    return rates


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", SHAPES)
class TestAxioms:
    def test_log_undoes_exp_with_all_digits(self, shape, scale, seed):
        rates = random_rates(shape, scale, seed)
        np.testing.assert_allclose(c.log_six(c.exp_six(rates)), rates, rtol=0, atol=1e-13 * scale)

    def test_exp_undoes_log(self, shape, scale, seed):
        six = c.exp_six(random_rates(shape, scale, seed))
        np.testing.assert_allclose(c.exp_six(c.log_six(six)), six, rtol=1e-12, atol=1e-13 * scale)

    def test_inverse(self, shape, scale, seed):
        rates = random_rates(shape, scale, seed)
        six = c.exp_six(rates)
        back = c.inverse_six(six)
        np.testing.assert_allclose(back, c.exp_six(-rates), rtol=1e-11, atol=1e-12 * scale)
        np.testing.assert_allclose(c.compose_six(back, six), 0, atol=2e-12 * scale)
        np.testing.assert_allclose(c.compose_six(six, back), 0, atol=2e-12 * scale)

    def test_composition(self, shape, scale, seed):
        a, b, d = (c.exp_six(random_rates(shape, scale, 10 * seed + k)) for k in range(3))
        left, right = c.compose_six(a, c.compose_six(b, d)), c.compose_six(c.compose_six(a, b), d)
        np.testing.assert_allclose(left, right, rtol=1e-11, atol=1e-11 * scale)
        np.testing.assert_allclose(c.compose_six(a, np.zeros(6)), a, atol=1e-15 * scale)
        np.testing.assert_allclose(c.compose_six(np.zeros(6), a), a, atol=1e-15 * scale)
        points = np.random.default_rng(seed).normal(size=(*shape, 2))
        moved = c.transform_points(a, c.transform_points(b, points))
        np.testing.assert_allclose(c.transform_points(c.compose_six(a, b), points), moved, atol=1e-11)

    def test_one_parameter_groups(self, shape, scale, seed):
        """exp(sX) exp(tX) = exp((s + t) X)."""
        rates = random_rates(shape, scale, seed)
        halves = c.compose_six(c.exp_six(0.75 * rates), c.exp_six(0.25 * rates))
        np.testing.assert_allclose(halves, c.exp_six(rates), rtol=1e-11, atol=1e-12 * scale)

    def test_matrices_and_six_agree(self, shape, scale, seed):
        rates = random_rates(shape, scale, seed)
        affine, other = c.exp(c.algebra_from_six(rates)), c.affine_from_six(c.exp_six(rates[..., ::-1]))
        np.testing.assert_allclose(c.six_from_affine(affine), c.exp_six(rates), rtol=1e-11, atol=1e-15)
        np.testing.assert_allclose(c.compose(other, affine), other @ affine, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(c.inverse(affine), np.linalg.inv(affine), rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(c.log(affine), c.algebra_from_six(rates), rtol=1e-11, atol=1e-14)

    def test_first_order(self, shape, scale, seed):
        rates = random_rates(shape, scale, seed)
        if scale < 0.1:
            np.testing.assert_allclose(c.exp_six(rates), rates, atol=60 * scale**2)
            np.testing.assert_allclose(c.log_six(rates), rates, atol=60 * scale**2)


@pytest.mark.parametrize("scale", SCALES)
def test_exp_and_log_against_scipy(scale):
    algebra = c.algebra_from_six(random_rates((8,), scale, 5))
    affine = c.exp(algebra)
    np.testing.assert_allclose(affine, np.array([expm(A) for A in algebra]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(c.log(affine), np.array([logm(M).real for M in affine]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("short", [1e-1, 1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("sign", [-1, 1])
def test_rotations_close_to_the_half_turn(short, sign):
    angle = sign * (np.pi - short)
    rates = np.array([3.0, -2.0, 0.1, 2 * angle, 0, 0])
    six = c.exp_six(rates)
    F = np.exp(0.05) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(c.gradient(six) + np.eye(2), F, atol=1e-14)
    np.testing.assert_allclose(c.log_six(six), rates, atol=1e-12)


def test_each_one_parameter_group_of_the_paper():
    t = 0.7
    ch, sh, co, si = np.cosh(t), np.sinh(t), np.cos(t), np.sin(t)
    blocks = {
        "L_s": np.exp(t) * np.eye(2),
        "L_r": [[co, -si], [si, co]],
        "L_b": np.diag([np.exp(t), np.exp(-t)]),
        "L_B": [[ch, sh], [sh, ch]],
    }
    for name, block in blocks.items():
        coefficients = t * np.eye(6)[c.GENERATOR_NAMES.index(name)]
        six = c.six_from_coefficients(coefficients)
        np.testing.assert_allclose(c.gradient(six) + np.eye(2), block, atol=1e-15, err_msg=name)
        np.testing.assert_allclose(c.coefficients_from_six(six), coefficients, atol=1e-15, err_msg=name)
    np.testing.assert_array_equal(c.six_from_coefficients([1, 2, 0, 0, 0, 0]), [1, 2, 0, 0, 0, 0])


@pytest.mark.parametrize(
    "four",
    [
        (0, 0.5, 0.5, 0),  # nilpotent: simple shear
        (0, 0.5, 0.5 + 1e-9, 0),
        (0, 0.5 + 1e-9, 0.5, 0),
        (1e-13, 3.0, 0, 3.0),
        (0.2, 0, 0, 0),
        (1.0, 0, 1.0, 0),  # an eigenvalue of the rates is zero: φ by its formula would be 0/0
        (1.0, 0, 1.0 - 1e-12, 0),
        (0, 12.5, 0, 0),  # more than a turn
        (6.0, 0, 20.0, 0),
        (-40.0, 3.0, 1.0, 2.0),
        (5.0, 40.0, 1.0, 2.0),
    ],
)
def test_difficult_exponentials(four):
    rates = np.array([1.0, -2.0, *four])
    expected = expm(c.algebra_from_six(rates))
    size = np.abs(expected).max()
    np.testing.assert_allclose(c.exp(c.algebra_from_six(rates)) / size, expected / size, rtol=0, atol=1e-13)


@pytest.mark.parametrize("zoom", [1e-5, 1e-2, 0.3, 3.0, 1e5])
def test_logarithm_of_strong_zooms_and_stretches(zoom):
    same = c.log_six([0, 0, 2 * (zoom - 1), 0, 0, 0])
    np.testing.assert_allclose(same[2], 2 * np.log(zoom), rtol=1e-10)
    along_x = c.log_six([0, 0, zoom - 1, 0, zoom - 1, 0])
    np.testing.assert_allclose(along_x[[2, 4]], np.log(zoom), rtol=1e-10)


def test_small_motions_keep_their_relative_digits():
    rates = np.array([1e-20, 0, 3e-20, 2e-20, 1e-20, 5e-21])
    close = {"rtol": 1e-14, "atol": 1e-38}
    np.testing.assert_allclose(c.exp_six(rates), rates, **close)
    np.testing.assert_allclose(c.log_six(rates), rates, **close)
    np.testing.assert_allclose(c.inverse_six(rates), -rates, **close)


def test_float32_is_as_good_as_it_can_be():
    rates = random_rates((100,), 0.3, 0)
    six = c.exp_six(rates.astype(np.float32))
    assert six.dtype == c.log_six(six).dtype == c.inverse_six(six).dtype == np.float32
    assert c.coefficients_from_six(six).dtype == c.six_from_coefficients(six).dtype == np.float32
    np.testing.assert_allclose(six, c.exp_six(rates), atol=2e-6)
    np.testing.assert_allclose(c.log_six(six), rates, atol=5e-6)


NO_LOGARITHM = {
    "half turn": [0, 0, -4, 0, 0, 0],
    "two negative eigenvalues": [0, 0, -5, 0, 0.5, 0],
    "a fold": [0, 0, -3, 0, 1, 0],
    "singular": [0, 0, -1, 0, 1, 0],
    "collapse": [0, 0, -2, 0, 0, 0],
    "negative Jordan block": [0, 0, -4, 1, 1, 0],
}


@pytest.mark.parametrize("six", NO_LOGARITHM.values(), ids=NO_LOGARITHM)
def test_maps_without_logarithm(six):
    many = np.zeros((3, 4, 6))
    many[1, 2] = many[2, 0] = six
    with pytest.raises(InputError, match=r"six: 2 of 12 elements without real log.*index \(1, 2\)"):
        c.log_six(many)
    with pytest.raises(InputError, match="six: without real logarithm"):
        c.coefficients_from_six(six)
    seen = c.log_six(many, invalid="nan")
    assert np.isnan(seen[1, 2]).all()
    assert np.isnan(seen[2, 0]).all()
    assert np.isnan(seen).sum() == 12
    matrix = c.log(c.affine_from_six(six), invalid="nan")
    assert np.isnan(matrix[:2]).all()
    np.testing.assert_array_equal(matrix[2], 0)


def test_singular_maps_have_no_inverse():
    flat = np.array([[0, 0, -2.0, 0, 0, 0], [0, 0, 0, 0, 0, 0]])
    with pytest.raises(InputError, match=r"1 of 2 elements singular .*index \(0,\)"):
        c.inverse_six(flat)
    seen = c.inverse_six(flat, invalid="nan")
    assert np.isnan(seen[0]).all()
    np.testing.assert_array_equal(seen[1], 0)
    fold = [0, 0, -2.0, 0, 2.0, 0]  # a reflection is its own inverse
    np.testing.assert_array_equal(c.inverse_six(fold), fold)


@pytest.mark.parametrize("function", [c.exp_six, c.log_six, c.inverse_six, c.coefficients_from_six])
def test_nan_stays_nan_silently(function):
    six = np.zeros((3, 6))
    six[1] = np.nan
    seen = function(six)
    assert np.isnan(seen[1]).all()
    assert np.isfinite(seen[[0, 2]]).all()
    six[1] = np.inf
    assert not np.isfinite(function(six)[1]).any()


def test_overflow_is_silent():
    assert not np.isfinite(c.exp_six([1.0, 0, 4000.0, 0, 0, 0])).all()
    assert not np.isfinite(c.exp_six([1.0, 0, 0, 0, 1e200, 0])).all()


def test_wrong_choices():
    with pytest.raises(InputError, match="invalid='drop': must be 'raise' or 'nan'"):
        c.log_six(np.zeros(6), invalid="drop")
    with pytest.raises(InputError, match=r"second \(3,\), first \(2,\)"):
        c.compose_six(np.zeros((3, 6)), np.zeros((2, 6)))
    with pytest.raises(InputError, match="last row"):
        c.log(np.zeros((3, 3)))
