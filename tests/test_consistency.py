"""Edges, gradients and residuals against the neighbours; the round trip; replacement."""

import numpy as np
import pytest

import measured
from measured import measure
from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.contradiction import ERRORS, GRADIENT_AGREEMENT
from sixflow.engine.neighbours import AGREEMENT
from sixflow.engine.window import attenuation_period, window_sigma
from sixflow.field.dataset import SIX
from sixflow.judge.contradiction import (
    PHASE,
    SMOOTH,
    at_edge,
    disagreement,
    gradient_outliers,
    gradient_variances,
    of_smooth,
    stands_out,
)  # fmt: skip
from sixflow.judge.replace import carry, predictions
from sixflow.judge.roundtrip import closure, no_return
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import curvature
from sixflow.synth import Affine, Sensor, Speckle, pair, render

STEP, WINDOW = 8, 31
PERIOD = attenuation_period(window_sigma(WINDOW))
GRID = Grid(3, 3, STEP, 16, 14)


def random_maps(seed=0):
    rng = np.random.default_rng(seed)
    maps = GRID.plane(np.array([2.0, -1.0, 0.03, -0.05, 0.02, 0.04]))
    maps[:2] += 0.3 * rng.normal(size=(2, *GRID.shape))
    maps[2:] += 0.03 * rng.normal(size=(4, *GRID.shape))
    maps[:, 3, 4] = maps[:, 9:11, 7] = np.nan
    variances = rng.uniform(1e-6, 1e-4, (6, *GRID.shape))
    variances[2:] /= 100
    return maps, variances


def wave(period, amplitude=1.0, *, blurred=False):
    """Displacement v = A sin(ky), as a window answers it where `blurred`."""
    k = 2 * np.pi / period
    size = amplitude * (np.exp(-((k * window_sigma(WINDOW)) ** 2) / 2) if blurred else 1)
    maps = np.zeros((6, 40, 12))
    y = STEP * np.arange(40)[:, None]
    maps[1], maps[5] = size * np.sin(k * y), size * k * np.cos(k * y)
    return maps


def at(maps, c, j, i):
    rows, columns = maps.shape[1:]
    return maps[c, j, i] if 0 <= j < rows and 0 <= i < columns else np.nan


def naive_disagreement(maps, variances, period):
    k = 2 * np.pi / period
    worst = np.zeros(maps.shape[1:])
    for j, i in np.ndindex(*worst.shape):
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            length = np.hypot(dx, dy)
            n = max(1, round(PHASE / k / STEP / length))
            h = np.array([dx, dy]) * n * STEP
            smooth = SMOOTH * of_smooth(min(k * n * STEP * length, np.pi))
            for c in (0, 1):
                value, slope, variance = [], [], 0
                for sign in (-1, 0, 1):
                    place = j + sign * n * dy, i + sign * n * dx
                    g = np.array([at(maps, 2 + 2 * c, *place), at(maps, 3 + 2 * c, *place)]) @ h
                    value.append(at(maps, c, *place) - sign * g)
                    slope.append(abs(g))
                    if sign:
                        parts = [at(variances, n, *place) for n in (c, 2 + 2 * c, 3 + 2 * c)]
                        variance += np.array([1, h[0] ** 2, h[1] ** 2]) @ parts
                ratio = abs(value[0] - value[2]) / (
                    ERRORS * np.sqrt(variance) + AGREEMENT + smooth * np.nanmax([*slope, 0])
                )
                worst[j, i] = np.nanmax([worst[j, i], ratio])
    return worst


@pytest.mark.parametrize("period", [40.0, PERIOD, 300.0])
def test_disagreement(period):
    maps, variances = random_maps()
    np.testing.assert_allclose(
        disagreement(maps, variances, STEP, period), naive_disagreement(maps, variances, period), rtol=1e-9
    )


def test_gradient_outliers():
    maps, variances = random_maps(1)
    maps[2:, 6, 9] += 0.5
    maps[4, 2, 2] -= 0.4
    n = max(1, round(PHASE * PERIOD / (2 * np.pi) / STEP))
    expected = np.zeros(GRID.shape, bool)
    for j, i in np.ndindex(*GRID.shape):
        for k, (dx, dy) in zip(range(2, 6), ((1, 0), (0, 1)) * 2, strict=True):
            g, value = maps[k, j, i], k // 2 - 1
            f = at(maps, value, j + n * dy, i + n * dx) - at(maps, value, j - n * dy, i - n * dx)
            f /= 2 * n * STEP
            around = np.array(
                [at(maps, k, j + b, i + a) for a in (-n, 0, n) for b in (-n, 0, n) if (a, b) != (0, 0)]
            )
            around = around[np.isfinite(around)]
            if len(around) < 5 or not np.isfinite(g + f):
                continue
            m = np.median(around)
            tolerance = 2 * np.sqrt(variances[k, j, i]) + GRADIENT_AGREEMENT
            far = abs(g - m) > 3 * (np.median(abs(around - m)) + tolerance) + 0.5 * abs(around).max()
            expected[j, i] |= far and abs(g - f) > 3 * tolerance + 0.5 * abs(g)
    assert expected[6, 9]
    np.testing.assert_array_equal(gradient_outliers(maps, variances, STEP, PERIOD), expected)


