"""Fits within a group smaller than the affine: limit, coverage, what is assumed, bad input."""

from functools import cache

import numpy as np
import pytest

import naive
import sixflow
from measured import PATTERNS, complete, noisy, rms, six_of, standard_errors, windows
from sixflow import InputError, Settings, synth
from sixflow.convention import SIX
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.maps.restriction import (
    ABSENT,
    allowed,
    confined,
    maps_of,
    projection,
    unknowns,
    with_shared_gradients,
)

SIDE, WINDOW, STEP, NOISE = 192, 31, 8, 2.0
CENTRE = ((SIDE - 1) / 2, (SIDE - 1) / 2)
MOTIONS = {
    "translation": synth.Affine.translation(2.3, -1.7),
    "euclidean": synth.Affine.rotation(0.1, centre=CENTRE),
    "similarity": synth.Affine.from_six((1, -2, 0.05, 0.08, 0, 0), centre=CENTRE),
}
METHODS = ("least_squares", "eigenfilter")


@cache
def trials(group, method):
    """Errors, standard errors and limits of the same at points with complete windows, over some patterns."""
    found = []
    for seed in range(3):
        pattern = PATTERNS["speckle"](seed)
        made = synth.pair(pattern, MOTIONS[group], (SIDE, SIDE))
        frames = noisy(made, NOISE, seed)
        field = sixflow.measure(*frames, window=WINDOW, step=STEP, group=group, method=method)
        x, y = np.meshgrid(field.x, field.y)
        good = complete(field)
        limit = limits(group, pattern, field)
        parts = six_of(field) - made.truth(x, y), standard_errors(field), limit
        found.append([part[good] for part in parts])
    return [np.concatenate(part) for part in zip(*found, strict=True)]


def limits(group, pattern, field):
    """Standard errors of the group's fit with the true gradients, in the reference's own texture."""
    x, y = np.meshgrid(np.arange(SIDE, dtype=float), np.arange(SIDE, dtype=float))
    gx, gy = pattern.gradient(x, y)
    sigma = WINDOW / np.sqrt(4 * np.pi)
    out = np.full((len(field.y), len(field.x), 6), np.nan)
    _, basis = allowed(group, np.zeros((6, 1, 1)), sigma)
    for j, py in enumerate(field.y.values):
        for i, px in enumerate(field.x.values):
            X, Y = (x - px) / sigma, (y - py) / sigma
            near = X**2 + Y**2 < 16
            w = np.exp(-(X[near] ** 2 + Y[near] ** 2) / 2)
            J = naive.jacobian(gx[near], gy[near], X[near], Y[near])
            J = J.T if J.shape[0] != 6 else J
            P = projection((J * w) @ J.T, basis[0, 0])
            noise = 2 * NOISE**2 * (J * w**2) @ J.T
            T = naive.six_transform(sigma)
            out[j, i] = np.sqrt(np.maximum(np.diagonal(T @ P @ noise @ P.T @ T.T), 0))
    return out


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("group", MOTIONS)
def test_errors_are_those_of_the_group(group, method):
    errors, predicted, limit = trials(group, method)
    present = [k for k in range(6) if k not in ABSENT[group]]
    if group == "euclidean":
        present.remove(2)  # of second order in the angle: the limit near zero motion knows nothing of it
    sampling = 4 / np.sqrt(2 * windows(len(errors), STEP, WINDOW))
    ratio, spread = (
        rms(errors[:, present]) / rms(limit[:, present]),
        rms(errors[:, present] / predicted[:, present]),
    )
    assert (ratio < 1.15 * (1 + sampling)).all()
    assert (np.abs(spread - 1) < 0.05 + sampling).all()
    # least squares predicts what theory says, to the small part that noise adds to the texture
    if method == "least_squares":
        assert rms(predicted[:, present]) == pytest.approx(rms(limit[:, present]), rel=0.05)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("group", MOTIONS)
def test_what_the_group_does_not_have_is_zero_by_assumption(group, method):
    errors, predicted, _ = trials(group, method)
    for k in ABSENT[group]:
        assert np.abs(errors[:, k]).max() < 1e-12
        assert (predicted[:, k] == 0).all()


