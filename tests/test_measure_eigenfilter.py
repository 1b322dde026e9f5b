"""`measure(method="eigenfilter")`: as good as predicted, nearly as good as possible, and blind to light.

Tolerances are sampling errors as in `test_measure_truth`: from N independent windows a spread is known to 1/√(2N).
"""

import json
from functools import cache

import numpy as np
import pytest
import tifffile
from scipy.signal import fftconvolve

import measured
import naive
from measured import measure
from sixflow import InputError, Settings, measure_sequence
from sixflow.cli import main
from sixflow.eigenfilters.problem import EigenfilterProblem, OperatorArray
from sixflow.engine.response import response as response_of
from sixflow.engine.window import attenuation_period, sharpening_noise, window_sigma
from sixflow.field.dataset import SIX
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.synth import Affine, Motion, Sensor, Speckle, pair, render, sequence
from sixflow.write import open_field
from solved import passes, plan_of

WINDOW, STEP, NOISE, SEEDS = 31, 8, 2, range(3)
EFFICIENCY = 1.15
CASES = [*((kind, NOISE) for kind in measured.PATTERNS), ("speckle", 9)]


def eigenfilter(*frames, **options):
    return measure(*frames, method="eigenfilter", **options)


def standardised(field, made):
    return measured.errors(field, made) / measured.standard_errors(field)


@cache
def cases(kind, noise):
    """(pair, eigenfilter field, least-squares field) of every seed."""
    out = []
    for seed in SEEDS:
        made = measured.ideal(kind, seed)
        frames = measured.noisy(made, noise, seed)
        out.append((made, eigenfilter(*frames), measure(*frames)))
    return out


def scatter(points, step=STEP, window=WINDOW):
    """Relative sampling error of a spread."""
    return 1 / np.sqrt(2 * measured.windows(points, step, window))


@pytest.mark.parametrize(("kind", "noise"), CASES)
def test_errors_are_as_large_as_predicted(kind, noise):
    for where in (measured.complete, measured.on_border):
        z = np.concatenate([standardised(field, made)[where(field)] for made, field, _ in cases(kind, noise)])
        spread = scatter(len(z))
        np.testing.assert_allclose(measured.rms(z), 1, atol=4 * spread)
        np.testing.assert_array_less(abs(z.mean(axis=0)), 4 * np.sqrt(2) * spread)
        for limit, share in ((1, 0.683), (1.96, 0.95)):
            chance = np.sqrt(2 * share * (1 - share)) * spread
            np.testing.assert_allclose((abs(z) < limit).mean(axis=0), share, atol=4 * chance)


@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_errors_are_close_to_the_cramer_rao_value(kind):
    """Errors are at most 1.15 times the least that is possible: seen, and predicted."""
    square, variance, limit = [], [], []
    for made, field, _ in cases(kind, NOISE):
        y, x = np.mgrid[:256, :256]
        gradient = made.pattern.gradient(x, y)
        bound = naive.cramer_rao(*gradient, window_sigma(WINDOW), field.x.values, field.y.values, NOISE)
        inside = measured.complete(field)
        square.append(measured.errors(field, made)[inside] ** 2)
        variance.append(measured.standard_errors(field)[inside] ** 2)
        limit.append(np.diagonal(bound, axis1=-2, axis2=-1)[inside])
    square, variance, limit = map(np.concatenate, (square, variance, limit))
    least = limit.mean(axis=0)
    assert (np.sqrt(square.mean(axis=0) / least) < EFFICIENCY * (1 + 4 * scatter(len(square)))).all()
    # no scatter of chance is in the prediction
    assert (np.sqrt(variance.mean(axis=0) / least) < EFFICIENCY).all()


