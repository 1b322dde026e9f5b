"""Frames of any kind become images, validity and pyramids."""

import numpy as np
import pytest

import naive
from sixflow.errors import InputError
from sixflow.prepare.frame import NO_MASK, Frame, both_valid
from sixflow.prepare.image import Grey, check_frame, to_image
from sixflow.prepare.light import flatten_lighting


def checker(shape, seed=1):
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize(
    "dtype", [bool, np.int8, np.uint8, np.uint16, np.int64, np.float16, np.float32, np.float64]
)
def test_real_frames_pass(dtype):
    frame = np.ones((4, 5), dtype)
    assert check_frame(frame, "frame0") is frame
    assert check_frame([[1, 2], [3, 4]], "frame0").shape == (2, 2)


@pytest.mark.parametrize(
    "frame", [np.ones((4, 5), complex), np.ones((4, 5, 3)), np.ones(4), np.empty((0, 5)), "a", None]
)
def test_other_frames_do_not(frame):
    with pytest.raises(InputError, match="frame7"):
        check_frame(frame, "frame7")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_image_is_the_frame_less_a_constant(dtype):
    frame = np.arange(12, dtype=np.uint8).reshape(3, 4)
    image, valid = to_image(frame, Grey(5.5, 1.0, dtype))
    assert image.dtype == dtype
    assert valid is NO_MASK
    np.testing.assert_array_equal(image, frame - 5.5)


def test_values_that_are_none_are_masked():
    frame = checker((6, 7))
    bad = [(0, 0), (3, 4), (5, 6)]
    for at, value in zip(bad, (np.nan, np.inf, -np.inf), strict=True):
        frame[at] = value
    image, valid = to_image(frame, Grey(0.5, 1.0, np.float32))
    assert np.isfinite(image).all()
    assert sorted(map(tuple, np.argwhere(valid == 0).tolist())) == bad
    np.testing.assert_allclose(image[valid == 1], frame[valid == 1] - 0.5, rtol=1e-6)


def test_both_valid():
    a, b = np.array([[1, 1, 0]], np.uint8), np.array([[0, 1, 0]], np.uint8)
    assert both_valid() is NO_MASK
    assert both_valid(NO_MASK, NO_MASK) is NO_MASK
    np.testing.assert_array_equal(both_valid(a, NO_MASK), a)
    np.testing.assert_array_equal(both_valid(a, b), [[0, 1, 0]])


def test_interpolable_is_two_pixels_inside():
    valid = (np.random.default_rng(2).random((30, 40)) > 0.02).astype(np.uint8)
    eroded = Frame(checker((30, 40)), valid).interpolable()
    for y, x in np.ndindex(30, 40):
        around = valid[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3]
        assert eroded[y, x] == around.all()
    assert Frame(checker((3, 3)), NO_MASK).interpolable() is NO_MASK


def test_levels():
    frame = Frame(checker((33, 50)), NO_MASK)
    assert frame.level(0) is frame
    assert frame.level(1).image.shape == (17, 25)
    assert frame.level(3).image.shape == (5, 7)
    assert frame.level(2) is frame.level(2)
    assert frame.level(12).image.shape == (1, 1)
    assert frame.nbytes > frame.image.nbytes


def test_masked_levels_know_nothing_of_what_is_masked():
    image, valid = checker((40, 44)), np.ones((40, 44), np.uint8)
    valid[10:25, 12:30] = 0
    spoiled = np.where(valid, image, 1e6)
    for level in (1, 2, 3):
        one, other = (Frame(a, valid).level(level) for a in (np.where(valid, image, 0), spoiled))
        np.testing.assert_array_equal(one.valid, other.valid)
        np.testing.assert_array_equal(one.image, other.image)
    assert not Frame(image, valid).level(1).valid[8:10, 10:13].any()


def test_levels_keep_a_constant_beside_a_mask():
    valid = np.ones((32, 32), np.uint8)
    valid[8:14, 9:20] = 0
    small = Frame(np.where(valid, 3.0, 99.0), valid).level(1)
    np.testing.assert_allclose(small.image[small.valid == 1], 3)


def test_within_shares_the_image():
    frame = Frame(checker((8, 8)), NO_MASK)
    assert frame.within(NO_MASK) is frame
    other = frame.within(np.ones((8, 8), np.uint8))
    assert other.image is frame.image


@pytest.mark.parametrize("degree", [3, 5])
def test_coefficients_are_kept(degree):
    frame = Frame(checker((12, 13)), NO_MASK)
    assert frame.coefficients(degree) is frame.coefficients(degree)
    np.testing.assert_allclose(
        frame.coefficients(degree), naive.spline_coefficients(frame.image, degree, 3), atol=1e-12
    )


@pytest.mark.parametrize("masked", [False, True])
def test_flatten_lighting(masked):
    image, sigma = 5 + 2 * checker((60, 50)), 6.0
    valid = np.ones(image.shape, np.uint8)
    if masked:
        valid[20:30, 10:30] = 0
    flat = flatten_lighting(image, valid if masked else NO_MASK, sigma)
    half = np.exp(-((np.arange(22) / sigma) ** 2) / 2)
    half /= half[0] + 2 * half[1:].sum()
    weight = naive.filter_separable(valid, half)
    centred = image - naive.filter_separable(image * valid, half) / weight
    spread = np.sqrt(naive.filter_separable(centred**2 * valid, half) / weight)
    np.testing.assert_allclose(flat, valid * centred / spread, atol=1e-10)


def test_flattened_light_forgets_gain_and_offset():
    image = checker((60, 50))
    one, other = flatten_lighting(image, NO_MASK, 5.0), flatten_lighting(7 * image - 30, NO_MASK, 5.0)
    np.testing.assert_allclose(one, other, atol=1e-10)


def test_flat_images_stay_finite():
    np.testing.assert_array_equal(flatten_lighting(np.zeros((20, 20)), NO_MASK, 4.0), 0)
    half = np.zeros((60, 60))
    half[:, 30:] = checker((60, 30))
    flat = flatten_lighting(half, NO_MASK, 3.0)
    assert np.isfinite(flat).all()
    assert not flat[:, :15].any()


def test_a_flat_image_that_is_not_zero_has_no_contrast():
    np.testing.assert_array_equal(flatten_lighting(np.full((20, 20), 3.0), NO_MASK, 4.0), 0)


@pytest.mark.parametrize("frame", [np.asfortranarray(checker((6, 8))), checker((8, 6)).T])
def test_images_lie_in_rows(frame):
    """Kernels are compiled for images that lie row by row; for any other layout they would be compiled again."""
    image, _ = to_image(frame, Grey(0.0, 1.0, np.float32))
    assert image.flags.c_contiguous
