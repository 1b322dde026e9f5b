"""What windows leave out: each law of `refine.bias` in numbers, and coverage where windows are exact filters."""

import math

import numpy as np
import pytest

from sixflow.convention.flags import FLAGS
from sixflow.engine.response import response
from sixflow.maps.grid import Grid
from sixflow.maps.six import maps_of_six
from sixflow.plan import LADDER, SHARPEN, Window
from sixflow.refine import bias
from sixflow.refine.bias import bands_of, bias_of, difference_noise, overlap
from sixflow.refine.resolution import choose
from sixflow.refine.solution import Solution, WindowStatistics

SIDE, STEP = 48, 8
GRID = Grid(0, 0, STEP, SIDE, SIDE)
COARSE = tuple(Window(31 * 2 ** (k / 2), SHARPEN) for k in (-1, 0, 1))


def level(window, six, variance, weight=1.0):
    """A solution of six (rows, columns, 6) with variances of the six, 1 or (6,) or (rows, columns, 6)."""
    shape = six.shape[:2]
    covariance = np.zeros((*shape, 6, 6), np.float32)
    covariance[..., range(6), range(6)] = variance
    plane = np.full(shape, 0.1)
    statistics = WindowStatistics(np.broadcast_to(weight, shape), *(plane for _ in range(6)))
    return Solution(
        maps_of_six(six), covariance, statistics, np.zeros(shape), np.full(shape, float(window.size)),
        np.full(shape, window.period), np.zeros(shape, np.uint16),
    )  # fmt: skip


