"""Doubt: points that rest on few pixels are tried again from what the others predict."""

import numpy as np
import pytest

import measured
from measured import measure
from sixflow.convention.flags import FLAGS
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.problem import MINIMUM_WEIGHT
from sixflow.search import stage
from sixflow.search.doubt import MOST, reconsidered
from sixflow.search.growth import Scene
from sixflow.synth import Affine, Particles, Sensor, pair
from solved import plan_of, solution_of

SHAPE = (10, 12)
ONES = np.ones(SHAPE)
CORNER = np.zeros(SHAPE, bool)
CORNER[:3, :3] = True


def judged(wrong=False, *, weight=None, foreign=True, failed=False):
    """A field that moves by 4 px, but for where it is wrong."""
    maps = np.zeros((6, *SHAPE))
    maps[0] = np.where(wrong, 0.0, 4.0)
    flag = np.where(np.broadcast_to(failed, SHAPE), FLAGS["outlier"], 0).astype(np.uint16)
    return solution_of(
        maps, flag=flag, weight=ONES if weight is None else weight, outlying=0 * ONES if foreign else None
    )


def scene(*answers):
    """A scene that gives these answers, one after the other, and the starts that it was asked for."""
    starts, left = [], list(answers)

    def judge(start, *_):
        starts.append(start)
        return left.pop(0)

    image = Frame(np.zeros((80, 96)), NO_MASK)
    return Scene(image, image, Grid.over((80, 96), 8), plan_of((80, 96)), judge), starts


THIN = 0.9 * MINIMUM_WEIGHT


def test_thin_points_begin_where_the_others_say():
    first, second = judged(CORNER, weight=np.where(CORNER, THIN, 1.0)), judged()
    place, starts = scene(second)
    assert reconsidered(first, place) is second
    assert len(starts) == 1
    np.testing.assert_allclose(starts[0][0], 4.0)


def test_doubts_may_become_fewer_in_steps():
    fewer = CORNER & (np.arange(12) < 2)
    first, middle = (judged(where, weight=np.where(where, THIN, 1.0)) for where in (CORNER, fewer))
    last = judged()
    assert reconsidered(first, scene(middle, last)[0]) is last
    assert reconsidered(first, scene(middle, middle)[0]) is middle


def test_a_field_with_as_many_doubts_or_failures_is_not_taken():
    first = judged(CORNER, weight=np.where(CORNER, THIN, 1.0))
    for again in (judged(CORNER, weight=np.where(CORNER, THIN, 1.0)), judged(failed=CORNER)):
        place, starts = scene(again)
        assert reconsidered(first, place) is first
        assert starts


@pytest.mark.parametrize(
    "found",
    [
        judged(),
        judged(CORNER, weight=np.where(CORNER, THIN, 1.0), foreign=False),
        judged(CORNER, weight=np.where(CORNER, THIN, 1.0), failed=CORNER),
        judged(weight=np.where(np.arange(SHAPE[1]) < (MOST + 0.2) * SHAPE[1], THIN, 1.0) * ONES),
        judged(weight=ONES * np.nan, failed=True),
    ],
    ids=["no doubt", "nothing foreign", "failed", "too many", "nothing measured"],
)
def test_nothing_is_tried(found):
    place, starts = scene()
    assert reconsidered(found, place) is found
    assert not starts


@pytest.mark.parametrize("seed", [2])
def test_dust_and_reflections_are_not_followed(seed, monkeypatch):
    """Foreign pixels that stand still, more of them than of particles, where the particles move by 5 px."""
    motion = Affine.from_six((2.0, -1.5, 0.008, 0.012, 0.006, -0.005), centre=(191.5, 191.5))
    made = pair(
        Particles(diameter=4, unmatched=0.2, seed=seed), motion, (384, 384),
        sensor=Sensor(noise=2, seed=seed, dead=0.05, glare=2.0),
    )  # fmt: skip
    field = measure(made.frame0, made.frame1)
    monkeypatch.setattr(stage, "reconsidered", lambda found, _: found)
    once = measure(made.frame0, made.frame1)
    wrong, wrong_once = (
        int((np.abs(measured.errors(f, made)[..., :2]) > 0.5).any(axis=-1).sum()) for f in (field, once)
    )
    assert wrong == 0
    assert measured.failed(field).sum() + wrong <= measured.failed(once).sum() + wrong_once
