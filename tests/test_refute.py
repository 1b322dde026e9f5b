"""Points whose pixels follow another motion than their own, or none that is known."""

import dataclasses

import numpy as np
import pytest

import naive
from sixflow import measure
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.evidence import (
    DIRECTIONS,
    Compared,
    Cost,
    Other,
    cost_strip,
    differing_strip,
    gain_strip,
    out_strip,
)
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.spline import noise_variance
from sixflow.engine.window import attenuation_period, window_sigma
from sixflow.judge import edges
from sixflow.judge.edges import refuted
from sixflow.judge.usual import percentiles
from sixflow.maps.grid import Grid
from sixflow.pair import body
from sixflow.prepare.frame import Frame
from sixflow.synth import Affine, Particles, Sensor, Speckle, Star, pair, render
from solved import plan_of, solution_of

SHAPE, STEP, WINDOW, NOISE, EDGE = (80, 144), 8, 31, 2.0, 71.5
GRID = Grid.over(SHAPE, STEP)
JUMP = 1.5
BESIDE = 2 * window_sigma(WINDOW)
"""px: the disc of a point reaches over the edge up to σ, and points up to σ further are beside it."""
AWAY = np.abs(GRID.x - EDGE) > BESIDE
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


def test_cost_of_pixels():
    random = np.random.default_rng(1)
    residual, gx, gy = random.normal(0, 3, (3, *SHAPE))
    residual[5, 7] = np.nan
    noise, bias = random.uniform(1, 4, GRID.shape), random.uniform(0, 1, GRID.shape)
    made = Cost(*np.empty((3, *SHAPE)), residual, 2.5)
    cost_strip(gx, gy, noise, bias, 0.1, GRID.origin_and_step, 0, SHAPE[0], made)
    near = [
        np.abs(np.arange(size)[:, None] - places + 0.25).argmin(axis=1)
        for size, places in zip(SHAPE, (GRID.y, GRID.x), strict=True)
    ]
    power = noise[np.ix_(*near)] + 0.1 * (gx**2 + gy**2)
    expected = np.nan_to_num(np.minimum(residual**2 / (2 * power), 2.5))
    np.testing.assert_allclose(made.cost, expected, rtol=1e-12)
    explained = np.minimum(bias[np.ix_(*near)] * (gx**2 + gy**2) / (2 * power), 2.5)
    power[5, 7] = explained[5, 7] = 0
    np.testing.assert_allclose(made.power, power, rtol=1e-12)
    np.testing.assert_allclose(made.explained, explained, rtol=1e-12)