def test_stands_out():
    rng = np.random.default_rng(2)
    noise, residual = rng.uniform(1, 2, GRID.shape), rng.uniform(0.05, 0.1, GRID.shape)
    for place, (a, b) in {(5, 5): (9, 9), (5, 9): (9, 1), (9, 5): (1, 9)}.items():
        noise[place] *= a
        residual[place] *= b
    noise[12, 12], residual[12, 12] = 20, 0.09
    found = stands_out(noise, residual, STEP, WINDOW)
    assert np.argwhere(found).tolist() == [[5, 5]]  # not brighter light alone, nor lower contrast alone


def test_waves_to_the_limit_of_resolution_agree():
    """At any amplitude; those of two thirds of that period do not."""
    nothing = np.zeros((6, 40, 12))
    for period in (PERIOD, 1.5 * PERIOD, 4 * PERIOD):
        for amplitude in (0.5, 5.0, 50.0):
            maps = wave(period, amplitude)
            assert disagreement(maps, nothing, STEP, PERIOD).max() < 1
            assert not gradient_outliers(maps, nothing, STEP, PERIOD).any()
    assert disagreement(wave(PERIOD / 1.7, 5.0), nothing, STEP, PERIOD).max() > 1


def test_curvature_is_what_neighbours_mispredict():
    """Of a parabola: ½h² d''."""
    y = STEP * np.arange(20)[:, None] * np.ones(20)
    maps = np.zeros((6, 20, 20))
    maps[1], maps[5] = 0.001 * y**2, 0.002 * y
    np.testing.assert_allclose(curvature(maps, STEP, WINDOW)[3:-3, 3:-3], 0.001 * 16**2)


def test_affine_fields_have_no_edges():
    maps = GRID.plane(np.array([2.0, -1.0, 0.3, -0.5, 0.2, 0.4]))
    nothing = np.zeros_like(maps)
    assert disagreement(maps, nothing, STEP, PERIOD).max() < 1e-9
    assert not gradient_outliers(maps, nothing, STEP, PERIOD).any()
    assert not curvature(maps, STEP, WINDOW).any()


def test_an_edge_needs_foreign_pixels():
    apart = np.array([[2.0, 2.0, 0.7, 0.7, 0.4, 0.0]])
    share = np.array([[0.0, 0.2, 0.0, 0.3, 0.0, 0.0]])
    centre = np.array([[0.0, 0.0, 0.0, 0.0, 0.9, 0.9]])
    assert at_edge(apart, share, centre).tolist() == [[False, True, False, True, True, False]]
    assert not at_edge(apart, None, None).any()


def test_gradient_variances():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 5, 6, 6))
    covariance = root @ np.swapaxes(root, -1, -2)
    transform = np.linalg.inv(SIX_FROM_GRADIENT)
    expected = np.diagonal(transform @ covariance @ transform.T, axis1=-2, axis2=-1)
    np.testing.assert_allclose(gradient_variances(covariance), np.moveaxis(expected, -1, 0))


def two_motions(size=224, jump=2.0):
    """Left half moves by (0, 0), right half by (0, jump), each with a speckle of its own."""
    halves = []
    for k in (0, 1):
        layers = [
            render(Speckle(seed=seed), (size, size), Affine.translation(0, k * v))
            for seed, v in ((1, 0.0), (2, jump))
        ]
        frame = np.where(np.arange(size) < size / 2, *layers)
        halves.append(Sensor(noise=2, seed=4).expose(frame, k))
    return halves


def test_points_at_a_motion_edge_are_flagged():
    frames = two_motions()
    field = measure(*frames)
    x = np.broadcast_to(field.x.values, field.flag.shape[1:])
    error = np.abs(field.v.values[0] - np.where(x < 112, 0.0, 2.0))
    deep = measured.depth(field) >= 16
    given = np.isfinite(error)
    far = np.abs(x - 111.5) > 24
    assert given[deep & far].mean() > 0.97
    assert measured.flagged(field, "edge")[deep & (np.abs(x - 111.5) < 6)].mean() > 0.8
    assert (error[given & deep] > 0.3).mean() < 0.02


