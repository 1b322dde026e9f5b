"""Preparing frames: one order, on the raw frame; what does not count changes nothing."""

import hashlib

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import measure_sequence
from sixflow.errors import BadFrameError
from sixflow.frames.floor import Floor
from sixflow.masks import Bodies
from sixflow.prepare.defects import defects, repaired
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.prepare.image import Grey, within_range
from sixflow.prepare.interlacing import InterlacingCheck, is_interlaced
from sixflow.prepare.light import BodyLight, flattened
from sixflow.prepare.nodata import blank, within_region
from sixflow.prepare.prepare import lowpassed, prepare_frame, prepare_pair
from sixflow.synth import Affine, Sensor, Speckle, pair

SIDE = 128
Y, X = np.mgrid[:SIDE, :SIDE]
SHIFT = (1.2, -0.7)
SIX = (*SHIFT, 0.004, 0.006, 0.0, 0.0)


def made(seed=3, side=SIDE, **sensor):
    motion = Affine.from_six(SIX, ((side - 1) / 2,) * 2)
    return pair(Speckle(seed=seed), motion, (side, side), sensor=Sensor(noise=2, seed=seed, bits=8, **sensor))


def masks(kind):
    """Of both frames; the disc moves, the numbered bodies and the ring stay."""
    if kind == "disc":
        return [np.hypot(X - 60 - k * SHIFT[0], Y - 64 - k * SHIFT[1]) < 44 for k in (0, 1)]
    if kind == "bodies":
        return [np.where(np.hypot(X - 34, Y - 64) < 28, 1, 0) + np.where(X > 70, 2, 0)] * 2
    return [(np.hypot(X - 64, Y - 64) < 58) & (np.hypot(X - 64, Y - 64) > 12)] * 2


def content(kind, seed=0):
    """What may stand outside of a mask."""
    return {
        "random numbers": np.random.default_rng(seed).random((SIDE, SIDE)) * 60000,
        "glare": np.full((SIDE, SIDE), 1e4),
        "checks": (X // 16 + Y // 16) % 2 * 4000.0,
        "other rows": Y % 2 * 900.0,
        "nothing": np.full((SIDE, SIDE), np.nan),
        "values of another order": np.full((SIDE, SIDE), 1e30),
    }[kind]


def assert_same(one, other):
    """Two fields are the same to the last bit, whatever their frames' digests."""
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=name)
    for name in set(one.attrs) - {"input_digest", "memory_bytes"}:
        assert str(one.attrs[name]) == str(other.attrs[name]), name


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("disc", {}),
        ("disc", {"lighting": "local", "reference": "middle"}),
        ("bodies", {"lighting": "local", "lowpass": 1.0}),
        ("bodies", {"reference": "second", "lighting": "none"}),
        ("ring", {"lighting": "gain+offset", "reference": "middle"}),
        ("ring", {"method": "eigenfilter"}),
        ("ring", {"search": "spectrum", "lowpass": 0.7}),
        ("disc", {"window": "auto", "lighting": "local"}),
        ("disc", {"robust": False, "forward_backward": True, "lighting": "local"}),
    ],
    ids=str,
)
def test_content_outside_the_masks_changes_not_a_bit(kind, options):
    frames, inside = made(dead=0.004), masks(kind)
    fields = []
    for outside in ("random numbers", "glare", "checks", "other rows", "nothing", "values of another order"):
        spoilt = [
            np.where(mask > 0, frame, content(outside, k))
            for k, (frame, mask) in enumerate(zip((frames.frame0, frames.frame1), inside, strict=True))
        ]
        fields.append(measure(*spoilt, mask=np.stack(inside), step=16, **options))
        assert_same(fields[0], fields[-1])
    asked = ~measured.flagged(fields[0], "masked")
    assert (~measured.failed(fields[0]))[asked].mean() > 0.8


def test_content_outside_the_masks_of_a_recording_changes_not_a_bit():
    frames = [made().frame0, made().frame1, np.roll(made().frame1, 1, 0)]
    inside = np.stack([masks("ring")[0]] * 3)
    one, other = (
        measure_sequence(
            [np.where(inside[0], frame, content(outside, k)) for k, frame in enumerate(frames)],
            mask=inside, step=16, lighting="local",
        )
        for outside in ("random numbers", "glare")
    )  # fmt: skip
    assert_same(one, other)


