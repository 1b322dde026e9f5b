"""Responses over a frame: the matrix product, the Fourier transform and the pyramid, against direct sums."""

import numpy as np
import pytest

import naive
from sixflow import InputError, synth
from sixflow.eigenfilters import (
    FilterBank,
    Gabor,
    Hyperbolic,
    JointOperator,
    Spiral,
    patches,
    respond,
    respond_dense,
    response_pyramid,
)
from sixflow.engine.fir import _HALVING
from sixflow.maps.grid import Grid

RADIUS = 7
BANK = FilterBank(
    (
        Gabor(0.9, 0.4, sigma=2.0),
        Gabor(0.7, 1.2, sigma=2.0, shape="equal-dc"),
        Spiral(2.0, 1, scale=4.0),
        Hyperbolic("shear", 2.0, 1.0, scale=4.0),
    ),
    RADIUS,
)
ROUNDING = 1e-12  # of the largest grey value times Σ|w|, several times what double precision leaves


@pytest.fixture(scope="module")
def frame():
    return np.random.default_rng(3).normal(100, 30, (24, 31))


def direct(bank, frame, x, y):
    """The sum over the patch, pixel by pixel, with reflected indices."""
    g = np.zeros(len(bank), complex)
    kernels = bank.matrix.reshape(len(bank), bank.size, bank.size)
    for j in range(-bank.radius, bank.radius + 1):
        for i in range(-bank.radius, bank.radius + 1):
            row, column = naive.mirror(y + j, frame.shape[0]), naive.mirror(x + i, frame.shape[1])
            g += frame[row, column] * kernels[:, j + bank.radius, i + bank.radius]
    return g


def close(got, wanted, frame):
    scale = np.abs(frame).max() * np.abs(BANK.matrix).sum(axis=1).max()
    np.testing.assert_allclose(got, wanted, rtol=0, atol=ROUNDING * scale)


def test_points_are_direct_sums_in_the_middle_and_at_the_borders(frame):
    x, y = np.array([0, 30, 15, 3, 30, 0]), np.array([0, 23, 12, 20, 0, 23])
    found = respond(BANK, frame, x, y)
    assert found.shape == (6, 4)
    assert found.dtype == np.complex128
    close(found, [direct(BANK, frame, *at) for at in zip(x, y, strict=True)], frame)


def test_dense_equals_points(frame):
    y, x = np.indices(frame.shape)
    dense = respond_dense(BANK, frame)
    assert dense.shape == (4, *frame.shape)
    close(dense.reshape(4, -1).T, respond(BANK, frame, x.ravel(), y.ravel()), frame)


@pytest.mark.parametrize("step", [2, 5, 40])
def test_dense_on_a_grid_is_the_grid_of_measurement(frame, step):
    grid = Grid.over(frame.shape, step)
    close(respond_dense(BANK, frame, step=step), respond_dense(BANK, frame)[:, grid.y][:, :, grid.x], frame)


def test_blocks_do_not_matter(frame, monkeypatch):
    x, y = np.arange(31), np.full(31, 11)
    whole = respond(BANK, frame, x, y)
    monkeypatch.setattr(patches, "BLOCK_BYTES", 8 * 15**2 * 4)
    close(respond(BANK, frame, x, y), whole, frame)
    assert [chosen.start for chosen, _ in patches.patch_blocks((frame,), x, y, RADIUS)] == list(
        range(0, 31, 4)
    )
    assert respond(BANK, frame, [], []).shape == (0, 4)


def test_a_constant_is_answered_by_the_equal_dc_pair_only():
    flat = respond_dense(BANK, np.full((20, 20), 50.0))
    sums = 50 * BANK.matrix.sum(axis=1)
    close(flat, np.broadcast_to(sums[:, None, None], flat.shape), np.array([50.0]))
    assert abs(sums[1]) > 1
    assert np.abs(sums[[0, 2, 3]]).max() < 1e-9


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float32, bool])
def test_grey_values_of_any_type(frame, dtype):
    other = (frame > 100) if dtype is bool else frame.clip(0, 255).astype(dtype)
    close(respond_dense(BANK, other), respond_dense(BANK, other.astype(float)), frame)


def test_a_frame_of_the_size_of_the_patch(frame):
    small = frame[:15, :15]
    close(respond_dense(BANK, small)[:, 0, 14], direct(BANK, small, 14, 0), frame)