@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_agrees_with_least_squares(kind):
    """Both see the same noise, in nearly the same way."""
    own, other, difference = [], [], []
    for made, field, plain in cases(kind, NOISE):
        both = ~measured.failed(field) & ~measured.failed(plain)
        assert both.mean() > 0.97
        gap = (measured.six_of(field) - measured.six_of(plain)) / measured.standard_errors(plain)
        assert np.abs(gap[both]).max() < 3
        difference.append(gap[both])
        inside = measured.complete(field) & measured.complete(plain)
        own.append(measured.errors(field, made)[inside])
        other.append(measured.errors(plain, made)[inside])
    assert (measured.rms(np.concatenate(difference)) < 0.6).all()
    # errors with a correlation of 1 − 0.6²/2: the ratio of their spreads is known to 1/√N of √(1 − ρ²) = 0.57
    own, other = np.concatenate(own), np.concatenate(other)
    chance = 0.57 * np.sqrt(2) * scatter(len(own))
    assert (measured.rms(own) / measured.rms(other) < EFFICIENCY + 4 * chance).all()


def test_no_bias_without_noise():
    for shift in ((0.5, -0.5), (0.98, 0.02)):
        made = measured.ideal("speckle", 0, 160, (*shift, 0.002, -0.003, 0.001, 0.002))
        field = eigenfilter(made.frame0, made.frame1, float64=True)
        error = np.abs(measured.errors(field, made))
        deep = measured.depth(field) >= 48
        assert error[deep][:, :2].max() < 1e-4
        assert error[deep][:, 2:].max() < 1e-5
        beside = ~measured.failed(field)
        # what a grey noise of 1 of 255 would do there
        assert error[beside][:, :2].max() < 5e-3
        assert error[beside][:, 2:].max() < 1e-3


class TestPasses:
    @staticmethod
    def problem(made):
        frames = [Frame(frame - 128, NO_MASK) for frame in (made.frame0, made.frame1)]
        grid = Grid.over(made.frame0.shape, STEP)
        return EigenfilterProblem(*frames, grid, plan_of(made.frame0.shape, method="eigenfilter")), grid

    @staticmethod
    def truth(made, grid):
        x, y = np.meshgrid(grid.x, grid.y)
        six, G = made.truth(x, y), made.motion.gradient(x, y)
        return np.stack([six[..., 0], six[..., 1], *(G[..., i, k] for i in range(2) for k in range(2))])

    @pytest.mark.parametrize("noise", [0, 3])
    def test_the_fixed_point_does_not_depend_on_the_start(self, noise):
        made = measured.ideal("speckle", 1, 128)
        made = pair(made.pattern, made.motion, (128, 128), sensor=Sensor(noise=noise))
        problem, grid = self.problem(made)
        rng = np.random.default_rng(1)
        ends = []
        for _ in range(2):
            # redundant directions as well: values and slopes of neighbours that contradict each other
            maps = self.truth(made, grid) + rng.normal(0, 0.2, (6, 1, 1)) * np.array(
                [[[1]]] * 2 + [[[0.03]]] * 4
            )
            maps[2:] += rng.normal(0, 0.01, maps[2:].shape)
            ends.append(passes(problem, maps, 12))
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-8)

    def test_truth_is_the_fixed_point_without_noise(self):
        made = measured.ideal("speckle", 1, 160)
        problem, grid = self.problem(made)
        truth = self.truth(made, grid)
        deep = np.minimum.outer(np.minimum(grid.y, 159 - grid.y), np.minimum(grid.x, 159 - grid.x)) >= 48
        for total in (True, False):
            step = passes(problem, truth, 1, total=total) - truth
            assert np.abs(step[:2][:, deep]).max() < 1e-4
            assert np.abs(step[2:][:, deep]).max() < 1e-5


@pytest.fixture(scope="module")
def scene():
    return measured.ideal("speckle", 2, 192)


EXACT = {"tolerance": 1e-4, "passes": 20}


@pytest.fixture(scope="module")
def steady(scene):
    """The scene with noise, in steady light."""
    return eigenfilter(*measured.noisy(scene, NOISE), **EXACT)


