"""Textures that fit themselves after a period."""

import numpy as np
import pytest

from sixflow import measure
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.judge.repeats import period_of
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.synth import Affine, Particles, Sensor, Speckle, pair, render

SHAPE = (160, 160)
Y, X = np.mgrid[:160, :160].astype(float)
SIGMA = 8.7


def dots(x, y, pitch=11.0):
    return 128 + 60 * (np.cos(2 * np.pi * x / pitch) + np.cos(2 * np.pi * y / pitch))


def noisy(frame, seed):
    return frame + np.random.default_rng(seed).normal(0, 2, frame.shape)


def test_the_period_of_a_grid():
    found = period_of(Frame(noisy(dots(X, Y), 1), NO_MASK), SIGMA)
    assert found is not None
    assert np.sort(np.abs(found)) == pytest.approx([0, 11], abs=0.2)


@pytest.mark.parametrize("pattern", [Speckle(seed=3), Particles(seed=3)])
def test_random_textures_have_none(pattern):
    assert period_of(Frame(noisy(render(pattern, SHAPE), 2), NO_MASK), SIGMA) is None


def ambiguous(field):
    return (field.flag.values[0] & FLAGS["ambiguous"]) != 0


def test_a_grid_is_ambiguous_and_a_guess_settles_it():
    frames = noisy(dots(X, Y), 1), noisy(dots(X - 7.0, Y), 2)
    field = measure(*frames, window=31)
    given = (field.flag.values[0] & FAILING) == 0
    assert ambiguous(field)[2:-2, 2:-2].mean() > 0.9
    assert given.mean() < 0.05
    assert "repeats every (11, " in field.attrs["notes"] or ", 11) px" in field.attrs["notes"]
    guessed = measure(*frames, window=31, search=(7.0, 0, 0, 0, 0, 0))
    given = (guessed.flag.values[0] & FAILING) == 0
    assert given[2:-2, 2:-3].mean() > 0.95
    assert abs(float(guessed.u.median()) - 7) < 0.05


def test_what_goes_on_into_a_texture_that_does_not_repeat_is_settled():
    made = pair(Speckle(seed=4), Affine.translation(0.8, 0.4), SHAPE, sensor=Sensor(noise=2))
    part = (X < 60) & (Y < 60)
    frames = [
        np.where(part, dots(X - k * 0.8, Y - k * 0.4), frame)
        for k, frame in enumerate((made.frame0, made.frame1))
    ]
    assert not ambiguous(measure(*frames, window=31)).any()


def test_an_aperture_is_not_given():
    wave = 128 + 60 * np.cos(2 * np.pi * (X * np.cos(0.3) + Y * np.sin(0.3)) / 8)
    moved = 128 + 60 * np.cos(2 * np.pi * ((X - 0.4) * np.cos(0.3) + (Y - 0.2) * np.sin(0.3)) / 8)
    field = measure(noisy(wave, 3), noisy(moved, 4))
    assert not ((field.flag.values & FAILING) == 0).any()
