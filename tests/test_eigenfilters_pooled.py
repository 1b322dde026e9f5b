"""Pooled measurement at points: truth, covariance, light, room, bad input."""

from functools import cache

import numpy as np
import pytest

from sixflow import InputError, synth
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.default import array_bank, default_bank
from sixflow.eigenfilters.kernels import Gabor
from sixflow.eigenfilters.pooled import PooledOperator, moved_six

WINDOW, SIDE = 21, 223
CENTRE = (SIDE - 1) / 2
SMALL = (0.03, -0.02, 1e-3, 2e-3, -1.5e-3, 1e-3)


@cache
def operator(phase_only=False):
    return PooledOperator(WINDOW, phase_only=phase_only)


@cache
def frames(six=SMALL, noise=2.0, seed=0):
    motion = synth.Affine.from_six(six, centre=(CENTRE, CENTRE))
    return synth.pair(
        synth.Speckle(seed=seed), motion, (SIDE, SIDE), sensor=synth.Sensor(noise=noise, seed=seed)
    )


def points(count):
    """`count`² points, a window or more apart, with room."""
    reach = operator().reach
    axis = np.linspace(reach, SIDE - 1 - reach, count).round().astype(int)
    return tuple(c.ravel() for c in np.meshgrid(axis, axis))


def standard_errors(found):
    return np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))


@pytest.mark.parametrize("phase_only", [False, True])
@pytest.mark.parametrize("which", range(6))
def test_each_number_is_measured_and_the_others_are_not_disturbed(which, phase_only):
    scale = np.array([0.05, 0.05, 5e-3, 5e-3, 5e-3, 5e-3])
    six = np.eye(6)[which] * scale
    made = frames(tuple(six), 0.0)
    x, y = np.array([CENTRE, CENTRE + 20]), np.array([CENTRE, CENTRE - 10])
    found = operator(phase_only).estimate(made.frame0, made.frame1, x, y)
    # second-order terms of the motion, and what the difference misses of the shortest waves
    np.testing.assert_allclose((found.six - made.truth(x, y)) / scale, 0, atol=0.01)