LIGHTS = [(0.5, 0), (2, 0), (1, 50), (2, -50)]


@pytest.mark.parametrize(("gain", "offset"), LIGHTS)
def test_gain_and_offset_are_not_seen(scene, steady, gain, offset):
    frame0, frame1 = measured.noisy(scene, NOISE)
    lit = eigenfilter(frame0, gain * frame1 + offset, **EXACT)
    assert not measured.failed(lit).any()
    change = np.abs(measured.six_of(lit) - measured.six_of(steady)) / measured.standard_errors(steady)
    assert change[measured.complete(steady)].max() < 0.5
    z = standardised(lit, scene)[~measured.failed(lit)]
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 * scatter(len(z)))


@pytest.mark.parametrize("slope", [0.4, 1.0])
def test_light_that_varies_over_the_frame(scene, steady, slope):
    """A slope of gain and offset disturbs less than where least squares estimates the light."""
    y, x = np.mgrid[:192, :192] / 191
    frame1 = (1 + slope * (x - 0.5)) * scene.frame1 + 75 * slope * y
    field = eigenfilter(scene.frame0, frame1, **EXACT)
    relit = measure(scene.frame0, frame1, lighting="gain+offset", robust=False, **EXACT)
    deep = measured.depth(field) >= 32
    error = measured.rms(measured.errors(field, scene)[deep])
    assert (error < 0.2 * measured.rms(measured.errors(relit, scene)[deep])).all()
    # a twentieth of what noise 2 of 255 does
    assert (error < 0.05 * np.median(measured.standard_errors(steady)[deep], axis=0)).all()


@pytest.mark.parametrize("lighting", ["gain+offset", "local"])
def test_lighting_can_be_corrected_as_well(scene, lighting):
    frame0, frame1 = measured.noisy(scene, NOISE)
    field = eigenfilter(frame0, 1.2 * frame1 + 10, lighting=lighting)
    inside = measured.complete(field)
    assert inside.mean() > 0.6
    z = standardised(field, scene)[inside]
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 * scatter(len(z)))


@pytest.fixture(scope="module")
def made():
    """A pair of unequal sides, eight bits, noise 2."""
    shape = (112, 141)
    motion = measured.affine((0.4, -0.3, 0.006, 0.008, 0.005, -0.004), shape)  # nothing leaves the frame
    return pair(Speckle(seed=3), motion, shape, sensor=Sensor(noise=NOISE, bits=8, seed=3))


@pytest.fixture(scope="module")
def field(made):
    return eigenfilter(made.frame0, made.frame1)


@pytest.fixture(scope="module")
def mask():
    mask = np.ones((112, 141), bool)
    mask[40:70, 50:90] = False
    mask[:, 130:] = False
    return mask


@pytest.fixture(scope="module")
def masked(made, mask):
    return eigenfilter(made.frame0, made.frame1, mask=mask, **EXACT)


def assert_close(first, second, atol=2e-5):
    """Equal flags, numbers within a few float32 roundings of positions of some 100 px."""
    np.testing.assert_array_equal(first.flag.values, second.flag.values)
    np.testing.assert_allclose(measured.six_of(first), measured.six_of(second), atol=atol)
    np.testing.assert_allclose(measured.standard_errors(first), measured.standard_errors(second), rtol=2e-3)


def assert_identical(first, second):
    for name in (*SIX, "covariance", "residual", "noise", "flag"):
        np.testing.assert_array_equal(first[name].values, second[name].values, err_msg=name)


def assert_honest(field, made):
    kept = ~measured.failed(field)
    z = standardised(field, made)[kept]
    assert np.isfinite(z).all()
    assert np.abs(z).max() < 6


