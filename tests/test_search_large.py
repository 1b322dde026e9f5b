"""Motions that coarse to fine does not find, and pairs in which there is nothing to find."""

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import InputError, Settings
from sixflow.pair.session import Session
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.search.plane import CHANCE, find_plane
from sixflow.search.spectrum import spectrum_of
from sixflow.search.tiles import agreement, haystack
from sixflow.synth import Affine, LambOseen, Particles, Sensor, pair

SIDE = 193
CENTRE = ((SIDE - 1) / 2, (SIDE - 1) / 2)
MOTIONS = {
    "turn of 30°": Affine.rotation(np.radians(30), centre=CENTRE),
    "zoom by 1.35": Affine.zoom(1.35, centre=CENTRE),
}


def made(kind, motion, seed=0):
    return pair(measured.PATTERNS[kind](seed), motion, (SIDE, SIDE), sensor=Sensor(noise=2, seed=seed))


@pytest.mark.parametrize("kind", ["speckle", "texture"])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())
def test_large_turns_and_zooms_are_found(kind, motion):
    found = made(kind, motion)
    field = measure(found.frame0, found.frame1)
    x, y = np.meshgrid(field.x, field.y)
    u, v = np.moveaxis(found.truth(x, y)[..., :2], -1, 0)
    stays = (np.minimum(x + u, y + v) > 16) & (np.maximum(x + u, y + v) < SIDE - 17)
    assert measured.failed(field)[stays].mean() < 0.02
    good = ~measured.failed(field)
    z = (measured.errors(field, found) / measured.standard_errors(field))[good]
    assert np.abs(z[:, :2]).max() < 6


def test_the_pyramid_alone_does_not_find_them_and_says_so():
    found = made("texture", MOTIONS["turn of 30°"])
    field = measure(found.frame0, found.frame1, search="pyramid")
    assert measured.failed(field).mean() > 0.9


def test_unrelated_frames_stay_failed():
    one, other = made("speckle", Affine.translation(0, 0)), made("speckle", Affine.translation(0, 0), seed=5)
    assert measured.failed(measure(one.frame0, other.frame0)).all()


def test_a_masked_frame_has_no_plane():
    found = made("speckle", MOTIONS["turn of 30°"])
    session = Session(Settings())
    frames = [session.prepare(frame, "frame").frame for frame in (found.frame0, found.frame1)]
    assert find_plane(frames[0].within(np.zeros((SIDE, SIDE), np.uint8)), frames[1], 31) is None


def test_unknown_search():
    with pytest.raises(InputError, match="search='global': must be one of 'auto', 'pyramid', 'spectrum'"):
        Settings(search="global")


def beyond(angle=2.4, zoom=0.8, shift=(30.0, -25.0), side=SIDE):
    """A motion that neither the pyramid nor `capture` finds."""
    cosine, sine = np.cos(angle), np.sin(angle)
    F = zoom * np.array([[cosine, -sine], [sine, cosine]]) @ [[1.1, 0.05], [0.05, 0.9]]
    return Affine(shift, F - np.eye(2), ((side - 1) / 2, (side - 1) / 2))


def stays_and_right(field, made, margin=16):
    """Share of the points inside both frames that are given and right, and the number of wrong points."""
    x, y = np.meshgrid(field.x, field.y)
    error = np.linalg.norm(measured.errors(field, made)[..., :2], axis=-1)
    limit = np.maximum(0.3, 5 * measured.standard_errors(field)[..., 0])
    u, v = np.moveaxis(made.truth(x, y)[..., :2], -1, 0)
    height, width = field.attrs["frame_shape"]
    stays = np.minimum.reduce([x, y, x + u, y + v, width - 1 - x - u, height - 1 - y - v]) > margin
    good = ~measured.failed(field)
    return (good & (error < limit))[stays].mean(), int((good & (error > limit)).sum())


@pytest.mark.parametrize("kind", ["speckle", "texture"])
@pytest.mark.parametrize(
    "motion",
    [
        beyond(),
        beyond(angle=np.pi, zoom=1.0, shift=(0.0, 0.0)),
        beyond(angle=-1.3, zoom=1.7, shift=(-20.0, 40.0)),
        beyond(angle=0.7, zoom=0.55, shift=(10.0, 15.0)),
    ],
    ids=["turned, smaller, shifted", "upside down", "enlarged", "half the size"],
)
def test_any_affine_motion_is_found_and_refined_to_the_limit(kind, motion):
    found = made(kind, motion)
    field = measure(found.frame0, found.frame1)
    right, wrong = stays_and_right(field, found)
    assert right > 0.95
    assert wrong == 0
    complete = measured.complete(field)
    z = (measured.errors(field, found) / measured.standard_errors(field))[complete][:, :2]
    # of so many windows as the points stand for, to three standard errors of their spread
    count = measured.windows(complete.sum(), 8, 31)
    assert np.sqrt((z**2).mean()) < 1 + 3 / np.sqrt(2 * count)


@pytest.mark.parametrize("method", ["least_squares", "eigenfilter"])
@pytest.mark.parametrize("group", ["affine", "similarity"])
def test_every_method_turns_with_the_motion(method, group):
    found = made("speckle", Affine.rotation(2.0, centre=CENTRE))
    field = measure(found.frame0, found.frame1, method=method, group=group, step=16, search="spectrum")
    right, wrong = stays_and_right(field, found)
    assert right > 0.95
    assert wrong == 0


