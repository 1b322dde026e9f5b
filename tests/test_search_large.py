"""Motions that coarse to fine does not find, and pairs in which there is nothing to find."""

import numpy as np
import pytest

import measured
from sixflow import InputError, Settings, measure
from sixflow.search.captured import captured_plane
from sixflow.synth import Affine, Sensor, pair

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


def test_masked_points_are_not_asked():
    from sixflow.session import Session

    found = made("speckle", MOTIONS["turn of 30°"])
    session = Session(Settings(), None)
    frames = [session.prepare(frame, "frame").frame for frame in (found.frame0, found.frame1)]
    everywhere = np.zeros((SIDE, SIDE), np.uint8)
    assert captured_plane(frames[0].within(everywhere), frames[1], 31) is None
    assert captured_plane(*frames, 8) is None


def test_unknown_search():
    with pytest.raises(InputError, match="search='global': must be one of 'auto', 'pyramid'"):
        Settings(search="global")
