"""Exponential and logarithm: against extended precision, next to the half turn, in pixels, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from sixflow.errors import InputError
from sixflow.groups import AFFINE, EUCLIDEAN, GROUPS, PROJECTIVE, SIMILARITY, TRANSLATION, Group

EPS = np.finfo(float).eps
each = pytest.mark.parametrize("group", GROUPS.values(), ids=str)


def naive_exp(X):
    """Taylor's series of X/2¹⁶, squared 16 times, in extended precision."""
    X = np.asarray(X, dtype=np.longdouble) / 2**16
    change, term = X, X
    for k in range(2, 12):
        term = term @ X / k
        change = change + term
    for _ in range(16):
        change = 2 * change + change @ change  # (I + C)² − I
    return change + np.eye(3)


def unit(M):
    return M / np.linalg.norm(np.asarray(M, float), axis=(-1, -2), keepdims=True)


def turned(group, angle, seed=0, count=500):
    """Rotations by an angle about random axes of the group: conjugates of exp(angle L_r)."""
    rng = np.random.default_rng(seed)
    frame = group.exp(rng.normal(0, 0.3, (count, group.dimension)))
    turn = np.zeros(group.dimension)
    turn[group.names.index("curl")] = angle
    tau = np.einsum("...jk,k->...j", group.adjoint(frame), turn)
    c, s = np.cos(np.longdouble(angle)), np.sin(np.longdouble(angle))
    plain = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).astype(float)
    return tau, group.compose(group.compose(frame, plain), group.inverse(frame))


@each
@pytest.mark.parametrize("scale", [1e-9, 1e-3, 0.3, 1.0, 3.0])
def test_exponential_against_extended_precision(group: Group, scale):
    tau = np.random.default_rng(1).normal(0, scale, (200, group.dimension))
    want = naive_exp(group.algebra(tau))
    np.testing.assert_allclose(unit(group.exp(tau)), unit(want).astype(float), rtol=0, atol=1e-12)


@each
@pytest.mark.parametrize("scale", [1e-9, 1e-3, 0.3, 1.0, 3.0])
def test_logarithm_leads_back_to_the_map(group: Group, scale):
    """Also where the map is so ill conditioned (up to 10⁹) that its logarithm has no digits left."""
    M = group.exp(np.random.default_rng(2).normal(0, scale, (200, group.dimension)))
    np.testing.assert_allclose(
        unit(group.exp(group.log(M))), unit(M), rtol=0, atol=1e-12 if scale < 3 else 1e-11
    )


