"""Interlacing in the content of frames: found where fields moved, and nowhere else."""

import io

import numpy as np
import pytest
from PIL import Image

import sixflow
from sixflow import synth
from sixflow.prepare.interlacing import InterlacingCheck, is_interlaced

SHAPE = (128, 160)
PATTERNS = [
    synth.Speckle(seed=1),
    synth.Speckle(seed=2, sigma=4.0),
    synth.Particles(diameter=3, density=0.04, rigid=True, seed=3),
    synth.Texture(seed=4),
]


def camera(light, noise=2.0, seed=0):
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(light + rng.normal(0, noise, light.shape)), 0, 255)


def woven(pattern, motion, seed=0):
    """A frame whose odd rows are half a frame later."""
    frame = synth.render(pattern, SHAPE)
    frame[1::2] = synth.render(pattern, SHAPE, motion.at(0.5))[1::2]
    return camera(frame, seed=seed)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("motion", [(4.3, 1.6), (3.0, 0.0), (0.0, 2.0), (-9.0, 1.0)])
def test_moving_fields_are_seen(pattern, motion):
    assert is_interlaced(woven(pattern, synth.Affine.translation(*motion)))


def test_turning_fields_are_seen():
    assert is_interlaced(woven(PATTERNS[0], synth.Affine.rotation(0.08, centre=(80, 64))))


def regular():
    """Frames with regular rows, that were all taken at once."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    speckle = synth.render(PATTERNS[0], SHAPE)
    for period in (2, 3, 4, 5, 8):
        yield camera(128 + 60 * np.sin(2 * np.pi * (0.8 * y + 0.6 * x) / period))
        yield camera(60 + 120.0 * ((y // period + x // period) % 2))
    yield camera(100.0 * ((y % 8 < 2) | (x % 8 < 2)))
    yield camera(speckle + 8 * (y % 2))
    yield camera(speckle * (1 - 0.2 * (y % 2)))
    yield camera(speckle * np.where((y % 2 == 0) & (x % 2 == 0), 0.5, np.where((y % 2) & (x % 2), 0.7, 1)))
    yield camera(speckle + np.random.default_rng(1).normal(0, 8, (SHAPE[0], 1)))
    yield camera(speckle[:64, :80].repeat(2, 0).repeat(2, 1))
    yield camera(np.where(x + 3 * y < 250, 40.0, 180.0), noise=0)
    for quality in (10, 50):
        store = io.BytesIO()
        Image.fromarray(camera(speckle).astype(np.uint8)).save(store, "JPEG", quality=quality)
        yield np.asarray(Image.open(store), float)


@pytest.mark.parametrize("number", range(19))
def test_regular_frames_are_not(number):
    frame = list(regular())[number]
    assert not is_interlaced(frame)
    assert not is_interlaced(frame.T)


def test_no_false_alarms():
    for seed in range(3):
        for kind in (
            synth.Speckle(seed=seed),
            synth.Particles(seed=seed, diameter=2),
            synth.Texture(seed=seed),
        ):
            for noise in (0, 5):
                assert not is_interlaced(camera(synth.render(kind, SHAPE), noise, seed))
        assert not is_interlaced(np.random.default_rng(seed).normal(size=SHAPE))


def test_frames_without_content_or_room():
    assert not is_interlaced(np.full(SHAPE, 7.0))
    assert not is_interlaced(np.zeros((64, 500)))
    assert not is_interlaced(np.zeros((500, 79)))


def test_told_once_in_the_first_frames():
    still, moved = (
        camera(synth.render(PATTERNS[0], SHAPE)),
        woven(PATTERNS[0], synth.Affine.translation(3, 1)),
    )
    check = InterlacingCheck()
    said = [check.notes(frame, f"frame {k}") for k, frame in enumerate([still, moved, moved])]
    assert [len(notes) for notes in said] == [0, 1, 0]
    assert said[1][0].startswith("frame 1: even and odd rows do not fit together: the frame is interlaced")
    check = InterlacingCheck()
    assert not any(check.notes(frame, "") for frame in [still] * 4 + [moved])


def test_measure_tells():
    motion = synth.Affine.translation(4.3, 1.6)
    later = synth.render(PATTERNS[2], SHAPE, motion.at(1.0))
    later[1::2] = synth.render(PATTERNS[2], SHAPE, motion.at(1.5))[1::2]
    field = sixflow.measure(woven(PATTERNS[2], motion), camera(later, seed=1), step=32)
    assert "interlaced" in field.attrs["notes"]