def constant(differences, variances, weight=1.0, windows=COARSE):
    """E of the finest band and more, of levels whose u differ by constants; (levels,) expected squares of u inside."""
    levels, u = [], 0.0
    for window, difference, variance in zip(windows, (0.0, *differences), variances, strict=True):
        u += difference
        six = np.zeros((SIDE, SIDE, 6))
        six[..., 0] = six[..., 1] = u
        levels.append(level(window, six, variance, weight))
    return bands_of(levels, windows, GRID).expected[:, SIDE // 2, SIDE // 2, 0].astype(float)


def beyond(q, sharpen=SHARPEN):
    """What the finest window leaves out over E of the finest band: a row of bands that fall by q, correlated by c."""
    a = overlap(sharpen, 2)[1] * math.sqrt(q)
    return q / (1 - q) * (1 + 2 * a / (1 - a))


TINY = 1e-12


def test_what_is_beyond_the_finest_sharpened_window_falls_by_the_root_of_a_half():
    finest, middle, _ = constant((0.1, 0.1), (TINY, TINY, TINY))
    assert finest == pytest.approx(0.01 * beyond(math.sqrt(0.5)), rel=1e-4)
    assert middle == pytest.approx(finest + 0.01, rel=1e-4)


@pytest.mark.parametrize(("ratio", "share"), [(0.01, 0.25), (0.5, 0.5), (2.0, math.sqrt(0.5))])
def test_beyond_a_plain_window_bands_go_on_within_limits(ratio, share):
    windows = tuple(Window(one.size) for one in COARSE)
    finest = constant((0.1, 0.1 / math.sqrt(ratio)), (TINY, TINY, TINY), windows=windows)[0]
    assert finest == pytest.approx(0.01 * beyond(share, 0), rel=1e-3)


@pytest.mark.parametrize(("weight", "share"), [(1.0, 0.5), (0.981, 0.5), (0.979, 0.5 * math.sqrt(2))])
def test_noise_hides_a_band_that_the_coarser_lets_expect(weight, share):
    """The finest window's noise is enormous: its band is a share of the next coarser's, more where windows are cut."""
    (f, _), _ = difference_noise(math.sqrt(2), SHARPEN)
    finest, middle, _ = constant((math.sqrt(f * 10), 0.1), (10.0, TINY, TINY), weight)
    assert middle - finest == pytest.approx(0.01 * share, rel=1e-2)


@pytest.mark.parametrize(
    ("first", "more", "is_there"),
    [
        (True, 0.95 / 3.8906, False),
        (True, 1.05 / 3.8906, True),
        (False, 0.95, False),
        (False, 1.05, True),
    ],
)
def test_a_band_is_there_if_chance_does_not_explain_it(first, more, is_there):
    """Uniform noise: the mean of n squares, n = 2 (1 + 8σ_c² k²) or 50 points of each component, at 1 in 10⁴; one
    standard deviation does in the first band.
    """
    (f, squared), _ = difference_noise(math.sqrt(2), SHARPEN)
    windows = COARSE[1:] if first else COARSE
    fine, coarse = windows[:2]
    points = (
        1 + 8 * coarse.sigma**2 * squared / fine.sigma**2,
        16 * math.pi * max(coarse.sigma / STEP, 1) ** 2,
    )
    part = 1 / (9 * min(points))
    limit = (1 - part + 3.8906 * math.sqrt(part)) ** 3
    variance = 1e-4
    difference = math.sqrt(f * variance * (1 + more * (limit - 1)))
    rest = () if first else (TINY,)
    found = constant((difference, *(0.0 for _ in rest)), (variance, *rest, TINY), windows=windows)
    assert (found[1] > 0) == is_there


def one_that_differs(others):
    """Expected squares of what the middle window leaves out along a line, where one point differs by 1 px."""
    windows = COARSE[1:]
    six = np.zeros((SIDE, SIDE, 6))
    six[..., :2] = others
    six[24, 24, :2] = 1.0
    levels = [level(windows[0], six, TINY), level(windows[1], np.zeros_like(six), TINY)]
    return bands_of(levels, windows, GRID).expected[1, 24, :, 0].astype(float)


def test_points_count_over_twice_the_window(monkeypatch):
    """One point that differs: K spreads it with a standard deviation of twice the coarser window's."""
    monkeypatch.setattr(bias, "RARE", 1e3)  # nothing is too rare
    bias.law_of.cache_clear()
    expected = one_that_differs(0.0)
    bias.law_of.cache_clear()
    reach = 2 * COARSE[2].sigma / STEP
    assert expected[29] / expected[24] == pytest.approx(math.exp(-(25) / (2 * reach**2)), rel=1e-3)


def test_what_is_far_does_not_count_where_points_know_better():
    """Beyond k's reach of a point that differs, energy is what the points there show, and one standard deviation."""
    (_, squared), _ = difference_noise(math.sqrt(2), SHARPEN)
    independent = 1 + 2 * COARSE[2].sigma ** 2 * squared / COARSE[1].sigma ** 2
    most = math.exp(0.5772 + math.sqrt(1.6449 / independent))  # of exponential deviates: γ, π²/6
    expected = one_that_differs(0.01)
    k = math.ceil(2.5 * COARSE[2].sigma / STEP)
    assert 24 + k + 2 < 24 + 2 * k  # K reaches on
    within, share = expected[24 + k + 2], expected[24 + k + 2] / 1e-4 / (1 + beyond(math.sqrt(0.5)))
    assert within > 0
    assert share == pytest.approx(most, rel=0.02)


def test_windows_that_bear_no_sharpening_leave_out_what_plain_ones_do():
    six = [np.zeros((SIDE, SIDE, 6)) for _ in COARSE]
    for k, one in enumerate(six):
        one[..., :2] = 0.1 * k
    levels = [level(w, one, TINY) for w, one in zip(COARSE, six, strict=True)]
    whole = bands_of(levels, COARSE, GRID).expected
    period = levels[0].period.copy()
    period[10, 10] = COARSE[2].period * 0.99
    lower = bands_of([levels[0].replace(period=period), *levels[1:]], COARSE, GRID)
    assert lower.expected[0, 10, 10, 0] == pytest.approx(whole[2, 10, 10, 0], rel=0.05)
    assert lower.expected[0, 20, 20, 0] == pytest.approx(whole[0, 20, 20, 0], rel=0.05)


def test_outlying_variances_tell_nothing():
    """A few points with hardly any texture do not hide what the others show."""
    rng = np.random.default_rng(0)
    six = np.zeros((SIDE, SIDE, 6))
    variance = np.full((SIDE, SIDE, 6), 1e-4)
    bad = rng.random((SIDE, SIDE)) < 0.02
    variance[bad] = 10.0
    coarse = six.copy()
    coarse[..., :2] = 0.03
    windows = COARSE[1:]
    found = [
        np.median(
            bias_of([level(windows[0], six, v), level(windows[1], coarse, TINY)], windows, GRID)[1, ..., 0]
        )
        for v in (variance, np.full_like(variance, 1e-4))
    ]
    assert found[0] == pytest.approx(found[1], rel=0.1)


def filtered(spectrum, noise, seed):
    """Levels of the ladder, sharpened, as exact filters of a motion and of white noise; and the true six."""
    n, rng = SIDE * STEP, np.random.default_rng(seed)
    ky, kx = (2 * np.pi * k for k in np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n), indexing="ij"))
    k2 = kx**2 + ky**2
    amplitude = spectrum(np.sqrt(k2))

    def waves(scale):
        return [np.fft.fft2(rng.normal(size=(n, n))) * scale for _ in range(2)]

    motion, white = waves(amplitude), waves(noise)

    def six_of(u, v):
        parts = (
            u,
            v,
            1j * (kx * u + ky * v),
            1j * (kx * v - ky * u),
            1j * (kx * u - ky * v),
            1j * (ky * u + kx * v),
        )
        return np.stack([np.fft.ifft2(p).real[::STEP, ::STEP] for p in parts], axis=-1)

    windows = tuple(Window(size, SHARPEN) for size in LADDER)
    levels = []
    for window in windows:
        T = response(np.exp(-k2 * window.sigma**2 / 2), SHARPEN)
        variance = [noise**2 * float((T**2 * w).mean()) for w in (1, k2)]
        levels.append(
            level(
                window,
                six_of(*(T * (m + w) for m, w in zip(motion, white, strict=True))),
                np.repeat(variance, (2, 4)),
            )
        )
    return levels, windows, six_of(*motion)


