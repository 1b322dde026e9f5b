"""What does not count changes nothing, to the last bit: content outside the masks, and pixels without a value. Where
these end, no direction is preferred. The settings and the comparison are those of `invariant`.
"""

import functools

import numpy as np
import pytest

from invariant import (
    CASES,
    ROUNDING,
    SETTINGS,
    SHAPE,
    TURNED,
    assert_identical,
    assert_turned,
    field_of,
    recording,
    turned,
)


def region(shape):
    """A region of interest with a hole, and a bay at the rim."""
    y, x = np.indices(shape)
    return (np.hypot(x - 80, y - 50) > 14) & (x > 9) & (y < shape[0] - 6) & ~((x > 60) & (y < 20) & (x < 90))


CONTENT = {
    "random": lambda rng, shape: rng.uniform(0, 255, shape),
    "glare": lambda rng, shape: np.where(rng.random(shape) < 0.3, 1e4, 0.0),
    "one value": lambda rng, shape: np.zeros(shape),
    "nothing": lambda rng, shape: np.full(shape, np.nan),
}


def with_content(frames, keep, content):
    """The frames inside of a region, and something else around it."""
    return np.where(keep, frames, CONTENT[content](np.random.default_rng(3), frames.shape))


@functools.cache
def masked_field(kind, name):
    frames = recording(kind)
    keep = region(frames.shape[1:])
    return field_of(frames, name, kind, mask=np.stack([keep, keep]))


CONTENTS = [(*case, "glare") for case in CASES]
CONTENTS += [
    ("speckle", name, content) for name in ("default", "local") for content in CONTENT if content != "glare"
]


@pytest.mark.parametrize(("kind", "name", "content"), CONTENTS)
def test_what_is_outside_the_masks_does_not_count(kind, name, content):
    frames = recording(kind)
    keep = region(frames.shape[1:])
    other = field_of(with_content(frames, keep, content), name, kind, mask=np.stack([keep, keep]))
    assert_identical(other, masked_field(kind, name))


@pytest.mark.parametrize(
    "name", ["default", "middle", "second", "local", "lowpass", "gain+offset", "eigenfilter"]
)
def test_what_is_outside_the_mask_of_the_first_frame_does_not_count_there(name):
    """Frame 1 has no mask: what moves out of the region is still there."""
    frames = recording()
    keep = region(SHAPE)
    other = np.stack([with_content(frames[0], keep, "glare"), frames[1]])
    assert_identical(field_of(other, name, mask=keep), field_of(frames, name, mask=keep))


@pytest.mark.parametrize("content", ["random", "glare", "one value"])
def test_what_is_outside_the_masks_of_integer_frames_does_not_count(content):
    """Their rounding is noise that is known beforehand, from the steps of their grey values."""
    frames = (2 * np.round(recording() / 2)).astype(np.uint16)
    keep = region(SHAPE)
    masks = np.stack([keep, keep])
    other = with_content(frames, keep, content).astype(np.uint16)
    assert_identical(field_of(other, mask=masks), field_of(frames, mask=masks))


@pytest.mark.parametrize(
    ("kind", "name"), [case for case in CASES if case[1] not in ("auto", "return, replace")]
)
def test_what_is_hidden_in_pixels_without_a_value_does_not_count(kind, name):
    """NaN, infinite, or masked in an array of NumPy: there is no value."""
    frames = recording(kind)
    lost = ~region(frames.shape[1:])
    field = field_of(np.where(lost, np.nan, frames), name, kind)
    assert_identical(field_of(np.where(lost, -np.inf, frames), name, kind), field)
    covered = [np.ma.array(with_content(frame, ~lost, "glare"), mask=lost) for frame in frames]
    assert_identical(field_of(covered, name, kind), field)


@pytest.mark.parametrize("how", TURNED)
@pytest.mark.parametrize("name", ["default", "middle"])
def test_masks_are_turned_with_the_frames(name, how):
    frames, keep = recording(), region(SHAPE)
    other = field_of(turned(frames, how), name, mask=turned(np.stack([keep, keep]), how))
    assert_turned(masked_field("speckle", name), other, how, ROUNDING)


@pytest.mark.parametrize("name", [name for name in SETTINGS if "lowpass" in name])
def test_the_rim_that_a_lowpass_takes_is_turned_with_the_frames(name):
    other = field_of(turned(recording(), "by 90°"), name)
    assert_turned(field_of(recording(), name), other, "by 90°", ROUNDING)