@pytest.mark.parametrize(
    "options", [{}, {"lighting": "local", "lowpass": 0.7, "reference": "middle"}], ids=str
)
def test_values_of_pixels_without_data_change_nothing(options):
    frames, missing = made(), np.random.default_rng(1).integers(0, SIDE, (2, 40))
    fields = []
    for value in (np.nan, np.inf, -np.inf):
        spoilt = [frame.astype(float) for frame in (frames.frame0, frames.frame1)]
        for frame in spoilt:
            frame[tuple(missing)] = frame[20:60, 70:90] = value
        fields.append(measure(*spoilt, step=16, **options))
    assert_same(fields[0], fields[1])
    assert_same(fields[0], fields[2])


@pytest.mark.parametrize("options", [{}, {"reference": "middle"}], ids=str)
@pytest.mark.parametrize("outside", ["random numbers", "checks"])
def test_far_inside_a_mask_of_the_first_frame_nothing_changes(options, outside):
    """Frame 1 has no mask, and its pixels count near the rim; two ends of one iteration differ by twice 0.005 px."""
    frames = made()
    inside = np.zeros((SIDE, SIDE), bool)
    inside[8:-8, 8:-8] = True
    before = measure(frames.frame0, frames.frame1, mask=inside, step=8, **options)
    spoilt = [np.where(inside, frame, content(outside)) for frame in (frames.frame0, frames.frame1)]
    after = measure(*spoilt, mask=inside, step=8, **options)
    deep = measured.depth(before) >= 8 + 44
    assert not measured.failed(after)[deep].any()
    assert np.abs(measured.six_of(after) - measured.six_of(before))[deep][:, :2].max() < 0.01


