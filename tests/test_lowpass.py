"""The Gaussian over both frames: its spectrum and noise, its covariance, what it mends, and what it must not touch."""

import numpy as np
import pytest
from scipy import ndimage

import measured
import naive
from measured import measure
from sixflow import InputError, Settings, measure_sequence
from sixflow.engine.lowpass import lowpass_half, lowpass_noise, lowpass_power, lowpass_reach, smoothed
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.spline import gradient_noise, noise_variance
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.prepare.prepare import lowpassed
from sixflow.synth import Affine, Particles, Sensor, Speckle, pair

WIDTHS = (0.4, 0.7, 1.0, 2.5)


def test_power_and_noise_are_those_of_the_weights():
    for s in WIDTHS:
        half = lowpass_half(s)
        weights = np.concatenate([half[:0:-1], half])
        assert weights.sum() == pytest.approx(1, abs=1e-14)
        spectrum = np.abs(np.fft.fft(weights, 256)) ** 2
        np.testing.assert_allclose(
            lowpass_power(s, 2 * np.pi * np.fft.fftfreq(256)), spectrum, rtol=1e-10, atol=1e-14
        )
        assert lowpass_noise(s) == pytest.approx(spectrum.mean() ** 2, rel=1e-12)
        if s >= 1:
            assert lowpass_noise(s) == pytest.approx(1 / (4 * np.pi * s**2), rel=1e-2)
    np.testing.assert_array_equal(lowpass_power(0.0, np.linspace(0, 3, 5)), 1)


def test_smoothing_is_a_convolution_that_leaves_slopes():
    image = np.random.default_rng(0).normal(size=(40, 50))
    inside = np.s_[8:-8, 8:-8]
    expected = ndimage.gaussian_filter(image, 1.0, truncate=4.0)
    np.testing.assert_allclose(smoothed(image, 1.0)[inside], expected[inside], atol=2e-12)
    slope = np.add.outer(3.0 * np.arange(40), -2.0 * np.arange(50))
    np.testing.assert_allclose(smoothed(slope, 1.0), slope, atol=1e-10)


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("lowpass", [0.5, 1.0])
def test_noise_after_the_lowpass_by_simulation(degree, lowpass):
    """Interpolated noise, and what it adds to gradients, within the sampling error of the simulated pixels."""
    rng, inside = np.random.default_rng(4), np.s_[12:-12, 12:-12]
    a, b, c = noise_variance(degree, lowpass)
    powers, ratios = [], []
    for _ in range(40):
        still, moved = (smoothed(n, lowpass) for n in rng.normal(size=(2, 72, 72)))
        shift = rng.uniform(0, 1, size=2)
        y, x = np.mgrid[:72, :72] + shift[:, None, None]
        brought = naive.interpolate(moved, x, y, degree)
        s = shift * (1 - shift)
        predicted = np.prod(1 + s * (a + s * (b + s * c)))
        ratios.append((brought[inside] ** 2).mean() / predicted / lowpass_noise(lowpass))
        powers.append((naive.differentiate((still + brought) / 2, 1)[inside] ** 2).mean())
    for values, expected in (
        (ratios, 1.0),
        (powers, gradient_noise(degree, DERIVATIVE, lowpass=lowpass) * lowpass_noise(lowpass)),
    ):
        assert np.mean(values) == pytest.approx(expected, abs=4 * np.std(values) / np.sqrt(len(values)))


@pytest.mark.parametrize(
    ("lowpass", "options"),
    [
        (0.7, {}), (1.0, {}), (1.5, {}), (1.0, {"sharpen": 2}), (1.0, {"interpolation": "cubic"}),
        (1.0, {"reference": "middle"}), (1.0, {"group": "similarity"}), (1.0, {"lighting": "gain+offset"}),
    ],
)  # fmt: skip
def test_coverage(lowpass, options):
    """Standardised errors have unit spread: 3 pairs hold about 3 · (256/31)² windows, so that it is known to 4 %."""
    central = options.get("reference") == "middle"  # where a shift alone is the same as seen from frame 0
    six = (0.8, -0.6, 0, 0, 0, 0) if central else (0.8, -0.6, 0.004, 0.006, 0, 0)
    spreads = []
    for seed in range(3):
        made = measured.ideal("speckle", seed, 256, six)
        field = measure(*measured.noisy(made, 3.0, seed), lowpass=lowpass, search="pyramid", **options)
        good = measured.complete(field)
        with np.errstate(invalid="ignore"):
            standardised = measured.errors(field, made)[good] / measured.standard_errors(field)[good]
        spreads.append(np.nanmean(standardised[:, :4] ** 2, axis=0))
    assert np.sqrt(np.mean(spreads)) == pytest.approx(1, abs=0.08)