@pytest.mark.parametrize("reference", ["first", "middle"])
def test_what_another_motion_saves(reference):
    """By direct interpolation of both frames; the residual of noise has twice the variance of one frame's."""
    share, light = SHARE[reference], np.broadcast_to([1.2, 5.0], (*GRID.shape, 2))
    frames, _ = halves(share)
    random = np.random.default_rng(2)
    maps = random.normal(0, 1, (6, *GRID.shape)) * np.array([2, 2, *[0.02] * 4])[:, None, None]
    own = Cost(
        random.uniform(0, 3, SHAPE),
        np.full(SHAPE, 50.0),
        random.uniform(0, 1, SHAPE),
        random.normal(0, 9, SHAPE),
        3.0,
    )
    wanted = np.zeros(GRID.shape, bool)
    wanted[3:5, 6:9] = True
    each, images = noise_variance(5, 0.0), [frame.image.astype(float) for frame in frames]
    before, after = (Interpolant(frame.coefficients(5), EVERYWHERE, each) for frame in frames)
    out, told = np.zeros((2, *SHAPE))
    gain_strip(
        Compared(images[0], before, after, share), own, Other(maps, light, GRID.origin_and_step, 6), wanted,
        0, GRID.rows, out, told,
    )  # fmt: skip
    assert not out[: GRID.y[3] - STEP // 2].any()
    for j, i in ((3, 6), (4, 8)):
        Y, X = np.mgrid[-STEP // 2 : STEP // 2, -STEP // 2 : STEP // 2].astype(float)
        u, v = (maps[c, j, i] + maps[2 + 2 * c, j, i] * X + maps[3 + 2 * c, j, i] * Y for c in (0, 1))
        x, y = GRID.x[i] + X, GRID.y[j] + Y
        seen, variance = [], []
        for image, way in zip(images, (-share, 1 - share), strict=True):
            there = x + way * u, y + way * v
            seen.append(naive.interpolate(image, *there, 5))
            parts = [(f - np.floor(f)) * (1 - f + np.floor(f)) for f in there]
            variance.append(np.prod([1 + s * (each[0] + s * (each[1] + s * each[2])) for s in parts], axis=0))
        if share == 0:
            variance[0] = np.ones_like(x)
        r = (seen[1] - 5.0) / 1.2 - seen[0]
        r = r * np.sqrt(2 / (variance[1] / 1.2**2 + variance[0]))
        cell = slice(GRID.y[j] - 4, GRID.y[j] + 4), slice(GRID.x[i] - 4, GRID.x[i] + 4)
        np.testing.assert_allclose(
            out[cell], (own.cost - own.explained)[cell] - np.minimum(r**2 / 100, 3.0), rtol=1e-6, atol=1e-6
        )
        apart = np.minimum((r - own.residual[cell]) ** 2 / 100, 3.0)
        np.testing.assert_allclose(told[cell], apart, rtol=1e-6, atol=1e-6)


def test_motions_that_cost_a_cell_more_are_out():
    """Two rows of 8 pixels: out where they cost C more, as the sums over the whole cell's rows say."""
    frames, maps = halves()
    own = Cost(np.full(SHAPE, 0.5), np.full(SHAPE, 2 * NOISE**2), np.zeros(SHAPE), np.zeros(SHAPE), 9.2)
    each, none = noise_variance(5, 0.0), np.empty((0, 0))
    compared = Compared(
        frames[0].image,
        Interpolant(none, EVERYWHERE, each),
        Interpolant(frames[1].coefficients(5), EVERYWHERE, each),
        0.0,
    )
    for motion, stays in ((maps, True), (-maps, False)):
        other, tried = Other(motion, np.empty((0, 0, 2)), GRID.origin_and_step, 6), np.ones(GRID.shape, bool)
        out_strip(compared, own, other, 0, GRID.rows, tried)
        inner = tried[1:-1, 1:-1][:, AWAY[1:-1]]
        # χ² of 16 pixels exceeds 16 + 2 C once in 200
        assert inner.mean() > 0.975 if stays else inner.mean() < 0.05
        saved, told = np.zeros((2, *SHAPE))
        gain_strip(compared, own, other, np.ones(GRID.shape, bool), 0, GRID.rows, saved, told)
        columns = GRID.x[1:-1, None] + np.arange(-STEP // 2, STEP // 2)
        both = sum(saved[GRID.y[1:-1] + below][:, columns].sum(axis=-1) for below in (-2, 1))
        np.testing.assert_array_equal(tried[1:-1, 1:-1], -both < 9.2)


def test_who_differs():
    """Neighbours that predict another motion, by more than a limit of both errors."""
    random = np.random.default_rng(3)
    maps = random.normal(0, 0.1, (6, *GRID.shape)) * np.array([1, 1, *[0.01] * 4])[:, None, None]
    variances = np.broadcast_to(np.array([1e-3, 2e-3, *[1e-7] * 4])[:, None, None], maps.shape).copy()
    asked, judged = random.random(GRID.shape) < 0.8, random.random(GRID.shape) < 0.9
    reach, bend = random.integers(1, 4, (1, *GRID.shape)), random.uniform(0, 0.1, GRID.shape)
    found = np.zeros((8, *GRID.shape), bool)
    differing_strip(maps, variances, bend, asked, judged, reach, STEP, 2.0, 0, GRID.rows, found)
    expected = np.zeros_like(found)
    for j, i in np.argwhere(judged):
        for n, (column, row) in enumerate(DIRECTIONS):
            y, x = j + row * reach[0, j, i], i + column * reach[0, j, i]
            if 0 <= y < GRID.rows and 0 <= x < GRID.columns and asked[y, x]:
                h = STEP * reach[0, j, i] * np.array([column, row])
                G, V = maps[2:, y, x].reshape(2, 2), variances[2:, y, x].reshape(2, 2)
                apart = maps[:2, y, x] - G @ h - maps[:2, j, i]
                error = np.sqrt(variances[:2, j, i] + variances[:2, y, x] + V @ h**2)
                expected[n, j, i] = (np.abs(apart) > bend[j, i] + 2 * error).any()
    assert expected.any()
    assert not expected[:, judged].all()
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("reference", ["first", "middle"])
def test_points_with_the_motion_of_the_other_side_are_refuted_and_no_others(reference):
    frames, maps = halves(SHARE[reference])
    assert not ask(frames, maps, reference=reference)[:, AWAY].any()
    maps, wrong = fattened(maps, 2)
    found = ask(frames, maps, reference=reference)
    assert found[wrong].all()
    assert not found[:, np.abs(GRID.x - EDGE + 2 * STEP) > BESIDE + 2 * STEP].any()


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
    assert found[wrong].all()
    assert not found[:, np.abs(GRID.x - EDGE + 2 * STEP) > BESIDE + 2 * STEP].any()


def test_points_that_failed_are_not_judged():
    frames, maps = halves()
    maps, wrong = fattened(maps, 2)
    for name, judged in (("outlier", False), ("low_texture", False), ("border", True)):
        flag = np.where(wrong, FLAGS[name], 0).astype(np.uint16)
        assert ask(frames, maps, flag=flag)[wrong].any() == judged


def test_masked_pixels_say_nothing():
    frames, maps = halves()
    maps, wrong = fattened(maps, 2)
    assert ask(frames, maps).any()
    valid = np.ones(SHAPE, np.uint8)
    valid[:, : int(EDGE)] = 0
    masked = [dataclasses.replace(frame, valid=valid) for frame in frames]
    assert not ask(masked, maps)[wrong].any()


def patched(seed=3):
    """A pattern that moves by (0.6, 0.3), in frame 1 with another one in a square of 64 px."""
    first = render(Speckle(seed=seed), (192, 192))
    second = render(Speckle(seed=seed), (192, 192), Affine.translation(0.6, 0.3))
    second[64:128, 64:128] = render(Speckle(seed=seed + 50), (64, 64))
    sensor = Sensor(noise=NOISE, seed=seed)
    return sensor.expose(first, 0), sensor.expose(second, 1)


def test_what_another_body_hides_is_not_given():
    field = measure(*patched())
    x, y = np.meshgrid(field.x.values, field.y.values)
    hidden = (np.abs(x - 95.5) < 32) & (np.abs(y - 95.5) < 32)
    away = np.maximum(np.abs(x - 95.5), np.abs(y - 95.5)) > 32 + 2 * BESIDE
    failed = (field.flag.values[0] & FAILING) != 0
    border = (field.flag.values[0] & FLAGS["border"]) != 0
    assert failed[hidden].all()
    assert not failed[away & ~border].any()


@pytest.mark.parametrize(("unmatched", "density"), [(0.3, 0.05), (0.4, 0.02)])
def test_lost_particles_are_usual(unmatched, density):
    """They raise what pixels cost everywhere, and many of them in one place are no edge."""
    motion = Affine.from_six((3.3, 1.2, 0.01, 0.02, 0.01, -0.01), centre=(128, 128))
    made = pair(
        Particles(diameter=2.5, density=density, seed=6, unmatched=unmatched), motion, (256, 256),
        sensor=Sensor(noise=4, bits=8),
    )  # fmt: skip
    flag = measure(made.frame0, made.frame1).flag.values[0]
    assert ((flag & FLAGS["edge"]) != 0).mean() < 0.005


def test_what_is_usual():
    """Of normal deviates the percentile and the scatter are theirs, whatever one half of a block holds."""
    random = np.random.default_rng(4)
    m, small = 1 + 0.1 * random.normal(size=(64, 64)), 1 + 0.2 * random.normal(size=(64, 64))
    low, scatter = percentiles(m, small, 1, 32)
    np.testing.assert_allclose(low, 0.9, atol=4 * 0.1 * 1.52 / np.sqrt(32 * 32 / 4))
    np.testing.assert_allclose(scatter, 0.2, rtol=0.1)
    m[:, :32] += 50
    raised, _ = percentiles(m, small, 1, 64)
    assert (raised < 1).all()


def test_smooth_motion_to_the_limit_of_resolution_is_not_refuted():
    period = attenuation_period(window_sigma(WINDOW))
    motion = Star(amplitude=2.0, periods=(period, period), columns=(0, 255), row=127.5)
    made = pair(Speckle(), motion, (256, 256), sensor=Sensor(noise=NOISE))
    flag = measure(made.frame0, made.frame1).flag.values[0]
    assert ((flag & FAILING) != 0)[3:-3, 3:-3].mean() < 0.01


@pytest.mark.parametrize("window", [31, "auto"])
@pytest.mark.parametrize("jump", [2.0, 8.0])
def test_points_beside_a_motion_edge_are_right_or_flagged(window, jump):
    """Honest errors exceed five standard errors once in a million; at most 1 % of what is given may."""
    parts = [
        [render(Speckle(seed=30 + n), (192, 192), Affine.translation(k * d, 0)) for k in (0, 1)]
        for n, d in enumerate((jump / 2, -jump / 2))
    ]
    x, sensor = np.arange(192.0), Sensor(noise=NOISE, seed=5)
    frames = [sensor.expose(np.where(x < 96 + k * jump / 2, parts[0][k], parts[1][k]), k) for k in (0, 1)]
    field = measure(*frames, window=window).isel(time=0)
    given = (field.flag.values & FAILING) == 0
    error = np.abs(field.u.values - np.where(field.x.values < 96, jump / 2, -jump / 2))
    wrong = given & (error > 0.1) & (error > 5 * field.sixflow.standard_error("u").values)
    near = np.broadcast_to(np.abs(field.x.values - 96) < 32, given.shape)
    assert wrong[near & given].mean() < 0.01 if (near & given).any() else True
    far = np.broadcast_to(np.abs(field.x.values - 96) > 48, given.shape)
    assert given[far].mean() > 0.95


def test_no_pixel_is_asked_where_neighbours_agree(monkeypatch):
    asked = []
    monkeypatch.setattr(edges._Pixels, "of", lambda *a: asked.append(a))
    made = pair(Speckle(), Affine.rotation(0.05, centre=(64, 64)), (128, 128), sensor=Sensor(noise=NOISE))
    measure(made.frame0, made.frame1, window=31)
    assert not asked


def test_pixels_are_not_asked_without_robust(monkeypatch):
    monkeypatch.setattr(body, "refuted", lambda *a: pytest.fail("asked"))
    measure(*patched(), robust=False)


def test_a_rough_match_is_not_hidden():
    """A square in which frame 1 has much more noise is matched worse than is usual, and still is the same pattern."""
    first = render(Speckle(seed=3), (192, 192))
    second = render(Speckle(seed=3), (192, 192), Affine.translation(0.6, 0.3))
    rough = np.random.default_rng(3).normal(0, 0.25 * first.std(), (64, 64))
    second[64:128, 64:128] += rough
    sensor = Sensor(noise=NOISE, seed=3)
    field = measure(sensor.expose(first, 0), sensor.expose(second, 1))
    assert ((field.flag.values & FLAGS["edge"]) != 0).mean() < 0.01
