"""Each operator alone: sign and size on all six generators, range, errors, stability, velocities, and families."""

import itertools

import numpy as np
import pytest

from sixflow import InputError, synth
from sixflow.convention import GENERATOR_NAMES, six_from_coefficients
from sixflow.eigenfilters import FilterBank, Gabor, Hyperbolic, LiteralOperator, Spiral, default_bank
from sixflow.eigenfilters.combination import combine_phases

OPERATORS = {  # the wave is resolved, and the window has fallen to nothing at the edge of the patch
    "L_x": (Gabor(0.7, 0.0, sigma=7.0), 28),
    "L_y": (Gabor(0.7, np.pi / 2, sigma=7.0), 28),
    "L_s": (Spiral(9.0, 0, scale=13.0, bandwidth=0.35), 44),
    "L_r": (Spiral(0.0, 5, scale=11.0, bandwidth=0.3), 31),
    "L_b": (Hyperbolic("stretch", 9.0, scale=13.0, bandwidth=0.35, width=0.3), 44),
    "L_B": (Hyperbolic("shear", 9.0, scale=13.0, bandwidth=0.35, width=0.3), 44),
}
ORDERS = {"L_x": 0.7, "L_y": 0.7, "L_s": 9.0, "L_r": 5.0, "L_b": 9.0, "L_B": 9.0}


def index(name):
    return GENERATOR_NAMES.index(name)


def moved(pattern, tau, radius):
    """The frame of a pattern moved by coefficients of the six generators about the middle of the patch."""
    motion = synth.Affine.from_six(tuple(six_from_coefficients(tau)), centre=(radius, radius))
    return synth.render(pattern, (2 * radius + 1,) * 2, motion)


def along(name, size):
    tau = np.zeros(6)
    tau[index(name)] = size
    return tau


def read(name, size, seed=0, **settings):
    """One operator on one pattern that moves along its generator by τ = size."""
    kernel, radius = OPERATORS[name]
    pattern = synth.Texture(seed=seed)
    operator = LiteralOperator(kernel, radius=radius, **{"noise": 0, **settings})
    frames = (moved(pattern, along(name, part), radius) for part in (0.0, size))
    return operator.estimate(*frames, [radius], [radius])