class TestMissingPixels:
    def test_mask(self, made, mask, masked, field):
        cut = masked
        here = mask[np.ix_(cut.y, cut.x)]
        np.testing.assert_array_equal(cut.flag.values[0] == 1, ~here)
        assert np.isnan(measured.six_of(cut)[~here]).all()
        assert not measured.failed(cut)[here].any()
        assert_honest(cut, made)
        near = measured.on_border(cut) & measured.complete(field)
        assert near.sum() > 20
        assert (measured.standard_errors(cut)[near] > 0.97 * measured.standard_errors(field)[near]).all()

    def test_nothing_under_the_mask_counts(self, made, mask):
        plain = eigenfilter(made.frame0, made.frame1, mask=mask)
        garbage = np.random.default_rng(1).integers(0, 256, mask.shape)
        assert_close(eigenfilter(np.where(mask, made.frame0, garbage), made.frame1, mask=mask), plain)
        assert_close(eigenfilter(np.where(mask, made.frame0, np.nan), made.frame1, mask=mask), plain)

    def test_a_full_mask_is_no_mask(self, made, field):
        assert_close(eigenfilter(made.frame0, made.frame1, mask=np.ones((112, 141), bool)), field)

    def test_pixels_without_a_value(self, made):
        spoiled = made.frame1.astype(float)
        spoiled[40:70, 50:90] = np.nan
        spoiled[np.random.default_rng(2).random(spoiled.shape) < 0.002] = np.nan
        found = eigenfilter(made.frame0, spoiled)
        y, x = np.meshgrid(found.y, found.x, indexing="ij")
        centre = (x > 62) & (x < 78) & (y > 50) & (y < 60)
        assert measured.failed(found)[centre].all()
        assert not measured.flagged(found, "masked").any()
        assert (~measured.failed(found)).mean() > 0.9
        assert_honest(found, made)
        first = made.frame0.astype(float)
        first[np.random.default_rng(3).random(first.shape) < 0.01] = np.nan
        assert_honest(eigenfilter(first, made.frame1), made)

    @pytest.mark.parametrize(
        ("gain", "offset", "most"), [(1, 60, 0.01), (1, -60, 0.01), (2, 0, 0.8), (0.5, 0, 0.8)]
    )
    def test_light_beside_missing_pixels(self, made, masked, mask, gain, offset, most):
        """A part of a patch sees brightness, and beside missing pixels brightness has a step: neither counts."""
        lit = eigenfilter(made.frame0, gain * made.frame1.astype(float) + offset, mask=mask, **EXACT)
        here = ~measured.failed(masked)
        change = np.abs(measured.six_of(lit) - measured.six_of(masked)) / measured.standard_errors(masked)
        assert change[here].max() < most
        errors = [measured.standard_errors(f)[here] for f in (lit, masked)]
        np.testing.assert_allclose(*errors, rtol=0.15 if offset == 0 else 1e-3)


ALIKE = (1, 1 + 1e-7)
"""Frames that are the same, but not to the last bit: those would be a copy."""


