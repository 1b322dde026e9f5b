"""The six numbers and the other ways to write the same motion."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from sixflow import convention as c
from sixflow.errors import InputError
from sixflow.field import dataset

SHAPES = [(), (1,), (5,), (3, 4), (0,), (2, 1, 3)]


def random_six(shape=(), scale=1.0, seed=0):
    return np.random.default_rng(seed).normal(0, scale, (*shape, 6))


def test_the_order_is_the_one_of_the_dataset():
    assert c.SIX == dataset.SIX


def test_gradient_matches_the_definition_by_differences_of_moved_points():
    six = random_six(scale=0.2)
    origin, right, down = (c.transform_points(six, p) for p in ([0, 0], [1, 0], [0, 1]))
    u_x, v_x = right - origin - [1, 0]
    u_y, v_y = down - origin - [0, 1]
    np.testing.assert_allclose(
        [*c.displacement(six), u_x + v_y, v_x - u_y, u_x - v_y, u_y + v_x], six, atol=1e-15
    )


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e3])
def test_round_trips(shape, scale):
    six = random_six(shape, scale)
    near = {"rtol": 1e-12, "atol": 1e-12 * scale}
    np.testing.assert_allclose(c.six_from_gradient(c.displacement(six), c.gradient(six)), six, **near)
    np.testing.assert_allclose(c.six_from_algebra(c.algebra_from_six(six)), six, **near)
    centre = np.array([3.0, -7.0])
    back = c.six_from_affine(c.affine_from_six(six, centre), centre)
    np.testing.assert_allclose(back, six, rtol=1e-12, atol=1e-14 * max(scale, 1) * 10)
    np.testing.assert_allclose(
        c.recentre(c.recentre(six, centre), -centre), six, rtol=1e-12, atol=1e-13 * scale
    )


def test_the_linear_matrices_are_inverse_and_agree_with_the_functions():
    six = random_six((7,))
    np.testing.assert_array_equal(c.SIX_FROM_GRADIENT @ c.GRADIENT_FROM_SIX, np.eye(6))
    flat = six @ c.GRADIENT_FROM_SIX.T
    np.testing.assert_allclose(flat[:, :2], c.displacement(six), atol=1e-15)
    np.testing.assert_allclose(flat[:, 2:].reshape(-1, 2, 2), c.gradient(six), atol=1e-15)


def test_affine_matrix_moves_points_as_the_six_do_about_any_centre():
    six, centre = random_six((4,)), np.array([11.0, -5.0])
    points = np.random.default_rng(1).normal(size=(4, 2))
    columns = np.concatenate([points, np.ones((4, 1))], axis=-1)
    moved = np.einsum("nij,nj->ni", c.affine_from_six(six, centre), columns)[:, :2]
    np.testing.assert_allclose(moved, c.transform_points(six, points, centre), atol=1e-12)
    elsewhere = c.recentre(six, [2.0, 3.0])
    np.testing.assert_allclose(
        moved, c.transform_points(elsewhere, points, centre + np.array([2.0, 3.0])), atol=1e-12
    )


def test_a_grid_of_centres_broadcasts():
    centres = np.stack(np.meshgrid(np.arange(3.0), np.arange(2.0)), axis=-1)
    assert c.affine_from_six(random_six(), centres).shape == (2, 3, 3, 3)


def test_generators_are_the_operators_of_the_paper():
    x, y = 2.0, 5.0
    velocities = c.GENERATORS @ [x, y, 1]
    expected = [[1, 0], [0, 1], [x, y], [-y, x], [x, -y], [y, x]]
    np.testing.assert_array_equal(velocities[:, :2], expected)
    halves = np.array([1, 1, 0.5, 0.5, 0.5, 0.5])
    six = random_six()
    np.testing.assert_allclose(
        np.tensordot(six * halves, c.GENERATORS, 1), c.algebra_from_six(six), atol=1e-15
    )


def test_commutators():
    """[L_s, L_x] = −L_x; L_s commutes with the linear ones; two others give ±2 the third."""
    X = dict(zip(c.GENERATOR_NAMES, c.GENERATORS, strict=True))

    def bracket(a, b):  # of the operators: minus that of the matrices
        return X[b] @ X[a] - X[a] @ X[b]

    np.testing.assert_array_equal(bracket("L_x", "L_y"), 0)
    np.testing.assert_array_equal(bracket("L_s", "L_x"), -X["L_x"])
    for other in ("L_r", "L_b", "L_B"):
        np.testing.assert_array_equal(bracket("L_s", other), 0)
    for a, b, third in (("L_b", "L_B", "L_r"), ("L_r", "L_b", "L_B"), ("L_r", "L_B", "L_b")):
        np.testing.assert_array_equal(abs(bracket(a, b)), 2 * abs(X[third]))


def test_constants_cannot_be_changed():
    for constant in (c.GENERATORS, c.SIX_FROM_GRADIENT, c.GRADIENT_FROM_SIX, c.Y_UP_SIGNS):
        with pytest.raises(ValueError, match="read-only"):
            constant[0] = 0


def test_results_do_not_share_memory_with_the_input():
    six = random_six((3,))
    before = six.copy()
    for function in (c.displacement, c.gradient, c.affine_from_six, c.to_y_up, c.exp_six):
        function(six)[...] = -9
    np.testing.assert_array_equal(six, before)


@pytest.mark.parametrize(
    "function",
    [c.displacement, c.gradient, c.affine_from_six, c.algebra_from_six, c.exp_six, c.log_six, c.to_y_up],
)
def test_float32_is_kept_and_integers_become_float64(function):
    assert function(np.zeros((2, 6), np.float32)).dtype == np.float32
    assert function(np.zeros((2, 6), np.int16)).dtype == np.float64
    assert function(np.zeros((2, 6), np.float16)).dtype == np.float64


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros(5), r"of shape \(5,\): the last dimensions must be \(6,\)"),
        (1.0, r"shape \(\)"),
        (np.zeros((6, 2)), r"shape \(6, 2\)"),
        (np.zeros(6, complex), "dtype complex128: must hold real numbers"),
        (np.zeros(6, object), "dtype object"),
        (np.zeros(6, bool), "dtype bool"),
        (["a"] * 6, "dtype <U1"),
        ([[1.0] * 6, [1.0] * 5], "cannot be made an array"),
    ],
)
@pytest.mark.parametrize("function", [c.gradient, c.exp_six, c.log_six, c.inverse_six, c.to_y_up])
def test_wrong_arrays_are_refused(function, value, message):
    with pytest.raises(InputError, match=message):
        function(*[value])


def test_masked_elements_become_nan():
    six = np.ma.masked_array(random_six((2,)), mask=[[False] * 6, [True] * 6])
    G = c.gradient(six)
    assert not isinstance(G, np.ma.MaskedArray)
    assert np.isfinite(G[0]).all()
    assert np.isnan(G[1]).all()


def test_shapes_that_do_not_broadcast_are_refused_by_name():
    with pytest.raises(InputError, match=r"six \(3,\), offset \(2,\)"):
        c.recentre(random_six((3,)), np.zeros((2, 2)))
    with pytest.raises(InputError, match=r"displacement \(3,\), gradient \(4,\)"):
        c.six_from_gradient(np.zeros((3, 2)), np.zeros((4, 2, 2)))


def test_projective_maps_are_refused():
    projective = np.eye(3) + np.zeros((4, 3, 3))
    projective[2, 2, 0] = 1e-6
    with pytest.raises(InputError, match=r"affine at index \(2,\) has the last row \[1e-06, 0.0, 1.0\]"):
        c.six_from_affine(projective)
    with pytest.raises(InputError, match="algebra at index"):
        c.exp(np.eye(3))


def test_import_brings_neither_scipy_nor_xarray():
    code = "import sys, sixflow.convention; print(sorted({'scipy', 'xarray', 'numba'} & set(sys.modules)))"
    seen = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert seen.stdout.strip() == "[]"


def test_to_y_up_is_the_same_motion_in_turned_coordinates():
    six, points = random_six((5,)), np.random.default_rng(2).normal(size=(5, 2))
    turn = np.array([1.0, -1.0])
    np.testing.assert_allclose(
        c.transform_points(c.to_y_up(six), points * turn), c.transform_points(six, points) * turn, atol=1e-14
    )


def test_to_y_up_of_the_covariance():
    A = np.random.default_rng(3).normal(size=(4, 6, 6))
    covariance = A @ A.swapaxes(-1, -2)
    six, turned = c.to_y_up(random_six((4,)), covariance)
    J = c.numerical_jacobian(c.to_y_up, six)
    np.testing.assert_allclose(turned, J @ covariance @ J.swapaxes(-1, -2), atol=1e-8)
    again, back = c.to_y_up(six, turned)
    np.testing.assert_array_equal(back, covariance)
    np.testing.assert_array_equal(again, random_six((4,)))
    with pytest.raises(InputError, match="covariance of shape"):
        c.to_y_up(six, covariance[..., 0])
