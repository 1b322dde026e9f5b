"""Masks: bodies that move on their own are measured apart, and one mask for each frame."""

import numpy as np
import pytest

import measured
import naive
from measured import measure
from sixflow import InputError, measure_sequence
from sixflow.engine.window import window_sigma
from sixflow.masks import REACH, Bodies, Masks
from sixflow.pair import body
from sixflow.pair.body import Body
from sixflow.prepare.frame import NO_MASK
from sixflow.prepare.light import flatten_lighting
from sixflow.synth import Affine, Sensor, Speckle, pair, render

SIZE, EDGE, SHIFT = 176, 88, 1.3


def sliding(seed, noise=0.0, shift=SHIFT, size=SIZE, edge=EDGE):
    """Two half planes that slide along their common edge in opposite directions; frames and exact six by row."""
    halves = [
        pair(Speckle(seed=seed + 50 * k), Affine.translation(way * shift, 0), (size, size))
        for k, way in enumerate((1, -1))
    ]
    top = np.arange(size)[:, None] < edge
    sensor = Sensor(noise=noise, seed=seed)
    frames = [
        sensor.expose(np.where(top, *(getattr(half, name) for half in halves)), k)
        for k, name in enumerate(("frame0", "frame1"))
    ]

    def truth(y):
        six = np.zeros((*np.shape(y), 6))
        six[..., 0] = np.where(np.asarray(y) < edge, shift, -shift)
        return six

    return frames, truth, halves