class TestLaw:
    @pytest.mark.parametrize("part", [0.1, -0.1])
    @pytest.mark.parametrize("name", GENERATOR_NAMES)
    def test_sign_and_size_on_every_generator(self, name, part):
        """Part of the range π/u. Over the order: right to the departure. Over the frequency: a trapezoid of ν."""
        tau = part * np.pi / ORDERS[name]
        kernel, radius = OPERATORS[name]
        h, w = kernel.derivative(name, radius), kernel.sample(radius)
        spread = np.linalg.norm(h + 1j * ORDERS[name] * w)  # of ν about u, on white noise
        stable = 0
        for seed in range(6):
            found = read(name, tau, seed)
            assert found.tau.shape == found.frequency.shape == (1, 1, 6)
            if not found.stable[0, 0]:
                continue
            stable += 1
            at = (0, 0, index(name))
            assert abs(found.tau[at] - tau) < (0.35 + tau * spread) * abs(tau)
            # truncation of the trapezoid (τβ)²/12, some more where ν is steep, and of the patch
            assert abs(found.tau_by_frequency[at] - tau) < ((tau * spread) ** 2 + 2e-3) * abs(tau)
        assert stable >= 3

    @pytest.mark.parametrize("order", [5, -5])
    def test_curl_is_exact_up_to_the_end_of_its_range(self, order):
        pattern, radius = synth.Speckle(seed=4), 31
        operator = LiteralOperator(Spiral(0.0, order, scale=11.0, bandwidth=0.3), radius=radius, noise=0)
        still = moved(pattern, np.zeros(6), radius)
        for part in (-0.97, -0.5, 0.01, 0.3, 0.97):
            tau = part * np.pi / 5
            found = operator.estimate(still, moved(pattern, along("L_r", tau), radius), [radius], [radius])
            assert found.tau[0, 0, 3] == pytest.approx(tau, abs=1e-4)
            assert found.tau_by_frequency[0, 0, 3] == pytest.approx(tau, abs=1e-4)
            assert found.frequency[0, 0, 3] == pytest.approx(order, rel=1e-4)
            assert found.amplitude_ratio[0, 0] == pytest.approx(1, rel=1e-3)
            assert found.stable[0, 0]

    def test_beyond_its_range_the_phase_wraps(self):
        found = read("L_r", 1.03 * np.pi / 5)
        assert found.tau[0, 0, 3] == pytest.approx(-0.97 * np.pi / 5, abs=1e-4)
        half_turn = read("L_x", 0.0)
        assert half_turn.phase[0, 0] == 0

    def test_half_a_turn_is_plus_pi(self):
        """(−π, π]: a negative is a shift by half a period whose sign nobody knows."""
        frame = moved(synth.Speckle(), np.zeros(6), 28)
        for first, second in ((frame, -frame), (-frame, frame)):
            phase = (
                LiteralOperator(*OPERATORS["L_x"][:1], radius=28).estimate(first, second, [28], [28]).phase
            )
            assert phase[0, 0] == np.pi

    def test_frequency_is_the_derivative_of_the_phase(self):
        step = 1e-4
        for name in GENERATOR_NAMES:
            found = read(name, step, seed=2)
            at = (0, 0, index(name))
            assert found.frequency[at] == pytest.approx(-found.phase[0, 0] / step, rel=5e-3)
        pair = LiteralOperator(Spiral(3.0, 2, scale=9.0), radius=28)
        frame = moved(synth.Speckle(), np.zeros(6), 28)
        known = np.isfinite(pair.estimate(frame, frame, [28], [28]).frequency[0, 0])
        np.testing.assert_array_equal(known, [False, False, True, True, False, False])

    def test_orders_that_are_nothing_but_rounding_are_none(self):
        found = read("L_y", 0.3)
        np.testing.assert_array_equal(np.isfinite(found.tau[0, 0]), np.arange(6) == 1)
        np.testing.assert_array_equal(found.orders, [[0, 0.7, 0, 0, 0, 0]])

    def test_light_does_not_turn_the_phase(self):
        kernel, radius = OPERATORS["L_b"]
        frames = [moved(synth.Speckle(), along("L_b", size), radius) for size in (0, 0.02)]
        operator = LiteralOperator(kernel, radius=radius)
        plain = operator.estimate(*frames, [radius], [radius])
        lit = operator.estimate(frames[0], 2 * frames[1] + 40, [radius], [radius])
        assert lit.phase[0, 0] == pytest.approx(plain.phase[0, 0], abs=1e-9)
        assert lit.amplitude_ratio[0, 0] == pytest.approx(2 * plain.amplitude_ratio[0, 0], rel=1e-9)


MIXED = FilterBank(
    (
        *(Gabor(0.7, k * np.pi / 4, sigma=6.0) for k in range(4)),
        *(Gabor(0.8, k * np.pi / 4 + 0.1, sigma=6.0) for k in range(4)),
        *(Spiral(sign * 6.0, 3, scale=11.0, bandwidth=0.35) for sign in (1, -1)),
        Spiral(0.0, 4, scale=11.0, bandwidth=0.35),
        Hyperbolic("stretch", 6.0, scale=11.0, bandwidth=0.35),
    ),
    28,
)


def points(side, radius, step=12):
    axis = np.arange(radius, side - radius, step)
    x, y = np.meshgrid(axis, axis)
    return x.ravel(), y.ravel()


