"""The historical operators: what each recovers, how it fails, and that it says so."""

import numpy as np
import pytest

from sixflow.convention import SIX
from sixflow.eigenfilters.historical import (
    HistoricalField,
    differentiated_flow,
    fleet_jepson,
    gradient_ratio,
)
from sixflow.eigenfilters.historical.moments import WindowSums
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.plot import plot_field
from sixflow.synth import Affine, Grating, Sensor, Speckle, pair

METHODS = (gradient_ratio, fleet_jepson, differentiated_flow)
SIDE, CENTRE = 129, 64.0  # a point of the grid, step 8, lies on the centre
SIGMA = 31 / np.sqrt(4 * np.pi)
RADIUS = 2.0  # of the blobs
SMALL = (0.2, 0.2, 0.01, 0.01, 0.01, 0.01)


def moved(six, *, noise=0.0, seed=3, radius=RADIUS):
    motion = Affine.from_six(six, (CENTRE, CENTRE))
    return pair(Speckle(sigma=radius, seed=seed), motion, (SIDE, SIDE), sensor=Sensor(noise=noise, seed=seed))


def pure(k):
    six = np.zeros(6)
    six[k] = SMALL[k]
    return six


def truth(made, field):
    return made.truth(*np.meshgrid(field.x, field.y))


def central(field):
    """The point of the grid on which linear motions have no translation."""
    return field.six[field.y.tolist().index(64), field.x.tolist().index(64)]


# The ratios


def slope_excess(radius):
    """⟨k sin k⟩/⟨sin² k⟩ over the spectrum exp(−k²s²) of speckle: I_t has the true slope, ∇I central differences."""
    k = np.linspace(0, np.pi, 4001)
    power = np.exp(-((radius * k) ** 2))
    return (power * k * np.sin(k)).sum() / (power * np.sin(k) ** 2).sum()


@pytest.mark.parametrize("k", range(6), ids=SIX)
@pytest.mark.parametrize("radius", [2.0, 3.0])
def test_gradient_ratio_recovers_each_generator_but_for_its_differences(k, radius):
    # what remains after the known excess: the excess varies with the texture in the window. Its spread over N
    # patches is about that of a mean of squares, √(2/N) of (excess − 1), N = window²/(4π radius²)
    made = [moved(pure(k), radius=radius, seed=seed) for seed in range(4)]
    relative = np.mean([central(gradient_ratio(m.frame0, m.frame1))[k] / SMALL[k] for m in made])
    excess = slope_excess(radius)
    spread = (excess - 1) * np.sqrt(2 / (4 * 31**2 / (4 * np.pi * radius**2)))
    second_order = (SMALL[k] / radius) ** 2 if k < 2 else (SMALL[k] * SIGMA / radius) ** 2
    assert abs(relative - excess) < 4 * spread + second_order


def test_gradient_ratio_leaks_between_generators():
    field = gradient_ratio(moved(pure(0)).frame0, moved(pure(0)).frame1)
    other = field.six[field.valid][:, 1]
    assert 0.02 * SMALL[0] < np.sqrt((other**2).mean()) < 0.5 * SMALL[0]


@pytest.mark.parametrize("k", range(6), ids=SIX)
def test_noise_makes_the_gradient_ratio_too_small_as_predicted(k):
    noise, window = 16.0, 101  # a large window: the bias stays, the scatter goes
    found, predicted = [], []
    for seed in range(8):
        clean, noisy = moved(pure(k), seed=seed), moved(pure(k), seed=seed, noise=noise)
        without = central(gradient_ratio(clean.frame0, clean.frame1, window=window))[k]
        found.append(central(gradient_ratio(noisy.frame0, noisy.frame1, window=window))[k] / without)
        I_y, I_x = np.gradient((clean.frame0 + clean.frame1) / 2)
        predicted.append(1 / (1 + noise**2 / 4 / ((I_x**2 + I_y**2).mean() / 2)))
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert np.mean(found) < 1 - 5 * error
    assert abs(np.mean(found) - np.mean(predicted)) < 3.5 * error
    assert error < 0.05


def test_plain_ratio_is_unstable():
    made = moved(pure(0), noise=4.0)
    truth_u = SMALL[0]
    spread = {
        ratio: np.sqrt(
            np.nanmean((gradient_ratio(made.frame0, made.frame1, ratio=ratio).six[..., 0] - truth_u) ** 2)
        )
        for ratio in ("least-squares", "pointwise")
    }
    assert spread["least-squares"] < 0.1 * truth_u
    assert spread["pointwise"] > truth_u  # nothing is left of the measurement


