"""Canonical coordinates: what defines them, sector by sector; inverse; invariant measure; refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sixflow.eigenfilters.coordinates import CanonicalCoordinates, canonical
from sixflow.eigenfilters.generators import L_B, L_b, L_r, L_s, L_x, L_y
from sixflow.errors import InputError

PAIRS = [(L_x, L_y), (L_s, L_r), (L_b, L_s), (L_B, L_s)]
CASES = [canonical(*pair) for pair in PAIRS]
EPS = np.finfo(np.float64).eps


def points_of(coordinates: CanonicalCoordinates, sector: int, count: int = 200):
    """Random points of a sector that keep 1 px from the singular lines."""
    x, y = np.random.default_rng(3).uniform(-20, 20, (2, 50 * count))
    inside = (coordinates.sector(x, y) == sector) & (coordinates.singular_distance(x, y) > 1)
    return x[inside][:count], y[inside][:count]


def along(generator, function, x, y, h=1e-4):
    """L f by a central difference along the trajectory, right to h²."""
    return (function(*generator.flow(h, x, y)) - function(*generator.flow(-h, x, y))) / (2 * h)


every = pytest.mark.parametrize(
    ("coordinates", "sector"),
    [(c, s) for c in CASES for s in range(c.sectors)],
    ids=lambda value: value if isinstance(value, int) else f"{value.first.symbol}-{value.second.symbol}",
)


@every
class TestSector:
    def test_definition(self, coordinates, sector):
        x, y = points_of(coordinates, sector)
        assert x.size == 200
        # the branch of the angle: turned away from where atan2 jumps
        keep = (y > 0.1) | (y < -0.1) | (x > 0)
        x, y = x[keep], y[keep]
        tolerance = {"rtol": 0, "atol": 1e-7}
        np.testing.assert_allclose(along(coordinates.first, coordinates.eta, x, y), 1, **tolerance)
        np.testing.assert_allclose(along(coordinates.first, coordinates.xi, x, y), 0, **tolerance)
        np.testing.assert_allclose(along(coordinates.second, coordinates.eta, x, y), 0, **tolerance)
        np.testing.assert_allclose(along(coordinates.second, coordinates.xi, x, y), 1, **tolerance)

    def test_finite_flows_are_translations(self, coordinates, sector):
        x, y = points_of(coordinates, sector)
        moved = coordinates.second.flow(0.3, *coordinates.first.flow(-0.8, x, y))
        period = coordinates.xi_period
        turned = coordinates.xi(*moved) - coordinates.xi(x, y) - 0.3
        turned = turned if math.isinf(period) else np.angle(np.exp(1j * turned))
        np.testing.assert_allclose(coordinates.eta(*moved) - coordinates.eta(x, y), -0.8, rtol=0, atol=1e-12)
        np.testing.assert_allclose(turned, 0, atol=1e-12)
        np.testing.assert_array_equal(coordinates.sector(*moved), sector)

    def test_inverse(self, coordinates, sector):
        x, y = points_of(coordinates, sector)
        eta, xi = coordinates.eta(x, y), coordinates.xi(x, y)
        np.testing.assert_allclose(coordinates.inverse(eta, xi, sector), (x, y), rtol=0, atol=1e-12)
        numbers = np.full(x.shape, sector)
        np.testing.assert_array_equal(
            coordinates.inverse(eta, xi, numbers), coordinates.inverse(eta, xi, sector)
        )

    def test_jacobian(self, coordinates, sector):
        x, y = points_of(coordinates, sector)
        keep = (y > 0.1) | (y < -0.1) | (x > 0)
        x, y = x[keep], y[keep]
        eta_x, eta_y, xi_x, xi_y = (
            along(g, f, x, y) for f in (coordinates.eta, coordinates.xi) for g in (L_x, L_y)
        )
        determinant = np.abs(eta_x * xi_y - eta_y * xi_x)
        np.testing.assert_allclose(coordinates.jacobian(x, y), determinant, rtol=1e-7)

    @pytest.mark.parametrize("which", ["first", "second"])
    def test_measure_is_invariant(self, coordinates, sector, which):
        x, y = points_of(coordinates, sector)
        generator = getattr(coordinates, which)
        tau, h = 0.6, 1e-3
        across_x = np.subtract(generator.flow(tau, x + h, y), generator.flow(tau, x - h, y)) / (2 * h)
        across_y = np.subtract(generator.flow(tau, x, y + h), generator.flow(tau, x, y - h)) / (2 * h)
        area = np.abs(across_x[0] * across_y[1] - across_x[1] * across_y[0])
        moved = coordinates.jacobian(*generator.flow(tau, x, y))
        np.testing.assert_allclose(area * moved, coordinates.jacobian(x, y), rtol=1e-9)

    def test_divergence_of_the_weighted_field_vanishes(self, coordinates, sector):
        """∇·(J a) = J ∇·a + L J = 0 for both generators: the measure is invariant."""
        x, y = points_of(coordinates, sector)
        J = coordinates.jacobian(x, y)
        for generator in (coordinates.first, coordinates.second):
            total = along(generator, coordinates.jacobian, x, y) + generator.divergence * J
            np.testing.assert_allclose(total / J, 0, atol=1e-6)


class TestSectors:
    def test_numbers_go_from_x_towards_y(self):
        angles = np.radians([45, 135, 225, 315])
        x, y = np.cos(angles), np.sin(angles)
        np.testing.assert_array_equal(canonical(L_b, L_s).sector(x, y), range(4))
        x, y = np.cos(angles - np.pi / 4), np.sin(angles - np.pi / 4)
        np.testing.assert_array_equal(canonical(L_B, L_s).sector(x, y), range(4))

    def test_shear_is_stretch_turned(self):
        """In axes turned by −45° the shear of x, y is a stretch along p = x + y, q = x − y over √2."""
        x, y = np.random.default_rng(1).normal(size=(2, 100))
        p, q = (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
        shear, stretch = canonical(L_B, L_s), canonical(L_b, L_s)
        np.testing.assert_allclose(shear.eta(x, y), stretch.eta(p, q), rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(shear.xi(x, y) - stretch.xi(p, q), np.log(2) / 2, rtol=0, atol=1e-12)
        np.testing.assert_allclose(shear.jacobian(x, y), stretch.jacobian(p, q), rtol=1e-12)
        np.testing.assert_allclose(shear.singular_distance(x, y), stretch.singular_distance(p, q), rtol=1e-12)

    @pytest.mark.parametrize(
        ("coordinates", "x", "y"),
        [
            (CASES[1], 0, 0),
            (CASES[2], 0, 3),
            (CASES[2], 3, 0),
            (CASES[2], 0, 0),
            (CASES[3], 2, 2),
            (CASES[3], 2, -2),
        ],
    )
    def test_singular_lines_are_silent(self, coordinates, x, y):
        assert not np.isfinite(coordinates.eta(x, y))
        assert coordinates.jacobian(x, y) == np.inf
        assert coordinates.sector(x, y) == -1
        assert coordinates.singular_distance(x, y) == 0

    def test_distance_is_to_the_nearest_line(self):
        assert CASES[0].singular_distance(3, 4) == np.inf
        assert CASES[1].singular_distance(3, 4) == 5
        assert CASES[2].singular_distance(3, -4) == 3
        assert abs(CASES[3].singular_distance(3, 4) - math.sqrt(0.5)) < 4 * EPS

    @pytest.mark.parametrize("coordinates", CASES, ids=lambda c: type(c).__name__)
    def test_nan_goes_through_and_single_precision_stays(self, coordinates):
        x, y = np.float32([[1, np.nan], [3, 1]])
        for member in (coordinates.eta, coordinates.xi, coordinates.jacobian, coordinates.singular_distance):
            assert member(x, y).dtype == np.float32
            assert np.isfinite(member(x, y)[0]) or coordinates is CASES[0]
        np.testing.assert_array_equal(coordinates.sector(x, y)[1], -1)
        assert coordinates.sector(x, y)[0] >= 0
        assert coordinates.inverse(x, y)[0].dtype == np.float32
        assert coordinates.eta(np.ones((3, 1)), np.ones(4) * 2).shape == (3, 4)


class TestRefusals:
    def test_shears_do_not_commute(self):
        with pytest.raises(InputError, match=r"do not commute, \[L_b, L_B\] = 2 L_r"):
            canonical("stretch", "shear")
        with pytest.raises(InputError, match=r"\[L_s, L_x\] = −L_x"):
            canonical(L_s, L_x)

    def test_reverse_order_is_offered_swapped(self):
        with pytest.raises(
            InputError, match=r"use canonical\('divergence', 'curl'\), whose ξ belongs to L_r"
        ):
            canonical(L_r, L_s)

    def test_others(self):
        with pytest.raises(InputError, match="one generator makes one coordinate"):
            canonical(L_s, "divergence")
        with pytest.raises(InputError, match="second='spiral'"):
            canonical(L_s, "spiral")
        with pytest.raises(InputError, match="sector=4: must be whole, 0 … 3"):
            CASES[2].inverse(0.0, 0.0, 4)
        with pytest.raises(InputError, match="sector=1: must be whole, 0 … 0"):
            CASES[1].inverse(0.0, 0.0, 1)
        with pytest.raises(InputError, match="leading shapes"):
            CASES[1].eta(np.zeros(2), np.zeros(3))
