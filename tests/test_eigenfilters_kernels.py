"""Kernels: normalisation, symmetry, their eigenvalue law, and derivatives against numerics and moved patterns."""

import numpy as np
import pytest

from sixflow.convention import GENERATOR_NAMES
from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.generators import as_generator
from sixflow.eigenfilters.geometry import patch
from sixflow.eigenfilters.kernels import Gabor, Hyperbolic, Spiral
from sixflow.eigenfilters.temporal import temporal_weights
from sixflow.errors import InputError
from sixflow.synth import Speckle

RADIUS = 40
KERNELS = [
    Gabor(0.5, 0.3, sigma=7.0),
    Gabor(0.25, -2.0, sigma=5.0),
    Gabor(0.6, 1.0, sigma=6.0, shape="equal-dc"),
    Spiral(4.0, 0, scale=14.0, sigma=9.0),
    Spiral(0.0, 5, scale=14.0, sigma=9.0),
    Spiral(-3.0, 3, scale=14.0, sigma=9.0, bandwidth=0.5),
    Spiral(3.0, 4, scale=12.0, bandwidth=0.3, jacobian=False),
    Hyperbolic("stretch", 6.0, scale=18.0, width=0.25, sigma=9.0),
    Hyperbolic("stretch", -2.0, 4.0, scale=16.0, width=0.25, sigma=9.0, signs=(1, 1, -1, -1)),
    Hyperbolic("shear", -6.0, scale=18.0, width=0.25, sigma=9.0, signs=(1, -1, 1, -1)),
    Hyperbolic("shear", 2.0, 5.0, scale=13.0, width=0.3, sigma=9.0, jacobian=False),
]
IDS = [kernel.label for kernel in KERNELS]
each_kernel = pytest.mark.parametrize("kernel", KERNELS, ids=IDS)
each_generator = pytest.mark.parametrize("generator", GENERATOR_NAMES)


@each_kernel
def test_unit_noise_gain_and_no_response_to_a_constant(kernel):
    w = kernel.sample(RADIUS)
    assert w.shape == (2 * RADIUS + 1,) * 2
    assert w.dtype == np.complex128
    assert (np.abs(w) ** 2).sum() == pytest.approx(1, abs=1e-12)
    if kernel.dc_free:
        assert abs(w.sum()) < 1e-13 * np.abs(w).sum()
    else:
        assert w.real.sum() == pytest.approx(w.imag.sum(), rel=1e-9)


def test_gain_is_that_of_white_noise():
    w = Gabor(0.5, 0.3, sigma=5.0).sample(20)
    noise = np.random.default_rng(0).standard_normal((4000, w.size))
    power = np.mean(np.abs(noise @ w.ravel()) ** 2)
    assert power == pytest.approx(1, abs=4 / np.sqrt(4000))


@pytest.mark.parametrize("kernel", KERNELS[:2], ids=IDS[:2])
def test_gabor_is_even_and_odd(kernel):
    w = kernel.sample(RADIUS)
    np.testing.assert_allclose(w[::-1, ::-1].real, w.real, atol=1e-15)
    np.testing.assert_allclose(w[::-1, ::-1].imag, -w.imag, atol=1e-15)


def test_equal_dc_pair_is_a_pair_of_mirror_images():
    kernel = Gabor(0.6, 0.4, sigma=5.0, shape="equal-dc")
    w = kernel.sample(30)
    np.testing.assert_allclose(w.real, w.imag[::-1, ::-1], atol=1e-15)
    x, y = patch(30)
    u, v = kernel.orders
    profile = np.exp(-(x**2 + y**2) / 50)
    cosine = (profile * np.cos(u * x + v * y + np.pi / 4)).reshape(w.shape)
    np.testing.assert_allclose(w.imag / w.imag.max(), cosine / cosine.max(), atol=1e-12)


