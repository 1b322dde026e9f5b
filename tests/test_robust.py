"""Foreign pixels: their weights, dead pixels, and what a measurement makes of them."""

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import InputError, Settings
from sixflow.engine.scales import FEW, NEGLIGIBLE, NORMAL, NORMAL_QUARTILE, OF_CONTRAST, REACH, TILE
from sixflow.engine.weigh import (
    FULL,
    LEAST_GAIN,
    NONE,
    by_chance,
    find_weights,
    largest_gain,
    weighing_noise,
    weight_slope,
)
from sixflow.prepare.defects import defects, repaired, without_defects
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.synth import CellularVortices, Particles, Sensor, Speckle, pair

SHAPE = (192, 192)
SIX = (1.5, -1.2, 0.006, 0.008, 0.004, -0.003)


def images(shape=(70, 90), seed=0):
    """Residual, gradients and right-hand side with some pixels that do not belong."""
    rng = np.random.default_rng(seed)
    residual, gx, gy, right = rng.normal(size=(4, *shape)).astype(np.float32)
    gx, gy = 10 * gx, 10 * gy
    residual += 0.05 * gx
    residual[20:24, 30:33] += 12
    residual[50, 10] -= 4.4
    residual[60:, 80:] = np.nan
    return residual, gx, gy, right