def gap(width=2):
    mask = np.ones((SIZE, SIZE), bool)
    mask[EDGE - width // 2 : EDGE + width - width // 2] = False
    return mask


def labels():
    return np.where(np.arange(SIZE)[:, None] < EDGE, 1, 2) * np.ones((1, SIZE), int)


def errors(field, truth):
    y, x = np.meshgrid(field.y, field.x, indexing="ij")
    near = (
        (abs(y - EDGE + 0.5) < 10) & (abs(x - SIZE / 2) < SIZE / 2 - 36) & ~measured.flagged(field, "masked")
    )
    return (measured.six_of(field) - truth(y))[near], measured.standard_errors(field)[near], near


@pytest.mark.parametrize("mask", [gap(), labels()], ids=["gap", "labels"])
@pytest.mark.parametrize("reference", ["first", "middle", "second"])
def test_nothing_leaks_across_an_edge(mask, reference):
    frames, truth, _ = sliding(1)
    field = measure(*frames, mask=mask, step=4, reference=reference)
    error, _, near = errors(field, truth)
    assert near.sum() > 80
    assert np.isfinite(error).all()
    assert np.abs(error[:, :2]).max() < 2e-3
    assert np.abs(error[:, 2:]).max() < 2e-4
    assert set(np.unique(field.body)) <= {0, 1, 2}
    body = field.body.values[0]
    np.testing.assert_array_equal(
        body[near] == 1, np.broadcast_to(field.y.values[:, None] < EDGE, near.shape)[near]
    )


@pytest.mark.parametrize("mask", [gap(), labels()], ids=["gap", "labels"])
def test_errors_at_an_edge_are_at_the_limit(mask):
    """The Cramér–Rao value of the half windows, right up to the edge, and the predicted errors are honest."""
    noise, square, limit, z = 3, [], [], []
    for seed in range(2):
        frames, truth, halves = sliding(seed, noise)
        field = measure(*frames, mask=mask, step=4)
        error, predicted, near = errors(field, truth)
        y, x = np.mgrid[:SIZE, :SIZE]
        for k, half in enumerate(halves):
            gradient = [np.where(Bodies.of(mask).labels == k + 1, g, 0) for g in half.pattern.gradient(x, y)]
            own = near & (field.body.values[0] == k + 1)
            rows = own.any(axis=1)
            bound = naive.cramer_rao(*gradient, window_sigma(31), field.x.values, field.y.values[rows], noise)
            limit.append(np.diagonal(bound, axis1=-2, axis2=-1)[own[rows]])
            exact = truth(np.meshgrid(field.y, field.x, indexing="ij")[0])
            square.append(((measured.six_of(field) - exact) ** 2)[own])
        z.append(error / predicted)
    z, ratio = (
        np.concatenate(z),
        np.sqrt(np.concatenate(square).mean(axis=0) / np.concatenate(limit).mean(axis=0)),
    )
    scatter = 4 / np.sqrt(2 * measured.windows(len(z), 4, 31))
    np.testing.assert_allclose(measured.rms(z), 1, atol=scatter)
    # pixels within REACH of another body are not counted: up to 2 · REACH of 15 rows of a half window
    assert (ratio < 1 + 2 * REACH / 15 + scatter).all()


def test_between_bodies_nothing_is_interpolated():
    frames, truth, _ = sliding(1)
    field = measure(*frames, mask=labels(), step=8)
    dense = field.sixflow.dense()
    u = dense.u.values[0]
    known = np.isfinite(u)
    y = np.broadcast_to(np.arange(SIZE)[:, None], u.shape)
    inner = np.abs(np.arange(SIZE) - SIZE / 2) < 50
    np.testing.assert_allclose(
        u[:, inner][known[:, inner]], truth(y)[..., 0][:, inner][known[:, inner]], atol=5e-3
    )
    assert not known[(y > EDGE - 5) & (y < EDGE + 3)].any()
    assert known[(np.abs(y - EDGE) > 8) & (np.abs(y - EDGE) < 30) & inner].all()
    between = field.sixflow.sample(SIZE / 2, EDGE - 0.5)
    assert np.isnan(between.u)
    assert np.isnan(between.u_standard_error)


def test_without_bodies_the_edge_is_blended():
    """What the labels are for: one region over both halves has errors of the size of the motion."""
    frames, truth, _ = sliding(1)
    field = measure(*frames, mask=np.ones((SIZE, SIZE), bool), step=4)
    error = errors(field, truth)[0]
    assert np.isnan(error).any() or np.abs(error).max() > 0.2


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64])
def test_one_body_is_one_region(kind):
    made = pair(Speckle(), Affine.rotation(0.02, (60, 60)), (120, 120), sensor=Sensor(noise=2))
    mask = np.zeros((120, 120), bool)
    mask[20:90, 30:100] = True
    mask[50:60, 50:60] = False
    one, other = (measure(made.frame0, made.frame1, mask=m) for m in (mask, mask.astype(kind)))
    assert "body" not in one
    np.testing.assert_array_equal(one.flag, other.flag)
    np.testing.assert_array_equal(measured.six_of(one), measured.six_of(other))
    assert one.attrs["input_digest"] == other.attrs["input_digest"]


def test_equal_numbers_move_together():
    made = pair(Speckle(), Affine.translation(2.0, 1.0), (128, 128), sensor=Sensor(noise=2))
    mask = gap()[:128, :128].astype(np.uint8) * 7
    field = measure(made.frame0, made.frame1, mask=mask)
    assert "body" not in field
    apart = measure(made.frame0, made.frame1, mask=mask > 0)
    assert set(np.unique(apart.body)) == {1, 2}
    assert field.attrs["input_digest"] != apart.attrs["input_digest"]


def test_many_bodies_cost_little_more_than_one():
    """Each is measured in a part of the frames, not in all of it."""
    labels = np.zeros((400, 400), int)
    for k in range(16):
        j, i = divmod(k, 4)
        labels[100 * j + 20 : 100 * j + 80, 100 * i + 20 : 100 * i + 80] = k + 1
    seen = []
    original = Body.measure

    def spy(self, *known):
        seen.append(self.still.image.size)
        return original(self, *known)

    frame = render(Speckle(), (400, 400))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Body, "measure", spy)
        field = measure(frame, np.roll(frame, 1, axis=1), mask=labels)
    assert len(seen) == 16
    assert sum(seen) < 8 * frame.size
    assert set(np.unique(field.body)) == set(range(17))
    kept = field.body.values[0] > 0
    np.testing.assert_allclose(field.u.values[0][kept], 1, atol=0.02)


