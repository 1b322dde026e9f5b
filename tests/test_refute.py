"""A neighbour's motion that fits the pixels beside a point better than its own."""

import dataclasses

import numpy as np
import pytest

import naive
from sixflow import measure
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.evidence import ERRORS, EVIDENCE, EXPLAINED, GAP, LEFT_TO_STAND, MOST_OUTLYING
from sixflow.engine.scales import OF_CONTRAST, local_contrast
from sixflow.engine.window import attenuation_period, window_sigma
from sixflow.judge.contradiction import gradient_variances
from sixflow.judge.edges import DISTANCES, refuted
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import curvature
from sixflow.pair import body
from sixflow.prepare.frame import Frame
from sixflow.synth import Affine, Sensor, Speckle, Star, pair, render
from solved import plan_of, solution_of

SHAPE, STEP, WINDOW, NOISE, EDGE = (80, 144), 8, 31, 2.0, 71.5
GRID = Grid.over(SHAPE, STEP)
JUMP = 1.5
AWAY = np.abs(GRID.x - EDGE) > STEP
"""Columns from which the discs do not reach the edge with weight."""
EVERYWHERE = np.empty((0, 0), np.uint8)


def halves(share=0.0, gain=1.0, offset=0.0, contrast=0.5, seed=3):
    """Frames whose right part is brighter and moves by −JUMP/2 before a left part that moves by JUMP/2, seen from
    where `share` of the motion is over, and the maps that are told at GRID.
    """
    x = np.arange(SHAPE[1])
    frames = []
    for k, way in enumerate((-share, 1 - share)):
        left, right = (
            contrast * (render(Speckle(seed=seed + n), SHAPE, Affine.translation(way * d, 0.0)) - 128)
            for n, d in enumerate((JUMP / 2, -JUMP / 2))
        )
        front = 1 / (1 + np.exp(-(x - EDGE + way * JUMP / 2) / 0.5))
        made = Sensor(noise=NOISE, seed=seed).expose(
            120 + (1 - front) * (left - 40) + front * (right + 40), k
        )
        frames.append(Frame(np.asarray(made * (gain if k else 1) + (offset if k else 0)), EVERYWHERE))
    maps = np.zeros((6, *GRID.shape))
    maps[0] = np.where(GRID.x < EDGE, JUMP / 2, -JUMP / 2)
    return frames, maps


def covariance():
    made = np.zeros((*GRID.shape, 6, 6))
    made[..., range(6), range(6)] = [1e-4, 1e-4, *[1e-6] * 4]
    return made


def ask(frames, maps, *, flag=None, light=None, window=WINDOW, **settings):
    flag = np.zeros(GRID.shape, np.uint16) if flag is None else flag
    found = solution_of(
        maps, window=window, covariance=covariance(), flag=flag, light=light, noise=np.full(GRID.shape, NOISE)
    )
    return refuted(*frames, GRID, found, plan_of(SHAPE, **settings))


def fattened(maps, points):
    """The right part's motion also at so many points left of the edge."""
    last = int(np.nonzero(GRID.x < EDGE)[0].max())
    wrong = np.zeros(GRID.shape, bool)
    wrong[:, last + 1 - points : last + 1] = True
    return np.where(wrong, maps[:, :, -1:], maps), wrong


