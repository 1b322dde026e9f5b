"""The bank: a recipe that compares and hashes, its matrices, their noise, and the sheet."""

import dataclasses
import pickle

import numpy as np
import pytest

from sixflow.convention import GENERATOR_NAMES
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.default import default_bank
from sixflow.eigenfilters.kernels import Gabor, Hyperbolic, Spiral
from sixflow.engine.window import window_sigma
from sixflow.errors import FieldFileError, InputError
from sixflow.synth import Speckle

KERNELS = (
    Gabor(0.5, 0.0, sigma=5.0),
    Gabor(0.5, 1.5, sigma=5.0),
    Spiral(3.0, 0, scale=8.0),
    Spiral(0.0, 3, scale=8.0),
    Hyperbolic("stretch", 3.0, scale=8.0),
)
RADIUS = 20


@pytest.fixture(scope="module")
def bank():
    return FilterBank(KERNELS, RADIUS)


def test_recipe_is_hashable_and_equal_recipes_share_their_arrays(bank):
    same = FilterBank(list(KERNELS), np.int64(RADIUS))
    assert same == bank
    assert hash(same) == hash(bank)
    assert same.matrix is bank.matrix
    assert same.derivatives is bank.derivatives
    assert FilterBank(KERNELS, RADIUS + 1) != bank
    assert FilterBank(KERNELS[::-1], RADIUS) != bank
    again = pickle.loads(pickle.dumps(bank))
    assert again == bank
    assert again.matrix is bank.matrix
    assert Gabor(1, 0) == Gabor(1.0, 0.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        bank.radius = 3


def test_matrices_are_the_samples_and_read_only(bank):
    assert len(bank) == 5
    assert bank.size == 41
    assert bank.matrix.shape == (5, 41**2)
    assert bank.derivatives.shape == (5, 6, 41**2)
    for j, kernel in enumerate(KERNELS):
        np.testing.assert_array_equal(bank.matrix[j].reshape(41, 41), kernel.sample(RADIUS))
        for k, name in enumerate(GENERATOR_NAMES):
            np.testing.assert_array_equal(
                bank.derivatives[j, k].reshape(41, 41), kernel.derivative(name, RADIUS)
            )
    for array in (bank.matrix, bank.derivatives, bank.noise_covariance, bank.whitening()):
        assert not array.flags.writeable


def test_responses_are_correlations(bank):
    frame = np.random.default_rng(2).uniform(0, 255, (60, 70))
    x, y = 33, 28
    patch = frame[y - RADIUS : y + RADIUS + 1, x - RADIUS : x + RADIUS + 1]
    g = bank.responses(patch.reshape(1, -1))
    assert g.shape == (1, 5)
    for j, kernel in enumerate(KERNELS):
        slow = sum(
            frame[y + dy, x + dx] * kernel.sample(RADIUS)[RADIUS + dy, RADIUS + dx]
            for dy in range(-RADIUS, RADIUS + 1)
            for dx in range(-RADIUS, RADIUS + 1)
        )
        assert g[0, j] == pytest.approx(slow)


def test_noise_covariance(bank):
    W, C = bank.matrix, bank.real_noise_covariance
    np.testing.assert_allclose(bank.noise_covariance, W @ W.conj().T)
    np.testing.assert_allclose(np.diag(bank.noise_covariance), 1, atol=1e-12)
    np.testing.assert_allclose(C[:5, :5] + C[5:, 5:], bank.noise_covariance.real, atol=1e-12)
    np.testing.assert_allclose(C[5:, :5] - C[:5, 5:], bank.noise_covariance.imag, atol=1e-12)
    assert bank.condition_number == pytest.approx(np.linalg.cond(C))


@pytest.mark.parametrize("threshold", [1e-2, 1e-4, 1e-10])
def test_whitened_noise_has_unit_covariance(threshold):
    crowded = FilterBank((*KERNELS, *(Gabor(0.5 + 0.01 * k, sigma=5.0) for k in range(1, 6))), RADIUS)
    T = crowded.whitening(threshold)
    np.testing.assert_allclose(T @ crowded.real_noise_covariance @ T.T, np.eye(len(T)), atol=1e-6)
    values = np.linalg.eigvalsh(crowded.real_noise_covariance)
    assert len(T) == (values >= threshold * values[-1]).sum()
    assert len(crowded.whitening(1e-2)) < len(crowded.whitening(1e-10))


def test_whitening_drops_what_is_there_twice():
    """A kernel and its conjugate have the same real responses."""
    twice = FilterBank((Spiral(3.0, 2, scale=8.0), Spiral(-3.0, -2, scale=8.0)), RADIUS)
    assert twice.independent == 2
    assert twice.condition_number > 1e12


@pytest.mark.parametrize("window", [5, 11, 31, 61])
def test_default_bank(window):
    bank = default_bank(window)
    assert 40 <= len(bank) <= 64
    assert bank.radius == np.ceil(4 * window_sigma(window))
    assert bank.independent > 40
    if window >= 31:
        assert bank.independent == 2 * len(bank)
    np.testing.assert_allclose(bank.matrix.sum(axis=1), 0, atol=1e-10)
    assert {kernel.generators for kernel in bank.kernels} == {
        ("L_x", "L_y"),
        ("L_s", "L_r"),
        ("L_b", "L_s"),
        ("L_B", "L_s"),
    }


def test_default_bank_of_some_families():
    gabors, spirals = default_bank(21, "gabor"), default_bank(21, ["spiral"])
    assert all(isinstance(kernel, Gabor) for kernel in gabors.kernels)
    assert default_bank(21, ("spiral", "gabor")).kernels == gabors.kernels + spirals.kernels
    long = default_bank(31, wavelengths=(12.0, 40.0))
    assert np.hypot(*long.orders[:20].T).max() == pytest.approx(2 * np.pi / 12)


def test_derivatives_of_the_default_bank_predict_the_change_of_the_responses():
    """All six at once: a small affine motion of a speckle pattern, to second order in the motion."""
    bank = default_bank(31)
    tau = np.array([0.02, -0.01, 1e-3, -2e-3, 1e-3, 1.5e-3])
    y, x = (
        np.mgrid[-bank.radius : bank.radius + 1, -bank.radius : bank.radius + 1].reshape(2, -1).astype(float)
    )
    G = np.array([[tau[2] + tau[4], tau[5] - tau[3]], [tau[5] + tau[3], tau[2] - tau[4]]])
    back = np.linalg.inv(np.eye(2) + G) @ np.stack([x - tau[0], y - tau[1]])
    pattern = Speckle(sigma=2.0, seed=4)
    I0, I1 = pattern(x, y), pattern(*back)
    change = bank.responses(I1) - bank.responses(I0)
    predicted = bank.derivatives @ ((I0 + I1) / 2) @ tau
    assert np.linalg.norm(change - predicted) < 0.02 * np.linalg.norm(change)


def test_describe(bank):
    lines = bank.describe().splitlines()
    assert lines[0].startswith("5 complex kernels on 41 × 41 px, 10 independent real responses")
    assert len(lines) == 2 + len(bank)
    assert "L_b, L_s" in lines[-1]
    assert FilterBank(KERNELS[:1], 9).describe().startswith("1 complex kernel on")


def test_picture(bank, tmp_path):
    figure = bank.picture(tmp_path / "bank.png")
    assert (tmp_path / "bank.png").stat().st_size > 10_000
    tiles = [ax.get_images()[0].get_array() for ax in figure.axes if ax.get_images()]
    assert len(tiles) == len(bank)
    np.testing.assert_array_equal(tiles[0][:, : bank.size], bank.matrix[0].real.reshape(bank.size, -1))
    np.testing.assert_array_equal(tiles[0][:, -bank.size :], bank.matrix[0].imag.reshape(bank.size, -1))


def test_picture_that_cannot_be_saved(bank, tmp_path):
    with pytest.raises(InputError, match=r"end it in \.png"):
        bank.picture(tmp_path / "bank.nothing")
    with pytest.raises(FieldFileError, match="cannot be saved"):
        bank.picture(tmp_path / "missing" / "bank.png")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FilterBank((), 20), r"kernels=\(\): must be one or more"),
        (lambda: FilterBank(3, 20), r"kernels=3"),
        (lambda: FilterBank(("gabor",), 20), r"kernels\[0\]='gabor'"),
        (lambda: FilterBank((Gabor(0.5), Gabor(0.5)), 20), r"kernels\[1\]=.* is there twice"),
        (lambda: FilterBank(KERNELS, 0), r"radius=0"),
        (lambda: FilterBank(KERNELS, 20).whitening(0.0), r"threshold=0.0"),
        (lambda: FilterBank(KERNELS, 20).whitening(1.5), r"threshold=1.5"),
        (lambda: FilterBank(KERNELS, 20).responses(np.zeros((41, 41))), r"last dimension must be 1681"),
        (lambda: default_bank(3), r"window=3: must be 5 to 400"),
        (lambda: default_bank(31, ()), r"kernels=\(\): must be one or more of gabor, spiral, hyperbolic"),
        (lambda: default_bank(31, ("gabour",)), r"kernels=\('gabour',\)"),
        (lambda: default_bank(31, wavelengths=(9.0, 9.0)), r"wavelengths=\(9.0, 9.0\): must be two lengths"),
        (lambda: default_bank(31, wavelengths=7.0), r"wavelengths=7.0"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