@pytest.mark.parametrize("lowpass", [0.7, 1.0])
def test_cost_in_noise(lowpass):
    """Predicted standard errors of a speckle rise by √(T₀ T₂)/T₁ of its known spectrum."""
    variance = 1.5**2
    made = pair(Speckle(sigma=1.5, seed=1), Affine.from_six((0.3, 0.2, 0, 0, 0, 0)), (192, 192))
    frames = measured.noisy(made, 1.0)
    plain, smooth = (
        np.median(measured.standard_errors(measure(*frames, lowpass=s))[6:-6, 6:-6], axis=(0, 1))
        for s in (0.0, lowpass)
    )
    expected = (variance + lowpass**2) ** 2 / (variance * (variance + 2 * lowpass**2))
    np.testing.assert_allclose(smooth / plain, expected, rtol=0.05)


def test_noise_is_that_of_the_frames():
    made = measured.ideal("speckle")
    for lowpass in (0.0, 0.7, 1.5):
        field = measure(*measured.noisy(made, 4.0), lowpass=lowpass)
        assert float(field.noise.median()) == pytest.approx(4.0, rel=0.04)


def test_bias_of_textures_as_fine_as_the_pixels():
    """Particles of 2.5 px, and a speckle that cubic splines have moved; u is wrong by half as much, or less."""
    y, x = np.mgrid[:160, :160].astype(float)
    particles = Particles(diameter=2.5, density=0.06, seed=3)
    fine = np.round(Speckle(sigma=1.0, seed=3)(x, y))
    for frames in (
        (particles(x, y), particles(x - 0.25, y)),
        (fine, ndimage.shift(fine, (0, 0.25), order=3, mode="mirror")),
    ):
        plain, smooth = (abs(float(measure(*frames, lowpass=s).u.mean()) - 0.25) for s in (0.0, 1.0))
        assert smooth < plain / 2


def test_what_is_outside_the_mask_does_not_enter():
    made = measured.ideal("speckle", size=160)
    mask = np.zeros((160, 160), bool)
    mask[30:130, 30:130] = True
    rng = np.random.default_rng(5)
    spoilt = [np.where(mask, frame, rng.normal(128, 60, mask.shape)) for frame in (made.frame0, made.frame1)]
    moving = [mask, ndimage.shift(mask.astype(float), (-0.6, 0.8), order=1) > 0.99]
    field = measure_sequence(np.array(spoilt), mask=moving, lowpass=1.0)
    known = ~measured.failed(field)
    error = measured.errors(field, made)[known]
    assert known[5:15, 5:15].all()
    assert np.abs(error[:, :2]).max() < 0.02


def test_pixels_without_a_value():
    made = measured.ideal("speckle", size=160)
    frame0, frame1 = made.frame0.copy(), made.frame1.copy()
    frame0[70:75, 60:66] = np.nan
    frame1[100:103, 100:104] = np.nan
    field = measure(frame0, frame1, lowpass=0.7)
    known = ~measured.failed(field)
    assert (known | measured.flagged(field, "masked"))[1:-1, 1:-1].all()
    assert np.abs(measured.errors(field, made)[known][:, :2]).max() < 0.01


def test_counted_pixels():
    valid = np.ones((20, 20), np.uint8)
    valid[9, 12] = 0
    frame = lowpassed(Frame(np.zeros((20, 20)), valid), 1.0)
    counted = frame.counted()
    reach = lowpass_reach(1.0)
    expected = np.zeros((20, 20), np.uint8)
    expected[1:-1, 1:-1] = 1
    expected[9 - reach : 10 + reach, 12 - reach : 13 + reach] = 0
    np.testing.assert_array_equal(counted, expected)
    np.testing.assert_array_equal(frame.valid, valid)
    plain = Frame(np.zeros((20, 20)), NO_MASK)
    assert lowpassed(plain, 0.0) is plain
    assert lowpassed(plain, 1.0) is lowpassed(plain, 1.0)


@pytest.mark.parametrize("value", [-1, 0.1, 5, np.nan, "auto", True])
def test_bad_values(value):
    with pytest.raises(InputError, match="lowpass="):
        Settings(lowpass=value)


def test_operators_have_a_band_of_their_own():
    with pytest.raises(InputError, match=r"lowpass=1.0: must be 0 with method='eigenfilter'"):
        Settings(lowpass=1.0, method="eigenfilter")


@pytest.mark.parametrize("options", [{"lighting": "local"}, {"reference": "second"}, {"window": "auto"}])
def test_with_other_settings(options):
    motion = Affine.from_six((0.8, -0.6, 0.004, 0.006, 0.003, -0.002), (79.5, 79.5))
    made = pair(Speckle(seed=2), motion, (160, 160), sensor=Sensor(noise=1, seed=2))
    plain, smooth = (measure(made.frame0, made.frame1, lowpass=s, **options) for s in (0.0, 0.7))
    both = ~measured.failed(plain) & ~measured.failed(smooth)
    assert both.mean() > 0.95
    difference = np.abs(plain.u - smooth.u).values[0][both]
    assert np.median(difference) < 0.005
