"""Frames that end within their array: what is taken for blank, what is not, and what is measured beside it."""

import numpy as np
import pytest
from scipy import ndimage

import measured
from sixflow import measure
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.prepare.nodata import blank, continued, without_blanks
from sixflow.synth import Affine, Particles, Sensor, Speckle, pair

SHAPE = (160, 160)


def made(seed=0, six=(0.5, -3.0, 0.0, 0.02, 0.0, 0.0)):
    motion = Affine.from_six(six, (79.5, 79.5))
    return pair(Speckle(seed=seed), motion, SHAPE, sensor=Sensor(noise=1, seed=seed, bits=8))


def filled(pair_of_frames, value=255):
    """Frame 1 as if software had moved frame 0: one value where frame 0 ends; and where that is."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    six = (0.5, -3.0, 0.0, 0.02, 0.0, 0.0)
    back_x = x - six[0] + six[3] / 2 * (y - 79.5)
    back_y = y - six[1] - six[3] / 2 * (x - 79.5)
    outside = (back_x < 0) | (back_y < 0) | (back_x > SHAPE[1] - 1) | (back_y > SHAPE[0] - 1)
    return np.where(outside, value, pair_of_frames.frame1).astype(np.uint8), outside


@pytest.mark.parametrize("value", [0, 128, 255])
def test_a_fill_is_found_whatever_its_value(value):
    frames = made()
    frame1, outside = filled(frames, value)
    found = blank(frame1, frames.frame0)
    # strips of less than an eighth of a side, and pixels of the pattern that have the value, may differ
    assert (found & outside).sum() > 0.95 * outside.sum()
    assert (found & ~outside).sum() < 0.02 * outside.sum()
    assert blank(frames.frame0, frame1) is None
    assert blank(frame1.astype(float) / 7, frames.frame0) is not None


def test_what_is_no_fill():
    frames = made()
    still, moved = frames.frame0, frames.frame1
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    particles = [np.round(Particles(seed=1, background=0)(x - s, y)) for s in (0, 3)]
    body = np.hypot(x - 80, y - 80) < 60
    on_black = [np.where(np.roll(body, s, 1), frame, 0) for s, frame in ((0, still), (5, moved))]
    flat = still.copy()
    flat[:, 80:] = 128
    noise = flat + np.random.default_rng(0).normal(0, 1, SHAPE)
    blob = still.copy()
    blob[:6, 40:52] = 255
    for one, other in (
        (still, moved), particles, on_black, (flat, noise), (blob, moved),
        (np.where(still > 128, 255, 0), np.where(moved > 128, 255, 0)),
    ):  # fmt: skip
        assert blank(np.asarray(one), np.asarray(other)) is None
        assert blank(np.asarray(other), np.asarray(one)) is None
    frame = Frame(still.astype(np.float32), NO_MASK)
    assert without_blanks(frame, frame) == (frame, frame, (0, 0))


def rims():
    """Where two frames have no pixel values: a frame around, corners, one corner, a strip."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return {
        "around": (np.minimum(x, y) < 8) | (np.maximum(x, y) > 151),
        "corners": (x + y < 60) | (x - y > 90) | (y - x > 110),
        "one corner": x + y < 40,
        "strip": y > 140,
    }


@pytest.mark.parametrize("value", [0, 77, 255])
@pytest.mark.parametrize("where", rims())
def test_a_rim_that_both_frames_have(where, value):
    frames, rim = made(), rims()[where]
    both = [np.where(rim, value, frame) for frame in (frames.frame0, frames.frame1)]
    for one, other in (both, both[::-1]):
        found = blank(one, other)
        # pixels of the pattern that touch the rim and have its value belong to it
        assert found[rim].all()
        assert (found & ~rim).sum() < 10
    unlike = [both[0], np.where(rim, 255 - value, frames.frame1)]
    assert blank(*unlike)[rim].all()


def test_points_beside_a_rim_that_both_frames_have():
    motion = Affine.translation(1.5, -0.7)
    frames = pair(Speckle(seed=0), motion, SHAPE, sensor=Sensor(noise=2, seed=3, bits=8))
    rim = rims()["corners"]
    field = measure(*(np.where(rim, 0, frame) for frame in (frames.frame0, frames.frame1)))
    flagged = measured.flagged(field, "masked")
    outside = rim[np.ix_(field.y.values, field.x.values)]
    assert flagged[outside].all()
    assert not flagged[~outside].any()
    failed = measured.failed(field)
    standardised = (measured.errors(field, frames) / measured.standard_errors(field))[~failed]
    assert np.abs(standardised).max() < 5


def naive_continued(image, valid, distance):
    """Of pixels beyond one straight edge on the right."""
    edge = np.flatnonzero(valid[0])[-1]
    out = image * valid
    for k in range(1, distance + 1):
        out[:, edge + k] = 2 * image[:, edge] - image[:, edge - k]
    return out


def test_images_go_on_oddly():
    image = np.random.default_rng(3).normal(size=(30, 40))
    valid = np.ones(image.shape, np.uint8)
    valid[:, 25:] = 0
    np.testing.assert_allclose(
        continued(image, valid)[:, :33], naive_continued(image, valid, 8)[:, :33], atol=1e-12
    )
    y, x = np.mgrid[:30, :40].astype(float)
    slope = 3 * x - 2 * y
    corner = np.ones(image.shape, np.uint8)
    corner[20:, 30:] = 0
    reached = ndimage.distance_transform_cdt(1 - corner, "taxicab") <= 8
    np.testing.assert_allclose(continued(slope, corner)[reached], slope[reached], atol=1e-9)
    np.testing.assert_array_equal(continued(image, np.zeros_like(valid)), 0)


def test_points_beside_a_fill():
    """Whatever is beside the fill is measured as if frame 1 ended there: within five standard errors."""
    frames = made()
    frame1, outside = filled(frames)
    field = measure(frames.frame0, frame1)
    assert "frame 1" in field.attrs["notes"]
    assert "beyond its end" in field.attrs["notes"]
    failed, (x, y) = measured.failed(field), np.meshgrid(field.x, field.y)
    truth = frames.truth(x.astype(float), y.astype(float))
    with np.errstate(invalid="ignore"):
        standardised = (measured.six_of(field) - truth) / measured.standard_errors(field)
    assert np.abs(standardised[~failed]).max() < 5
    there_x, there_y = np.round(x + truth[..., 0]).astype(int), np.round(y + truth[..., 1]).astype(int)
    inside = (there_x > 5) & (there_x < 154) & (there_y > 5) & (there_y < 154)
    well = ndimage.distance_transform_edt(~outside)[there_y.clip(0, 159), there_x.clip(0, 159)] > 5
    assert not failed[inside & well].any()
    assert measured.flagged(field, "border")[~failed & ~well].all()


@pytest.mark.parametrize(
    "options", [{"lighting": "local"}, {"reference": "second"}, {"lowpass": 0.7}, {"method": "eigenfilter"}]
)
def test_with_other_settings(options):
    frames = made(1)
    frame1, _ = filled(frames)
    field = measure(frames.frame0, frame1, **options)
    assert "beyond its end" in field.attrs["notes"]
    assert (~measured.failed(field)).mean() > 0.85


def test_not_without_robust():
    frames = made()
    assert "beyond its end" not in measure(frames.frame0, filled(frames)[0], robust=False).attrs["notes"]