def test_plain_ratio_agrees_where_the_slope_never_vanishes():
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    frame0, frame1 = 3 * x + 2 * y, 3 * (x - 0.25) + 2 * y
    plain = gradient_ratio(frame0, frame1, window=9, ratio="pointwise")
    best = gradient_ratio(frame0, frame1, window=9)
    for field in (plain, best):
        np.testing.assert_allclose(field.six[field.valid][:, 0], 0.25, rtol=1e-12)
        np.testing.assert_allclose(
            field.six[field.valid][:, 1], 0.375, rtol=1e-12
        )  # the other generator alone


# Phase


@pytest.mark.parametrize("k", [0, 1])
def test_phase_of_a_translation(k):
    made = moved(pure(k))
    field = fleet_jepson(made.frame0, made.frame1)
    error = (field.six - truth(made, field))[field.valid]
    # phase that is not straight within the displacement: (k u)³ against a unit of phase
    bound = (2 * np.pi / 8 * SMALL[k]) ** 3 / (2 * np.pi / 8)
    assert np.abs(error[:, :2]).max() < bound
    assert np.abs(error[:, 2:]).max() < bound / SIGMA


@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_phase_of_a_deformation(k):
    # each component is the motion's mean within the filter's radius, off by about G σ_g/√2. Of N filters that fit
    # the window in each of 6 orientations the slope is off by that over σ √N
    made = moved(pure(k))
    field = fleet_jepson(made.frame0, made.frame1)
    filter_radius = 4.71
    N = 6 * 31**2 / (4 * np.pi * filter_radius**2)
    bound = SMALL[k] * filter_radius / np.sqrt(2) / (SIGMA * np.sqrt(N))
    error = (field.six - truth(made, field))[field.valid]
    assert np.sqrt((error[:, 2:] ** 2).mean(axis=0)).max() < bound
    assert np.sqrt((error[:, :2] ** 2).mean(axis=0)).max() < bound * SIGMA


def test_phase_is_not_biased_by_noise():
    found = [
        np.nanmean(fleet_jepson(m.frame0, m.frame1).six[..., 0])
        for m in (moved(pure(0), noise=8.0, seed=seed) for seed in range(10))
    ]
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert abs(np.mean(found) - SMALL[0]) < 3.5 * error
    assert error < 0.1 * SMALL[0]


def test_stability_test_rejects_what_is_unstable():
    made = moved(np.array([1.5, -1.0, 0.02, 0.02, 0, 0]))
    kept = fleet_jepson(made.frame0, made.frame1)
    everything = fleet_jepson(
        made.frame0, made.frame1, frequency_deviation=1e6, amplitude_deviation=1e6, least_amplitude=0
    )
    both = kept.valid & everything.valid
    rms = [np.sqrt(((f.six - truth(made, f))[both] ** 2).mean(axis=0)) for f in (kept, everything)]
    assert (rms[0] < rms[1]).all()
    assert everything.valid.sum() >= kept.valid.sum()


# Differences


@pytest.mark.parametrize("k", [0, 1])
def test_differentiated_translation(k):
    made = moved(pure(k))
    field = differentiated_flow(made.frame0, made.frame1)
    error = (field.six - truth(made, field))[field.valid]
    # cubic splines of speckle: error (k/2π)⁴-fold, below 0.5 % of a displacement of a fraction of a pixel
    assert np.abs(error[:, :2]).max() < 0.005 * SMALL[k]
    # two derivatives, each of two such errors over 2 step
    assert np.abs(error[:, 2:]).max() < 2 * 2 * 0.005 * SMALL[k] / (2 * 8)


@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_differentiated_deformation(k):
    # d is the mean of the motion weighted by w I_x²; on speckle of radius s its variance is (3/8) (G s)² per
    # component of G, and that of its derivative at most 3/2 / σ² of it: smooth over σ. Four components, all four
    # of the same size or zero, make the six; the differences over 2 step are a little less
    made = moved(pure(k))
    field = differentiated_flow(made.frame0, made.frame1)
    error = (field.six - truth(made, field))[field.valid]
    G = SMALL[k] / 2
    in_d = np.sqrt(2 * 3 / 8) * G * RADIUS
    assert np.sqrt((error[:, :2] ** 2).mean(axis=0)).max() < 2 * in_d
    assert np.sqrt((error[:, 2:] ** 2).mean(axis=0)).max() < 2 * np.sqrt(2) * np.sqrt(1.5) * in_d / SIGMA
    assert abs(error[:, k].mean()) < 0.1 * SMALL[k]