def test_a_turning_disc_in_a_still_surround():
    pattern, angle = measured.PATTERNS["speckle"](3), np.radians(100)
    y, x = np.mgrid[:257, :257].astype(float)
    dx, dy = x - 128, y - 128
    inside = np.hypot(dx, dy) < 75
    cosine, sine = np.cos(angle), np.sin(angle)
    still = pattern(x, y)
    turned = np.where(inside, pattern(128 + cosine * dx + sine * dy, 128 - sine * dx + cosine * dy), still)
    rng = np.random.default_rng(1)
    frames = [frame + rng.normal(0, 2, frame.shape) for frame in (still, turned)]
    field = measure(*frames)
    gx, gy = np.meshgrid(field.x - 128.0, field.y - 128.0)
    disc = np.hypot(gx, gy)
    u = np.where(disc < 75, (cosine - 1) * gx - sine * gy, 0)
    error = np.abs(field.u.values[0] - u)
    assert np.isfinite(error)[disc < 75 - 24].all()
    assert np.isfinite(error)[(disc > 75 + 24) & (measured.depth(field) > 16)].mean() > 0.97
    assert (
        error[(disc < 75 - 24) | (disc > 75 + 24)][np.isfinite(error[(disc < 51) | (disc > 99)])].max() < 0.3
    )


def test_growth_finds_the_core_of_a_swirl():
    pattern = measured.PATTERNS["texture"](2)
    y, x = np.mgrid[:257, :257].astype(float)
    dx, dy = x - 128, y - 128
    angle = -np.exp(-((np.hypot(dx, dy) / 70) ** 2))
    moved = pattern(
        128 + np.cos(angle) * dx - np.sin(angle) * dy, 128 + np.sin(angle) * dx + np.cos(angle) * dy
    )
    shares = [
        (~measured.failed(measure(pattern(x, y), moved, search=search))).mean()
        for search in ("pyramid", "auto")
    ]
    assert shares[1] > shares[0] + 0.1


class TestNothingInCommon:
    def test_no_texture(self):
        rng = np.random.default_rng(0)
        flat = [100 + rng.normal(0, 1, (96, 96)) for _ in range(2)]
        for search in ("auto", "spectrum"):
            assert measured.failed(measure(*flat, search=search)).mean() > 0.99

    def test_a_grating_has_no_map(self):
        x = np.tile(np.arange(160), (160, 1))
        frames = [Frame((50 * np.cos(x / 1.5 + phase)).astype(np.float32), NO_MASK) for phase in (0, 1)]
        assert find_plane(*frames, 31) is None

    @pytest.mark.parametrize("kind", ["speckle", "texture"])
    def test_unrelated_frames(self, kind):
        frames = [
            Frame((made(kind, Affine.translation(0, 0), seed).frame0 - 128).astype(np.float32), NO_MASK)
            for seed in (0, 7)
        ]
        assert find_plane(*frames, 31) is None

    def test_too_small_to_look_for_tiles(self):
        small = Frame(np.random.default_rng(0).normal(size=(40, 200)).astype(np.float32), NO_MASK)
        assert find_plane(small, small, 31) is None


def test_masked_pixels_do_not_count():
    found = made("speckle", beyond())
    rng = np.random.default_rng(5)
    valid = np.ones((SIDE, SIDE), np.uint8)
    valid[:, :60] = 0
    spoiled = np.where(valid, found.frame0 - 128, 500 * rng.normal(size=(SIDE, SIDE)))
    frames = Frame(spoiled.astype(np.float32), valid), Frame((found.frame1 - 128).astype(np.float32), NO_MASK)
    plane = find_plane(*frames, 31)
    np.testing.assert_allclose(plane.six[2:], np.ravel(found.motion.G), atol=0.03)


def test_the_moments_of_a_spectrum_change_with_the_map():
    motion = beyond(angle=0.6, zoom=1.2, shift=(50, 20))
    found = pair(measured.PATTERNS["texture"](1), motion, (SIDE, SIDE))
    M0, M1 = (spectrum_of(frame - 128).moments for frame in (found.frame0, found.frame1))
    A = np.eye(2) + np.array(motion.G)
    # 80 waves of a window of 193 px
    np.testing.assert_allclose(A.T @ M1 @ A, M0, atol=0.1 * np.trace(M0))


def test_tiles_that_agree_leave_no_doubt():
    found = made("speckle", Affine.translation(20, -12))
    frames = [(frame - 128).astype(np.float32) for frame in (found.frame0, found.frame1)]
    right = agreement(frames[0], NO_MASK, haystack(frames[1]), np.eye(2), 4)
    assert right.evidence > 100
    np.testing.assert_allclose(right.offset, [20, -12], atol=0.5)
    wrong = agreement(frames[0], NO_MASK, haystack(frames[1]), -np.eye(2), 4)
    assert wrong.evidence < CHANCE


def test_strong_vortices_are_found():
    """A core that turns by 0.9 rad: particle images of 2.8 px match over a few px there, and no window of 31 does."""
    found = pair(
        Particles(diameter=2.8, density=0.04, rigid=True, seed=1, unmatched=0.1),
        LambOseen(angle=0.9, core=40, centre=(128, 128)), (256, 256), sensor=Sensor(noise=3, bits=8),
    )  # fmt: skip
    field = measure(found.frame0, found.frame1, step=16, window="auto")
    error = np.hypot(*np.moveaxis(measured.errors(field, found)[..., :2], -1, 0))
    assert (error < 2).mean() > 0.9  # half the distance between particles
    assert not (error >= 2).any()