def test_unresolved_motion_stands_and_is_flagged():
    from sixflow.synth import Star

    motion = Star(amplitude=2.0, periods=(70.0, 70.0), columns=(0, 224), row=112)
    made = pair(Speckle(seed=3), motion, (224, 224), sensor=Sensor(noise=1, seed=3))
    field = measure(made.frame0, made.frame1, window=31)
    deep = measured.depth(field) >= 24
    assert measured.flagged(field, "unresolved")[deep].mean() > 0.3
    assert not measured.flagged(field, "edge")[deep].any()
    stands = measured.flagged(field, "unresolved") & ~measured.failed(field)
    assert np.isfinite(field.v.values[0][stands]).all()


# Round trip


def test_an_affine_motion_returns():
    G = np.array([[0.02, -0.03], [0.05, 0.01]])
    d = np.array([3.0, -2.0])
    back = np.linalg.inv(np.eye(2) + G)
    maps = GRID.plane(np.array([*d, *G.ravel()]))
    backward = GRID.plane(np.array([*(-back @ d), *(back - np.eye(2)).ravel()]))
    np.testing.assert_allclose(closure(maps, backward, GRID), 0, atol=1e-9)
    covariance = np.broadcast_to(1e-4 * np.eye(6), (*GRID.shape, 6, 6))
    assert not no_return(maps, backward, covariance, covariance, GRID).any()
    maps[0, 6, 6] += 0.2
    maps[:, 2, 2] = np.nan
    found = no_return(maps, backward, covariance, covariance, GRID)
    assert np.argwhere(found).tolist() == [[6, 6]]
    backward[:, 6:9, 6:9] = np.nan  # nothing is known there
    assert not no_return(maps, backward, covariance, covariance, GRID).any()


def test_forward_backward_flags_what_does_not_return():
    made = measured.ideal("speckle", 3, 128)
    frame0, frame1 = measured.noisy(made, 2)
    field = measure(frame0, frame1, forward_backward=True)
    assert not measured.flagged(field, "forward_backward").any()
    np.testing.assert_array_equal(field.u, measure(frame0, frame1).u)


# Replacement


def test_carried_maps():
    rng = np.random.default_rng(4)
    u, v, *G = rng.normal(size=6)
    h = np.array([3.0, -5.0])
    there = np.array([u, v]) + np.reshape(G, (2, 2)) @ h
    np.testing.assert_allclose(
        carry(*h) @ SIX_FROM_GRADIENT @ [u, v, *G], SIX_FROM_GRADIENT @ [*there, *G], atol=1e-12
    )


def test_predictions_of_an_affine_field_are_exact():
    maps = GRID.plane(np.array([2.0, -1.0, 0.03, -0.05, 0.02, 0.04]))
    six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, maps, axes=1), 0, -1)
    covariance = np.broadcast_to(1e-4 * np.eye(6), (*GRID.shape, 6, 6)).copy()
    wanted = np.zeros(GRID.shape, bool)
    wanted[5:8, 5:7] = wanted[0, 0] = True
    holed = np.where(wanted[..., None], np.nan, six)
    predicted, spread, known = predictions(holed, covariance, wanted, STEP, WINDOW)
    assert known.all()  # the corner has three neighbours in reach 1, and more further out
    np.testing.assert_allclose(predicted[known], six[wanted][known], atol=1e-9)
    assert (spread[known][:, 0, 0] >= 1e-4 * (1 + 2 * 16)).all()  # u carried by gradients that are not exact
    wanted[:] = True
    assert not predictions(np.full_like(six, np.nan), covariance, wanted, STEP, WINDOW)[2].any()


def test_replaced_points_have_a_value_and_are_not_measured():
    frames = two_motions()
    plain, filled = (measure(*frames, replace_failed=on) for on in (False, True))
    replaced = measured.flagged(filled, "replaced")
    assert replaced.sum() > 20
    assert (filled.flag.values[0][replaced] & FAILING != 0).all()
    np.testing.assert_array_equal(filled.flag & ~np.uint16(FLAGS["replaced"]), plain.flag)
    for name in SIX:
        assert np.isfinite(filled[name].values[0][replaced]).all()
        np.testing.assert_array_equal(filled[name].values[0][~replaced], plain[name].values[0][~replaced])
    assert np.isnan(filled.noise.values[0][replaced]).all()
    np.testing.assert_array_equal(filled.sixflow.valid, plain.sixflow.valid)
    x = np.broadcast_to(filled.x.values, replaced.shape)
    error = np.abs(filled.v.values[0] - np.where(x < 112, 0.0, 2.0))[replaced]
    z = error / np.sqrt(filled.covariance.values[0][replaced][:, 1, 1])
    assert measured.rms(z[:, None]) < 2