class TestNothingToFollow:
    """What cannot be measured is flagged, never confidently wrong."""

    @pytest.mark.parametrize("noise", [(0, 0), (0, 1), (1, 1)])
    def test_a_pattern_without_texture_in_one_half(self, noise):
        frame = render(Speckle(), (64, 72))
        frame[:, 36:] = 128
        rng = np.random.default_rng(3)
        frames = (
            frame * scale + rng.normal(0, n, frame.shape) for n, scale in zip(noise, ALIKE, strict=True)
        )
        field = eigenfilter(*frames, window=15, step=4)
        flat = np.broadcast_to(field.x.values > 36 + 20, measured.failed(field).shape)
        assert measured.flagged(field, "low_texture", "unmatched", "masked")[flat].all()
        textured = np.broadcast_to(field.x.values < 24, flat.shape)
        assert not measured.failed(field)[textured].any()

    @pytest.mark.parametrize("noise", [0, 2])
    def test_texture_in_one_frame_only(self, noise):
        """Contrast that vanished altogether is no change of light."""
        made = measured.ideal("speckle", 5, 128)
        frame0, frame1 = measured.noisy(made, noise)
        frame1[:, 64:] = 100
        for frames in ((frame0, frame1), (frame1, frame0)):
            field = eigenfilter(*frames)
            x = np.broadcast_to(field.x.values, measured.failed(field).shape)
            assert measured.failed(field)[x > 64 + 16].all()
            assert not measured.failed(field)[x < 64 - 31].any()
        assert np.abs(standardised(eigenfilter(frame0, frame1), made)[x < 64 - 31]).max() < (
            6 if noise else np.inf
        )

    def test_unrelated_frames(self):
        for noise in (0, 3):
            rng = np.random.default_rng(1)
            frames = [render(Speckle(seed=s), (160, 160)) + rng.normal(0, noise, (160, 160)) for s in (0, 50)]
            assert (~measured.failed(eigenfilter(*frames))).mean() < 0.01

    def test_noise_alone(self):
        rng = np.random.default_rng(2)
        for seed_frames in rng.normal(100, 10, (2, 2, 160, 160)):
            assert (~measured.failed(eigenfilter(*seed_frames))).mean() < 0.01

    def test_the_aperture_problem_is_flagged(self):
        """A grating moves along its stripes without a trace; where frames are continued at the border it bends."""
        y, x = np.mgrid[:112, :112]
        kept, inner = [], []
        for angle in (0.0, 0.6, 2.2):
            phase = 2 * np.pi / 9 * (np.cos(angle) * x + np.sin(angle) * y)
            rng = np.random.default_rng(5)
            field = eigenfilter(*(128 + 50 * np.cos(phase + s) + rng.normal(0, 1, x.shape) for s in (0, 0.3)))
            kept.append(~measured.failed(field))
            inner.append(kept[-1][measured.depth(field) >= 31])
        assert np.mean(kept) < 0.05
        assert not np.any(inner)

    @pytest.mark.parametrize("noise", [20, 40, 80])
    def test_low_signal_to_noise(self, noise):
        """Contrast 35: points are lost, and those that are kept keep their word."""
        made = measured.ideal("speckle", 1)
        field = eigenfilter(*measured.noisy(made, noise, 1))
        kept = ~measured.failed(field)
        z = standardised(field, made)[kept]
        assert np.abs(z).max(initial=0) < 5
        if noise == 20:
            assert kept.mean() > 0.9
            np.testing.assert_allclose(measured.rms(z), 1, atol=4 * scatter(len(z)))
        if noise >= 80:
            assert kept.mean() < 0.05


@pytest.mark.parametrize(
    "six",
    [
        (0, 0, 0, 0, 0, 0),
        (-60.2, 31.1, 0, 0, 0, 0),
        (0.4, 0.3, 0.16, 0, 0, 0),
        (0.4, 0.3, 0, 0.2, 0, 0),
        (6.0, -5.0, 0.05, 0.08, -0.04, 0.03),
    ],
)
def test_large_motion_is_found(six):
    made = pair(Speckle(seed=2), measured.affine(six, (256, 256)), (256, 256), sensor=Sensor(noise=NOISE))
    field = eigenfilter(made.frame0, made.frame1)
    x, y = np.meshgrid(field.x, field.y)
    u, v = np.moveaxis(made.truth(x, y)[..., :2], -1, 0)
    stays = (np.minimum(x, x + u) > 16) & (np.maximum(x, x + u) < 239)
    stays &= (np.minimum(y, y + v) > 16) & (np.maximum(y, y + v) < 239)
    assert measured.failed(field)[stays].mean() < 0.01
    assert np.abs(standardised(field, made)[stays & ~measured.failed(field)]).max() < 6


