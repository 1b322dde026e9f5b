"""Maps of a neighbourhood: what they hold, and that deformations are translations of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from blobs import HALF, X, Y, pair, pattern
from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.generators import L_B, L_b, L_r, L_s
from sixflow.eigenfilters.neighbourhood import hyperbolic_map, log_polar_map
from sixflow.errors import InputError

INTERPOLATION = 5e-4  # over twice what the quintic spline leaves of these patterns, away from the border


@pytest.fixture(scope="module")
def still():
    return pattern(0)(X, Y)


class TestMaps:
    def test_log_polar_values(self, still):
        found = log_polar_map(still, HALF, HALF, r_min=3, r_max=20, shape=(16, 24))
        r, angle = np.exp(found["eta"].values)[:, None], found["xi"].values
        np.testing.assert_allclose(
            found, pattern(0)(r * np.cos(angle), r * np.sin(angle)), rtol=0, atol=INTERPOLATION
        )
        assert (found.dims, found["eta"].size, found["xi"].size) == (("eta", "xi"), 16, 24)
        np.testing.assert_allclose(np.exp(found["eta"][[0, -1]]), [3, 20])
        assert found["xi"][0] == -np.pi
        assert found["xi"].attrs == {"long_name": "atan2(y, x)", "units": "rad"}

    @pytest.mark.parametrize(("name", "first"), [("stretch", L_b), ("shear", L_B)])
    def test_hyperbolic_values(self, still, name, first):
        found = hyperbolic_map(still, HALF, HALF, generator=name, r_min=3, r_max=15, shape=(12, 16))
        assert found.dims == ("sector", "eta", "xi")
        for sector in range(4):
            eta, xi = np.meshgrid(found["eta"], found["xi"], indexing="ij")
            x, y = canonical(first, L_s).inverse(eta, xi, sector)
            np.testing.assert_allclose(found[sector], pattern(0)(x, y), rtol=0, atol=INTERPOLATION)
            one = hyperbolic_map(
                still, HALF, HALF, generator=first, sector=sector, r_min=3, r_max=15, shape=(12, 16)
            )
            np.testing.assert_allclose(one, found[sector], rtol=0, atol=1e-6)
            radius = np.hypot(x, y)
            np.testing.assert_allclose(
                radius, np.exp(xi - xi[0, 0]) * 3 * np.sqrt(np.cosh(2 * eta)), rtol=1e-12
            )

    def test_off_centre_and_single_precision(self, still):
        here = log_polar_map(still.astype(np.float32), HALF + 5.5, HALF - 3.25, r_max=12)
        r, angle = np.exp(here["eta"].values)[:, None], here["xi"].values
        want = pattern(0)(5.5 + r * np.cos(angle), -3.25 + r * np.sin(angle))
        np.testing.assert_allclose(here, want, rtol=0, atol=INTERPOLATION)

    def test_outside_the_frame_is_nan(self, still):
        found = log_polar_map(still, 10, HALF, r_max=24)
        x = 10 + np.exp(found["eta"]) * np.cos(found["xi"])
        np.testing.assert_array_equal(np.isnan(found), x < 0)
        assert np.isnan(log_polar_map(still, -500, 0)).all()


class TestTranslations:
    """The maps of exactly deformed frames, compared after a shift by whole samples, and by correlation."""

    def test_zoom_shifts_eta(self):
        shape, tau = (65, 128), 8 * math.log(12) / 64  # eight samples
        frames = pair(1, L_s, L_r, tau, 0)
        map0, map1 = (log_polar_map(f, HALF, HALF, r_min=2, r_max=24, shape=shape) for f in frames)
        np.testing.assert_allclose(map1.values[8:], map0.values[:-8], rtol=0, atol=INTERPOLATION)

    def test_rotation_shifts_xi(self):
        frames = pair(1, L_s, L_r, 0, 2 * np.pi * 10 / 128)
        map0, map1 = (log_polar_map(f, HALF, HALF) for f in frames)
        np.testing.assert_allclose(map1.values, np.roll(map0.values, 10, axis=1), rtol=0, atol=INTERPOLATION)

    @pytest.mark.parametrize("first", [L_b, L_B], ids=["stretch", "shear"])
    def test_shear_shifts_eta_and_zoom_shifts_xi(self, first):
        tau_eta, tau_xi = 10 * 1.6 / 64, -6 * math.log(9) / 64
        frames = pair(2, first, L_s, tau_eta, tau_xi)
        map0, map1 = (
            hyperbolic_map(f, HALF, HALF, generator=first, r_max=18, eta_max=0.8, shape=(65, 65))
            for f in frames
        )
        finer = math.exp(6 * (abs(tau_eta) + abs(tau_xi)))  # a quintic's error goes with the sixth derivative
        np.testing.assert_allclose(
            map1.values[:, 10:, :-6], map0.values[:, :-10, 6:], rtol=0, atol=INTERPOLATION * finer
        )


class TestRefusals:
    def test_numbers(self, still):
        with pytest.raises(InputError, match=r"r_min=5, r_max=5: must be 0 < r_min < r_max"):
            log_polar_map(still, HALF, HALF, r_min=5, r_max=5)
        with pytest.raises(InputError, match=r"shape=\(64, 3\)"):
            log_polar_map(still, HALF, HALF, shape=(64, 3))
        with pytest.raises(InputError, match="x=nan"):
            log_polar_map(still, math.nan, HALF)
        with pytest.raises(InputError, match="eta_max=0"):
            hyperbolic_map(still, HALF, HALF, eta_max=0)
        with pytest.raises(InputError, match="generator='curl': must be a shear"):
            hyperbolic_map(still, HALF, HALF, generator="curl")
        with pytest.raises(InputError, match="sector=4"):
            hyperbolic_map(still, HALF, HALF, sector=4)

    def test_frames(self, still):
        holed = still.copy()
        holed[HALF, HALF] = np.nan
        with pytest.raises(InputError, match="1 pixels that are not finite"):
            log_polar_map(holed, HALF, HALF)
        with pytest.raises(InputError, match="image has shape"):
            log_polar_map(np.zeros((3, 4, 5)), 1, 1)
