"""Correlation of maps: that it finds the deformation, without and with noise, in any light."""

from __future__ import annotations

import math

import numpy as np
import pytest

from blobs import HALF, X, Y, pair, pattern
from sixflow.eigenfilters.correlation import correlation_surface
from sixflow.eigenfilters.generators import L_B, L_b, L_r, L_s
from sixflow.eigenfilters.neighbourhood import hyperbolic_map, log_polar_map
from sixflow.errors import InputError

STEP_FRACTION = 0.02  # samples: what the residual interpolation may move a correlation peak by


class TestCorrelation:
    @pytest.mark.parametrize("seed", range(2))
    @pytest.mark.parametrize(
        ("tau_eta", "tau_xi"), [(0, 0), (0.01, -0.02), (0.2, 0), (0, 1), (-0.15, 0.4), (0.4, -3.0)]
    )
    def test_zoom_and_rotation(self, seed, tau_eta, tau_xi):
        found = correlation_surface(
            *(log_polar_map(f, HALF, HALF) for f in pair(seed, L_s, L_r, tau_eta, tau_xi))
        )
        steps = [float(np.diff(found.surface[axis][:2])[0]) for axis in ("eta", "xi")]
        assert abs(found.tau_eta - tau_eta) < STEP_FRACTION * steps[0]
        assert abs(found.tau_xi - tau_xi) < STEP_FRACTION * steps[1]
        assert found.peak > 0.98
        best = found.surface.argmax(("eta", "xi"))
        assert abs(found.surface["eta"][best["eta"]] - tau_eta) <= 0.51 * steps[0]
        assert abs(found.surface["xi"][best["xi"]] - tau_xi) <= 0.51 * steps[1]

    @pytest.mark.parametrize("sector", [None, 2])
    @pytest.mark.parametrize("first", [L_b, L_B], ids=["stretch", "shear"])
    @pytest.mark.parametrize(("tau_eta", "tau_xi"), [(0.01, 0.02), (0.2, 0), (0.1, -0.2)])
    def test_shear_and_zoom(self, first, sector, tau_eta, tau_xi):
        frames = pair(3, first, L_s, tau_eta, tau_xi)
        found = correlation_surface(
            *(hyperbolic_map(f, HALF, HALF, generator=first, sector=sector, eta_max=0.8) for f in frames)
        )
        assert abs(found.tau_eta - tau_eta) < STEP_FRACTION * 1.6 / 63
        assert abs(found.tau_xi - tau_xi) < STEP_FRACTION * math.log(12) / 63

    def test_lighting_does_not_matter(self):
        before, after = pair(4, L_s, L_r, 0.1, 0.3)
        plain, lit = (
            correlation_surface(log_polar_map(before, HALF, HALF), log_polar_map(f, HALF, HALF))
            for f in (after, 30 + 2.5 * after)
        )
        assert abs(lit.tau_eta - plain.tau_eta) < 1e-6
        assert abs(lit.tau_xi - plain.tau_xi) < 1e-6

    def test_reversed_in_time(self):
        maps = [log_polar_map(f, HALF, HALF) for f in pair(5, L_s, L_r, 0.1, 0.3)]
        there, back = correlation_surface(*maps), correlation_surface(*maps[::-1])
        np.testing.assert_allclose([back.tau_eta, back.tau_xi], [-there.tau_eta, -there.tau_xi], atol=1e-6)

    def test_noise_is_survived(self):
        rng = np.random.default_rng(9)
        frames = [f + rng.normal(0, 0.1, f.shape) for f in pair(6, L_s, L_r, 0.15, 0.5)]
        found = correlation_surface(*(log_polar_map(f, HALF, HALF) for f in frames))
        assert abs(found.tau_eta - 0.15) < math.log(12) / 63 / 2  # half a sample
        assert abs(found.tau_xi - 0.5) < np.pi / 128
        assert found.peak < 0.99


class TestRefusals:
    def test_maps(self):
        still = pattern(0)(X, Y)
        good = log_polar_map(still, HALF, HALF)
        with pytest.raises(InputError, match="different axes"):
            correlation_surface(good, log_polar_map(still, HALF, HALF, r_max=20))
        with pytest.raises(InputError, match="dimensions"):
            correlation_surface(good, good.rename(eta="a"))
        with pytest.raises(InputError, match=r"map1 has \d+ samples without value"):
            correlation_surface(good, log_polar_map(still, 10, HALF))
        with pytest.raises(InputError, match="map0 has no contrast"):
            correlation_surface(log_polar_map(np.full(still.shape, 7.1), HALF, HALF), good)
