"""What stands out of its surroundings: scales of residuals, defects and changes of light, in numbers.

Each constant stands for something, and a test moves when it moves.
"""

import numpy as np
import pytest

from sixflow.engine.scales import TILE, local_contrast, median_around
from sixflow.engine.weigh import find_weights
from sixflow.prepare.defects import defects
from sixflow.prepare.frame import NO_MASK, Frame, eroded
from sixflow.prepare.nodata import within_region
from sixflow.synth import Particles, Speckle


@pytest.mark.parametrize(("size", "weight"), [(3.4, 1), (4.25, 0.54), (5.1, 0)])
@pytest.mark.parametrize("of", ["contrast", "gradient"])
def test_least_residual_that_is_foreign(of, size, weight):
    """Without noise: 3.5 to 5 times 0.02 of the contrast around, or 0.02 px of the gradient."""
    residual, gradient, still = np.zeros((3, 96, 96))
    raw, weights = np.ones((2, 96, 96))
    if of == "contrast":
        still[:] = np.where(np.arange(96) % 2, 50, -50)
        still[:48, :48] *= 1000  # elsewhere
        scale = 0.02 * 50
    else:
        gradient[:] = 30.0
        scale = 0.02 * 30
    residual[88, 88] = size * scale
    find_weights(residual, gradient, 0 * gradient, still, raw, weights)
    assert weights[88, 88] == pytest.approx(weight, abs=0.01)
    assert weights[70, 70] == 1


def test_scales_are_medians_of_25_tiles_of_16_px():
    """Twelve bright tiles of 25 change nothing, thirteen do; tiles further away never."""
    flat = np.where(np.arange(160) % 2, 1.0, -1.0) * np.ones((160, 1))
    place = np.array([72])
    for count, expected in ((12, 1.0), (13, 100.0)):
        bright = flat.copy()
        for k in range(count):
            j, i = divmod(k, 5)
            bright[32 + 16 * j : 48 + 16 * j, 32 + 16 * i : 48 + 16 * i] *= 100
        assert local_contrast(bright, NO_MASK, place, place)[0, 0] == pytest.approx(expected)
    far = flat.copy()
    far[:32], far[112:], far[:, :32], far[:, 112:] = 1e4, -1e4, 1e4, -1e4
    assert local_contrast(far, NO_MASK, place, place)[0, 0] == 1.0
    valid = np.ones((160, 160), np.uint8)
    valid[:, 16:] = 0
    assert (local_contrast(np.where(valid, flat, 1e6), valid, place, np.arange(160)) == 1).all()
    assert TILE == 16


def test_unknown_tiles_take_the_nearest_known():
    tiles = np.full((9, 9), np.nan)
    tiles[0, 0], tiles[8, 8] = 1.0, 5.0
    out = median_around(tiles, 1)
    assert out[0, 4] == out[4, 0] == 1
    assert out[4, 8] == out[8, 4] == 5
    assert np.isnan(median_around(np.full((2, 3), np.nan), 1)).all()


def lone(value, background, at=(20, 20)):
    image = background.astype(float)
    image[at] += value
    return image


def found(image, at=(20, 20), valid=NO_MASK):
    return at in zip(*defects(image, image, valid, valid).tolist(), strict=True)


def test_what_stands_out_is_a_defect():
    steps = np.where(np.arange(64) < 32, -1.0, 1.0) * np.ones((64, 1))
    assert not found(lone(0.47, steps))
    assert found(lone(0.53, steps))
    noise = np.random.default_rng(4).normal(size=(64, 64))
    noise[18:23, 18:23] = 0
    inner, opposite = noise[1:-1, 1:-1], []
    for j, i in ((0, 1), (1, 0), (1, 1), (1, -1)):
        beside = [noise[1 + s * j : 63 + s * j, 1 + s * i : 63 + s * i] for s in (1, -1)]
        opposite.append(inner - sum(beside) / 2)
    B = np.maximum(np.min(opposite, 0), 0) + np.minimum(np.max(opposite, 0), 0)
    level = 4 * np.sort(np.abs(B)[::8, ::4].ravel())[int(0.9 * 127)]
    assert not found(lone(0.97 * level, noise))
    assert found(lone(1.03 * level, noise))
    for diameter, alone in ((1.8, True), (2.0, False)):  # D = 0.9 A at 1.9 px
        particle = np.round(100 * np.exp(-8 * (np.hypot(*np.mgrid[-20:44, -20:44]) / diameter) ** 2), 1)
        assert found(particle) == alone


def test_defects_at_a_rim_and_those_far_from_a_reflection():
    steps = np.where(np.arange(64) < 32, -1.0, 1.0) * np.ones((64, 1))
    valid = np.ones((64, 64), np.uint8)
    valid[:20] = 0
    for value, expected in ((0.9, False), (1.1, True)):  # twice the level inside
        assert found(np.where(valid, lone(value, steps), 1e4), valid=valid) == expected
    wide = np.tile(steps, (5, 5))
    bright = wide.copy()
    bright[:64, :64] *= 1e4
    assert found(lone(0.53, bright, (20, 84)), (20, 84))
    assert not found(lone(0.47, bright, (20, 84)), (20, 84))


def test_peaks_that_hardly_move_are_no_defects_at_a_rim():
    Y, X = np.mgrid[:128, :128]
    for pattern in (Particles(diameter=3, seed=4), Speckle(seed=4)):
        image = np.round(pattern(X + 0.0, Y + 0.0))
        valid = (np.hypot(X - 60, Y - 64) < 44).astype(np.uint8)
        frame = within_region(Frame(image, NO_MASK), valid)
        other = within_region(Frame(np.round(pattern(X - 0.4, Y + 0.2)), NO_MASK), valid)
        at = tuple(defects(frame.image, other.image, valid, valid))
        assert eroded(valid, 1)[at].all()