@pytest.mark.parametrize("kind", ["none", "everything", "disc", "bodies"])
@pytest.mark.parametrize(
    "options",
    [
        {"lighting": "local"},
        {"lighting": "gain+offset", "lowpass": 0.7},
        {"lighting": "local", "lowpass": 1.0, "reference": "middle"},
        {"lighting": "local", "reference": "second"},
    ],
    ids=str,
)
def test_dead_pixels_are_replaced_before_anything_mixes_them(kind, options):
    """The error is that of frames without them; 1 % of the pixels are lost, and the spread of rms is 4/√(2n)."""
    frames = made(seed=4, side=SIDE)
    rows, columns = np.random.default_rng(7).integers(2, SIDE - 2, (2, SIDE**2 // 100))
    spoilt = [frame.copy() for frame in (frames.frame0, frames.frame1)]
    for frame in spoilt:
        frame[rows, columns] = 255
    mask = {"none": None, "everything": np.ones((SIDE, SIDE), bool)}.get(kind)
    mask = masks(kind)[0] if kind in ("disc", "bodies") else mask
    clean, dead = (
        measure(*two, mask=mask, step=8, **options) for two in ((frames.frame0, frames.frame1), spoilt)
    )
    given = ~measured.failed(clean) & (measured.depth(clean) >= 8)
    assert (~measured.failed(dead))[given].mean() > 0.97
    given &= ~measured.failed(dead)
    errors = [measured.rms(measured.errors(field, frames)[given])[:2].mean() for field in (clean, dead)]
    assert errors[1] < (1 + 4 / np.sqrt(2 * measured.windows(given.sum(), 8, 31))) * errors[0]
    assert "dead or hot pixels were replaced" in dead.attrs["notes"]
    assert "dead" not in clean.attrs["notes"]


def prepared(image, bodies=None):
    return prepare_frame(
        np.asarray(image, float), "frame", bodies, Grey(0.0, 1.0, np.float64),
        floor=Floor(), interlacing=InterlacingCheck(), lasting=True,
    )  # fmt: skip


def test_the_order():
    """No data, defects, low-pass, light: each on what the one before has left."""
    frames = made(dead=0.01)
    mask = masks("disc")
    bodies = [Bodies.of(one) for one in mask]
    two = [prepared(frame, one) for frame, one in zip((frames.frame0, frames.frame1), bodies, strict=True)]
    result = prepare_pair(*two, masks_move=True, robust=True, copies=False, lowpass=0.7)
    regions = [one.astype(np.uint8) for one in mask]
    cut = [within_region(one.frame, region) for one, region in zip(two, regions, strict=True)]
    at = defects(cut[0].image, cut[1].image, *regions)
    assert result.dead >= at.shape[1] > 20
    mended = cut[0].showing(repaired(cut[0].image, at, regions[0]))
    if result.dead == at.shape[1]:
        np.testing.assert_array_equal(result.reference.frame.image, lowpassed(mended, 0.7).image)
    assert result.reference.frame.reach == 2
    assert result.reference.digest == hashlib.sha256(frames.frame0.astype(float).tobytes()).digest()


def test_frames_of_which_nothing_is_to_be_taken_stay_what_they_are():
    """So that spline and pyramid of a frame serve both its pairs."""
    frames = made()
    two = [prepared(frame) for frame in (frames.frame0, frames.frame1)]
    result = prepare_pair(*two, masks_move=False, robust=True, copies=False, lowpass=0.0)
    assert result.reference.frame is two[0].frame
    assert result.moved.frame is two[1].frame
    again = [
        prepare_pair(*two, masks_move=False, robust=True, copies=False, lowpass=1.0).moved.frame for _ in "12"
    ]
    assert again[0] is again[1]
    assert flattened(again[0], 5.0) is flattened(again[0], 5.0)


def test_values_out_of_range():
    image, valid = np.zeros((4, 5)), np.ones((4, 5), np.uint8)
    image[1, 2] = 2e12
    inside = valid.copy()
    inside[1] = 0
    assert within_range(image / 4, NO_MASK, NO_MASK, 1.0, "frame") is NO_MASK
    assert within_range(image, valid, inside, 1.0, "frame")[1, 2] == 0
    with pytest.raises(BadFrameError, match="2e"):
        within_range(image, valid, NO_MASK, 1.0, "frame 7")


def test_interlacing_is_judged_by_pixels_that_count():
    still, moved = (Speckle()(X + 0.0 + s, Y + 0.0) for s in (0, 2))
    rows = np.where(Y % 2, moved, still)
    right = (X >= 64).astype(np.uint8)
    left_only, right_only = np.where(X < 64, rows, still), np.where(X >= 64, rows, still)
    assert is_interlaced(right_only, right)
    assert not is_interlaced(left_only, right)
    assert not is_interlaced(np.where(X < 64, 1e5 * (Y % 2), still), right)


def test_blank_rims_are_looked_for_where_pixels_count():
    other = np.random.default_rng(0).random((64, 64))
    for width, long_enough in (
        (3, False),
        (8, True),
    ):  # no two of the other 448 neighbours are equal: 3.4 px by chance
        filled = other.copy()
        filled[:3, :width] = 1
        assert (blank(filled, other) is not None) == long_enough
    seen = np.ones((64, 64), np.uint8)
    seen[:2, :10] = 0
    assert blank(filled, other, other_valid=seen) is not None
    seen[:3] = 0
    assert blank(filled, other, seen) is None
    assert blank(filled, other, other_valid=seen) is None


def test_light_of_a_body_where_the_motion_carries_it():
    from sixflow.maps.grid import Grid

    grid = Grid.over((SIDE, SIDE), 8)
    maps = np.zeros((6, *grid.shape))
    maps[0] = 10
    inside = masks("ring")[0].astype(np.uint8)
    frame = Frame(np.random.default_rng(2).normal(size=(SIDE, SIDE)), NO_MASK)
    light = BodyLight(frame, inside, grid, 6.0, False)
    still, lit = light.divided_out(frame, frame, maps, 0.0)
    assert still is frame
    there = np.roll(inside, 10, axis=1)
    expected = flattened(frame, 6.0, there)
    np.testing.assert_allclose(lit.image[:, 40:], expected.image[:, 40:], atol=1e-9)
    swapped = light.reversed.divided_out(frame, frame, -maps, 1.0)
    assert swapped[1] is frame
    np.testing.assert_allclose(swapped[0].image[:, 40:], expected.image[:, 40:], atol=1e-9)
