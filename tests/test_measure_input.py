"""Input that cannot be used is refused by name; what cannot be measured is flagged, never confidently wrong."""

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import InputError, SixflowError, measure_sequence
from sixflow.synth import Speckle, render

GOOD = render(Speckle(), (64, 72))
NAN = np.nan


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (GOOD[:60], ["frame1", "(60, 72)", "(64, 72)", "one shape"]),
        (GOOD.T, ["frame1", "(72, 64)"]),
        (GOOD[None], ["frame1", "(1, 64, 72)", "(height, width)"]),
        (np.stack([GOOD] * 3, axis=-1), ["frame1", "(64, 72, 3)", "luminance"]),
        (GOOD.ravel(), ["frame1", "(4608,)"]),
        (np.float64(3.0), ["frame1", "()"]),
        (GOOD + 0j, ["frame1", "complex128", "real"]),
        (GOOD.astype(object), ["frame1", "object"]),
        (GOOD.astype(str), ["frame1", "<U"]),
        (GOOD.astype("datetime64[s]"), ["frame1", "datetime64"]),
        (np.empty((0, 0)), ["frame1", "(0, 0)", "no pixels"]),
        (np.empty((64, 0)), ["frame1", "(64, 0)", "no pixels"]),
        (np.full_like(GOOD, 7), ["frame1", "constant", "7"]),
        (np.zeros((64, 72), bool), ["frame1", "constant"]),
        (np.full_like(GOOD, NAN), ["frame1", "no finite pixel", "4608"]),
        (np.full_like(GOOD, np.inf), ["frame1", "no finite pixel"]),
        (np.where(np.arange(72) < 5, GOOD[0, 0], np.full_like(GOOD, NAN)), ["frame1", "constant"]),
        (None, ["frame1"]),
        ("frame.tif", ["frame1"]),
    ],
)
def test_a_frame_that_cannot_be_used(frame, said):
    with pytest.raises(InputError) as caught:
        measure(GOOD, frame)
    for part in said:
        assert part in str(caught.value)
    # the reference is checked in the same way, unless it is the other one that then has another shape
    if "one shape" not in str(caught.value) and np.shape(frame) != (72, 64):
        with pytest.raises(InputError, match="frame0"):
            measure(frame, GOOD)


def test_errors_are_value_errors_of_one_family():
    assert issubclass(InputError, ValueError)
    assert issubclass(InputError, SixflowError)


@pytest.mark.parametrize("shape", [(64, 1), (1, 64), (1, 1), (30, 200), (200, 30)])
def test_frames_smaller_than_the_window(shape):
    frame = render(Speckle(), shape)
    with pytest.raises(InputError) as caught:
        measure(frame, frame + 1)
    if shape == (1, 1):
        assert "frame0 is constant" in str(caught.value)
        return
    for part in ("frame0", str(shape), "window=31", "smaller"):
        assert part in str(caught.value)


@pytest.mark.parametrize("shape", [(31, 31), (31, 90), (9, 9), (5, 6), (8, 200)])
def test_frames_just_as_large_as_the_window(shape):
    frame = render(Speckle(sigma=1.2), shape)
    field = measure(frame, frame * (1 + 1e-7), window=min(31, *shape), step=3)
    kept = ~measured.failed(field)
    assert kept.any()
    np.testing.assert_allclose(measured.six_of(field)[kept], 0, atol=1e-4)


@pytest.mark.parametrize(
    ("mask", "said"),
    [
        (np.ones((64, 71), bool), ["mask", "(64, 71)", "(64, 72)"]),
        (np.ones((72, 64), bool), ["mask", "(72, 64)"]),
        (np.ones((1, 64, 72), bool), ["mask", "(1, 64, 72)"]),
        (np.zeros((64, 72), bool), ["mask", "False everywhere"]),
        (np.zeros((64, 72), np.uint8), ["mask", "False everywhere"]),
        (np.ones((64, 72)), ["mask", "float64", "bool"]),
        (np.ones((64, 72), complex), ["mask", "complex128"]),
        (True, ["mask", "()"]),
        (np.empty((0, 0), bool), ["mask"]),
    ],
)
def test_a_mask_that_cannot_be_used(mask, said):
    with pytest.raises(InputError) as caught:
        measure(GOOD, GOOD, mask=mask)
    for part in said:
        assert part in str(caught.value)


def test_a_mask_where_there_are_no_values():
    frame = GOOD.copy()
    frame[:32] = NAN
    mask = np.zeros(GOOD.shape, bool)
    mask[:20] = True
    with pytest.raises(InputError, match=r"mask is True only where"):
        measure(frame, GOOD, mask=mask)


@pytest.mark.parametrize(
    "options",
    [
        {"window": 0}, {"window": -31}, {"window": 4.9}, {"window": NAN}, {"window": np.inf}, {"window": "31"},
        {"window": True}, {"step": 0}, {"step": -8}, {"step": 2.5}, {"step": True}, {"sharpen": -1}, {"sharpen": 17},
        {"interpolation": "linear"}, {"lighting": "gain"}, {"levels": -1}, {"levels": 13}, {"passes": 0},
        {"tolerance": 0}, {"tolerance": -1.0}, {"tolerance": NAN}, {"float64": 1}, {"pixel_size": 0},
        {"frame_interval": -0.1}, {"length_unit": " "}, {"winodw": 31},
    ],
)  # fmt: skip
def test_settings_that_cannot_be_used(options):
    ((name, value),) = options.items()
    with pytest.raises(InputError) as caught:
        measure(GOOD, GOOD, **options)
    assert name in str(caught.value)
    if name != "winodw":
        assert f"{name}={value!r}" in str(caught.value)
    else:
        assert "no such setting; there are" in str(caught.value)


