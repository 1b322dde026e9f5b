"""Measured fields against exact truth: errors as large as predicted, as small as possible, and unbiased.

Tolerances are sampling errors: from N independent windows the spread of standardised errors is known to
1/√(2N), their mean to 1/√N. Four of these are allowed.
"""

import numpy as np
import pytest

import measured
import naive
from measured import measure
from sixflow.engine.response import response as response_of
from sixflow.engine.window import sharpening_noise, window_sigma
from sixflow.synth import Motion, Speckle, pair

WINDOW, STEP, SEEDS = 31, 8, range(6)


def standardised(kind, noise, where, **options):
    """Standardised errors of the points `where` over all seeds, shape (n, 6), and 1/(mean standard error)."""
    parts, spread = [], []
    for seed in SEEDS:
        made = measured.ideal(kind, seed)
        field = measure(*measured.noisy(made, noise, seed), **options)
        spread.append(measured.standard_errors(field)[where(field)])
        parts.append(measured.errors(field, made)[where(field)] / spread[-1])
    return np.concatenate(parts), 1 / np.concatenate(spread).mean(axis=0)


@pytest.mark.parametrize("noise", [1, 3, 9])
@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_errors_are_as_large_as_predicted(kind, noise):
    z, spread = standardised(kind, noise, measured.complete)
    count = measured.windows(len(z), STEP, WINDOW)
    assert count > 250
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 / np.sqrt(2 * count))
    # particles of 4 px diameter are not quite band-limited: the spline is off by up to 5e-4 px
    systematic = np.array([5e-4] * 2 + [0] * 4) * spread
    np.testing.assert_array_less(abs(z.mean(axis=0)), 4 / np.sqrt(count) + systematic)
    for limit, share in ((1, 0.683), (1.96, 0.95)):
        scatter = np.sqrt(share * (1 - share) / count)
        np.testing.assert_allclose((abs(z) < limit).mean(axis=0), share, atol=4 * scatter)


@pytest.mark.parametrize("noise", [1, 3, 9])
@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_errors_at_the_border_are_as_large_as_predicted(kind, noise):
    z, _ = standardised(kind, noise, measured.on_border)
    count = measured.windows(len(z), STEP, WINDOW)
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 / np.sqrt(2 * count))


@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_errors_reach_the_cramer_rao_value(kind):
    noise = 2
    square, limit = [], []
    for seed in SEEDS:
        made = measured.ideal(kind, seed)
        field = measure(*measured.noisy(made, noise, seed))
        y, x = np.mgrid[:256, :256]
        bound = naive.cramer_rao(
            *made.pattern.gradient(x, y), window_sigma(WINDOW), field.x.values, field.y.values, noise
        )
        inside = measured.complete(field)
        square.append(measured.errors(field, made)[inside] ** 2)
        limit.append(np.diagonal(bound, axis1=-2, axis2=-1)[inside])
    square, limit = np.concatenate(square), np.concatenate(limit)
    efficiency = np.sqrt((square / limit).mean(axis=0))
    count = measured.windows(len(square), STEP, WINDOW)
    np.testing.assert_allclose(efficiency, 1, atol=4 / np.sqrt(2 * count))


SHIFTS = [(0, 0), (0.25, 0.1), (0.5, -0.5), (-0.75, 0.3), (0.98, 0.02)]


@pytest.mark.parametrize(("interpolation", "limit"), [("cubic", 1e-3), ("quintic", 1e-4)])
@pytest.mark.parametrize("shift", SHIFTS)
def test_no_bias_without_noise(interpolation, limit, shift):
    made = measured.ideal("speckle", 0, 160, (*shift, 0.002, -0.003, 0.001, 0.002))
    field = measure(made.frame0, made.frame1, interpolation=interpolation, float64=True)
    # windows and the splines under them see nothing of the border
    error = np.abs(measured.errors(field, made)[measured.depth(field) >= 48])
    assert error[:, :2].max() < limit
    assert error[:, 2:].max() < 1e-4


@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_no_bias_at_the_border_without_noise(kind):
    made = measured.ideal(kind)
    field = measure(made.frame0, made.frame1)
    error = np.abs(measured.errors(field, made)[~measured.failed(field)])
    # what a grey noise of 1 of 255 would do there; particles of 4 px are not quite band-limited, see above
    factor = 5 if kind == "particles" else 1
    assert error[:, :2].max() < factor * 5e-3
    assert error[:, 2:].max() < factor * 1e-3


def test_no_bias_at_the_edge_of_a_mask():
    """A partial window alone does not bias: the same points, cut off by a mask instead of the frame's border."""
    made = measured.ideal("speckle", 0, 192)
    mask = np.zeros((192, 192), bool)
    mask[16:-16, 16:-16] = True
    field = measure(made.frame0, made.frame1, mask=mask)
    at_edge = measured.on_border(field)
    assert at_edge.sum() > 100
    error = np.abs(measured.errors(field, made)[at_edge])
    assert error[:, :2].max() < 1e-4
    assert error[:, 2:].max() < 1e-5


