"""Joint measurement of all six numbers from a bank: truth, covariance, light, bad input."""

import numpy as np
import pytest

from sixflow import InputError, synth
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.joint import JointOperator
from sixflow.eigenfilters.kernels import Gabor

SIDE, RADIUS = 160, 22
WAVELENGTHS = {8: 12, 12: 10, 18: 8}


@pytest.fixture(scope="module")
def bank():
    kernels = [
        Gabor(2 * np.pi / wavelength, np.pi * (k + 0.5) / count, sigma=8.0)
        for wavelength, count in WAVELENGTHS.items()
        for k in range(count)
    ]
    return FilterBank(tuple(kernels), RADIUS)


def points():
    axis = np.arange(RADIUS + 2, SIDE - RADIUS - 2, 14)
    x, y = np.meshgrid(axis, axis)
    return x.ravel(), y.ravel()


def found(bank, six, *, noise=0.0, seed=0, phase_only=False, sensors=None, pattern=None):
    motion = synth.Affine.from_six(six, centre=(SIDE / 2, SIDE / 2))
    sensor = sensors or synth.Sensor(noise=noise, seed=seed)
    made = synth.pair(pattern or synth.Texture(seed=seed), motion, (SIDE, SIDE), sensor=sensor)
    x, y = points()
    estimate = JointOperator(bank, phase_only=phase_only).estimate(made.frame0, made.frame1, x, y)
    return estimate, estimate.six - made.truth(x.astype(float), y.astype(float))


@pytest.mark.parametrize("phase_only", [False, True])
@pytest.mark.parametrize("which", range(6))
def test_each_number_is_measured_and_the_others_are_not_disturbed(bank, which, phase_only):
    size = 0.05 if which < 2 else 0.005
    six = np.zeros(6)
    six[which] = size
    estimate, _ = found(bank, six, phase_only=phase_only)
    # displacements differ from point to point; compare about the centre of the motion
    x, y = points()
    middle = np.argmin(np.hypot(x - SIDE / 2, y - SIDE / 2))
    scale = np.array([10.0, 10.0, 1, 1, 1, 1]) * 0.005
    own = estimate.six[middle] / scale
    moved = synth.Affine.from_six(tuple(six), centre=(SIDE / 2, SIDE / 2))
    truth = moved.six(float(x[middle]), float(y[middle])) / scale
    # second-order terms of the motion, (ω τ)² of the highest frequency, bound what linear responses leave out
    np.testing.assert_allclose(own, truth, atol=0.04)


@pytest.mark.parametrize("phase_only", [False, True])
def test_covariance_covers_the_errors(bank, phase_only):
    standardised = []
    for seed in range(6):
        estimate, error = found(
            bank, (0.03, -0.02, 4e-4, 5e-4, -3e-4, 2e-4), noise=2, seed=seed, phase_only=phase_only
        )
        standardised.append(error / np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2)))
    z = np.concatenate(standardised)
    # points overlap: about one independent window per (2 RADIUS)² px
    independent = 6 * (SIDE / (2 * RADIUS)) ** 2
    assert np.abs(z.std(axis=0) - 1).max() < 4 / np.sqrt(2 * independent)


def test_noise_is_that_of_one_frame(bank):
    estimate, _ = found(bank, np.zeros(6), noise=2)
    assert np.median(estimate.noise) == pytest.approx(2, rel=0.1)


def test_contrast_and_offset_do_not_move_the_six(bank):
    sensors = (synth.Sensor(noise=1, seed=1), synth.Sensor(noise=1, seed=2, gain=1.05, offset=20))
    estimate, error = found(bank, np.zeros(6), sensors=sensors)
    z = error / np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2))
    assert np.abs(z).max() < 5
    assert np.median(estimate.contrast) == pytest.approx(np.log(1.05), abs=0.01)


def test_phase_withstands_a_large_change_of_contrast(bank):
    sensors = (synth.Sensor(noise=1, seed=1), synth.Sensor(noise=1, seed=2, gain=2, offset=-50))
    estimate, error = found(bank, np.zeros(6), sensors=sensors, phase_only=True)
    z = error / np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2))
    assert np.abs(z).max() < 5


def test_constant_frames_give_nothing(bank):
    flat = np.full((SIDE, SIDE), 7.0)
    x, y = points()
    for phase_only in (False, True):
        estimate = JointOperator(bank, phase_only=phase_only).estimate(flat, flat, x, y)
        assert np.isnan(estimate.six).all()


def test_too_few_kernels():
    bank = FilterBank((Gabor(0.5), Gabor(0.5, 1.0)), 10)
    with pytest.raises(InputError, match="4 independent responses"):
        JointOperator(bank)
    with pytest.raises(InputError, match="2 independent responses"):
        JointOperator(bank, phase_only=True)