def test_quadrature_under_the_reflection_that_reverses_the_coordinate():
    curl = Spiral(0.0, 5, scale=12.0).sample(RADIUS)
    np.testing.assert_allclose(curl[::-1], curl.conj(), atol=1e-13)
    stretch = Hyperbolic("stretch", 3.0, scale=14.0).sample(RADIUS)
    np.testing.assert_allclose(stretch.T, stretch.conj(), atol=1e-13)
    shear = Hyperbolic("shear", 3.0, scale=14.0).sample(RADIUS)
    np.testing.assert_allclose(shear[::-1], shear.conj(), atol=1e-13)
    for u, v in [(3.0, 2), (-2.5, 3)]:
        w, conjugate = (Spiral(s * u, s * v, scale=12.0).sample(RADIUS) for s in (1, -1))
        np.testing.assert_allclose(w.conj(), conjugate, atol=1e-13)


def test_spiral_is_the_formula_of_the_paper():
    x, y = patch(20)
    away = np.hypot(x, y) > 0
    r, angle = np.where(away, np.hypot(x, y), 1.0), np.arctan2(y, x)
    w = away * np.exp(-1j * (3 * np.log(r) + 2 * angle) - np.log(r / 8) ** 2 / (2 * 0.4**2)) / r**2
    w /= np.sqrt((np.abs(w) ** 2).sum())  # free of DC as it is, v being no multiple of 4
    np.testing.assert_allclose(Spiral(3.0, 2, scale=8.0).sample(20).ravel(), w, atol=1e-12)


def test_jacobian_of_a_log_gaussian_is_a_change_of_scale():
    plain = Spiral(3.0, 2, scale=8.0, bandwidth=0.3, jacobian=False).sample(25)
    scaled = Spiral(3.0, 2, scale=8.0 * np.exp(2 * 0.09), bandwidth=0.3).sample(25)
    np.testing.assert_allclose(scaled, plain, atol=1e-14)


def test_hyperbolic_vanishes_on_the_singular_axes_and_follows_its_signs():
    w = Hyperbolic("stretch", 3.0, scale=14.0, signs=(1, -1, -1, 1)).sample(RADIUS)
    assert not w[RADIUS].any()
    assert not w[:, RADIUS].any()
    plus, minus = w[RADIUS + 1 :, RADIUS + 1 :], w[RADIUS + 1 :, RADIUS - 1 :: -1]  # x, y > 0 and x < 0 < y
    np.testing.assert_allclose(minus, -plus, atol=1e-14)
    w = Hyperbolic("shear", 3.0, scale=14.0).sample(RADIUS)
    assert not np.diagonal(w).any()
    assert not np.diagonal(w[::-1]).any()


@each_kernel
def test_evaluate_equals_sample(kernel):
    x, y = patch(12)
    assert np.array_equal(kernel.evaluate(x, y, 12).reshape(25, 25), kernel.sample(12))


@each_generator
@each_kernel
def test_derivative_kernel_is_the_divergence_of_the_kernel_times_the_field(kernel, generator):
    L, step = as_generator(generator), 2e-3
    x, y = patch(RADIUS)
    keep = np.hypot(x, y) > 2  # closer to the singular point a numerical step is not small

    def flux(dx, dy):
        a_x, a_y = L.field(x + dx, y + dy)
        w = kernel.evaluate(x + dx, y + dy, RADIUS)
        return (a_x if dx else a_y) * w

    def slope(dx, dy):
        return (8 * (flux(dx, dy) - flux(-dx, -dy)) - flux(2 * dx, 2 * dy) + flux(-2 * dx, -2 * dy)) / (
            12 * step
        )

    numerical = slope(step, 0) + slope(0, step)
    given = kernel.derivative(generator, RADIUS).ravel()
    scale = np.abs(kernel.sample(RADIUS)).max() * np.hypot(*L.field(x, y)).max()
    difference = (given - numerical)[keep]
    if kernel.dc_free:  # what is left of a response to a constant was taken out along the envelope
        envelope = kernel._terms(x, y).envelope[keep]
        taken_out = envelope * (envelope @ difference) / (envelope @ envelope)
        assert np.abs(taken_out).max() < 1e-3 * scale
        difference -= taken_out
    assert np.abs(difference).max() < 1e-7 * scale
    if kernel.dc_free:
        assert abs(given.sum()) < 1e-12 * max(np.abs(given).sum(), scale)