@pytest.mark.parametrize("window", [10, 15, 21, 51])
def test_other_windows(window):
    made = measured.ideal("texture", 1, 160)
    field = eigenfilter(*measured.noisy(made, 3, 1), window=window)
    inside = measured.complete(field)
    assert inside.mean() > 0.25
    z = standardised(field, made)
    points = inside.sum() * min(1, window**2 / STEP**2)  # small windows are not all seen by the grid
    assert measured.rms(z[inside]) == pytest.approx(1, abs=4 * scatter(points, window=window))
    assert np.nanmax(np.abs(z)) < 6
    assert field.attrs["attenuation_period_10"] == pytest.approx(attenuation_period(window_sigma(window)))


def test_the_step_changes_only_where_points_lie():
    frames = measured.noisy(measured.ideal("speckle", 0, 129), NOISE)
    coarse, fine = (eigenfilter(*frames, step=step) for step in (8, 4))
    shared = fine.sel(x=coarse.x, y=coarse.y)
    inside = measured.complete(coarse) & measured.complete(shared)
    assert inside.sum() > 50
    difference = (measured.six_of(coarse) - measured.six_of(shared))[inside]
    assert np.abs(difference / measured.standard_errors(coarse)[inside]).max() < 0.2


def test_a_window_without_room_for_operators():
    frame = render(Speckle(), (64, 64))
    for window in (5, 9.9):
        with pytest.raises(
            InputError, match=rf"window={window}: method='eigenfilter' .* at least 10 px; .*least_squares"
        ):
            eigenfilter(*(frame * scale for scale in ALIKE), window=window)
    assert not measured.failed(eigenfilter(*(frame * scale for scale in ALIKE), window=10)).any()


@pytest.mark.parametrize("shape", [(31, 31), (31, 90), (40, 33)])
def test_small_frames(shape):
    frame = render(Speckle(sigma=1.2), shape)
    field = eigenfilter(*(frame * scale for scale in ALIKE), step=3)
    kept = ~measured.failed(field)
    assert kept.any()
    np.testing.assert_allclose(measured.six_of(field)[kept], 0, atol=1e-4)


def test_double_precision_changes_roundings_only(made, field):
    double = eigenfilter(made.frame0, made.frame1, float64=True)
    assert double.u.dtype == np.float64
    assert_close(field, double)
    np.testing.assert_allclose(field.noise, double.noise, rtol=1e-3)
    np.testing.assert_allclose(field.residual, double.residual, rtol=1e-3)


def test_repeated_runs_are_identical(made, field):
    frames = made.frame0.copy(), made.frame1.copy()
    assert_identical(eigenfilter(*frames), field)
    np.testing.assert_array_equal(frames[0], made.frame0)
    np.testing.assert_array_equal(frames[1], made.frame1)


def test_the_unit_of_grey_does_not_matter(made, field):
    for gain, offset in ((1 / 255, 0), (257, -5000), (1e30, 0)):
        scaled = eigenfilter(*(gain * frame.astype(float) + offset for frame in (made.frame0, made.frame1)))
        assert_close(scaled, field, atol=2e-4)
        np.testing.assert_allclose(scaled.noise, gain * field.noise, rtol=1e-3)


def test_transposed_frames(made, field):
    """x and y change places: u and v as well, curl and stretch change sign. The bank has no such symmetry."""
    turned = eigenfilter(made.frame0.T, made.frame1.T)
    expected = measured.six_of(turned).swapaxes(0, 1)[..., [1, 0, 2, 3, 4, 5]] * [1, 1, 1, -1, -1, 1]
    np.testing.assert_array_equal(field.flag.values[0], turned.flag.values[0].T)
    change = (np.abs(measured.six_of(field) - expected) / measured.standard_errors(field))[
        ~measured.failed(field)
    ]
    assert change.max() < 1.5
    assert measured.rms(change).max() < 0.4


def test_noise_and_residual_are_reported():
    for kind, noise in CASES:
        made, field, _ = cases(kind, noise)[0]
        inside = measured.complete(field)
        assert np.median(field.noise.values[0][inside]) == pytest.approx(noise, rel=0.05)
        # of the responses, to which low frequencies of the pattern do not contribute
        residual = np.median(field.residual.values[0][inside])
        assert 0.3 < residual / (np.sqrt(2) * noise / made.frame0.std()) < 1.5


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


