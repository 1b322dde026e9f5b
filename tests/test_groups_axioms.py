"""The axioms of groups and algebras, for all five groups, batch shapes and sizes of elements."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.linalg import expm

from sixflow import convention, groups
from sixflow.eigenfilters import bracket as bracket_of_operators
from sixflow.groups import AFFINE, GROUPS, PROJECTIVE, Group

ALL = list(GROUPS.values())
SHAPES = [(), (2, 3), (0,)]
SCALES = [1e-12, 1e-4, 0.1, 1.0]
EPS = np.finfo(float).eps
each = pytest.mark.parametrize("group", ALL, ids=lambda g: g.name)
sizes = pytest.mark.parametrize("scale", SCALES)
batches = pytest.mark.parametrize("shape", SHAPES, ids=str)


def coefficients(group, shape, scale, seed):
    """Coefficients whose rotation stays below a half turn, so that the principal logarithm is theirs."""
    tau = np.random.default_rng(seed).normal(0, scale, (*shape, group.dimension))
    angle = np.abs(np.linalg.eigvals(group.algebra(tau)).imag).max(-1) if tau.size else np.zeros(shape)
    return tau * np.minimum(1, 3 / np.maximum(angle, 1e-300))[..., None]


def elements(group, shape, scale, *seeds):
    return [group.exp(coefficients(group, shape, scale, seed)) for seed in seeds]


def same(got, want, tolerance=1e-12):
    """Equal as maps: matrices up to a factor, each relative to its size."""
    got, want = (M / np.linalg.norm(M, axis=(-1, -2), keepdims=True) for M in (got, want))
    np.testing.assert_allclose(got, want, rtol=0, atol=tolerance)


@each
@batches
@sizes
class TestGroup:
    def test_closure(self, group: Group, shape, scale):
        first, second = elements(group, shape, scale, 1, 2)
        product = group.compose(second, first)
        assert product.shape == (*shape, 3, 3)
        assert group.contains(product).shape == shape
        assert group.contains(product).all()
        assert group.contains(group.inverse(first)).all()

    def test_associativity(self, group: Group, shape, scale):
        a, b, c = elements(group, shape, scale, 1, 2, 3)
        same(group.compose(a, group.compose(b, c)), group.compose(group.compose(a, b), c))

    def test_identity_and_inverse(self, group: Group, shape, scale):
        (M,) = elements(group, shape, scale, 4)
        same(group.compose(M, group.identity), M)
        same(group.compose(group.identity, M), M)
        same(group.inverse(group.inverse(M)), M)
        for product in (group.compose(group.inverse(M), M), group.compose(M, group.inverse(M))):
            np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), rtol=0, atol=1e-12)

    def test_round_trips(self, group: Group, shape, scale):
        tau = coefficients(group, shape, scale, 5)
        M = group.exp(tau)
        assert group.log(M).shape == tau.shape
        # A map known to a relative precision determines its logarithm to that times its condition number.
        condition = np.linalg.cond(M)[..., None] if M.size else 1
        assert (np.abs(group.log(M) - tau) <= np.maximum(1e-14, 20 * EPS * condition)).all()
        same(group.exp(group.log(M)), M)

    def test_one_parameter_groups(self, group: Group, shape, scale):
        tau = coefficients(group, shape, scale, 6)
        same(group.compose(group.exp(0.75 * tau), group.exp(0.25 * tau)), group.exp(tau))
        same(group.inverse(group.exp(tau)), group.exp(-tau))

    def test_adjoint_is_a_homomorphism(self, group: Group, shape, scale):
        a, b = elements(group, shape, scale, 7, 8)
        left, right = group.adjoint(group.compose(a, b)), np.matmul(group.adjoint(a), group.adjoint(b))
        size = np.abs(group.adjoint(a)).max(initial=1) * np.abs(group.adjoint(b)).max(initial=1)
        assert left.shape == (*shape, group.dimension, group.dimension)
        np.testing.assert_allclose(left / size, right / size, rtol=0, atol=1e-12)
        unity = np.matmul(group.adjoint(a), group.adjoint(group.inverse(a)))
        np.testing.assert_allclose(
            unity / size, np.broadcast_to(np.eye(group.dimension), unity.shape) / size, atol=1e-12
        )

    def test_adjoint_moves_motions(self, group: Group, shape, scale):
        """M exp(X) M⁻¹ = exp(Ad_M X)."""
        (M,) = elements(group, shape, scale, 9)
        tau = coefficients(group, shape, 0.3, 10)
        carried = np.einsum("...jk,...k->...j", group.adjoint(M), tau)
        same(group.compose(group.compose(M, group.exp(tau)), group.inverse(M)), group.exp(carried), 1e-11)

    def test_exponential_of_ad_is_adjoint_of_exponential(self, group: Group, shape, scale):
        tau = coefficients(group, shape, scale, 11)
        want = expm(group.ad(tau)) if tau.size else group.ad(tau)
        size = np.abs(want).max(initial=1)
        np.testing.assert_allclose(group.adjoint(group.exp(tau)) / size, want / size, rtol=0, atol=1e-12)

    def test_action(self, group: Group, shape, scale):
        a, b = elements(group, shape, min(scale, 0.1), 12, 13)
        points = np.random.default_rng(14).uniform(-1, 1, (*shape, 2))
        assert group.act(a, points).shape == points.shape
        np.testing.assert_allclose(
            group.act(a, group.act(b, points)), group.act(group.compose(a, b), points), rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(
            group.act(group.inverse(a), group.act(a, points)), points, rtol=0, atol=1e-12
        )
        np.testing.assert_array_equal(group.act(group.identity, points), points)


@each
@batches
class TestAlgebra:
    def test_coefficients_and_matrices(self, group: Group, shape):
        tau = coefficients(group, shape, 1, 1)
        X = group.algebra(tau)
        assert X.shape == (*shape, 3, 3)
        np.testing.assert_allclose(group.coefficients(X), tau, rtol=0, atol=8 * EPS)
        np.testing.assert_allclose(group.coefficients(X + 0.75 * np.eye(3)), tau, rtol=0, atol=8 * EPS)

    def test_bracket(self, group: Group, shape):
        a, b, c = (coefficients(group, shape, 1, seed) for seed in range(3))
        A, B = group.algebra(a), group.algebra(b)
        exact = {"rtol": 0, "atol": 100 * EPS}
        assert group.bracket(a, b).shape == a.shape
        np.testing.assert_allclose(group.bracket(a, b), group.coefficients(A @ B - B @ A), **exact)
        np.testing.assert_allclose(group.bracket(a, b), -group.bracket(b, a), **exact)
        np.testing.assert_allclose(group.bracket(a, a), 0, **exact)
        np.testing.assert_allclose(
            group.bracket(a, 2 * b + c), 2 * group.bracket(a, b) + group.bracket(a, c), **exact
        )
        np.testing.assert_allclose(
            np.einsum("...jk,...k->...j", group.ad(a), b), group.bracket(a, b), **exact
        )

    def test_jacobi_identity(self, group: Group, shape):
        a, b, c = (coefficients(group, shape, 1, seed) for seed in range(3))
        cycle = sum(group.bracket(x, group.bracket(y, z)) for x, y, z in ((a, b, c), (b, c, a), (c, a, b)))
        np.testing.assert_allclose(cycle, 0, rtol=0, atol=200 * EPS)

    def test_bracket_is_what_a_small_commutator_does(self, group: Group, shape):
        """exp(εX) exp(εY) exp(−εX) exp(−εY) = exp(ε² [X, Y] + O(ε³))."""
        a, b = (coefficients(group, shape, 0.5, seed) for seed in range(2))
        small = 1e-4
        there, back = (group.compose(group.exp(s * a), group.exp(s * b)) for s in (small, -small))
        np.testing.assert_allclose(
            group.log(group.compose(there, back)) / small**2, group.bracket(a, b), rtol=0, atol=20 * small
        )

    def test_adjoint_keeps_brackets(self, group: Group, shape):
        a, b, m = (coefficients(group, shape, 0.5, seed) for seed in range(3))
        move = lambda x: np.einsum("...jk,...k->...j", group.adjoint(group.exp(m)), x)  # noqa: E731
        np.testing.assert_allclose(
            move(group.bracket(a, b)), group.bracket(move(a), move(b)), rtol=1e-10, atol=1e-10
        )


@each
def test_structure_constants(group: Group):
    f, X = group.structure_constants, group.generators
    assert f.shape == (group.dimension,) * 3
    assert not f.flags.writeable
    np.testing.assert_array_equal(f, -f.swapaxes(0, 1))
    np.testing.assert_array_equal(2 * f, np.round(2 * f))
    for i in range(group.dimension):
        for j in range(group.dimension):
            got = np.tensordot(f[i, j], X, 1)
            np.testing.assert_allclose(got, X[i] @ X[j] - X[j] @ X[i], rtol=0, atol=2 * EPS)
            one = np.eye(group.dimension)
            np.testing.assert_array_equal(group.bracket(one[i], one[j]), f[i, j] + 0.0)


def test_brackets_have_the_opposite_sign_of_the_operators():
    for i, first in enumerate(AFFINE.symbols):
        for j, second in enumerate(AFFINE.symbols):
            np.testing.assert_array_equal(
                AFFINE.structure_constants[i, j], -bracket_of_operators(first, second) + 0.0
            )


def test_killing_form_tells_sl3():
    """tr(ad_X ad_Y) = 6 tr(XY) in sl(3), which is simple; that of the affine algebra is degenerate."""
    basis = np.eye(8)
    form = np.einsum("iab,jba->ij", PROJECTIVE.ad(basis), PROJECTIVE.ad(basis))
    X = PROJECTIVE.generators
    np.testing.assert_allclose(form, 6 * np.einsum("iab,jba->ij", X, X), rtol=0, atol=1e-13)
    assert np.linalg.matrix_rank(form) == 8
    small = np.einsum("iab,jba->ij", AFFINE.ad(np.eye(6)), AFFINE.ad(np.eye(6)))
    assert np.linalg.matrix_rank(small) < 6


@pytest.mark.parametrize(("small", "large"), list(itertools.pairwise(ALL)), ids=str)
@pytest.mark.parametrize("scale", [1e-3, 0.3])
def test_every_group_lies_in_the_next(small: Group, large: Group, scale):
    a, b = (coefficients(small, (5,), scale, seed) for seed in range(2))
    up = lambda tau: large.coefficients(small.algebra(tau))  # noqa: E731
    assert set(small.names) < set(large.names)
    assert large.contains(small.exp(a)).all()
    assert not small.contains(large.exp(coefficients(large, (5,), scale, 3))).any()
    same(large.exp(up(a)), small.exp(a))
    np.testing.assert_allclose(large.log(small.exp(a)), up(a), rtol=0, atol=1e-13)
    np.testing.assert_allclose(up(small.bracket(a, b)), large.bracket(up(a), up(b)), rtol=0, atol=1e-14)
    columns = [large.names.index(name) for name in small.names]
    np.testing.assert_allclose(
        large.adjoint(small.exp(a))[:, columns][..., columns], small.adjoint(small.exp(a)), rtol=0, atol=1e-13
    )
    points = np.random.default_rng(2).uniform(-2, 2, (5, 2))
    np.testing.assert_allclose(
        large.act(small.exp(a), points), small.act(small.exp(a), points), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(large.field(up(a), points), small.field(a, points), rtol=0, atol=1e-14)


@each
def test_leading_dimensions_are_broadcast(group: Group):
    tau = coefficients(group, (4, 1), 0.1, 0)
    points = np.random.default_rng(0).uniform(-1, 1, (7, 2))
    M = group.exp(tau)
    assert M.shape == (4, 1, 3, 3)
    assert group.act(M, points).shape == group.field(tau, points).shape == (4, 7, 2)
    assert group.apply(tau, points, points).shape == (4, 7)
    np.testing.assert_array_equal(group.act(M, points)[2, 3], group.act(M[2, 0], points[3]))
    others = group.exp(coefficients(group, (3,), 0.1, 1))
    assert group.compose(M, others).shape == (4, 3, 3, 3)
    assert group.bracket(tau, coefficients(group, (3,), 1, 1)).shape == (4, 3, group.dimension)


def test_names_are_those_of_the_library():
    assert AFFINE.names == convention.SIX
    assert AFFINE.symbols == convention.GENERATOR_NAMES
    np.testing.assert_array_equal(AFFINE.generators, convention.GENERATORS)
    assert [g.dimension for g in ALL] == [2, 3, 4, 6, 8]
    assert PROJECTIVE.names == groups.NAMES
    assert PROJECTIVE.symbols == groups.SYMBOLS
    np.testing.assert_allclose(np.trace(PROJECTIVE.generators, axis1=1, axis2=2), 0, atol=EPS)
    six = np.random.default_rng(0).normal(size=6)
    rates = convention.coefficients_from_six(six / 10)
    np.testing.assert_allclose(AFFINE.exp(rates), convention.affine_from_six(six / 10), rtol=0, atol=1e-15)
    assert repr(groups.EUCLIDEAN) == "<the euclidean group: L_x, L_y, L_r>"