@each_generator
@each_kernel
def test_derivative_of_the_response_to_a_moving_pattern(kernel, generator):
    """I1(exp(τL) x) = I0(x): I1 is I0 at the points that the flow comes from."""
    L, tau = as_generator(generator), 2e-4
    x, y = patch(RADIUS)
    w, h = kernel.sample(RADIUS).ravel(), kernel.derivative(generator, RADIUS).ravel()
    measured, predicted = [], []
    for seed in range(6):
        pattern = Speckle(sigma=2.5, seed=seed)
        later, sooner = (pattern(*L.flow(-sign * tau, x, y)) @ w for sign in (1, -1))
        measured.append((later - sooner) / (2 * tau))
        predicted.append(pattern(x, y) @ h)
    error = np.abs(np.array(measured) - predicted)
    # 1 % of the typical change under this motion; waves near the singular axes are not fully resolved
    typical = 35 * np.abs(w).max() * np.sqrt(np.mean(L.field(x, y)[0] ** 2 + L.field(x, y)[1] ** 2))
    assert error.max() < 0.01 * max(np.sqrt(np.mean(np.abs(predicted) ** 2)), typical)


@pytest.mark.parametrize("tau", [0.02, -0.05])
@each_kernel
def test_own_law(kernel, tau):
    """The response to the kernel's own wave, cos(uη + vξ + phase), turns by −uτ and −vτ.

    Of that cosine the kernel takes one half with a weight a, and of the conjugate half a little, b = εa:
    the turn is −uτ on average over phases, and within a factor (1 + ε)/(1 − ε) at each of them.
    """
    coordinates = canonical(*kernel.generators)
    (u, v), (x, y) = kernel.orders, patch(RADIUS)
    w = kernel.sample(RADIUS).ravel()
    keep = np.abs(w) > 0
    x, y, w = x[keep], y[keep], w[keep] * np.sign(kernel._signs(x[keep], y[keep]))

    def wave(L, tau):
        at_x, at_y = L.flow(-tau, x, y)  # of a sector, the flow never leaves it
        return u * coordinates.eta(at_x, at_y) + v * coordinates.xi(at_x, at_y)

    still = wave(as_generator("L_x"), 0.0)
    small = abs(np.exp(-1j * still) @ w) / abs(np.exp(1j * still) @ w)
    assert small < 0.25
    phases = np.arange(8) * np.pi / 8
    for name, order in zip(kernel.generators, (u, v), strict=True):
        L = as_generator(name)
        step = tau * (5.0 if name in ("L_x", "L_y") else 1.0)  # px
        moved = wave(L, step)
        turn = np.array(
            [np.angle(np.cos(moved + phase) @ w / (np.cos(still + phase) @ w)) for phase in phases]
        )
        size = abs(step * order)
        assert np.mean(turn) == pytest.approx(-order * step, abs=2 * small**4 * size + 1e-9)
        assert np.abs(turn + order * step).max() <= 2 * small / (1 - small) * size + 1e-9


@pytest.mark.parametrize("order", [2, 5])
def test_rotation_is_an_exact_law(order):
    """The window is a function of r alone: λ = exp(−ivτ) at any angle, for any pattern, up to the lattice."""
    kernel, L = Spiral(2.0, order, scale=14.0, sigma=9.0), as_generator("curl")
    x, y = patch(RADIUS)
    w, pattern = kernel.sample(RADIUS).ravel(), Speckle(sigma=2.5, seed=1)
    turned, still = pattern(*L.flow(-0.7, x, y)) @ w, pattern(x, y) @ w
    assert turned == pytest.approx(np.exp(-0.7j * order) * still, abs=2e-3 * abs(still))