def test_one_search_for_many_bodies_begins_them_all(monkeypatch):
    made = pair(Speckle(), Affine.rotation(0.02, centre=(96, 96)), (192, 192), sensor=Sensor(noise=2))
    frame1 = made.frame1.copy()
    other = slice(64, 128), slice(0, 64)  # one tile has a motion of its own, far from that of the others
    frame1[other] = pair(Speckle(), Affine.translation(14, -11), (192, 192), sensor=Sensor(noise=2)).frame1[
        other
    ]
    tile = np.arange(192) // 64
    mask = 1 + tile[:, None] * 3 + tile
    searched = []
    find_motion = body.find_motion
    monkeypatch.setattr(body, "find_motion", lambda *args: searched.append(1) or find_motion(*args))
    field = measure(made.frame0, frame1, mask=mask)
    y, x = np.meshgrid(field.y, field.x, indexing="ij")
    own = (y > 84) & (y < 118) & (x < 40) & (x > 10)
    moves = field.u.values[0][own], field.v.values[0][own]
    for found, true in zip(moves, (14, -11), strict=True):
        np.testing.assert_allclose(found, true, atol=0.1)
    rest = (mask[np.ix_(field.y.astype(int), field.x.astype(int))] != 4) & ~measured.flagged(field, "masked")
    given = rest & np.isfinite(field.u.values[0])
    assert given.sum() > 0.9 * rest.sum()
    error = (measured.six_of(field) - made.truth(x, y)) / measured.standard_errors(field)
    assert np.abs(error[given & (field.flag.values[0] == 0)]).max() < 6
    assert 1 <= len(searched) < 9


def test_a_mask_for_each_frame():
    """A body that moves over a still background of the same texture: only pixels on it in both frames count."""
    body = pair(Speckle(seed=1), Affine.translation(6.0, 4.0), (140, 140))
    still = render(Speckle(seed=2), (140, 140))
    y, x = np.mgrid[:140, :140]
    masks = [np.hypot(x - 65 - 6 * k, y - 65 - 4 * k) < 40 for k in (0, 1)]
    frames = [np.where(m, f, still) for m, f in zip(masks, (body.frame0, body.frame1), strict=True)]
    field = measure(*frames, mask=np.stack(masks), step=4)
    kept = ~measured.failed(field)
    assert kept.sum() > 250
    assert np.abs(measured.six_of(field)[kept] - [6, 4, 0, 0, 0, 0]).max() < 0.02
    np.testing.assert_array_equal(field.body.values[0] > 0, ~measured.flagged(field, "masked"))
    one = measure(*frames, mask=masks[0], step=4)
    assert one.attrs["input_digest"] != field.attrs["input_digest"]


@pytest.mark.parametrize("form", [np.stack, list, iter, lambda masks: masks.__getitem__])
def test_masks_of_a_recording_in_any_form(form):
    frames = [render(Speckle(), (80, 90), Affine.translation(0.5 * k, 0)) for k in range(4)]
    masks = [np.zeros((80, 90), bool) for _ in frames]
    for k, mask in enumerate(masks):
        mask[10:70, 10 + 3 * k : 60 + 3 * k] = True
    field = measure_sequence(frames, mask=form(masks), window=21)
    for k in range(3):
        inside = masks[k][np.ix_(field.y, field.x)]
        np.testing.assert_array_equal(field.flag.values[k] == 1, ~inside)
        alone = measure(frames[k], frames[k + 1], mask=[masks[k], masks[k + 1]], window=21)
        np.testing.assert_allclose(field.u.values[k], alone.u.values[0], atol=1e-4)


GOOD = render(Speckle(), (64, 72))
ONES = np.ones((64, 72), bool)