def test_differentiated_flow_finds_several_pixels():
    made = moved(np.array([5.0, -3.0, 0.02, 0.02, -0.02, 0.01]))
    field = differentiated_flow(made.frame0, made.frame1)
    error = (field.six - truth(made, field))[field.valid]
    assert np.sqrt((error[:, :2] ** 2).mean(axis=0)).max() < 0.1
    assert field.valid.mean() > 0.4


def test_differences_amplify_noise_more_on_a_finer_grid_of_small_windows():
    made = moved(np.zeros(6), noise=8.0)
    rms = [
        np.sqrt(
            np.nanmean(
                differentiated_flow(made.frame0, made.frame1, window=9, grid_step=step).six ** 2, axis=(0, 1)
            )
        )
        for step in (16, 4)
    ]
    assert (rms[1][2:] > 2 * rms[0][2:]).all()
    np.testing.assert_allclose(rms[1][:2], rms[0][:2], rtol=0.5)


# All


@pytest.mark.parametrize("method", METHODS)
def test_noise_makes_it_worse(method):
    six = pure(0)
    spread = []
    for noise in (0.0, 8.0, 32.0):
        made = moved(six, noise=noise)
        field = method(made.frame0, made.frame1)
        spread.append(np.sqrt(((field.six - truth(made, field))[field.valid][:, 0] ** 2).mean()))
    assert spread[0] < spread[2]
    assert spread[1] < spread[2]