SPECTRA = {
    "nothing": lambda k: 0 * k,
    "smooth": lambda k: 200.0 * np.exp(-((k * 40) ** 2) / 2),
    "k⁻³": lambda k: np.where((k > 2 * np.pi / 300) & (k < 0.5), 2e-3 * np.maximum(k, 1e-9) ** -2.0, 0),
}


@pytest.mark.parametrize("name", SPECTRA)
@pytest.mark.parametrize("noise", [0.2, 1.0])
def test_errors_are_covered(name, noise):
    """|z| > 3 at 1 % of all points at most, whatever the window; and where there is nothing to leave out, standard
    errors stay as they are. What lies in noise at every window is covered in displacement, and by half in gradients.
    """
    levels, windows, truth = filtered(SPECTRA[name], noise, 1)
    bias = bias_of(levels, windows, GRID)
    chosen = choose(levels, windows, GRID)
    six = [np.moveaxis(np.tensordot(_SIX, one.maps, 1), 0, -1) for one in (*levels, chosen)]
    variances = [np.diagonal(one.covariance, axis1=-2, axis2=-1) for one in (*levels, chosen)]
    for k, (found, variance, beta) in enumerate(zip(six, variances, (*bias, chosen.bias), strict=True)):
        z = np.abs(found - truth) / np.sqrt(variance + beta)
        if name.startswith("k"):
            assert (z[..., :2] > 3).mean() < 0.04, k
            assert np.sqrt((z[..., 2:] ** 2).mean()) < 2, k
        else:
            assert (z > 3).mean() < 0.01, k
        if name == "nothing":
            assert np.median(beta / variance) < 0.1
            assert np.sqrt((z**2).mean()) > 0.7
    best = min(float(((one - truth)[..., :2] ** 2).mean()) for one in six[:-1])
    assert ((six[-1] - truth)[..., :2] ** 2).mean() < 1.5 * best


_SIX = np.array(
    [
        [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 1], [0, 0, 0, -1, 1, 0], [0, 0, 1, 0, 0, -1],
        [0, 0, 0, 1, 1, 0],
    ]
)  # fmt: skip


def test_points_without_a_window_say_nothing():
    six = [np.zeros((SIDE, SIDE, 6)) for _ in COARSE]
    levels = [level(w, one, 1e-4) for w, one in zip(COARSE, six, strict=True)]
    flag = np.zeros((SIDE, SIDE), np.uint16)
    flag[:20] = FLAGS["low_texture"]
    levels[0] = levels[0].replace(flag=flag, maps=np.where(flag != 0, np.nan, levels[0].maps))
    bands = bands_of(levels, COARSE, GRID)
    assert np.isfinite(bands.expected).all()
    assert (bands.expected < 1e-6).all()
    assert bands_of(levels[1:2], COARSE[1:2], GRID).seen.max() == 0