def resolution(window, blob):
    """σ of the pooled array along y, for horizontal displacements of Gaussian blobs of radius `blob`.

    A row S of an operator answers a displacement u(x) with Σ S(x) g(x) u(x), and is weighed with its own Σ S(x') g(x'):
    on average over patterns u counts by Σ_j S_j(x) (S_j * R)(x), R the autocorrelation of the gradient g.
    """
    array = OperatorArray.of(window, np.dtype(np.float64))
    radius = array.projection.radius
    y, x = np.mgrid[-24:25, -24:25]
    t = 2 * blob**2
    R = np.exp(-(x**2 + y**2) / (2 * t)) * (1 / t - x**2 / t**2)
    rows = array.projection.rows.reshape(-1, 2 * radius + 1, 2 * radius + 1)
    profile = sum(row * fftconvolve(row, R, "same") for row in rows).sum(axis=1)
    square = (profile * np.arange(-radius, radius + 1) ** 2).sum() / profile.sum()
    return np.sqrt(array.width**2 + square)


@pytest.mark.parametrize("period", [64, 100])
def test_attenuation_of_a_wave(period):
    """Waves are attenuated by the Gaussian of the pool and what each operator sees of it; sharpening undoes that."""
    shape, amplitude, blob = (256, 256), 0.2, 1.5
    made = pair(Speckle(sigma=blob), Wave(amplitude, period), shape)
    k, sigma = 2 * np.pi / period, window_sigma(WINDOW)
    assert 1 < resolution(WINDOW, blob) / sigma < 1.1
    M, seen = (np.exp(-((k * s) ** 2) / 2) for s in (sigma, resolution(WINDOW, blob)))
    for sharpen in (0, 2):
        field = eigenfilter(made.frame0, made.frame1, sharpen=sharpen, step=4)
        inside = field.isel(time=0, y=(field.y > 52) & (field.y < 203), x=(field.x > 50) & (field.x < 205))
        # whole periods of rows, so that sine and cosine are orthogonal over them
        rows = inside.y.values[: int(period / 4) * ((len(inside.y) * 4) // period)]
        inside = inside.sel(y=rows)
        cosine, sine = np.cos(k * rows), np.sin(k * rows)
        u_y = ((inside.shear - inside.curl) / 2).values
        # the fixed point of U ← Q (M U + M̃ (U* − U)), Q of the window's own M
        Q = response_of(M, sharpen) / M
        response = Q * seen / (1 - Q * M + Q * seen) if sharpen else seen
        for values, wave, size in ((inside.u.values, cosine, amplitude), (u_y, -sine, amplitude * k)):
            known = np.isfinite(values)
            assert known.mean() > 0.99
            weight = known * wave[:, None]
            columns = (weight * np.where(known, values, 0)).sum(axis=0) / (weight**2).sum(axis=0) / size
            chance = columns.std() / np.sqrt(len(columns) * 4 / WINDOW)
            assert columns.mean() == pytest.approx(response, abs=4 * chance + 0.01)


def test_noise_of_sharpening():
    """Noise grows by the factors of `sharpening_noise`, and the predicted errors with it."""
    sharpen, growth, z = 2, [], []
    for seed, (made, plain, _) in zip(SEEDS, cases("speckle", NOISE), strict=True):
        field = eigenfilter(*measured.noisy(made, NOISE, seed), sharpen=sharpen)
        inside = measured.depth(plain) >= 48  # sharpening passes look beyond the window
        growth.append([measured.errors(f, made)[inside] ** 2 for f in (field, plain)])
        z.append(standardised(field, made)[inside])
    sharp, plain = (np.sqrt(np.concatenate(part).mean(axis=0)) for part in zip(*growth, strict=True))
    z = np.concatenate(z)
    displacement, gradient = sharpening_noise(sharpen)
    factors = np.array([displacement] * 2 + [gradient] * 4)
    np.testing.assert_allclose(sharp / plain / factors, 1, atol=4 * scatter(len(z)))
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 * scatter(len(z)))


def test_a_recording_is_its_pairs():
    motion = Affine.rotation(0.01, (48, 40))
    frames = sequence(Speckle(), motion, (80, 96), 3, sensor=Sensor(noise=NOISE, bits=8)).frames
    field = measure_sequence(frames, method="eigenfilter", window=21)
    for k in range(2):
        alone = eigenfilter(frames[k], frames[k + 1], window=21)
        np.testing.assert_array_equal(field.flag.values[k], alone.flag.values[0])
        np.testing.assert_allclose(field.u.values[k], alone.u.values[0], atol=2e-5)


class TestSettings:
    def test_attributes(self, field):
        settings = Settings.from_mapping(json.loads(field.attrs["settings"]))
        assert settings == Settings(window=31, method="eigenfilter")
        assert repr(settings) == "Settings(window=31, method='eigenfilter')"

    def test_file_and_command_line(self, made, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "settings.toml").write_text('method = "eigenfilter"\nwindow = 21\nstep = 16\n')
        assert Settings.from_toml("settings.toml") == Settings(method="eigenfilter", window=21, step=16)
        assert (
            Settings.from_mapping(json.loads(Settings(method="eigenfilter").to_json())).method
            == "eigenfilter"
        )
        tifffile.imwrite("A.tif", made.frame0)
        tifffile.imwrite("B.tif", made.frame1)
        expected = eigenfilter(made.frame0, made.frame1, window=21, step=16)
        flags = ["--method", "eigenfilter", "--window", "21", "--step", "16"]
        for k, options in enumerate((["--settings", "settings.toml"], flags)):
            assert main(["measure", "A.tif", "B.tif", "-o", f"{k}.nc", *options]) == 0
            with open_field(f"{k}.nc") as stored:
                assert json.loads(stored.attrs["settings"])["method"] == "eigenfilter"
                np.testing.assert_array_equal(stored.u.values, expected.u.values)

    @pytest.mark.parametrize("method", ["eigen", "", None, 1, "Eigenfilter"])
    def test_unknown_method(self, method):
        with pytest.raises(InputError, match=r"method=.*: must be one of 'least_squares', 'eigenfilter'"):
            Settings(method=method)


def test_frozen_numbers():
    """Numbers of one small case, so that no change goes unnoticed; they may differ by float32 rounding only."""
    made = pair(Speckle(seed=1), measured.affine((1.4, -0.7, 0.01, 0.02, -0.01, 0.015), (64, 64)), (64, 64))
    field = eigenfilter(made.frame0.round(), made.frame1.round(), step=24)
    np.testing.assert_array_equal(field.flag.values[0], [[2, 2, 2], [2, 0, 2], [2, 2, 2]])
    values = measured.six_of(field)
    # float32 holds positions of 64 px to 4e-6 px and their slopes to that over σ
    np.testing.assert_allclose(values[1, 1, :2], [1.3985322, -0.7143143], atol=2e-5)
    np.testing.assert_allclose(values[1, 1, 2:], [0.0101081, 0.0202393, -0.0099449, 0.0152189], atol=2e-6)
    u = [[1.462069, 1.458970, 1.460862], [1.401734, 1.398532, 1.405025], [1.339826, 1.341337, 1.341015]]
    np.testing.assert_allclose(values[..., 0], u, atol=2e-5)
    spread = [0.00119963, 0.00126213, 0.000141247, 0.000142793, 0.000136732, 0.000137081]
    np.testing.assert_allclose(measured.standard_errors(field)[1, 1], spread, rtol=1e-3)
    assert float(field.noise[0, 1, 1]) == pytest.approx(0.291716, rel=1e-3)
    assert float(field.residual[0, 1, 1]) == pytest.approx(0.00872425, rel=1e-3)