@pytest.mark.parametrize("method", METHODS)
def test_sign_and_axes(method):
    made = moved(np.array([0.3, -0.2, 0.0, 0.0, 0.0, 0.0]))
    u, v = np.nanmedian(method(made.frame0, made.frame1).six[..., :2], axis=(0, 1))
    assert (u, v) == pytest.approx((0.3, -0.2), abs=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_result(method):
    made = moved(pure(2))
    field = method(made.frame0, made.frame1, grid_step=10, window=25)
    grid = Grid.over((SIDE, SIDE), 10)
    assert isinstance(field, HistoricalField)
    np.testing.assert_array_equal(field.x, grid.x)
    np.testing.assert_array_equal(field.y, grid.y)
    assert field.six.shape == (*grid.shape, 6)
    assert field.valid.dtype == bool
    np.testing.assert_array_equal(np.isfinite(field.six).all(axis=-1), field.valid)
    np.testing.assert_array_equal(np.isnan(field.six).all(axis=-1), ~field.valid)
    data = field.to_dataset()
    assert data["u"].dims == ("time", "y", "x")
    assert data.attrs["method"] == field.method
    for k, name in enumerate(SIX):
        np.testing.assert_array_equal(data[name].values[0], field.six[..., k])


def test_dataset_can_be_drawn(tmp_path):
    made = moved(pure(3))
    data = fleet_jepson(made.frame0, made.frame1).to_dataset()
    plot_field(data, made.frame0, path=tmp_path / "field.png")
    assert (tmp_path / "field.png").stat().st_size > 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("grey", [0.0, 0.1, 200.0])
def test_constant_frames_are_not_valid(method, grey):
    frame = np.full((64, 72), grey)
    field = method(frame, frame)
    assert not field.valid.any()
    assert np.isnan(field.six).all()


@pytest.mark.parametrize("method", METHODS)
def test_constant_region_is_not_valid(method):
    made = moved(pure(0))
    frames = [np.where(np.arange(SIDE) < 70, 100.1, frame) for frame in (made.frame0, made.frame1)]
    field = method(*frames, window=15)
    reach = int(3.5 * 15 / np.sqrt(4 * np.pi)) + 20  # of the window and of the Gabor filters
    assert not field.valid[:, field.x < 70 - reach].any()
    assert field.valid[:, (field.x > 90) & (field.x < 110)].mean() > 0.5


@pytest.mark.parametrize("method", METHODS)
def test_masked_region_is_not_valid_and_the_rest_stands(method):
    made = moved(pure(0))
    frame1 = made.frame1.copy()
    frame1[:, :60] = np.nan
    frame1[100, 100] = np.inf
    field = method(made.frame0, frame1, window=15)
    assert not field.valid[:, field.x < 50].any()
    right = field.six[field.valid][:, 0]
    assert right.size > 10
    assert np.median(right) == pytest.approx(SMALL[0], rel=0.1)


@pytest.mark.parametrize("method", METHODS)
def test_a_grating_does_not_determine_six(method):
    made = pair(Grating(wavelength=8.0), Affine.translation(0.2, 0.0), (96, 96))
    assert not method(made.frame0, made.frame1).valid.any()


def test_normal_equations_are_the_plain_sums():
    rng = np.random.default_rng(5)
    g_x, g_y, r = rng.normal(size=(3, 20, 24))
    grid, sigma = Grid(2, 3, 7, 3, 2), 2.5
    sums = WindowSums(r.shape, grid, sigma)
    A, b = sums.normal_equations((g_x * g_x, g_x * g_y, g_y * g_y), (g_x * r, g_y * r))
    y, x = np.indices(r.shape)
    for j, i in np.ndindex(grid.shape):
        X, Y = (x - grid.x[i]) / sigma, (y - grid.y[j]) / sigma
        w = np.exp(-(X**2 + Y**2) / 2) / (2 * np.pi * sigma**2) * (np.abs(X) <= 3.5) * (np.abs(Y) <= 3.5)
        along = [g_x, g_y, X * g_x + Y * g_y, -Y * g_x + X * g_y, X * g_x - Y * g_y, Y * g_x + X * g_y]
        np.testing.assert_allclose(A[j, i], [[(w * p * q).sum() for p in along] for q in along], atol=1e-13)
        np.testing.assert_allclose(b[j, i], [(w * p * r).sum() for p in along], atol=1e-13)


FRAME = np.random.default_rng(0).normal(size=(40, 48))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("frame0", "frame1", "options", "message"),
    [
        (np.zeros((40, 48, 3)), FRAME, {}, r"frame0 has shape \(40, 48, 3\).*luminance"),
        (FRAME, np.zeros((40, 48, 3)), {}, r"frame1 has shape \(40, 48, 3\).*luminance"),
        (FRAME, FRAME[:-1], {}, r"frame1 has shape \(39, 48\).*crop both"),
        (FRAME * 1j, FRAME, {}, "frame0 has dtype complex128"),
        (np.full((40, 48), np.nan), FRAME, {}, "frame0 has no finite pixel: give"),
        (FRAME, np.full((40, 48), np.inf), {}, "frame1 has no finite pixel: give"),
        (np.zeros((0, 4)), np.zeros((0, 4)), {}, r"frame0 has shape \(0, 4\)"),
        (FRAME[:4], FRAME[:4], {}, r"frame0 has shape \(4, 48\): give frames of at least 5×5"),
        (FRAME, FRAME, {"window": 4}, "window=4: must be a finite number of px of at least 5"),
        (FRAME, FRAME, {"window": 41}, "window=41.*at most 40 px.*choose a smaller window"),
        (FRAME, FRAME, {"window": np.nan}, "window=nan: must be a finite number"),
        (FRAME, FRAME, {"window": "wide"}, "window='wide': must be"),
        (FRAME, FRAME, {"grid_step": 0}, "grid_step=0: must be"),
        (FRAME, FRAME, {"grid_step": 2.5}, "grid_step=2.5: must be"),
        (FRAME, FRAME, {"grid_step": 41}, "grid_step=41: must be"),
    ],
)
def test_bad_input(method, frame0, frame1, options, message):
    with pytest.raises(InputError, match=message):
        method(frame0, frame1, **options)


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        (gradient_ratio, {"ratio": "median"}, "ratio='median': must be 'least-squares' or 'pointwise'"),
        (fleet_jepson, {"wavelength": 2}, "wavelength=2: must be"),
        (fleet_jepson, {"wavelength": 30}, "wavelength=30: must be .* at most 20"),
        (fleet_jepson, {"orientations": 1}, "orientations=1: must be"),
        (fleet_jepson, {"bandwidth": 3}, "bandwidth=3: must be"),
        (fleet_jepson, {"frequency_deviation": 0}, "frequency_deviation=0: must be"),
        (fleet_jepson, {"amplitude_deviation": -1}, "amplitude_deviation=-1: must be"),
        (fleet_jepson, {"least_amplitude": 1}, "least_amplitude=1: must be below 1"),
        (fleet_jepson, {"condition": 0.5}, "condition=0.5: must be"),
        (differentiated_flow, {"levels": 0}, "levels=0: must be"),
        (differentiated_flow, {"passes": 0}, "passes=0: must be"),
        (differentiated_flow, {"grid_step": 40}, "grid_step=40: the grid is 1×2.*smaller step"),
    ],
)
def test_bad_options(method, options, message):
    with pytest.raises(InputError, match=message):
        method(FRAME, FRAME, **options)