@pytest.mark.parametrize("group", [EUCLIDEAN, SIMILARITY, AFFINE, PROJECTIVE], ids=str)
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("short", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_rotations_close_to_the_half_turn(group: Group, sign, short):
    tau, M = turned(group, sign * (np.pi - short))
    found = group.log(M)
    np.testing.assert_allclose(unit(group.exp(found)), unit(M), rtol=0, atol=1e-12)
    # A map known to 1e-15 determines the plane of the rotation, in general, only to 1e-15/short.
    in_plane = group in (EUCLIDEAN, SIMILARITY)
    if in_plane or short > 1e-9:
        np.testing.assert_allclose(found, tau, rtol=0, atol=1e-12 if in_plane else 1e-12 + 1e-13 / short)


@pytest.mark.parametrize("group", [EUCLIDEAN, SIMILARITY, AFFINE, PROJECTIVE], ids=str)
@pytest.mark.parametrize("dirt", [0, 1e-16])
def test_half_turns_have_a_logarithm(group: Group, dirt):
    _, M = turned(group, np.pi)
    M[..., :2, :2] += np.random.default_rng(0).choice([-dirt, dirt], (500, 2, 2))
    found = group.log(M)
    np.testing.assert_allclose(unit(group.exp(found)), unit(M), rtol=0, atol=1e-12)
    plain = group.log(np.diag([-1.0, -1.0, 1.0]))
    np.testing.assert_allclose(plain[group.names.index("curl")], np.pi, rtol=0, atol=2 * EPS)
    np.testing.assert_allclose(np.delete(plain, group.names.index("curl")), 0, rtol=0, atol=EPS)


def test_reflections_are_projective_half_turns():
    mirror = np.diag([-1.0, 1.0, 1.0])
    halfway = PROJECTIVE.exp(PROJECTIVE.log(mirror) / 2)
    np.testing.assert_allclose(unit(halfway @ halfway), unit(-mirror), rtol=0, atol=1e-15)
    assert PROJECTIVE.contains(mirror)
    assert not AFFINE.contains(mirror)


def test_small_motions_keep_their_digits():
    """τ ~ 1e-9: the entries of M − I are known to 1e-16, and so is the logarithm."""
    rng = np.random.default_rng(0)
    for group in GROUPS.values():
        tau = rng.normal(0, 1e-9, (20, group.dimension))
        np.testing.assert_allclose(group.log(group.exp(tau)), tau, rtol=0, atol=2e-15)
    corner = np.zeros((3, 3))
    corner[2, 0], corner[0, 2] = -1e-20, 1e-20  # beside 1 they are exact
    np.testing.assert_allclose(PROJECTIVE.log(np.eye(3) + corner)[[0, 6]], 1e-20, rtol=1e-12)
    np.testing.assert_array_equal(TRANSLATION.log(TRANSLATION.exp([1e-200, 3.0])), [1e-200, 3.0])


@pytest.mark.parametrize(
    "eigenvalues",
    [(1, 1, 1), (2, 2, 0.25), (0.5, 0.5, 4), (1, 1 + 1e-8, 1 - 1e-8), (1, 1 + 1e-15, 1), (3, 1 / 3, 1)],
)
def test_equal_eigenvalues_do_no_harm(eigenvalues):
    """Also defective matrices: Jordan blocks, in random coordinates."""
    rng = np.random.default_rng(3)
    S = np.eye(3) + rng.uniform(-0.5, 0.5, (30, 3, 3))
    for upper in ([0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1e-8, 1, 0.5]):
        J = np.diag(eigenvalues).astype(float)
        J[0, 1], J[1, 2], J[0, 2] = upper
        M = S @ J @ np.linalg.inv(S)
        np.testing.assert_allclose(unit(PROJECTIVE.exp(PROJECTIVE.log(M))), unit(M), rtol=0, atol=1e-12)


def test_homographies_in_pixels():
    """The same map in units of 1, 100 and 10⁴ px: the logarithm follows, and points come back to 1e-12 of the frame."""
    tau = np.random.default_rng(4).normal(0, 0.2, (100, 8))
    points = np.random.default_rng(5).uniform(-1, 1, (100, 2))
    for px in (1.0, 100.0, 1e4):
        scaled = tau * np.array([px, px, 1, 1, 1, 1, 1 / px, 1 / px])
        M = PROJECTIVE.exp(scaled)
        found = PROJECTIVE.log(M)
        np.testing.assert_allclose(found * tau / scaled, tau, rtol=0, atol=1e-13)
        again = PROJECTIVE.act(PROJECTIVE.exp(found), points * px)
        np.testing.assert_allclose(again / px, PROJECTIVE.act(M, points * px) / px, rtol=0, atol=1e-12)


@pytest.mark.parametrize("factor", [1e-200, -3.7, 1e100, 0.3])
def test_factors_of_a_homography_do_not_matter(factor):
    tau = np.random.default_rng(6).normal(0, 0.3, (10, 8))
    M = PROJECTIVE.exp(tau)
    np.testing.assert_allclose(np.linalg.det(M), 1, rtol=0, atol=1e-14)
    np.testing.assert_allclose(PROJECTIVE.log(factor * M), tau, rtol=0, atol=1e-14)
    np.testing.assert_allclose(PROJECTIVE.adjoint(factor * M), PROJECTIVE.adjoint(M), rtol=0, atol=1e-13)
    for made in (PROJECTIVE.compose(factor * M, M), PROJECTIVE.inverse(factor * M)):
        np.testing.assert_allclose(np.linalg.det(made), 1, rtol=0, atol=1e-13)


WITHOUT = {
    "two negative": np.diag([-1.0, -2.0, 1.0]),
    "negative Jordan block": np.array([[-1.0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0]]),
    "nearly equal": np.array([[-1.0, 1e-9, 0], [1e-9, -1.0, 0], [0, 0, 1.0]]),
}


@pytest.mark.parametrize("group", [AFFINE, PROJECTIVE], ids=str)
@pytest.mark.parametrize("matrix", WITHOUT.values(), ids=WITHOUT)
def test_maps_without_real_logarithm(group: Group, matrix):
    if matrix[0, 1] != 1:  # rounding would make of the block a rotation by nearly π, which has a logarithm
        carrier = group.exp(0.2 * np.ones(group.dimension))
        matrix = group.compose(group.compose(carrier, matrix), group.inverse(carrier))
    many = np.tile(np.eye(3), (3, 4, 1, 1))
    many[1, 2] = matrix
    with pytest.raises(
        InputError, match=r"matrix at index \(1, 2\) has no real logarithm: .* has the eigenvalues -"
    ):
        group.log(many)
    with pytest.raises(InputError, match=r"matrix has no real logarithm.*half turn.*invalid='nan'"):
        group.log(matrix)
    found = group.log(many, invalid="nan")
    assert np.isnan(found[1, 2]).all()
    assert np.isnan(found).sum() == group.dimension
    with pytest.raises(InputError, match="invalid='drop': must be 'raise' or 'nan'"):
        group.log(np.eye(3), invalid="drop")


@each
def test_nan_stays_nan_silently(group: Group):
    tau = np.zeros((3, group.dimension))
    tau[1, 0] = np.nan
    M = group.exp(tau)
    assert np.isnan(M[1]).any()
    np.testing.assert_array_equal(M[0], np.eye(3))
    for found in (
        group.log(M),
        group.adjoint(M),
        group.inverse(M),
        group.compose(M, M),
        group.act(M, [1.0, 2.0]),
    ):
        assert np.isnan(found[1]).any()
        assert np.isfinite(found[[0, 2]]).all()
    np.testing.assert_array_equal(group.contains(M), [True, False, True])
    tau[1] = np.inf
    assert not np.isfinite(group.exp(tau)[1]).all()
    assert not np.isfinite(group.exp(np.full(group.dimension, 1e200))).all() or group is TRANSLATION


def test_masked_arrays_become_nan():
    tau = np.ma.masked_array(np.zeros((2, 3)), [[True] * 3, [False] * 3])
    assert np.isnan(EUCLIDEAN.exp(tau)[0]).any()
    assert np.isfinite(EUCLIDEAN.exp(tau)[1]).all()