@pytest.mark.parametrize(
    ("mask", "said"),
    [
        (np.ones((3, 64, 72), bool), ["mask", "(3, 64, 72)", "(2, height, width)"]),
        ([ONES, 0 * ONES], ["mask of frame 1", "False everywhere"]),
        ([0 * ONES, ONES], ["mask of frame 0", "False everywhere"]),
        ([ONES], ["mask", "1 masks", "2 frames"]),
        ([ONES, ONES[:60]], ["mask", "(60, 72)", "(64, 72)"]),
        (-labels()[:64, :72], ["mask", "from -1", "numbered from 1"]),
        (lambda number: 7.5 * ONES, ["mask of frame 0", "float64"]),
    ],
)
def test_masks_that_cannot_be_used(mask, said):
    with pytest.raises(InputError) as caught:
        measure(GOOD, GOOD, mask=mask)
    for part in said:
        assert part in str(caught.value)


def test_a_second_mask_where_there_are_no_values():
    frame = GOOD.copy()
    frame[:40] = np.nan
    second = ONES.copy()
    second[30:] = False
    with pytest.raises(InputError, match="mask of the second frame is True only where"):
        measure(GOOD, frame, mask=[ONES, second])


def test_masks_of_frames_may_be_missing():
    masks = Masks(lambda number: None if number else ONES)
    assert masks.moving
    assert masks.at(1) is None
    field = measure(GOOD, GOOD, mask=[ONES, None])
    assert (field.body == 1).all()


def test_pixels_near_another_body_do_not_count():
    mask = np.array([[1, 1, 1, 1, 1, 0, 2, 2, 2, 2], [1, 1, 1, 1, 1, 0, 2, 2, 2, 2]])
    clear = [True] * (5 + 1 - REACH) + [False] * (2 * REACH - 1) + [True] * (4 + 1 - REACH)
    assert Bodies.of(mask).clear[0].tolist() == clear
    assert Bodies.of(mask > 0).clear[0].tolist() == clear
    assert Bodies.of(mask == 1).clear is None


def test_corners_join_the_parts_of_a_mask():
    assert len(Bodies.of(np.array([[True, False], [False, True]])).boxes) == 1
    assert sorted(Bodies.of(np.array([[2**31 - 1, 0, 5]])).boxes) == [5, 2**31 - 1]


def test_local_light_of_a_region_knows_nothing_of_what_is_around():
    image = np.random.default_rng(0).normal(size=(60, 60))
    region = np.zeros((60, 60))
    region[:, :30] = 1
    spoiled = np.where(region > 0, image, 50 + 9 * image)
    one, other = (flatten_lighting(a, NO_MASK, 5.0, region)[:, :30] for a in (image, spoiled))
    np.testing.assert_allclose(one, other, atol=1e-12)
    valid = (region > 0).astype(np.uint8)
    np.testing.assert_allclose(one, flatten_lighting(image, valid, 5.0)[:, :30], atol=1e-12)


def test_local_light_inside_a_moving_body():
    """A body that gets darker before a bright, still background: its light is that of the body alone."""
    made = pair(Speckle(), Affine.translation(3.3, 1.4), (128, 128))
    y, x = np.mgrid[:128, :128]
    around = 160 + 60 * ((x // 20 + y // 20) % 2)
    frames = [
        np.where(np.hypot(x - 64 - 3.3 * k, y - 64 - 1.4 * k) < 42, [1, 0.8][k] * frame, around)
        for k, frame in enumerate((made.frame0, made.frame1))
    ]
    masks = [np.hypot(x - 64 - 3.3 * k, y - 64 - 1.4 * k) < 40 for k in (0, 1)]
    # with the background in the local mean the error is 0.08 px
    for mask, reference in ((masks, "first"), (masks[0], "second")):
        field = measure(*frames, mask=mask, lighting="local", window=25, step=4, reference=reference)
        kept = ~measured.failed(field)
        assert kept.sum() > 250
        error = (measured.six_of(field) - [3.3, 1.4, 0, 0, 0, 0])[kept]
        assert measured.rms(error)[:2].max() < 0.01