def twin(frames, maps, light=None, reference="first"):
    """Every neighbour tried on all pixels, by direct sums."""
    images = [frame.image for frame in frames]
    floors = (OF_CONTRAST * local_contrast(images[0], EVERYWHERE, GRID.y, GRID.x)) ** 2
    share, sigma, degree = SHARE[reference], window_sigma(WINDOW), 5
    variances = gradient_variances(covariance())
    bend, found = curvature(maps, STEP, WINDOW), np.zeros(GRID.shape, bool)
    half = int(np.ceil(2.5 * sigma / 2))
    Y, X = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    rows, columns = GRID.shape

    def residual(motion, j, i):
        x, y = GRID.x[i] + X, GRID.y[j] + Y
        u, v = (motion[c] + motion[2 + 2 * c] * X + motion[3 + 2 * c] * Y for c in (0, 1))
        values = []
        for image, way in zip(images, (-share, 1 - share), strict=True):
            there = x + way * u, y + way * v
            inside = (
                (there[0] >= 0) & (there[0] <= SHAPE[1] - 1) & (there[1] >= 0) & (there[1] <= SHAPE[0] - 1)
            )
            placed = [np.clip(place, 0, size - 1) for place, size in zip(there, SHAPE[::-1], strict=True)]
            values.append(np.where(inside, naive.interpolate(image, *placed, degree), np.nan))
        gain, offset = (1.0, 0.0) if light is None else light[j, i]
        return (values[1] - offset) / gain - values[0]

    for j, i in np.ndindex(GRID.shape):
        mine = None
        for part in DISTANCES:
            reach = round(part * WINDOW / STEP)
            for dj, di in np.ndindex(3, 3):
                y, x = j + (dj - 1) * reach, i + (di - 1) * reach
                if (dj, di) == (1, 1) or not (0 <= y < rows and 0 <= x < columns):
                    continue
                h = np.array([(di - 1) * reach * STEP, (dj - 1) * reach * STEP])
                told = maps[:, y, x].copy()
                told[:2] -= told[2:].reshape(2, 2) @ h
                differs = False
                for c in (0, 1):
                    variance = variances[c, j, i] + variances[c, y, x]
                    variance += (
                        h[0] ** 2 * variances[2 + 2 * c, y, x] + h[1] ** 2 * variances[3 + 2 * c, y, x]
                    )
                    apart = abs(told[c] - maps[c, j, i])
                    differs |= apart > LEFT_TO_STAND + bend[j, i] + ERRORS * np.sqrt(variance)
                if not differs:
                    continue
                mine = residual(maps[:, j, i], j, i) if mine is None else mine
                other = residual(told, j, i)
                along = (X * h[0] + Y * h[1]) / np.hypot(*h)
                gap, power = GAP * WINDOW, 2 * NOISE**2
                for size in (2, 4):
                    w = np.exp(-(X**2 + Y**2) / 2 / (sigma / size) ** 2) * np.clip(
                        (along - gap) / 2 / gap, 0, 1
                    )
                    w = np.where(np.isfinite(mine + other), w, 0)
                    if not w.any():
                        continue
                    left, instead = (
                        (w * np.minimum(np.nan_to_num(r) ** 2, MOST_OUTLYING * power)).sum() / w.sum()
                        for r in (mine, other)
                    )
                    count = w.sum() ** 2 / (w**2).sum()
                    ratio = count / 2 * (left - instead) / max(min(left, instead), floors[j, i])
                    explained = instead < power * (1 + EXPLAINED * np.sqrt(2 / count))
                    found[j, i] |= explained and ratio > EVIDENCE * np.sqrt(3 * count) / 2
    return found


@pytest.mark.parametrize("reference", ["first", "middle"])
def test_agrees_with_its_twin(reference):
    frames, maps = halves(SHARE[reference])
    maps, _ = fattened(maps, 2)
    maps[:2] += np.random.default_rng(1).normal(0, 0.02, (2, *GRID.shape))
    found = ask(frames, maps, reference=reference)
    assert found.any()
    np.testing.assert_array_equal(found, twin(frames, maps, reference=reference))


@pytest.mark.parametrize("reference", ["first", "middle"])
def test_points_with_the_motion_of_the_other_side_are_refuted_and_no_others(reference):
    frames, maps = halves(SHARE[reference])
    assert not ask(frames, maps, reference=reference)[:, AWAY].any()
    maps, wrong = fattened(maps, 2)
    found = ask(frames, maps, reference=reference)
    assert found[wrong].mean() > 0.9
    assert not found[:, AWAY & ~wrong[0]].any()


def test_a_side_without_texture_decides_nothing():
    frames, maps = halves(contrast=0.0)
    maps, _ = fattened(maps, 2)
    assert not ask(frames, maps)[:, AWAY].any()