class TestPyramid:
    def test_levels_are_the_halved_frames(self):
        frame = np.random.default_rng(1).normal(0, 1, (61, 70))
        pyramid = response_pyramid(BANK, frame, levels=2, step=3)
        image = frame
        for level, part in enumerate(pyramid):
            grid = Grid.over(image.shape, 3)
            assert part.level == level
            np.testing.assert_array_equal(part.x, 2**level * grid.x)
            np.testing.assert_array_equal(part.y, 2**level * grid.y)
            close(part.values, respond_dense(BANK, image, step=3), np.array([10.0]))
            image = naive.filter_separable(image, _HALVING, stride=2)
        assert len(pyramid) == 3

    def test_coordinates_have_no_offset(self):
        """An even operator answers most strongly at the centre of a blob, on every level."""
        y, x = np.mgrid[:129, :161]
        blob = np.exp(-((x - 84) ** 2 + (y - 52) ** 2) / (2 * 6.0**2))
        bank = FilterBank((Gabor(0.8, 0.3, sigma=3.0),), 9)
        for part in response_pyramid(bank, blob, levels=2, step=1):
            row, column = np.unravel_index(part.values[0].real.argmax(), part.values[0].shape)
            assert (part.x[column], part.y[row]) == (84, 52)
            # even about it, up to single steps: an offset of half a pixel would show here
            middle = part.values[0].real[row]
            np.testing.assert_allclose(middle[column + 1 : column + 9], middle[column - 8 : column][::-1])

    def test_a_level_sees_waves_as_much_longer(self):
        """The Gaussian spectrum at half the frequency, exp(−(kσ/2)²/2) = 0.06, and halving, which takes off half."""
        bank = FilterBank((Gabor(2 * np.pi / 8, sigma=6.0),), 19)
        frame = synth.render(synth.Grating(wavelength=32.0), (160, 160))
        strength = [np.abs(part.values).mean() for part in response_pyramid(bank, frame, levels=2, step=8)]
        assert strength[2] > 8 * max(strength[:2])


class TestRefusals:
    def test_patch_larger_than_the_frame(self, frame):
        small = frame[:14]
        message = "radius=7: the patch of 15 × 15 px is larger than the frame of 14 × 31 px"
        for ask in (
            lambda: respond(BANK, small, [3], [3]),
            lambda: respond_dense(BANK, small),
            lambda: response_pyramid(BANK, small, 0),
        ):
            with pytest.raises(InputError, match=message):
                ask()
        bank = FilterBank(tuple(Gabor(0.9, k * 0.4, sigma=2.0) for k in range(8)), RADIUS)
        with pytest.raises(InputError, match=message):
            JointOperator(bank).estimate(small, small, np.array([3]), np.array([3]))

    @pytest.mark.parametrize(
        ("x", "y", "message"),
        [
            ([31], [0], r"x\[0\]=31: must be a whole pixel of the frame, 0 … 30"),
            ([0, 1], [0, -1], r"y\[1\]=-1: must be a whole pixel of the frame, 0 … 23"),
            ([2.5], [3], r"x\[0\]=2\.5: must be a whole pixel"),
            ([np.nan], [3], r"x\[0\]=nan: must be a whole pixel"),
            ([1, 2], [3], "x and y have 2 and 1 points"),
            ([[1]], [[3]], r"x of shape \(1, 1\)"),
            (["a"], [3], r"x of shape \(1,\) and dtype <U1"),
        ],
    )
    def test_points(self, frame, x, y, message):
        with pytest.raises(InputError, match=message):
            respond(BANK, frame, x, y)

    def test_whole_floats_are_pixels(self, frame):
        close(respond(BANK, frame, [4.0], [5.0]), respond(BANK, frame, [4], [5]), frame)

    def test_frames(self, frame):
        holed = frame.copy()
        holed[2, 3] = np.nan
        holed[4, 5] = np.inf
        with pytest.raises(InputError, match="frame has 2 pixels that are not finite"):
            respond_dense(BANK, holed)
        for wrong in (frame[0], frame + 1j, np.zeros((0, 5)), [["a"]]):
            with pytest.raises(InputError, match="frame has"):
                respond(BANK, wrong, [0], [0])

    def test_numbers(self, frame):
        with pytest.raises(InputError, match="step=0"):
            respond_dense(BANK, frame, step=0)
        with pytest.raises(InputError, match="levels=-1"):
            response_pyramid(BANK, frame, -1)
        with pytest.raises(
            InputError, match="levels=1: the coarsest level is 12 × 16 px, smaller than the patch"
        ):
            response_pyramid(BANK, frame, 1)
