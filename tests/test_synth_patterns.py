"""Patterns: exact derivatives, exact brightness constancy, statistics, one and the same from every side."""

import subprocess
import sys

import numpy as np
import pytest

from sixflow.errors import InputError
from sixflow.synth import (
    Affine,
    CellularVortices,
    Grating,
    LambOseen,
    Particles,
    Plaid,
    Speckle,
    Texture,
    render,
)

PATTERNS = [
    Speckle(sigma=2.0, seed=1),
    Speckle(sigma=3.5, density=0.2, contrast=20.0, mean=90.0, seed=2),
    Particles(diameter=3.0, diameter_spread=0.4, density=0.05, seed=3),
    Texture(shortest=5.0, longest=30.0, waves=40, seed=4),
    Grating(wavelength=9.0, angle=0.4, phase=1.0),
    Plaid(wavelengths=(8.0, 13.0), angles=(0.2, 1.9)),
]
IDS = ["speckle", "sparse", "particles", "texture", "grating", "plaid"]


def anywhere(count=400, seed=0):
    return np.random.default_rng(seed).uniform(-80, 150, (2, count))


def derivative(along, h=5e-3):
    """Five-point difference; the step is large beside the blobs' ends, where they drop by 1e-10."""
    return (8 * (along(h) - along(-h)) - along(2 * h) + along(-2 * h)) / (12 * h)


@pytest.mark.parametrize("pattern", PATTERNS, ids=IDS)
def test_gradient_is_the_derivative(pattern):
    x, y = anywhere()
    I_x = derivative(lambda h: pattern(x + h, y))
    I_y = derivative(lambda h: pattern(x, y + h))
    given_x, given_y = pattern.gradient(x, y)
    np.testing.assert_allclose(given_x, I_x, atol=1e-5)
    np.testing.assert_allclose(given_y, I_y, atol=1e-5)


@pytest.mark.parametrize("pattern", PATTERNS, ids=IDS)
@pytest.mark.parametrize(
    "motion",
    [
        Affine.from_six((3.3, -1.2, 0.02, 0.1, -0.03, 0.05), centre=(40, 40)),
        CellularVortices(amplitude=2.0, period=60.0),
        LambOseen(angle=1.5, core=25.0, centre=(30, 40)),
    ],
    ids=["affine", "vortices", "lamb-oseen"],
)
def test_brightness_is_constant_along_the_motion(pattern, motion):
    x, y = anywhere()
    np.testing.assert_allclose(pattern.image(*motion.forward(x, y), motion), pattern(x, y), atol=1e-8)


def test_speckle_agrees_with_a_plain_sum_over_its_blobs():
    pattern = Speckle(sigma=1.7, density=0.4, seed=5)
    blobs = pattern._blobs((-20, 40, -20, 40))
    x, y = np.random.default_rng(1).uniform(0, 20, (2, 50))
    r2 = (x[:, None] - blobs[:, 0]) ** 2 + (y[:, None] - blobs[:, 1]) ** 2
    plain = pattern.mean + (blobs[:, 2] * np.exp(-r2 * blobs[:, 3])).sum(axis=1)
    np.testing.assert_allclose(pattern(x, y), plain, atol=1e-7)


@pytest.mark.parametrize("pattern", PATTERNS, ids=IDS)
def test_a_pattern_does_not_depend_on_how_it_is_asked(pattern):
    frame = render(pattern, (40, 60))
    np.testing.assert_array_equal(render(pattern, (17, 23)), frame[:17, :23])
    assert pattern(31.0, 12.0) == frame[12, 31]
    assert pattern([[31.0, 32.0]], [[12.0]]).shape == (1, 2)
    far = pattern([31.0, 5e8], [12.0, -5e8])
    assert far[0] == frame[12, 31]
    assert np.isfinite(far).all()
    assert pattern(np.empty(0), np.empty(0)).shape == (0,)


def test_many_threads_and_parts_change_nothing(monkeypatch):
    from sixflow.synth.patterns import field

    pattern = Speckle(seed=9)
    whole = render(pattern, (200, 220))
    monkeypatch.setattr(field, "CHUNK", 1000)
    monkeypatch.setattr(field, "_MOST_BLOBS", 500)
    np.testing.assert_array_equal(render(pattern, (200, 220)), whole)


@pytest.mark.parametrize("seed", [0, 1, 2**40, 2**70])
def test_seeds_choose_the_pattern(seed):
    shape = (200, 200)
    one = render(Speckle(seed=seed), shape)
    np.testing.assert_array_equal(one, render(Speckle(seed=seed), shape))
    other = render(Speckle(seed=seed + 1), shape)
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.13


@pytest.mark.parametrize("pattern", [Speckle(sigma=2.0, contrast=30.0), Texture(contrast=30.0, waves=200)])
def test_mean_and_contrast(pattern):
    frame = render(pattern, (400, 400))
    assert frame.mean() == pytest.approx(128, abs=1.5)
    assert frame.std() == pytest.approx(30, rel=0.03)


def test_texture_stays_in_its_band():
    frame = render(Texture(shortest=5.0, longest=10.0, contrast=30.0), (256, 256)) - 128
    taper = np.hanning(256)[:, None] * np.hanning(256)
    power = np.abs(np.fft.fft2(frame * taper)) ** 2
    k = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256))
    inside = (k > 1 / 10.4) & (k < 1 / 4.8)
    assert power[inside].sum() / power.sum() > 0.999