class TestErrors:
    def test_noise_spreads_readings_as_predicted(self):
        """Standard errors of every operator and of the families, by 40 draws of noise at 49 points."""
        pattern, side, noise, draws = synth.Texture(seed=1), 140, 1.0, 40
        frames = [
            synth.render(pattern, (side, side), synth.Affine.translation(*shift))
            for shift in ((0, 0), (0.6, -0.4))
        ]
        x, y = points(side, 28)
        operator = LiteralOperator(MIXED, noise=noise, least_amplitude=20)
        exact = operator.estimate(*frames, x, y)
        means = exact.combine()
        rng = np.random.default_rng(8)
        errors, spread = [], []
        for _ in range(draws):
            found = operator.estimate(*(f + rng.normal(0, noise, f.shape) for f in frames), x, y)
            errors.append((found.tau - exact.tau) / exact.standard_error)
            # the weights of the exact frames, so that no point changes its operators
            weight = np.where(exact.stable, exact.amplitude**2, 0)
            rates = np.broadcast_to(exact.orders, exact.tau.shape)
            tau = combine_phases(
                rates, found.phase, weight, exact.sensitivity, MIXED.real_noise_covariance
            ).tau
            spread.append((tau - means.tau) / means.standard_error)
        z = np.array(errors)[:, exact.stable][..., [0, 1, 2, 3, 4]]
        independent = draws * len(x) / 4  # points 12 px apart share half of their noise
        assert np.nanstd(z) == pytest.approx(1, abs=4 / np.sqrt(2 * independent))
        combined = np.array(spread).reshape(-1, 6)[:, :5]
        for k in range(5):
            assert np.nanstd(combined[:, k]) == pytest.approx(1, abs=4 / np.sqrt(2 * independent))

    def test_standard_error_is_noise_over_amplitude_and_order(self):
        found = read("L_s", 0.02, noise=3.0)
        wanted = 3.0 / (found.amplitude[0, 0] * 9.0)
        assert found.standard_error[0, 0, 2] == pytest.approx(wanted, rel=0.05)
        assert read("L_s", 0.02, noise=0).standard_error[0, 0, 2] == 0

    def test_stability(self):
        radius = 28
        pattern = synth.Speckle(seed=3)
        frame = synth.render(pattern, (140, 140))
        x, y = points(140, radius, 6)
        sure = LiteralOperator(MIXED, noise=1.0).estimate(frame, frame, x, y)
        away = np.where(sure.orders != 0, np.abs(sure.frequency - sure.orders), 0)
        size = np.linalg.norm(sure.orders, axis=1)
        assert (away / size[:, None])[sure.stable].max() <= 0.35
        assert 0.2 < sure.stable.mean() < 0.95
        strict = LiteralOperator(MIXED, noise=1.0, departure=0.1).estimate(frame, frame, x, y)
        assert not (strict.stable & ~sure.stable).any()
        assert strict.stable.sum() < sure.stable.sum()
        faint = LiteralOperator(MIXED, noise=10.0).estimate(frame, frame, x, y)
        np.testing.assert_array_equal(faint.stable, sure.stable & (sure.amplitude >= 40.0))
        # rotation turns windows of r into themselves: the curl operator is stable wherever it answers
        assert sure.stable[:, 10].all()

    def test_nothing_to_see_is_not_stable(self):
        flat = np.full((70, 70), 123.4)
        for noise in (0, 1):
            found = LiteralOperator(MIXED, noise=noise).estimate(flat, flat, [35], [35])
            assert not found.stable.any()
            assert np.isnan(found.combine().tau).all()
        zero = LiteralOperator(MIXED).estimate(0 * flat, 0 * flat, [35], [35])
        assert not zero.stable.any()
        assert np.isnan(zero.tau).all()


class TestFamilies:
    def test_one_order_each_is_the_weighted_mean(self):
        bank = FilterBank(tuple(Spiral(0.0, v, scale=11.0, bandwidth=0.3) for v in (2, 3, 5)), 31)
        pattern = synth.Speckle(seed=6)
        shift = np.array([0.3, -0.2, 0.004, 0.02, 0.003, 0.001])
        frames = (moved(pattern, part * shift, 31) for part in (0, 1))
        found = LiteralOperator(bank).estimate(*frames, [31], [31])
        weight = found.amplitude[0] ** 2 * found.orders[:, 3] ** 2 * found.stable[0]
        combined = found.combine()
        assert combined.tau[0, 3] == pytest.approx((weight * found.tau[0, :, 3]).sum() / weight.sum())
        assert combined.operators[0].tolist() == [0, 0, 0, 3, 0, 0]
        assert np.isnan(np.delete(combined.tau[0], 3)).all()
        assert np.isnan(np.delete(combined.standard_error[0], 3)).all()

    @pytest.mark.parametrize("by", ["order", "frequency"])
    def test_least_squares_separates_the_two_of_a_pair(self, by):
        """A zoom and a turn at once, seen by (u, v) and (−u, v); naive normal equations as the twin."""
        bank = FilterBank(
            tuple(Spiral(sign * 9.0, v, scale=13.0, bandwidth=0.35) for v in (2, 4) for sign in (1, -1)), 44
        )
        tau = along("L_s", 0.02) + along("L_r", -0.05)
        worst = []
        for seed in range(3):
            frames = (moved(synth.Texture(seed=seed), part * tau, 44) for part in (0, 1))
            found = LiteralOperator(bank, noise=0, departure=1).estimate(*frames, [44], [44])
            combined = found.combine(by)
            rates = found.orders if by == "order" else found.frequency[0]
            use = found.stable[0]
            A, b, w = rates[use][:, 2:4], -found.phase[0, use], found.amplitude[0, use]
            twin = np.linalg.lstsq(A * w[:, None], b * w, rcond=None)[0]
            np.testing.assert_allclose(combined.tau[0, 2:4], twin, rtol=1e-9)
            worst.append(np.abs(combined.tau[0, 2:4] - tau[2:4]))
        # by frequency to second order; by order the curl is exact but for what the zoom does to it
        limit = (2e-4, 1e-4) if by == "frequency" else (0.35 * 0.02, 0.35 * 0.02 * 9 / 2)
        assert (np.max(worst, axis=0) < limit).all()

    def test_what_cannot_be_separated_is_unknown(self):
        found = LiteralOperator(Spiral(5.0, 3, scale=11.0, bandwidth=0.35), radius=35, departure=10).estimate(
            *(moved(synth.Speckle(), along("L_r", size), 35) for size in (0, 0.1)), [35], [35]
        )
        assert found.stable.all()
        assert np.isfinite(found.tau[0, 0, 2:4]).all()  # each as if the other were 0
        combined = found.combine()
        assert np.isnan(combined.tau).all()
        assert combined.operators[0].tolist() == [0, 0, 1, 1, 0, 0]

    def test_all_six_of_the_default_bank(self):
        pattern, tau = synth.Speckle(seed=2), np.array([0.05, -0.04, 0.004, 0.006, -0.003, 0.002])
        frames = [moved(pattern, part * tau, 35) for part in (0, 1)]
        combined = LiteralOperator(default_bank(31), departure=1).estimate(*frames, [35], [35]).combine()
        assert np.isfinite(combined.tau).all()
        # each family sees the others as an error of their size: 0.06 px, or 0.06/8.7
        assert (np.abs(combined.tau - tau)[0] < [0.06, 0.06, 0.014, 0.014, 0.014, 0.014]).all()
        np.testing.assert_allclose(
            combined.standard_error**2, np.diagonal(combined.covariance, axis1=1, axis2=2)
        )


