"""Measures of deformation against their definitions, and principal values against NumPy's eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import polar, sqrtm

from sixflow import convention as c
from sixflow.errors import InputError

TENSORS = [c.green_lagrange, c.almansi, c.hencky, c.biot, c.small_strain]
FINITE = [c.green_lagrange, c.almansi, c.hencky, c.biot]
PARTIAL = [c.almansi, c.hencky, c.biot, c.rotation_angle]
SCALES = [1e-9, 1e-3, 0.1, 0.5]


def random_gradient(shape=(), scale=0.1, seed=0):
    """Gradients of maps that do not fold, turned by any angle."""
    rng = np.random.default_rng(seed)
    G = rng.normal(0, scale, (*shape, 2, 2))
    F = np.eye(2) + G
    return np.where((np.linalg.det(F) > 0.05)[..., None, None], G, np.abs(G) * [[1, 0], [0, 1]])


def turn(angle):
    co, si = np.cos(angle), np.sin(angle)
    return np.stack([co, -si, si, co], axis=-1).reshape(*np.shape(angle), 2, 2)


@pytest.mark.parametrize("scale", SCALES)
def test_against_the_definitions(scale):
    G = random_gradient((30,), scale, 1)
    for g in G:
        F = np.eye(2) + g
        N = np.linalg.inv(F)
        R, U = polar(F)
        values, axes = np.linalg.eigh(F.T @ F)
        close = {"rtol": 0, "atol": 1e-13}
        np.testing.assert_allclose(c.deformation_gradient(g), F)
        np.testing.assert_allclose(c.green_lagrange(g), (F.T @ F - np.eye(2)) / 2, **close)
        np.testing.assert_allclose(c.almansi(g), (np.eye(2) - N.T @ N) / 2, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(
            c.hencky(g), axes @ np.diag(np.log(values) / 2) @ axes.T, rtol=1e-11, atol=1e-13
        )
        np.testing.assert_allclose(c.biot(g), U - np.eye(2), **close)
        np.testing.assert_allclose(c.biot(g), sqrtm(F.T @ F).real - np.eye(2), rtol=0, atol=1e-12)
        np.testing.assert_allclose(c.rotation_angle(g), np.arctan2(R[1, 0], R[0, 0]), **close)
        np.testing.assert_allclose(c.area_ratio(g), np.linalg.det(F), **close)
        np.testing.assert_allclose(c.small_strain(g), (g + g.T) / 2)
        np.testing.assert_allclose(c.small_rotation(g), (g[1, 0] - g[0, 1]) / 2)


@pytest.mark.parametrize("function", TENSORS)
@pytest.mark.parametrize("scale", [1e-12, 1e-7, 1e-4])
def test_all_tensors_agree_to_first_order_with_all_digits(function, scale):
    G = random_gradient((50,), scale, 2)
    np.testing.assert_allclose(function(G), c.small_strain(G), rtol=0, atol=(1e-13 + 20 * scale) * scale)


@pytest.mark.parametrize("scale", [1e-12, 1e-7, 1e-4])
def test_small_angles_keep_their_digits(scale):
    G = random_gradient((50,), scale, 2)
    np.testing.assert_allclose(c.rotation_angle(G), c.small_rotation(G), rtol=0, atol=20 * scale**2)


@pytest.mark.parametrize("angle", [0.01, 1.0, np.pi / 2, 3.0, -3.1, np.pi - 1e-9])
@pytest.mark.parametrize("scale", SCALES)
def test_rotation_after_the_deformation_changes_only_the_angle(angle, scale):
    G = random_gradient((20,), scale, 3)
    turned = turn(angle) @ (np.eye(2) + G) - np.eye(2)
    for function in (c.green_lagrange, c.hencky, c.biot):
        np.testing.assert_allclose(function(turned), function(G), rtol=1e-10, atol=1e-13)
    moved_axes = turn(angle) @ c.almansi(G) @ turn(angle).T
    np.testing.assert_allclose(c.almansi(turned), moved_axes, rtol=1e-9, atol=1e-12)
    difference = c.rotation_angle(turned) - c.rotation_angle(G) - angle
    np.testing.assert_allclose(np.exp(1j * difference), 1, atol=1e-12)
    np.testing.assert_allclose(c.area_ratio(turned), c.area_ratio(G), atol=1e-12)


def test_pure_rotation_deforms_only_for_the_infinitesimal():
    G = turn(0.3) - np.eye(2)
    for function in FINITE:
        np.testing.assert_allclose(function(G), 0, atol=1e-16)
    np.testing.assert_allclose(c.small_strain(G), (np.cos(0.3) - 1) * np.eye(2), atol=1e-16)
    np.testing.assert_allclose(c.small_rotation(G), np.sin(0.3))


def test_the_field_of_measures_has_the_field_s_shape():
    G = random_gradient((2, 3, 4))
    for function in TENSORS:
        assert function(G).shape == (2, 3, 4, 2, 2)
        np.testing.assert_array_equal(function(G), np.swapaxes(function(G), -1, -2))
        assert function(G.astype(np.float32)).dtype == np.float32
        assert function(G[:0]).shape == (0, 3, 4, 2, 2)
    for function in (c.rotation_angle, c.small_rotation, c.area_ratio):
        assert function(G).shape == (2, 3, 4)
        assert function(G.astype(np.float32)).dtype == np.float32


def test_hencky_of_a_map_without_rotation_is_its_logarithm():
    H = c.small_strain(random_gradient((20,), 0.5, 4))
    six = c.exp_six(c.six_from_gradient([0, 0], H))
    np.testing.assert_allclose(c.hencky(c.gradient(six)), H, atol=1e-14)
    np.testing.assert_allclose(c.gradient(c.log_six(six)), H, atol=1e-14)


def test_trace_of_hencky_is_the_logarithm_of_the_area_ratio():
    G = random_gradient((20,), 0.5, 5)
    np.testing.assert_allclose(np.trace(c.hencky(G), axis1=-2, axis2=-1), np.log(c.area_ratio(G)), atol=1e-13)


def test_almansi_is_the_negative_green_lagrange_of_the_inverse():
    six = c.exp_six(np.random.default_rng(6).normal(0, 0.3, (10, 6)))
    back = c.green_lagrange(c.gradient(c.inverse_six(six)))
    np.testing.assert_allclose(c.almansi(c.gradient(six)), -back, atol=1e-14)


@pytest.mark.parametrize("function", PARTIAL)
@pytest.mark.parametrize("bad", [np.diag([-2.0, 0.0]), np.diag([-1.0, 0.0]), np.diag([-1.0, -1.0])])
def test_folds_are_refused_or_nan(function, bad):
    G = np.zeros((3, 2, 2))
    G[1] = bad
    with pytest.raises(InputError, match=r"gradient: 1 of 3 elements folded or flattened .*index \(1,\)"):
        function(G)
    with pytest.raises(InputError, match="gradient: folded"):
        function(bad)
    seen = function(G, invalid="nan")
    assert np.isnan(seen[1]).all()
    assert (seen[[0, 2]] == 0).all()
    with pytest.raises(InputError, match="invalid='x'"):
        function(G, invalid="x")


@pytest.mark.parametrize("function", [*TENSORS, c.rotation_angle, c.small_rotation, c.area_ratio])
def test_nan_and_inf_are_silent(function):
    G = np.zeros((3, 2, 2))
    G[1], G[2] = np.nan, np.inf
    seen = function(G)
    assert np.isnan(seen[1]).all()
    assert np.isfinite(seen[0]).all()
    assert not np.isfinite(seen[2]).all() or function is c.rotation_angle


@pytest.mark.parametrize("function", [*TENSORS, c.rotation_angle, c.principal_values, c.max_shear])
def test_wrong_shapes_are_refused(function):
    for bad in (np.zeros(6), np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((2, 2), complex)):
        with pytest.raises(InputError, match=r"(gradient|tensor) of"):
            function(bad)


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1.0, 1e3])
def test_principal_quantities_against_eigh(scale):
    T = c.small_strain(random_gradient((100,), 0.5, 7)) * scale
    values, axes = np.linalg.eigh(T)
    np.testing.assert_allclose(c.principal_values(T), values[:, ::-1], rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(c.max_shear(T), values[:, 1] - values[:, 0], rtol=0, atol=1e-14 * scale)
    angle = c.principal_angle(T)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", direction, axes[:, :, 1])), 1, atol=1e-13)
    assert (np.abs(angle) <= np.pi / 2).all()


def test_engineering_and_tensor_shear():
    six = np.array([0, 0, 0, 0, 0, 0.02])
    assert c.small_strain(c.gradient(six))[0, 1] == 0.01
    assert c.max_shear(c.small_strain(c.gradient(six))) == 0.02


def test_the_axis_of_a_vertical_tension_is_a_right_angle_whatever_the_sign_of_zero():
    for zero in (0.0, -0.0):
        assert c.principal_angle([[-1.0, zero], [zero, 1.0]]) == np.pi / 2
    assert c.principal_angle(np.zeros((2, 2))) == 0


def test_a_gradient_is_no_tensor():
    G = np.zeros((4, 2, 2))
    G[2, 0, 1] = 0.1
    for function in (c.principal_values, c.principal_angle, c.max_shear):
        with pytest.raises(InputError, match=r"1 of 4 are not symmetric, the first at index \(2,\)"):
            function(G)
        assert np.isnan(function(np.full((2, 2), np.nan))).all()