class Wave(Motion):
    """u = amplitude cos(k y): every row slides as a whole."""

    def __init__(self, amplitude, period):
        self.amplitude, self.k = amplitude, 2 * np.pi / period

    def _displacement(self, x, y):
        return self.amplitude * np.cos(self.k * y), 0.0

    def _gradient(self, x, y):
        return 0.0, -self.amplitude * self.k * np.sin(self.k * y), 0.0, 0.0

    def _inverse(self, x, y):
        return x - self._displacement(x, y)[0], y


@pytest.mark.parametrize("period", [40, 64, 100])
def test_attenuation_of_a_wave(period):
    """Sine displacements are attenuated as the window and its sharpening passes say, the gradients as well."""
    shape, amplitude, window = (256, 512), 0.2, 31
    made = pair(Speckle(sigma=1.5), Wave(amplitude, period), shape)
    k = 2 * np.pi / period
    M = np.exp(-((k * window_sigma(window)) ** 2) / 2)
    for sharpen in (0, 1, 2, 4):
        field = measure(made.frame0, made.frame1, window=window, step=4, sharpen=sharpen)
        inside = field.isel(time=0, y=(field.y > 52) & (field.y < 203), x=(field.x > 50) & (field.x < 461))
        # whole periods of rows, so that sine and cosine are orthogonal over them
        rows = inside.y.values[: int(period / 4) * ((len(inside.y) * 4) // period)]
        inside = inside.sel(y=rows)
        cosine, sine = np.cos(k * rows), np.sin(k * rows)
        response = response_of(M, sharpen)
        u_y = ((inside.shear - inside.curl) / 2).values
        for values, wave, size in ((inside.u.values, cosine, amplitude), (u_y, -sine, amplitude * k)):
            known = np.isfinite(values)
            assert known.mean() > 0.99
            weight = known * wave[:, None]
            columns = (weight * np.where(known, values, 0)).sum(axis=0) / (weight**2).sum(axis=0) / size
            scatter = columns.std() / np.sqrt(len(columns) * 4 / window)
            assert columns.mean() == pytest.approx(response, abs=4 * scatter + 0.01)


def test_a_strict_tolerance_does_not_take_sharpening_away():
    """Passes that rounding keeps from coming nearer have not diverged: points keep the finer resolution."""
    made = pair(Speckle(), Wave(0.2, 60.0), (256, 256))
    field = measure(made.frame0, made.frame1, sharpen=4, tolerance=1e-3)
    period = field.resolution.values[np.isfinite(field.resolution.values)]
    assert (period < 1.01 * period.min()).mean() > 0.98


@pytest.mark.parametrize("sharpen", [1, 3])
def test_noise_of_sharpening(sharpen):
    """Noise grows by the factors of `sharpening_noise`, and the predicted errors with it."""
    plain, sharp, z = [], [], []
    for seed in SEEDS:
        made = measured.ideal("speckle", seed)
        frames = measured.noisy(made, 2, seed)
        fields = [measure(*frames, sharpen=n, step=4) for n in (0, sharpen)]
        inside = measured.depth(fields[0]) >= 48  # sharpening passes look beyond the window
        for field, kept in zip(fields, (plain, sharp), strict=True):
            kept.append(measured.errors(field, made)[inside])
        z.append((measured.errors(fields[1], made) / measured.standard_errors(fields[1]))[inside])
    count = measured.windows(sum(map(len, plain)), 4, WINDOW)
    displacement, gradient = sharpening_noise(sharpen)
    growth = measured.rms(np.concatenate(sharp)) / measured.rms(np.concatenate(plain))
    scatter = 1 / np.sqrt(2 * count)
    np.testing.assert_allclose(growth / np.array([displacement] * 2 + [gradient] * 4), 1, atol=4 * scatter)
    np.testing.assert_allclose(measured.rms(np.concatenate(z)), 1, atol=4 * scatter)


def test_smaller_windows_have_larger_honest_errors():
    z, spread = [], []
    for window in (21, 31, 51):
        made = measured.ideal("texture", 1)
        field = measure(*measured.noisy(made, 3, 1), window=window)
        inside = measured.complete(field)
        z.append(measured.rms((measured.errors(field, made) / measured.standard_errors(field))[inside]))
        spread.append(np.median(measured.standard_errors(field)[inside], axis=0))
        count = measured.windows(inside.sum(), STEP, window)
        np.testing.assert_allclose(z[-1], 1, atol=4 / np.sqrt(2 * count))
    # displacement ∝ 1/window, gradients ∝ 1/window²
    np.testing.assert_allclose((spread[0] / spread[2])[:2], 51 / 21, rtol=0.15)
    np.testing.assert_allclose((spread[0] / spread[2])[2:], (51 / 21) ** 2, rtol=0.15)


def test_noise_and_residual_are_reported():
    for kind in measured.PATTERNS:
        made = measured.ideal(kind)
        field = measure(*measured.noisy(made, 3))
        inside = measured.complete(field)
        noise = field.noise.values[0][inside]
        assert np.median(noise) == pytest.approx(3, rel=0.05)
        contrast = made.frame0.std()
        assert np.median(field.residual.values[0][inside]) == pytest.approx(
            np.sqrt(2) * 3 / contrast, rel=0.35
        )