@pytest.mark.parametrize("frames", [[], [GOOD], iter([]), iter([GOOD]), GOOD[None]])
def test_fewer_than_two_frames(frames):
    with pytest.raises(
        InputError, match=r"frames: [01] given; a motion needs at least two|no frames; give at least two"
    ):
        measure_sequence(frames)


def test_frames_of_a_recording_are_named_by_number():
    with pytest.raises(InputError, match="frame 2 has 72×60 px"):
        measure_sequence([GOOD, GOOD + 1, GOOD[:60]], strict=True)
    with pytest.raises(InputError, match="frame 1 is constant"):
        measure_sequence([GOOD, np.zeros_like(GOOD)], strict=True)


@pytest.mark.parametrize("pairs", ["all", "", None, 1])
def test_unknown_pairs(pairs):
    with pytest.raises(InputError, match=r"pairs=.*'consecutive', 'double', 'first'"):
        measure_sequence([GOOD, GOOD], pairs=pairs)


def test_too_few_times():
    with pytest.raises(InputError, match=r"times has 1 values for 3 frames"):
        measure_sequence([GOOD] * 3, times=[0.0])


def assert_never_confidently_wrong(field, truth, share):
    """At most `share` of the points is given a value, and what is given is right to five standard errors."""
    kept = ~measured.failed(field)
    assert kept.mean() <= share
    wrong = np.abs(measured.six_of(field) - truth)[kept] > 5 * measured.standard_errors(field)[kept]
    # chance: 5 standard errors of an interpolation-limited field are reached nowhere else
    assert wrong.any(axis=-1).mean() < 0.02 if kept.any() else True
    assert np.isnan(measured.six_of(field)[~kept]).all()


@pytest.mark.parametrize("noise", [0, 3])
def test_unrelated_frames(noise):
    rng = np.random.default_rng(1)
    for seed in range(4):
        frames = [
            render(Speckle(seed=s), (160, 160)) + rng.normal(0, noise, (160, 160)) for s in (seed, seed + 50)
        ]
        field = measure(*frames)
        assert (~measured.failed(field)).mean() < 0.01


def test_noise_alone():
    rng = np.random.default_rng(2)
    field = measure(*rng.normal(100, 10, (2, 160, 160)))
    assert (~measured.failed(field)).mean() < 0.01


@pytest.mark.parametrize("shift", [(150, 0), (0, -200), (90, 90)])
def test_motion_larger_than_can_be_followed(shift):
    pattern = Speckle(seed=4)
    y, x = np.mgrid[:128, :128]
    field = measure(pattern(x, y), pattern(x - shift[0], y - shift[1]))
    assert_never_confidently_wrong(field, [*shift, 0, 0, 0, 0], 0.5)


def test_a_pattern_without_texture_in_one_half():
    frame = GOOD.copy()
    frame[:, 36:] = 128
    field = measure(frame, frame + np.random.default_rng(3).normal(0, 1, frame.shape), window=15, step=4)
    flat = np.broadcast_to(field.x.values > 36 + 16, measured.failed(field).shape)
    assert measured.flagged(field, "low_texture", "unmatched")[flat].all()
    textured = np.broadcast_to(field.x.values < 24, flat.shape)
    assert not measured.failed(field)[textured].any()


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
def test_the_aperture_problem_is_flagged(angle):
    """A grating moves along its stripes without a trace: no point of it can be measured."""
    y, x = np.mgrid[:96, :96]
    phase = 2 * np.pi / 9 * (np.cos(angle) * x + np.sin(angle) * y)
    rng = np.random.default_rng(5)
    frames = [128 + 50 * np.cos(phase + s) + rng.normal(0, 1, x.shape) for s in (0, 0.3)]
    field = measure(*frames)
    assert measured.failed(field).mean() > 0.99


def test_half_of_the_moved_frame_missing():
    made = measured.ideal("speckle", 5, 128)
    frame0, frame1 = measured.noisy(made, 2)
    frame1[:, 64:] = 100
    field = measure(frame0, frame1)
    x = np.broadcast_to(field.x.values, measured.failed(field).shape)
    assert measured.failed(field)[x > 64 + 16].all()
    known = x < 64 - 31
    assert not measured.failed(field)[known].any()
    z = (measured.errors(field, made) / measured.standard_errors(field))[known]
    assert np.abs(z).max() < 6


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1e-12, 1e12, 1e30, 1e300])
def test_extreme_grey_values(scale):
    """Grey values may be in any unit."""
    made = measured.ideal("speckle", 5, 128)
    field = measure(made.frame0 * scale, made.frame1 * scale)
    kept = ~measured.failed(field)
    assert kept.mean() > 0.9
    assert np.abs(measured.errors(field, made)[kept]).max() < 0.05


def test_single_bright_pixels_do_no_harm_elsewhere():
    made = measured.ideal("speckle", 5, 128)
    frame0, frame1 = measured.noisy(made, 2)
    frame1[64, 64] = 1e5
    field = measure(frame0, frame1)
    x, y = np.meshgrid(field.x, field.y)
    far = np.hypot(x - 64, y - 64) > 50
    z = (measured.errors(field, made) / measured.standard_errors(field))[far & ~measured.failed(field)]
    assert np.abs(z).max() < 6
    assert not measured.failed(field)[far].any()