@pytest.mark.parametrize("frames", [2, 3, 8])
@pytest.mark.parametrize("kind", ["centred", "causal"])
def test_temporal_weights_are_those_of_a_straight_line(frames, kind):
    times, value, derivative = temporal_weights(frames, kind)
    assert times[-1] == (0 if kind == "causal" else (frames - 1) / 2)
    line = 3.0 - 0.25 * times
    assert value @ line == pytest.approx(3.0, abs=1e-12)
    assert derivative @ line == pytest.approx(-0.25, abs=1e-12)
    assert (derivative**2).sum() == pytest.approx(12 / (frames * (frames**2 - 1)))


@pytest.mark.parametrize("kind", ["centred", "causal"])
def test_temporal_derivative_of_a_moving_pattern_is_its_phase_rate(kind):
    kernel = Gabor(0.4, 0.0, sigma=6.0)
    x, _ = patch(24)
    w = kernel.sample(24).ravel()
    times, value, derivative = temporal_weights(5, kind)
    g = np.array([np.cos(0.4 * (x - 0.1 * t)) @ w for t in times])
    assert np.imag((derivative @ g) / (value @ g)) == pytest.approx(-0.4 * 0.1, rel=0.02)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Gabor(0.0), r"frequency=0.0: must be .* rad/px"),
        (lambda: Gabor(4.0), r"frequency=4.0"),
        (lambda: Gabor(np.nan), r"frequency=nan"),
        (lambda: Gabor("fast"), r"frequency='fast'"),
        (lambda: Gabor(0.5, sigma=0.1), r"sigma=0.1: must be .* px of at least 0.5"),
        (lambda: Gabor(0.5, shape="even"), r"shape='even': must be 'quadrature' or 'equal-dc'"),
        (lambda: Spiral(3.0, 1.5), r"angular=1.5: must be a whole number"),
        (lambda: Spiral(0.0, 0), r"radial=0.0, angular=0: must not both be 0"),
        (lambda: Spiral(30.0, 0, scale=8.0), r"radial=30.0.*lower the order below 25.1"),
        (lambda: Spiral(3.0, 0, scale=0.5), r"scale=0.5"),
        (lambda: Spiral(3.0, 0, bandwidth=0.0), r"bandwidth=0.0"),
        (lambda: Spiral(3.0, 0, jacobian=2), r"jacobian=2: must be True or False"),
        (lambda: Hyperbolic("curl", 3.0), r"generator='curl': must be 'stretch' or 'shear'"),
        (lambda: Hyperbolic("shear", 0.0), r"u=0.0, v=0.0: must not both be 0"),
        (lambda: Hyperbolic("shear", 3.0, width=3.0), r"width=3.0"),
        (lambda: Hyperbolic("shear", 3.0, signs=(1, 1)), r"signs=\(1, 1\): must be four"),
        (lambda: Hyperbolic("shear", 3.0, signs=(1, 1, 0, 1)), r"must be four numbers \+1 or -1"),
        (lambda: Gabor(0.5).sample(0), r"radius=0: must be a whole number of px from 1 to 512"),
        (lambda: Gabor(0.5).sample(9.5), r"radius=9.5"),
        (lambda: Gabor(0.5).derivative("twist", 9), r"generator='twist'"),
        (lambda: Gabor(1e-6, sigma=0.5).sample(1), r"radius=1: .*constant on the patch"),
        (lambda: Spiral(3.0, 0, scale=300.0, bandwidth=0.05).sample(3), r"radius=3: .* vanishes"),
        (lambda: temporal_weights(1), r"frames=1: must be a whole number from 2"),
        (lambda: temporal_weights(5, "future"), r"kind='future': must be 'centred' or 'causal'"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