def test_particle_density_and_brightness():
    pattern = Particles(density=0.02, brightness=100.0, brightness_spread=0.3, diameter_spread=0.3, seed=2)
    blobs = pattern._blobs(0, 0.02, None, (0, 500, 0, 500))
    inside = ((blobs[:, :2] > 0) & (blobs[:, :2] < 500)).all(axis=1)
    assert inside.sum() == pytest.approx(5000, abs=5 * 5000**0.5)
    assert blobs[:, 2].mean() == pytest.approx(100, rel=0.03)
    assert blobs[:, 2].std() == pytest.approx(30, rel=0.05)
    diameter = np.sqrt(8 / blobs[:, 3])
    assert diameter.mean() == pytest.approx(3, rel=0.02)
    assert diameter.std() == pytest.approx(0.3, rel=0.05)


def test_rigid_particles_move_with_their_centres_and_stay_round():
    motion = Affine.zoom(1.5)
    pattern = Particles(density=0.01, rigid=True, background=0.0, seed=4)
    blobs = pattern._blobs(4, 0.01, None, (-20, 80, -20, 80))
    x, y = np.random.default_rng(0).uniform(10, 60, (2, 200))
    r2 = (x[:, None] - 1.5 * blobs[:, 0]) ** 2 + (y[:, None] - 1.5 * blobs[:, 1]) ** 2
    round_images = (blobs[:, 2] * np.exp(-r2 * blobs[:, 3])).sum(axis=1)
    np.testing.assert_allclose(pattern.image(x, y, motion), round_images, atol=1e-6)


def test_rigid_and_deforming_particles_agree_for_a_translation():
    motion = Affine.translation(0.4, -2.7)
    deforming = render(Particles(unmatched=0.2), (50, 50), motion)
    np.testing.assert_allclose(
        render(Particles(unmatched=0.2, rigid=True), (50, 50), motion), deforming, atol=1e-7
    )


@pytest.mark.parametrize("unmatched", [0.0, 0.3, 1.0])
def test_unmatched_particles_lower_the_correlation_of_the_frames(unmatched):
    pattern = Particles(unmatched=unmatched, density=0.02)
    still = Affine.translation(0.0, 0.0)
    frames = [render(pattern, (300, 300), still, number=k) for k in range(3)]
    np.testing.assert_array_equal(frames[0], render(pattern, (300, 300)))
    for a, b in ((0, 1), (1, 2)):
        correlation = np.corrcoef(frames[a].ravel(), frames[b].ravel())[0, 1]
        assert correlation == pytest.approx(1 - unmatched, abs=0.05)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Speckle(sigma=0), "sigma=0"),
        (lambda: Speckle(sigma=-2.0), "sigma=-2.0"),
        (lambda: Speckle(sigma=float("nan")), "sigma=nan"),
        (lambda: Speckle(sigma="2"), "sigma='2'"),
        (lambda: Speckle(sigma=True), "sigma=True"),
        (lambda: Speckle(density=0.0), "density=0.0"),
        (lambda: Speckle(contrast=-1), "contrast=-1"),
        (lambda: Speckle(mean=None), "mean=None"),
        (lambda: Speckle(seed=1.5), "seed=1.5"),
        (lambda: Speckle(seed=-1), "seed=-1"),
        (lambda: Particles(diameter=0), "diameter=0"),
        (lambda: Particles(diameter=2, diameter_spread=1.5), "diameter_spread=1.5"),
        (lambda: Particles(density=-0.1), "density=-0.1"),
        (lambda: Particles(brightness_spread=0.9), "brightness_spread=0.9"),
        (lambda: Particles(unmatched=1.1), "unmatched=1.1"),
        (lambda: Particles(rigid=1), "rigid=1"),
        (lambda: Texture(shortest=10, longest=5), "longest=5"),
        (lambda: Texture(waves=0), "waves=0"),
        (lambda: Grating(wavelength=0), "wavelength=0"),
        (lambda: Plaid(wavelengths=(3.0,)), "wavelengths="),
        (lambda: Plaid(wavelengths=(3.0, -1.0)), r"wavelengths\[1\]=-1.0"),
        (lambda: Plaid(angles="ab"), "angles='ab'"),
    ],
)
def test_a_bad_parameter_is_named(make, name):
    with pytest.raises(InputError, match=f"{name}.*must"):
        make()


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (np.nan, 0.0, "x: 1 of 1"),
        (0.0, [np.inf, 1.0], "y: 1 of 2"),
        (1e12, 0.0, "beyond"),
        ("a", 0.0, "dtype"),
        (1j, 0.0, "dtype"),
        ([[1.0], [1.0, 2.0]], 0.0, "cannot be made an array"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], "broadcast"),
    ],
)
def test_bad_coordinates_are_refused(x, y, message):
    for ask in (Speckle(), Speckle().gradient, Speckle().image, Affine().displacement, Affine().inverse):
        with pytest.raises(InputError, match=message):
            ask(x, y)


def test_motions_that_bring_in_too_much_are_refused():
    with pytest.raises(InputError, match="shrinks less"):
        render(Particles(rigid=True), (64, 64), Affine.zoom(1e-6))
    with pytest.raises(InputError, match="beyond"):
        render(Speckle(), (64, 64), Affine.translation(1e12, 0))


def test_importing_compiles_nothing():
    code = "import sys, sixflow.synth; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