RATE, FRAMES = 0.03, 7


@pytest.fixture(scope="module")
def frames():
    """A steady rotation."""
    return [moved(synth.Speckle(seed=4), along("L_r", RATE * t), 31) for t in range(FRAMES)]


class TestVelocity:
    @pytest.mark.parametrize("kind", ["centred", "causal"])
    def test_steady_rotation(self, frames, kind):
        """A straight line fitted to exp(−iωt): ω n²/10 of the second order and less."""
        operator = LiteralOperator(Spiral(0.0, 3, scale=11.0, bandwidth=0.3), radius=31)
        for count in (2, 3, FRAMES):
            found = operator.velocity(frames[:count], [31], [31], kind)
            limit = (3 * RATE * count) ** 2
            assert found.tau[0, 0, 3] == pytest.approx(RATE, rel=limit)
            assert np.sign(found.phase[0, 0]) == -1

    def test_two_frames(self, frames):
        operator = LiteralOperator(Spiral(0.0, 4, scale=11.0, bandwidth=0.3), radius=31)
        pair = operator.estimate(*frames[:2], [31], [31])
        line = operator.velocity(frames[:2], [31], [31])
        assert line.phase[0, 0] == pytest.approx(2 * np.tan(pair.phase[0, 0] / 2), rel=1e-6)
        assert line.standard_error[0, 0, 3] == pytest.approx(pair.standard_error[0, 0, 3], rel=0.01)

    @pytest.mark.parametrize("kind", ["centred", "causal"])
    def test_noise(self, frames, kind):
        operator = LiteralOperator(Spiral(0.0, 4, scale=11.0, bandwidth=0.3), radius=31, noise=2)
        exact = operator.velocity(frames, [31], [31], kind)
        rng, draws, found = np.random.default_rng(2), 300, []
        for _ in range(draws):
            noisy = [frame + rng.normal(0, 2, frame.shape) for frame in frames]
            found.append(operator.velocity(noisy, [31], [31], kind).tau[0, 0, 3])
        ratio = np.std(found) / exact.standard_error[0, 0, 3]
        assert ratio == pytest.approx(1, abs=4 / np.sqrt(2 * draws))
        assert exact.combine().standard_error[0, 3] == pytest.approx(exact.standard_error[0, 0, 3])

    def test_more_frames_have_less_noise(self, frames):
        """Σb² = 12/(n(n² − 1))."""
        operator = LiteralOperator(Spiral(0.0, 2, scale=11.0, bandwidth=0.3), radius=31)
        errors = [operator.velocity(frames[:n], [31], [31]).standard_error[0, 0, 3] for n in (2, 7)]
        assert errors[0] / errors[1] == pytest.approx(np.sqrt(7 * 48 / (2 * 3)), rel=0.05)

    @pytest.mark.parametrize("name", GENERATOR_NAMES)
    def test_every_generator(self, name):
        kernel, radius = OPERATORS[name]
        step = 0.02 * np.pi / ORDERS[name]
        pattern = synth.Texture(seed=3)
        frames = [moved(pattern, along(name, step * t), radius) for t in (-1, 0, 1)]
        found = LiteralOperator(kernel, radius=radius).velocity(frames, [radius], [radius])
        assert found.tau_by_frequency[0, 0, index(name)] == pytest.approx(step, rel=0.02)