def test_light_of_the_window_is_allowed_for():
    gain, offset = 1.3, 12.0
    frames, maps = halves(gain=gain, offset=offset)
    maps, wrong = fattened(maps, 2)
    light = np.broadcast_to([gain, offset], (*GRID.shape, 2))
    found = ask(frames, maps, light=light)
    assert found[wrong].mean() > 0.9
    assert not found[:, AWAY & ~wrong[0]].any()


def test_who_is_judged_and_who_is_asked():
    frames, maps = halves()
    maps, wrong = fattened(maps, 2)
    for name, judged in (("unresolved", False), ("outlier", False), ("border", True)):
        flag = np.where(wrong, FLAGS[name], 0).astype(np.uint16)
        assert ask(frames, maps, flag=flag)[wrong].any() == judged
    for name, asked in (("unmatched", False), ("edge", True)):
        flag = np.where(wrong, 0, FLAGS[name]).astype(np.uint16)
        assert ask(frames, maps, flag=flag)[wrong].any() == asked


def test_masked_pixels_say_nothing():
    frames, maps = halves()
    maps, wrong = fattened(maps, 2)
    assert ask(frames, maps).any()
    valid = np.ones(SHAPE, np.uint8)
    valid[:, : int(EDGE)] = 0
    masked = [dataclasses.replace(frame, valid=valid) for frame in frames]
    assert not ask(masked, maps)[wrong].any()


def test_smooth_motion_to_the_limit_of_resolution_is_not_refuted():
    period = attenuation_period(window_sigma(WINDOW))
    motion = Star(amplitude=2.0, periods=(period, period), columns=(0, 255), row=127.5)
    made = pair(Speckle(), motion, (256, 256), sensor=Sensor(noise=NOISE))
    flag = measure(made.frame0, made.frame1).flag.values[0]
    assert ((flag & FAILING) != 0)[3:-3, 3:-3].mean() < 0.01


def test_fewer_points_beside_an_edge_are_wrong(monkeypatch):
    weak, strong = halves(contrast=0.3, seed=11)[0], halves(contrast=1.0, seed=12)[0]
    images = [np.concatenate([a.image, b.image]) for a, b in zip(weak, strong, strict=True)]
    wrong = []
    for asked in (False, True):
        if not asked:
            monkeypatch.setattr(body, "refuted", lambda *a: np.zeros(a[2].shape, bool))
        field = measure(*images)
        monkeypatch.undo()
        truth = np.where(field.x < EDGE, JUMP / 2, -JUMP / 2)
        error = np.abs(field.u.values[0] - truth)
        wrong.append(int((error > 0.3).sum()))
        if asked:
            edge = (field.flag.values[0] & FLAGS["edge"]) != 0
            assert not edge[:, np.abs(field.x.values - EDGE) > WINDOW].any()
    assert wrong[1] < wrong[0]


def test_a_motion_that_explains_nothing_refutes_nothing():
    """What lies beside the point belongs to neither: another pattern in frame 1."""
    frames, maps = halves()
    maps, wrong = fattened(maps, 2)
    assert ask(frames, maps)[wrong].any()
    other = frames[1].image.copy()
    other[:, int(EDGE) - 40 : int(EDGE)] = halves(seed=20)[0][1].image[:, int(EDGE) - 40 : int(EDGE)]
    assert not ask([frames[0], Frame(other, EVERYWHERE)], maps)[wrong].any()


def test_nobody_is_asked_where_no_pixel_is_foreign(monkeypatch):
    asked = []
    monkeypatch.setattr(body, "refuted", lambda *a: asked.append(a) or np.zeros(a[2].shape, bool))
    motion = Star(amplitude=1.0, periods=(120.0, 120.0), columns=(0, 127), row=63.5)
    made = pair(Speckle(), motion, (128, 128), sensor=Sensor(noise=NOISE))
    measure(made.frame0, made.frame1)
    assert not asked