def test_euclidean_maps_are_rotations():
    made = synth.pair(PATTERNS["speckle"](0), MOTIONS["euclidean"], (SIDE, SIDE))
    field = sixflow.measure(made.frame0, made.frame1, group="euclidean")
    G = field.sixflow.displacement_gradient.values
    F = (G + np.eye(2))[np.isfinite(G).all(axis=(-2, -1))]
    np.testing.assert_allclose(
        np.linalg.det(F), 1, atol=1e-4
    )  # single precision, second order of the last step
    assert (complete(field) | (field.flag.values[0] > 0)).all()


def test_a_translation_follows_a_field_that_deforms():
    motion = synth.Affine.from_six((1, -2, 0.02, 0.02, 0, 0.01), centre=CENTRE)
    made = synth.pair(PATTERNS["speckle"](1), motion, (SIDE, SIDE))
    frames = noisy(made, NOISE)
    field = sixflow.measure(*frames, group="translation")
    x, y = np.meshgrid(field.x, field.y)
    # translations leave the deformation out: the points say so
    flag = field.flag.values[0]
    assert (flag[(flag & FAILING) == 0] & FLAGS["unresolved"]).astype(bool).mean() > 0.5
    whole = (flag & ~np.uint16(FLAGS["unresolved"])) == 0
    error = (six_of(field) - made.truth(x, y))[whole][:, :2]
    # the texture's centre of mass in the window is off by up to some px: that many times the gradient is its due
    assert rms(error).max() < 0.02 * 2
    assert whole.mean() > 0.5


def test_confined_is_constrained_least_squares():
    rng = np.random.default_rng(0)
    A, q = rng.normal(size=(40, 6)), rng.normal(size=40)
    base, basis = rng.normal(size=6), rng.normal(size=(6, 3))
    delta = np.linalg.lstsq(A @ basis, q - A @ base, rcond=None)[0]
    found = confined(A.T @ A, A.T @ q, base, basis)
    np.testing.assert_allclose(found, base + basis @ delta, rtol=1e-8)
    np.testing.assert_allclose(projection(A.T @ A, basis) @ A.T @ A @ basis, basis, atol=1e-8)


def test_maps_of_every_group_are_its_own():
    rng = np.random.default_rng(1)
    maps = 0.1 * rng.normal(size=(6, 2, 3))
    for group in MOTIONS:
        base, basis = allowed(group, maps, 9.0)
        assert basis.shape == (2, 3, 6, {"translation": 2, "euclidean": 3, "similarity": 4}[group])
        tangent = maps_of(base + 1e-4 * basis[..., -1], 9.0)  # one step along the last direction
        G = np.array([[tangent[2], tangent[3]], [tangent[4], tangent[5]]])
        stretch, shear = G[0, 0] - G[1, 1], G[0, 1] + G[1, 0]
        np.testing.assert_allclose([stretch, shear], 0, atol=1e-12)
    np.testing.assert_allclose(maps_of(unknowns(maps, 9.0), 9.0), maps, rtol=1e-14)


def test_gradients_that_are_shared_with_the_neighbours():
    y, x = np.mgrid[:40:8, :48:8].astype(float)
    maps = np.zeros((6, 5, 6))
    maps[0], maps[1] = 1 + 0.1 * x - 0.2 * y, 0.3 * x
    full = with_shared_gradients(maps, 8)
    for plane, value in zip(full[2:], (0.1, -0.2, 0.3, 0), strict=True):
        np.testing.assert_allclose(plane, value, atol=1e-12)
    maps[:, 2, 2] = np.nan
    assert np.isfinite(with_shared_gradients(maps, 8)[2:, 0, 0]).all()


def test_bad_input():
    with pytest.raises(InputError, match="group='projective': must be one of"):
        Settings(group="projective")
    with pytest.raises(InputError, match="sharpen=2: must be 0 with group='similarity'"):
        Settings(group="similarity", sharpen=2)
    assert len(SIX) == 6