def naive_weight(residual, gx, gy, still, before):
    """ω from the formulas, with SciPy's interpolation between the tiles."""
    height, width = residual.shape
    tiles = -(-height // TILE), -(-width // TILE)
    scales, contrasts, changes = (
        np.full((3, *tiles), np.nan),
        np.full(tiles, np.nan),
        np.full((3, *tiles), np.nan),
    )
    for j, i in np.ndindex(*tiles):
        box = np.s_[j * TILE : (j + 1) * TILE, i * TILE : (i + 1) * TILE]
        known = np.isfinite(residual[box]) & (before[box] >= NEGLIGIBLE)
        if 4 * known.sum() < TILE**2:
            continue
        r, power, grey = (
            part[known].astype(float)
            for part in (np.abs(residual[box]), gx[box] ** 2 + gy[box] ** 2, still[box])
        )
        noise = NORMAL * np.sort(r)[len(r) // 2]
        steep = power > power.mean() / 2
        ratio = np.sort(r[steep] / np.sqrt(power[steep]))
        misfit = (NORMAL * ratio[len(ratio) // 2]) ** 2 - noise**2 * (1 / power[steep]).mean()
        dark = np.sort(grey)[len(grey) // 2]
        scales[:, j, i] = noise, np.sqrt(max(misfit, 0)), dark
        contrasts[j, i] = still[box][known].std()
        bright = np.abs(grey + residual[box][known] / 2 - dark)
        told = bright**2 > max((bright**2).mean() / 2, noise**2)
        if told.sum() >= FEW:
            ratio = np.sort(r[told] / bright[told])
            changes[:, j, i] = (
                (NORMAL_QUARTILE * ratio[len(ratio) // 4]) ** 2,
                (1 / bright[told] ** 2).mean(),
                (power[told] / bright[told] ** 2).mean(),
            )
    usual = np.empty((4, *tiles))
    for j, i in np.ndindex(*tiles):
        around = np.s_[max(0, j - REACH) : j + REACH + 1, max(0, i - REACH) : i + REACH + 1]
        noise, misfit, dark = np.nanmedian(scales[:, *around], axis=(1, 2))
        usual[:, j, i] = noise, misfit, np.nan, dark
    left = np.maximum(changes[0] - usual[0] ** 2 * changes[1] - usual[1] ** 2 * changes[2], 0)
    for j, i in np.ndindex(*tiles):
        around = np.s_[max(0, j - REACH) : j + REACH + 1, max(0, i - REACH) : i + REACH + 1]
        usual[0, j, i] = max(usual[0, j, i], OF_CONTRAST * np.nanmedian(contrasts[around]))
        usual[1, j, i] = max(usual[1, j, i], 0.02)
        usual[2, j, i] = np.sqrt(np.nanmedian(left[around]))
    y = np.clip((np.arange(height) + 0.5) / TILE - 0.5, 0, tiles[0] - 1)
    x = np.clip((np.arange(width) + 0.5) / TILE - 0.5, 0, tiles[1] - 1)

    def between(plane):
        down = np.stack([np.interp(y, np.arange(tiles[0]), column) for column in plane.T], axis=1)
        return np.stack([np.interp(x, np.arange(tiles[1]), row) for row in down])

    noise, misfit, change, dark = (between(plane) for plane in usual)
    r = residual.astype(float)
    with np.errstate(invalid="ignore"):
        allowed = noise**2 + misfit**2 * (gx.astype(float) ** 2 + gy.astype(float) ** 2)
        t2 = r**2 / (allowed + (change * (still + r / 2 - dark)) ** 2)
    own = np.clip((NONE**2 - np.nan_to_num(t2)) / (NONE**2 - FULL**2), 0, 1)
    padded = np.pad(own, 1, mode="edge")
    return np.min([padded[j : j + height, i : i + width] for j in range(3) for i in range(3)], axis=0)


def test_weights_are_those_of_the_formulas():
    residual, gx, gy, _ = (
        part.astype(float) for part in images()
    )  # a pixel that is in by rounding changes scales
    raw, weight = np.ones((2, *residual.shape))
    weight[18:26, 28:35] = 0  # these say nothing of what is usual
    still = 60 * np.random.default_rng(5).normal(size=residual.shape)
    expected = naive_weight(residual, gx, gy, still, naive_weight(residual, gx, gy, still, weight.copy()))
    before = [part.copy() for part in (residual, gx, gy)]
    find_weights(residual, gx, gy, still, raw, weight)
    np.testing.assert_allclose(weight, expected, atol=2e-4)
    assert 0 < (weight == 0).mean() < 0.05
    assert ((weight > 0) & (weight < 1)).any()
    for after, given in zip((residual, gx, gy), before, strict=True):  # the images stay as they are
        np.testing.assert_array_equal(after, given)


def test_gaussian_noise_keeps_its_weight():
    """Of Gaussian residuals 9 · 4.7e-4 of the pixels are touched."""
    rng = np.random.default_rng(1)
    residual, gx, gy, _ = rng.normal(size=(4, 256, 256)).astype(np.float32)
    raw, weight = np.ones((2, 256, 256), np.float32)
    find_weights(residual, gx, gy, gx, raw, weight)
    assert 1 - weight.mean() < 0.005


def test_scales_come_down_to_the_pixels_that_belong():
    """Blobs as bright as the pattern, over 45 % of the frame: their residuals leave the scales, then all are found."""
    rng = np.random.default_rng(8)
    residual, gx, gy, still = rng.normal(size=(4, 256, 256)).astype(np.float32)
    still *= 12
    blobs = np.zeros((256, 256), bool)
    y, x = rng.integers(0, 252, (2, 1500))
    for j, i in np.ndindex(5, 5):
        blobs[y + j, x + i] = True
    residual[blobs] += (np.where(rng.random(256) < 0.5, -12, 12) * np.ones((256, 1)))[blobs].astype(
        np.float32
    )
    raw, weight = np.ones((2, 256, 256), np.float32)
    shares = []
    for _ in range(10):
        find_weights(residual, gx, gy, still, raw, weight)
        shares.append((weight[blobs] < NEGLIGIBLE).mean())
    assert 0.4 < blobs.mean() < 0.5
    assert shares[0] < 0.95
    assert shares[-1] > 0.999
    inner = ~blobs
    for axis in (0, 1):
        for by in (-1, 1):
            inner &= ~np.roll(blobs, by, axis)
    assert weight[inner].mean() > 0.7  # the others beside a blob lose theirs


@pytest.mark.parametrize("make", [Speckle, Particles])
def test_what_matches_by_chance(make):
    """Of unrelated patterns, chance keeps less of the gradients' power than the bound, whatever is allowed."""
    xy = np.meshgrid(np.arange(512.0), np.arange(512.0))
    made = [make(seed=k).image(*xy) for k in (1, 2)]
    first, second = ((m - m.mean()) / m.std() for m in made)
    gy, gx = np.gradient((first + second) / 2)
    for ratio in (0.1, 0.2, 0.4):
        alone = np.abs(first - second) < FULL * ratio
        padded = np.pad(alone, 1, mode="edge")
        kept = np.all([padded[j : j + 512, i : i + 512] for j in range(3) for i in range(3)], axis=0)
        share = (kept * (gx**2 + gy**2)).sum() / (gx**2 + gy**2).sum()
        seen = np.sqrt(((first - second)[kept] ** 2).mean()) / first[kept].std()
        assert 0 < share < by_chance(seen)


def test_an_unresolved_motion_is_not_foreign():
    """Residuals that grow with the gradient are what a motion leaves that windows do not resolve."""
    rng = np.random.default_rng(2)
    gx, gy = 20 * rng.normal(size=(2, 256, 256)).astype(np.float32)
    wave = 0.5 * np.sin(np.arange(256) / 20).astype(np.float32)
    residual = (wave * gx + rng.normal(size=(256, 256))).astype(np.float32)
    raw, weight = np.ones((2, 256, 256), np.float32)
    find_weights(residual, gx, gy, gx, raw, weight)
    assert 1 - weight.mean() < 0.01


def faded(loss, flicker, seed=0, side=192):
    """Residual, gradients and reference of particle images that fade and are lost where they are; the noise is 1."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side]
    count = side * side // 25
    places, bright = rng.uniform(0, side, (2, count)), rng.uniform(20, 100, count)
    change, lost = np.exp(rng.normal(0, flicker, count)), rng.random(count) < loss
    frames = rng.normal(size=(2, side, side))
    for (row, column), peak, factor, gone in zip(places.T, bright, change, lost, strict=True):
        box = np.s_[max(int(row) - 5, 0) : int(row) + 6, max(int(column) - 5, 0) : int(column) + 6]
        spot = peak * np.exp(-((y[box] - row) ** 2 + (x[box] - column) ** 2))
        frames[0][box] += spot
        frames[1][box] += 0 if gone else factor * spot
    gy, gx = np.gradient(frames.mean(axis=0))
    return [part.astype(np.float32) for part in (frames[1] - frames[0], gx, gy, frames[0])]


def information_kept(residual, gx, gy, still):
    raw, weight = np.ones((2, *residual.shape), np.float32)
    find_weights(residual, gx, gy, still, raw, weight)
    return float((weight * (gx**2 + gy**2)).sum() / (gx**2 + gy**2).sum())


@pytest.mark.parametrize("flicker", [0.1, 0.3, 0.6])
def test_particles_that_flicker_are_not_outlying(flicker):
    """Changes of brightness of any size: no more than a few percent of the information is left out."""
    assert information_kept(*faded(0.0, flicker)) > 0.96


def test_lost_particles_are_outlying_where_the_others_stay():
    """Half the brightness of a lost one stays in the mean of both frames: of gradients' squares a quarter as much."""
    loss = 0.25
    share = loss / 4 / (loss / 4 + 1 - loss)
    assert information_kept(*faded(loss, 0.0)) < 1 - share
    assert information_kept(*faded(loss, 0.6)) > 0.95


def gain_of_weights(residual, gx, gy, still):
    raw, weight = np.ones((2, *residual.shape), np.float32)
    find_weights(residual, gx, gy, still, raw, weight)
    return largest_gain(residual, gx, gy, weight)


def test_weights_are_used_where_they_gain():
    """Without a speck of 5 × 5 px, or lost particles beside others that stay, the variance is less than half."""
    residual, gx, gy, still = faded(0.0, 0.0)
    speck = residual.copy()
    speck[100:105, 100:105] += 60
    assert gain_of_weights(residual, gx, gy, still) < 1.05
    assert gain_of_weights(speck, gx, gy, still) > 1.2 * LEAST_GAIN
    assert gain_of_weights(*faded(0.25, 0.0)) > 1.2 * LEAST_GAIN
    assert gain_of_weights(*faded(0.3, 0.5)) < LEAST_GAIN / 1.2


def test_gain_is_that_of_the_formula():
    residual, gx, gy, _ = (part.astype(float) for part in images((128, 64)))
    weight = np.random.default_rng(2).random(residual.shape)
    weight[3, 4] = NEGLIGIBLE / 2
    used, power, gains = np.where(weight < NEGLIGIBLE, 0, weight), gx**2 + gy**2, []
    for part in (np.s_[:64], np.s_[64:]):
        known = np.isfinite(residual[part])
        r2, w, g2 = residual[part][known] ** 2, used[part][known], power[part][known]
        gains.append((r2 * g2).sum() / g2.sum() ** 2 / ((w**2 * r2 * g2).sum() / (w * g2).sum() ** 2))
    assert largest_gain(residual, gx, gy, weight) == pytest.approx(max(gains), rel=1e-6)


def test_particles_of_a_pixel_are_measured_as_without_weights():
    pattern = Particles(diameter=1.0, density=0.03, rigid=True, seed=5)
    motion = measured.affine((3, 0, 0.02, 0, 0.02, 0), SHAPE)
    made = pair(pattern, motion, SHAPE, sensor=Sensor(noise=2, bits=8), pixel_integration=4)
    robust, plain = (measure(made.frame0, made.frame1, robust=on) for on in (True, False))
    known = ~measured.failed(robust) & ~measured.failed(plain)
    assert known.mean() > 0.95
    rms = [measured.rms(measured.errors(field, made)[known])[0] for field in (robust, plain)]
    assert rms[0] < 1.1 * rms[1]


def test_covariance_of_the_weighted_mean():
    """The factor of the M-estimate, on the mean of a contaminated normal sample."""
    rng = np.random.default_rng(3)
    n, tries = 400, 2000
    sample = rng.normal(size=(tries, n))
    sample[:, : n // 5] = rng.uniform(-10, 10, (tries, n // 5))
    mean = np.median(sample, axis=1)

    def weights(mean):
        t2 = (sample - mean[:, None]) ** 2
        return np.clip((NONE**2 - t2) / (NONE**2 - FULL**2), 0, 1)

    for _ in range(20):
        w = weights(mean)
        mean = (w * sample).sum(axis=1) / w.sum(axis=1)
    w = weights(mean)
    sandwich = ((w * (sample - mean[:, None])) ** 2).sum(axis=1) / w.sum(axis=1) ** 2
    factor = weighing_noise(w.mean(axis=1), weight_slope(w, w).mean(axis=1))[:, 0, 0]
    assert mean.var() / sandwich.mean() > 1.15
    assert mean.var() / (factor * sandwich).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / tries))


def exposed(pattern, *, seed=1, noise=2.0, **sensor):
    return pair(pattern, measured.affine(SIX, SHAPE), SHAPE, sensor=Sensor(noise=noise, seed=seed, **sensor))


def test_dead_pixels_are_found_and_no_others():
    for pattern in (Speckle(seed=4), Particles(diameter=3, seed=4), Particles(diameter=2.4, seed=5)):
        clean, dead = exposed(pattern), exposed(pattern, dead=0.02)
        assert defects(clean.frame0, clean.frame1).shape[1] < 1e-4 * clean.frame0.size
        # where nothing moves, a few of a hundred peaks of the smallest particles
        assert defects(clean.frame0, clean.frame0 + 1).shape[1] < 0.05 * 0.04 * clean.frame0.size
        is_dead, found = dead.frame0 != clean.frame0, np.zeros(SHAPE, bool)
        found[tuple(defects(dead.frame0, dead.frame1))] = True
        disturbing = (np.abs(dead.frame0 - clean.frame0) > 100) & is_dead
        assert found[disturbing].mean() > 0.4
        assert (found & ~is_dead).sum() <= 0.01 * is_dead.sum()


@pytest.mark.parametrize("diameter", [1.0, 1.3])
@pytest.mark.parametrize("shift", [0.02, 0.1])
def test_slow_particles_as_small_as_pixels_are_no_defects(diameter, shift):
    """They stay where they are and stand alone, but light the pixels beside them."""
    pattern = Particles(diameter=diameter, density=0.02, rigid=True, seed=1, unmatched=0.1)
    motion = measured.affine((shift, shift / 2, 0, 0, 0, 0), SHAPE)
    made = pair(pattern, motion, SHAPE, sensor=Sensor(noise=2, bits=8), pixel_integration=4)
    assert defects(made.frame0, made.frame1).shape[1] == 0


def test_frames_without_defects_stay_what_they_are():
    made = exposed(Speckle(seed=4))
    frames = [Frame(f, NO_MASK) for f in (made.frame0, made.frame1)]
    first, second, count = without_defects(*frames)
    assert count == 0
    assert first is frames[0]
    assert second is frames[1]


def test_repair_is_exact_for_cubics():
    y, x = np.mgrid[:30, :40] / 10.0
    image = 1 + x - 2 * y + x**3 - x * y**2 + 0.5 * y**3
    at = np.array([[5, 12, 20], [7, 30, 15]])
    spoilt = image.copy()
    spoilt[tuple(at)] = 99
    np.testing.assert_allclose(repaired(spoilt, at), image, atol=1e-10)
    assert spoilt[5, 7] == 99


CASES = {
    "unmatched particles": (Particles(diameter=4, unmatched=0.2, seed=1), {}),
    "dead pixels": (Particles(diameter=4, seed=1), {"dead": 0.05}),
    "dead pixels on speckle": (Speckle(seed=1), {"dead": 0.05}),
    "glare": (Speckle(seed=1), {"glare": 2.0}),
    "all three": (Particles(diameter=4, unmatched=0.2, seed=1), {"dead": 0.05, "glare": 2.0}),
    "half unmatched": (Particles(diameter=4, unmatched=0.5, seed=2), {}),
}


@pytest.mark.parametrize("case", CASES)
def test_foreign_pixels_do_little_harm(case):
    pattern, sensor = CASES[case]
    made = exposed(pattern, **sensor)
    robust, plain = (measure(made.frame0, made.frame1, robust=on) for on in (True, False))
    error, other = (np.abs(measured.errors(f, made)) for f in (robust, plain))
    inside = measured.depth(robust) >= 16
    known = inside & ~measured.failed(robust)
    assert known[inside].mean() > 0.97
    assert measured.rms(error[known])[0] < 0.3 * measured.rms(other[inside & ~measured.failed(plain)])[0]
    z = (error / measured.standard_errors(robust))[known]
    assert (z[:, :2] > 5).any(axis=1).mean() < 0.01
    assert 0.7 < measured.rms(z[:, :2]).mean() < 1.35  # some 36 independent windows


@pytest.mark.parametrize("diameter", [2.0, 3.0])
def test_particles_without_anything_in_common_are_flagged(diameter):
    """The dark between them matches by chance, more of it from pass to pass: nothing may be believed."""
    first, second = (exposed(Particles(diameter=diameter, seed=k), seed=k) for k in (11, 12))
    field = measure(first.frame0, second.frame1, search="pyramid")
    assert measured.failed(field).mean() > 0.95


def test_nothing_changes_where_nothing_is_foreign():
    made = exposed(Speckle(seed=2))
    robust, plain = (measure(made.frame0, made.frame1, robust=on) for on in (True, False))
    np.testing.assert_array_equal(robust.u, plain.u)
    np.testing.assert_array_equal(robust.flag, plain.flag)


def test_vortices_are_answered_as_without_weights():
    """A motion that is not resolved, on particles with shot noise: the response stays the window's."""
    made = pair(
        Particles(diameter=4, seed=3), CellularVortices(amplitude=2, period=150), SHAPE,
        sensor=Sensor(noise=1, electrons=2, seed=3),
    )  # fmt: skip
    robust, plain = (measure(made.frame0, made.frame1, robust=on) for on in (True, False))
    known = ~measured.failed(robust) & ~measured.failed(plain)
    x, y = np.meshgrid(robust.x, robust.y)
    truth = made.truth(x, y)[..., 0]
    answers = [(f.u.values[0] * truth)[known].sum() / (truth**2)[known].sum() for f in (robust, plain)]
    assert answers[0] == pytest.approx(answers[1], abs=0.01)


def test_sharpening_and_light_with_foreign_pixels():
    made = exposed(Particles(diameter=4, unmatched=0.15, seed=6), dead=0.01)
    frame1 = 1.3 * made.frame1 + 10
    field = measure(made.frame0, frame1, lighting="gain+offset", sharpen=1)
    inside = (measured.depth(field) >= 20) & ~measured.failed(field)
    assert inside.sum() > 200
    assert measured.rms(measured.errors(field, made)[inside])[0] < 0.05


def test_dead_pixels_are_noted_and_replaced_for_eigenfilters():
    made = exposed(Speckle(seed=5), dead=0.01)
    robust, plain = (
        measure(made.frame0, made.frame1, method="eigenfilter", step=16, robust=on) for on in (True, False)
    )
    assert "dead or hot pixels were replaced" in robust.attrs["notes"]
    inside = (measured.depth(robust) >= 20) & ~measured.failed(robust)
    assert inside.sum() > 50
    assert measured.rms(measured.errors(robust, made)[inside])[0] < 0.05
    # pixels that are left in stand still, and hold the field back
    assert "replaced" not in plain.attrs["notes"]
    assert "stands still" in plain.attrs["notes"]
    assert measured.rms(measured.errors(plain, made)[inside & ~measured.failed(plain)])[0] > 0.05


@pytest.mark.parametrize("name", ["robust", "forward_backward", "replace_failed"])
def test_switches_are_true_or_false(name):
    with pytest.raises(InputError, match=f"{name}=1: must be True or False"):
        Settings(**{name: 1})