class TestRefusals:
    KERNEL = Gabor(0.7, sigma=6.0)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"bank": KERNEL}, "radius=None: a single kernel needs the radius of its patch"),
            ({"bank": KERNEL, "radius": 0}, "radius=0: must be a whole number"),
            ({"bank": MIXED, "radius": 5}, "radius=5: the bank has its own, 28"),
            ({"bank": "gabor"}, "bank='gabor': must be a FilterBank"),
            ({"bank": MIXED, "noise": -1}, "noise=-1: must be a finite number of grey values of at least 0"),
            ({"bank": MIXED, "noise": np.nan}, "noise=nan"),
            ({"bank": MIXED, "least_amplitude": -1}, "least_amplitude=-1"),
            ({"bank": MIXED, "departure": 0}, "departure=0: must be a finite number above 0"),
        ],
    )
    def test_operator(self, arguments, message):
        with pytest.raises(InputError, match=message):
            LiteralOperator(**arguments)

    def test_frames(self):
        operator, frame = (
            LiteralOperator(self.KERNEL, radius=20),
            np.random.default_rng(0).normal(size=(64, 64)),
        )
        with pytest.raises(InputError, match=r"frame 1 has shape \(60, 64\)"):
            operator.estimate(frame, frame[:60], [30], [30])
        with pytest.raises(InputError, match="frame1 has 4096 pixels that are not finite"):
            operator.estimate(frame, frame * np.nan, [30], [30])
        with pytest.raises(InputError, match="patch of 41 × 41 px is larger than the frame"):
            operator.estimate(frame[:40], frame[:40], [30], [30])
        with pytest.raises(InputError, match=r"x\[0\]=64"):
            operator.estimate(frame, frame, [64], [0])
        with pytest.raises(InputError, match="frames=1: must be a whole number from 2"):
            operator.velocity([frame], [30], [30])
        with pytest.raises(InputError, match=r"frames\[2\] has shape \(64, 60\)"):
            operator.velocity([frame, frame, frame[:, :60]], [30], [30])
        with pytest.raises(InputError, match="kind='late'"):
            operator.velocity([frame, frame], [30], [30], "late")
        with pytest.raises(InputError, match="by='phase': must be 'order' or 'frequency'"):
            operator.estimate(frame, frame, [30], [30]).combine("phase")


def test_points_come_in_blocks(monkeypatch):
    """What a block holds does not depend on the others."""
    from sixflow.eigenfilters import patches

    frames = [synth.render(synth.Speckle(seed=s), (90, 90)) for s in (1, 2)]
    x, y = points(90, 28, 4)
    operator = LiteralOperator(MIXED)
    whole = operator.estimate(*frames, x, y)
    monkeypatch.setattr(patches, "BLOCK_BYTES", 8 * 57**2 * 10)
    parts = operator.estimate(*frames, x, y)
    for field in ("phase", "amplitude", "frequency", "standard_error", "tau"):
        np.testing.assert_allclose(getattr(parts, field), getattr(whole, field), rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(parts.stable, whole.stable)


def test_covariances_of_combinations_are_positive():
    """On any orders and weights: the sandwich is a covariance, and unknowns that nobody sees are NaN."""
    rng = np.random.default_rng(5)
    R = rng.normal(size=(10, 10))
    for zeros in itertools.combinations(range(6), 2):
        rates = rng.normal(size=(3, 5, 6))
        rates[..., zeros] = 0
        q = rng.normal(size=(2, 3, 5)) + 1j * rng.normal(size=(2, 3, 5))
        found = combine_phases(rates, rng.normal(size=(3, 5)), rng.uniform(0.1, 1, (3, 5)), q, R @ R.T)
        known = np.setdiff1d(np.arange(6), zeros)
        assert np.isnan(found.tau[:, zeros]).all()
        assert np.linalg.eigvalsh(found.covariance[:, known[:, None], known]).min() > 0
