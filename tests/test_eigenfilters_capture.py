"""Capture: large motions at one scale, by each generator and by all, and when they are believed."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from sixflow import synth
from sixflow.convention import SIX, six_from_coefficients
from sixflow.eigenfilters import JointOperator, PooledOperator, capture, default_bank
from sixflow.eigenfilters.candidates import of_pairs, size_of
from sixflow.eigenfilters.group_correlation import PAIRS, GroupCorrelation
from sixflow.eigenfilters.patches import patch_blocks
from sixflow.eigenfilters.warped import Neighbourhoods, Spline
from sixflow.engine.window import window_sigma
from sixflow.errors import InputError

RADIUS, WINDOW = 64, 31
SIGMA = window_sigma(WINDOW)
AT = [RADIUS]
TEXTURES = {
    "speckle": lambda seed: synth.Speckle(seed=seed),
    "particles": lambda seed: synth.Particles(diameter=4, seed=seed),
    "texture": lambda seed: synth.Texture(seed=seed),
}
LARGE = {  # τ: half of the longest wave of the bank; 25 % zoom; 30°; shears of 0.2
    "u": 10.5,
    "v": -10.5,
    "divergence": math.log(0.75),
    "curl": math.radians(30),
    "stretch": math.asinh(0.1),
    "shear": -math.asinh(0.1),
}
ALL = np.array([-7.0, 5.0, 0.15, -0.4, 0.07, 0.08])  # τ


def six_of(name: str, tau: float) -> np.ndarray:
    coefficients = np.zeros(6)
    coefficients[SIX.index(name)] = tau
    return six_from_coefficients(coefficients)


def frames(pattern, six, noise=0.0, seed=0, radius=RADIUS):
    motion = synth.Affine.from_six(tuple(six), centre=(radius, radius))
    made = synth.pair(pattern, motion, (2 * radius + 1,) * 2, sensor=synth.Sensor(noise=noise, seed=seed))
    return made.frame0, made.frame1


def neighbourhoods(frame0, frame1, x=AT, y=AT):
    return Neighbourhoods(Spline(frame0), Spline(frame1), np.array(x, float), np.array(y, float), SIGMA)


def assert_right(found, six):
    error = np.abs(found.six - six)
    assert (error[:, :2] < 0.1).all()
    assert (error[:, 2:] < 0.01).all()
    assert found.converged.all()


class TestGroupCorrelation:
    @pytest.mark.parametrize("pair", PAIRS, ids=" ".join)
    def test_is_the_zero_normalised_correlation_after_the_motion(self, pair):
        near = neighbourhoods(*frames(synth.Speckle(), np.zeros(6)))
        known = six_from_coefficients([[1.0, 2.0, 0.05, 0.1, 0.03, -0.02]])
        group = GroupCorrelation.of(pair, WINDOW)
        surface = group.surface(near, known)[0]
        offsets, w = [part.ravel() for part in group.offsets], group.weight.ravel()
        for row, column in np.random.default_rng(0).integers(surface.shape, size=(5, 2)):
            coefficients = np.zeros(6)
            coefficients[group.coordinates.first.index] = group.tau[0][row]
            coefficients[group.coordinates.second.index] = group.tau[1][column]
            F = np.eye(2) + _gradient(six_from_coefficients(coefficients))
            o = F @ np.array(offsets) + coefficients[:2, None]
            still, _ = near.frame0.at(near.x, near.y, np.zeros((1, 6)), tuple(offsets), 3)
            moved, _ = near.frame1.at(near.x, near.y, known, (o[0], o[1]), 3)
            assert surface[row, column] == pytest.approx(_correlation(still[0], moved[0], w), abs=1e-9)

    @pytest.mark.parametrize("name", SIX)
    def test_a_summit_is_next_to_the_motion(self, name):
        six = six_of(name, LARGE[name])
        near = neighbourhoods(*frames(synth.Speckle(), six))
        found = of_pairs(near, tuple(GroupCorrelation.of(pair, WINDOW) for pair in PAIRS), 1)
        # half a sample of both coordinates: 1 px for the shift, 1/(2σ) over the window's rms radius √2 σ
        nearest = size_of(found.six - six, SIGMA).min()
        assert nearest < 1.0

    def test_turns_of_any_angle(self):
        group = GroupCorrelation.of(("L_s", "L_r"), WINDOW)
        step = np.diff(np.sort(group.tau[1]))
        np.testing.assert_allclose(step, 2 * np.pi / step.size, rtol=0.02)
        assert step.sum() + step[0] == pytest.approx(2 * np.pi)

    def test_no_contrast(self):
        near = neighbourhoods(*frames(synth.Speckle(contrast=0), np.zeros(6)))
        for pair in PAIRS:
            group = GroupCorrelation.of(pair, WINDOW)
            surface = group.surface(near, np.zeros((1, 6)))
            assert np.isfinite(surface).all()
            assert group.summits(surface, 3).shape == (1, 3, 6)


class TestNeighbourhoods:
    def test_a_frame_matches_itself_in_any_light(self):
        frame, _ = frames(synth.Speckle(), np.zeros(6))
        for gain, offset in ((1, 0), (0.5, 50), (2, -50)):
            seen = neighbourhoods(frame, gain * frame + offset).warped(np.array([0]), np.zeros((1, 6)), 27, 5)
            assert seen.correlation[0] == pytest.approx(1)
            assert seen.weight[0] == pytest.approx(1)
        assert neighbourhoods(frame, -frame).warped(np.array([0]), np.zeros((1, 6)), 27, 5).correlation[
            0
        ] == pytest.approx(-1)

    def test_the_true_map_undoes_the_motion(self):
        six = six_from_coefficients(ALL)
        seen = neighbourhoods(*frames(synth.Texture(), six)).warped(np.array([0]), six[None], 27, 5)
        # a quintic spline keeps a wave of 6 px, the shortest of the texture, to 3·10⁻³ of its amplitude
        assert np.sqrt(np.mean((seen.still - seen.moved) ** 2)) < 3e-3 * 35
        assert seen.correlation[0] > 1 - 3e-5

    def test_pixels_without_a_partner_are_not_counted(self):
        frame, _ = frames(synth.Speckle(), np.zeros(6))
        shift = np.array([[50.0, 0, 0, 0, 0, 0]])
        seen = neighbourhoods(frame, 2 * frame + 10).warped(np.array([0]), shift, 27, 5)
        counted = seen.counted[0].reshape(55, 55)
        assert counted[:, :41].all()  # up to x = 14, where x + 64 + 50 is the last column
        assert not counted[:, 42:].any()
        w = np.exp(-(np.arange(-27, 28) ** 2) / (2 * SIGMA**2))
        assert seen.weight[0] == pytest.approx(w[:42].sum() / w.sum())

    def test_details_of_white_noise_are_its_pixels(self):
        noise = np.random.default_rng(0).normal(size=(257, 257))
        x, y = (c.ravel() for c in np.meshgrid(np.arange(40, 220, 35), np.arange(40, 220, 35)))
        found = neighbourhoods(noise, noise, x, y).details(27)
        assert found.mean() == pytest.approx(WINDOW**2, rel=0.1)

    @pytest.mark.parametrize("texture", ["speckle", "texture"])
    def test_details_tell_what_chance_correlates(self, texture):
        (frame0, _), (frame1, _) = (
            frames(TEXTURES[texture](seed), np.zeros(6), radius=256) for seed in (1, 2)
        )
        x, y = (c.ravel() for c in np.meshgrid(np.arange(40, 480, 33), np.arange(40, 480, 33)))
        near = neighbourhoods(frame0, frame1, x, y)
        rho = near.warped(np.arange(x.size), np.zeros((x.size, 6)), 27, 5).correlation
        # 64 squares of normal numbers: their mean is known to √(2/64) = 0.18; N itself to some 20 %
        assert np.mean(rho**2) * near.details(27).mean() == pytest.approx(1, abs=0.6)


class TestLargeMotions:
    @pytest.mark.parametrize(("name", "texture"), list(zip(SIX, 2 * list(TEXTURES), strict=True)))
    def test_each_generator_alone(self, name, texture):
        six = six_of(name, LARGE[name])
        assert_right(capture(*frames(TEXTURES[texture](3), six), AT, AT), six)

    @pytest.mark.parametrize("texture", TEXTURES)
    def test_all_at_once(self, texture):
        six = six_from_coefficients(ALL)
        assert_right(capture(*frames(TEXTURES[texture](4), six), AT, AT), six)

    def test_where_it_came_from(self):
        for name, origin in (("u", "L_x, L_y"), ("curl", "L_s, L_r")):
            found = capture(*frames(synth.Speckle(), six_of(name, LARGE[name])), AT, AT)
            assert found.origin[0] == origin
            assert found.iterations[0] >= 2

    def test_no_motion(self):
        frame, _ = frames(synth.Speckle(), np.zeros(6))
        found = capture(frame, frame, AT, AT)
        np.testing.assert_allclose(found.six, 0, atol=1e-9)
        assert found.origin[0] == "no motion"
        assert found.correlation[0] == pytest.approx(1)

    def test_another_window(self):
        six = six_of("curl", -0.4)
        assert_right(capture(*frames(synth.Speckle(), six), AT, AT, window=24), six)

    def test_light(self):
        six = six_of("curl", 0.5)
        frame0, frame1 = frames(synth.Speckle(), six)
        assert_right(capture(frame0, 1.5 * frame1 - 30, AT, AT), six)

    def test_near_the_border(self):
        """Operators beyond the border are left out; the map is right all the same."""
        six = six_of("u", -9.0)
        frame0, frame1 = frames(synth.Speckle(), six)
        assert_right(capture(frame0, frame1, [30], AT), six)

    def test_grey_scale_does_not_matter(self):
        frame0, frame1 = frames(synth.Speckle(), six_of("curl", 0.5))
        one, other = (capture(scale * frame0, scale * frame1, AT, AT) for scale in (1.0, 1e200))
        np.testing.assert_allclose(one.six, other.six, atol=1e-6)

    def test_points_do_not_depend_on_each_other(self):
        frame0, frame1 = frames(synth.Speckle(), six_from_coefficients(ALL))
        x, y = np.array([64, 50]), np.array([64, 60])
        together = capture(frame0, frame1, x, y)
        for k in range(2):
            alone = capture(frame0, frame1, x[k : k + 1], y[k : k + 1])
            np.testing.assert_allclose(alone.six[0], together.six[k], atol=1e-6)
            assert alone.origin[0] == together.origin[k]

    def test_no_points(self):
        frame, _ = frames(synth.Speckle(), np.zeros(6))
        found = capture(frame, frame, [], [])
        assert found.six.shape == (0, 6)
        assert found.converged.shape == (0,)


@functools.cache
def noisy():
    """A large motion at 12 dB, and its errors, at points that share few pixels."""
    six = six_from_coefficients(ALL)
    motion = synth.Affine.from_six(tuple(six), centre=(128, 128))
    made = synth.pair(synth.Speckle(seed=5), motion, (257, 257), sensor=synth.Sensor(noise=35 / 4, seed=1))
    x, y = (c.ravel() for c in np.meshgrid([98, 128, 158], [98, 128, 158]))
    found = capture(made.frame0, made.frame1, x, y)
    return found, found.six - made.truth(x.astype(float), y.astype(float))


class TestJudgement:
    def test_noise_is_survived(self):
        found, error = noisy()
        assert found.converged.all()
        # P/(P + n) with n = P/16
        assert np.median(found.correlation) == pytest.approx(16 / 17, abs=0.02)
        assert (np.abs(error) < 6 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))).all()

    def test_covariance_covers(self):
        found, error = noisy()
        ratio = error / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
        # 9 points × 6 numbers, those of a point correlated: about 30 free ones, ±13 % for one σ of the rms
        assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1, abs=0.4)

    @pytest.mark.parametrize("texture", TEXTURES)
    def test_unrelated_frames_are_not_believed(self, texture):
        (frame0, _), (frame1, _) = (frames(TEXTURES[texture](seed), np.zeros(6)) for seed in (10, 20))
        found = capture(frame0, frame1, AT, AT)
        assert not found.converged[0]
        assert found.correlation[0] < 0.8

    @pytest.mark.parametrize("pattern", [synth.Plaid(wavelengths=(9, 9)), synth.Grating(wavelength=9)])
    def test_a_repeating_pattern_is_not_believed(self, pattern):
        frame, _ = frames(pattern, np.zeros(6))
        found = capture(frame, frame, AT, AT)
        assert not found.converged[0]
        assert found.rival[0] == pytest.approx(1, abs=1e-3)

    def test_no_texture(self):
        flat = np.full((97, 97), 7.0)
        speckle, _ = frames(synth.Speckle(), np.zeros(6), radius=48)
        for pair in ((flat, flat), (flat, speckle), (speckle, flat)):
            found = capture(*pair, [48], [48])
            assert not found.converged[0]
            assert found.correlation[0] == -1

    def test_what_has_left_the_frame_is_not_believed(self):
        frame0, frame1 = frames(synth.Speckle(), six_of("u", 25.0))
        assert not capture(frame0, frame1, [120], AT).converged[0]


class TestPatches:
    def test_noise_does_not_shrink_the_motion(self):
        """As much noise as signal in the gradients: Γ of `pooled` is half of the normal matrix."""
        motion = synth.Affine.translation(0.3, -0.2)
        made = synth.pair(synth.Speckle(seed=3), motion, (257, 257), sensor=synth.Sensor(noise=35 / 2))
        x, y = (c.ravel() for c in np.meshgrid(np.arange(48, 220, 40), np.arange(48, 220, 40)))
        found = PooledOperator(WINDOW).estimate(made.frame0, made.frame1, x, y)
        error = found.six[:, :2] - [0.3, -0.2]
        spread = np.sqrt(np.mean(np.diagonal(found.covariance, axis1=1, axis2=2)[:, :2], axis=0) / len(x))
        assert (np.abs(error.mean(axis=0)) < 4 * spread).all()
        assert (4 * spread < 0.12).all()  # without Γ u is 0.15

    def test_the_same_as_points_of_a_frame(self):
        frame0, frame1 = frames(synth.Speckle(), six_from_coefficients(ALL / 100), noise=1)
        x, y = np.array([60, 64]), np.array([64, 58])
        joint = JointOperator(default_bank(21))
        [(_, stacks)] = patch_blocks((frame0, frame1), x, y, joint.bank.radius)
        direct, by_patch = joint.estimate(frame0, frame1, x, y), joint.estimate_patches(*stacks)
        np.testing.assert_allclose(by_patch.six, direct.six, atol=1e-5)
        array = PooledOperator(21)
        [(_, stacks)] = patch_blocks((frame0, frame1), x, y, array.reach)
        direct = array.estimate(frame0, frame1, x, y)
        by_patch = array.estimate_patches(*stacks, np.ones(stacks[0].shape, dtype=bool))
        np.testing.assert_allclose(by_patch.six, direct.six, atol=1e-9)
        np.testing.assert_allclose(by_patch.covariance, direct.covariance, rtol=1e-6)

    def test_pixels_that_are_not_counted(self):
        array = PooledOperator(21)
        side = 2 * array.reach + 1
        frame0, frame1 = (f.reshape(1, -1) for f in frames(synth.Speckle(), ALL / 1000, radius=array.reach))
        counted = np.ones((side, side), dtype=bool)
        counted[:, -8:] = False
        spoilt = np.where(counted.ravel(), frame1, 0.0)
        found = array.estimate_patches(frame0, spoilt, counted.reshape(1, -1))
        np.testing.assert_allclose(
            found.six, array.estimate_patches(frame0, frame1, counted.reshape(1, -1)).six
        )
        assert np.isnan(array.estimate_patches(frame0, frame1, np.zeros_like(frame0, dtype=bool)).six).all()

    def test_wrong_shapes(self):
        joint, array = JointOperator(default_bank(21)), PooledOperator(21)
        with pytest.raises(InputError, match="patches of"):
            joint.estimate_patches(np.zeros((2, 9)), np.zeros((2, 9)))
        with pytest.raises(InputError, match="patches of"):
            array.estimate_patches(np.zeros((2, 9)), np.zeros((2, 9)), np.ones((2, 9), dtype=bool))


class TestInput:
    FRAME = np.random.default_rng(0).normal(size=(64, 70))

    @pytest.mark.parametrize(
        ("frame1", "x", "y", "options", "message"),
        [
            (FRAME[:60], [30], [30], {}, "frame1 has shape"),
            (FRAME, [30.5], [30], {}, r"x\[0\]=30.5"),
            (FRAME, [30], [64], {}, r"y\[0\]=64"),
            (FRAME, [30, 31], [30], {}, "as many"),
            (FRAME, [30], [30], {"window": 9}, "window=9"),
            (FRAME, [30], [30], {"window": 65}, "smaller than window"),
            (FRAME, [30], [30], {"window": math.nan}, "window=nan"),
            (np.where(FRAME > 2, np.nan, FRAME), [30], [30], {}, "frame1 has .* not finite"),
            (FRAME * 1j, [30], [30], {}, "frame1 has dtype"),
        ],
    )
    def test_refused(self, frame1, x, y, options, message):
        with pytest.raises(InputError, match=message):
            capture(self.FRAME, frame1, x, y, **options)


def _gradient(six):
    _, _, divergence, curl, stretch, shear = six
    return np.array([[divergence + stretch, shear - curl], [shear + curl, divergence - stretch]]) / 2


def _correlation(a, b, w):
    a, b = a - (w * a).sum() / w.sum(), b - (w * b).sum() / w.sum()
    return (w * a * b).sum() / math.sqrt((w * a * a).sum() * (w * b * b).sum())