@pytest.mark.parametrize("phase_only", [False, True])
def test_covariance_covers_the_errors(phase_only):
    made, (x, y) = frames(), points(6)
    found = operator(phase_only).estimate(made.frame0, made.frame1, x, y)
    z = (found.six - made.truth(x, y)) / standard_errors(found)
    # points are a window apart, and count as one each
    assert np.diff(np.unique(x)).min() >= WINDOW
    np.testing.assert_allclose(np.sqrt((z**2).mean(axis=0)), 1, atol=4 / np.sqrt(2 * len(z)))
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(len(z))
    assert np.median(found.noise) == pytest.approx(2, rel=0.05)
    assert np.isnan(found.contrast).all()
    np.testing.assert_allclose(found.covariance, np.swapaxes(found.covariance, 1, 2), atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


def test_phases_alone_are_noisier():
    made, (x, y) = frames(), points(3)
    both = [standard_errors(operator(p).estimate(made.frame0, made.frame1, x, y)) for p in (False, True)]
    ratio = np.median(both[1] / both[0], axis=0)
    assert (ratio > 1.05).all()
    assert (ratio < 2).all()


@cache
def in_steady_light(phase_only, noise):
    made = frames(noise=noise)
    return operator(phase_only).estimate(made.frame0, made.frame1, *points(3))


@pytest.mark.parametrize("phase_only", [False, True])
@pytest.mark.parametrize(
    ("gain", "offset", "slope"),
    [
        (0.5, 0, 0),
        (2, 0, 0),
        (1, 50, 0),
        (1, -50, 0),
        (2, -50, 0),
        (1, 0, 0.5),
        (1, 0, -0.5),
        (1.5, -20, 0.25),
    ],
)
def test_light_does_not_disturb(phase_only, gain, offset, slope):
    """Gain, brightness, and a slope of both by half of the light across the window.

    By less than half of the standard error of noise 2; noise that is lit with the frame is weighed differently.
    """
    plain, error = in_steady_light(phase_only, 0.0), standard_errors(in_steady_light(phase_only, 2.0))
    x, y = points(3)
    for k in range(0, len(x), 4):
        shading = 1 + slope * (np.arange(SIDE) - x[k]) / WINDOW
        at = x[k : k + 1], y[k : k + 1]
        still, noisy = (
            operator(phase_only).estimate(made.frame0, gain * shading * made.frame1 + offset, *at)
            for made in (frames(noise=0.0), frames(noise=2.0))
        )
        assert (np.abs(still.six[0] - plain.six[k]) < 0.5 * error[k]).all()
        assert (np.abs(noisy.six - frames().truth(*at)) < 4.5 * standard_errors(noisy)).all()


def test_contrast_does_not_shorten_the_motion():
    made = frames((0.05, -0.03, 0.0, 0.0, 0.0, 0.0), 0.0)
    for gain in (0.5, 1.0, 2.0):
        found = operator().estimate(made.frame0, gain * made.frame1, [CENTRE], [CENTRE])
        np.testing.assert_allclose(found.six[0, :2], [0.05, -0.03], rtol=0.01)


def test_kernels_that_see_brightness():
    """A bank that is not free of DC: brightness is taken out all the same."""
    kernels = tuple(
        Gabor(f, k * np.pi / 6, sigma=4, shape="equal-dc") for f in (0.5, 0.8, 1.1) for k in range(6)
    )
    own = PooledOperator(31, FilterBank(kernels, 12))
    made = frames()
    plain = own.estimate(made.frame0, made.frame1, [CENTRE], [CENTRE])
    lit = own.estimate(made.frame0, made.frame1 + 50, [CENTRE], [CENTRE])
    assert np.abs((lit.six - plain.six) / standard_errors(plain)).max() < 0.1
    np.testing.assert_allclose(
        lit.covariance, plain.covariance, rtol=0.05, atol=1e-3 * plain.covariance.max()
    )


@pytest.mark.parametrize("phase_only", [False, True])
def test_texture_in_one_frame_only_is_no_measurement(phase_only):
    """All contrast, or none: nothing contradicts any motion, and the errors say so."""
    made, flat = frames(), np.full((SIDE, SIDE), 128.0)
    for pair in ((made.frame0, flat), (flat, made.frame1)):
        found = operator(phase_only).estimate(*pair, [CENTRE], [CENTRE])
        assert standard_errors(found)[0, :2].min() > 0.1


def test_unlike_frames_have_large_errors():
    found = operator().estimate(frames().frame0, frames(seed=1).frame0, *points(2))
    assert standard_errors(found)[:, :2].min() > 0.1


def test_without_texture():
    flat = np.full((SIDE, SIDE), 7.0)
    found = operator().estimate(flat, flat, [CENTRE], [CENTRE])
    assert np.isnan(found.six).all()
    assert np.isnan(found.covariance).all()


def test_points_without_room_are_nan():
    made, half = frames(), SIDE // 2
    x, y = np.array([0, half, half, half, SIDE - 1, 25]), np.array([0, 0, 17, half, SIDE - 1, half])
    found = operator().estimate(made.frame0, made.frame1, x, y)
    # a corner has a quarter of its window; 25 px are room for more than half of the positions
    np.testing.assert_array_equal(np.isnan(found.six).all(axis=1), [True, True, False, False, True, False])
    np.testing.assert_array_equal(np.isnan(found.six), np.isnan(found.covariance[..., 0]))
    z = (found.six - made.truth(x, y)) / standard_errors(found)
    assert np.nanmax(np.abs(z)) < 5
    beside, whole = standard_errors(found)[[2, 3]]
    assert (beside > whole).all()


def test_no_points():
    found = operator().estimate(frames().frame0, frames().frame1, np.empty(0, int), np.empty(0, int))
    assert found.six.shape == (0, 6)
    assert found.covariance.shape == (0, 6, 6)


def test_points_do_not_depend_on_each_other():
    made, (x, y) = frames(), points(3)
    alone = operator().estimate(made.frame0, made.frame1, x[4:5], y[4:5])
    np.testing.assert_allclose(alone.six[0], in_steady_light(False, 2.0).six[4], atol=1e-12)


def test_patches_are_measured_as_points_are():
    made, (x, y) = frames(), points(2)
    reach = operator().reach
    window = np.s_[-reach : reach + 1]
    offset_y, offset_x = np.mgrid[window, window]
    stacks = [
        frame[y[:, None, None] + offset_y, x[:, None, None] + offset_x].reshape(len(x), -1)
        for frame in (made.frame0, made.frame1)
    ]
    counted = np.ones_like(stacks[0], bool)
    found = operator().estimate_patches(*stacks, counted)
    plain = operator().estimate(made.frame0, made.frame1, x, y)
    np.testing.assert_allclose(found.six, plain.six, atol=1e-12)
    np.testing.assert_allclose(found.covariance, plain.covariance, atol=1e-12)
    counted[0], counted[1, ::7] = False, False
    assert np.isnan(operator().estimate_patches(*stacks, counted).six[:2]).all()
    with pytest.raises(InputError, match=rf"all must be \(points, {(2 * reach + 1) ** 2}\)"):
        operator().estimate_patches(*stacks, counted[:2])


def test_bank_and_spacing_can_be_chosen():
    made = frames()
    for bank, spacing in (
        (default_bank(12, wavelengths=(4, 12)), None),
        (None, 5),
        (array_bank(15), np.int64(6)),
    ):
        found = PooledOperator(WINDOW, bank, spacing=spacing).estimate(
            made.frame0, made.frame1, [CENTRE], [CENTRE]
        )
        assert np.abs((found.six - made.truth([CENTRE], [CENTRE])) / standard_errors(found)).max() < 5


def test_map_about_another_point():
    """M(d) takes the six of an affine map from p to p + d."""
    motion = synth.Affine.from_six((0.3, -0.2, 0.02, 0.03, -0.01, 0.04), centre=(0, 0))
    scale = np.array([1, 1, 2, 2, 2, 2])
    here, there = motion.six(5.0, -2.0) / scale, motion.six(12.0, 1.5) / scale
    np.testing.assert_allclose(moved_six(7.0, 3.5) @ here, there, atol=1e-14)


GOOD = np.random.default_rng(1).normal(size=(64, 72))


@pytest.mark.parametrize("window", [9.9, 0, -31, np.nan, np.inf, "31", None, True])
@pytest.mark.parametrize("bank", [None, default_bank(12)])
def test_window_that_cannot_be_used(window, bank):
    with pytest.raises(InputError, match=r"window=.*at least 10 px"):
        PooledOperator(window, bank)


@pytest.mark.parametrize("spacing", [0, -8, 2.5, np.nan, "8", True])
def test_spacing_that_cannot_be_used(spacing):
    with pytest.raises(InputError, match=r"spacing=.*whole number of px.*5 suits"):
        PooledOperator(31, spacing=spacing)


def test_bank_that_cannot_be_used():
    with pytest.raises(InputError, match=r"bank: its operators reach .* the window of 21 px only 5.92 px"):
        PooledOperator(21, default_bank(31))
    few = FilterBank((Gabor(0.8, sigma=3), Gabor(0.8, 1.57, sigma=3)), 9)
    with pytest.raises(InputError, match="4 independent responses: 14 unknowns"):
        PooledOperator(31, few)
    phases = FilterBank(tuple(Gabor(0.8, k * np.pi / 8, sigma=3) for k in range(8)), 9)
    with pytest.raises(InputError, match="16 independent responses: 21 unknowns"):
        PooledOperator(31, phases, phase_only=True)
    assert PooledOperator(31, phases).freedom == 8


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frame1": GOOD[:60]}, r"frame 1 has shape \(60, 72\), frame 0 \(64, 72\)"),
        ({"frame0": GOOD.ravel()}, "frame0"),
        ({"frame1": np.where(GOOD > 2, np.nan, GOOD)}, "frame1 has .* pixels that are not finite"),
        (
            {"frame0": GOOD[:27, :26], "frame1": GOOD[:27, :26], "x": [3], "y": [3]},
            "the patch of 27 × 27 px is larger than the frame",
        ),
        ({"x": [72]}, r"x\[0\]=72: must be a whole pixel of the frame"),
        ({"y": [-1]}, r"y\[0\]=-1: must be a whole pixel"),
        ({"x": [30.5]}, r"x\[0\]=30.5: must be a whole pixel"),
        ({"x": [30, 31]}, "x and y have 2 and 1 points"),
        ({"x": 30, "y": 30}, r"x of shape \(\)"),
    ],
)
def test_frames_and_points_that_cannot_be_used(change, said):
    arguments = {"frame0": GOOD, "frame1": GOOD, "x": [30], "y": [30]} | change
    with pytest.raises(InputError, match=said):
        operator().estimate(**arguments)
