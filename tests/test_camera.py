"""What matched tiles show of the camera: light that changes unevenly, frames of unlike sharpness, what stands still."""

import re

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter1d

import measured
from sixflow import measure
from sixflow.judge.spectra import Spectra
from sixflow.judge.standing import stands_still
from sixflow.maps.grid import Grid
from sixflow.prepare.defects import repaired
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.prepare.lighting import Change
from sixflow.prepare.tiles import SIDE, Tiles
from sixflow.synth import Affine, Particles, Sensor, Speckle, pair, render

SHAPE = (224, 224)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]]
RAMP = X / 111.5 - 1


def grey(light, noise, seed):
    return np.clip(np.rint(light + np.random.default_rng(seed).normal(0, noise, SHAPE)), 0, 255).astype(
        np.uint8
    )


def moved(motion, pattern=None):
    pattern = Speckle(seed=1) if pattern is None else pattern
    return render(pattern, SHAPE), render(pattern, SHAPE, motion)


def tiles_of(first, second, motion, known=slice(None)):
    """Tiles by the true motion."""
    grid = Grid.over(SHAPE, 8)
    maps = np.full((6, *grid.shape), np.nan)
    x, y = np.meshgrid(grid.x.astype(float), grid.y.astype(float))
    maps[:2, known] = np.stack(motion.displacement(x, y))[:, known]
    maps[2:, known] = 0
    frames = (Frame(np.asarray(frame, np.float32), NO_MASK) for frame in (first, second))
    return Tiles.matched(*frames, grid, maps)


# Tiles


def test_tiles_hold_the_same_piece_of_the_pattern():
    motion = Affine.translation(2.3, -1.6)
    tiles = tiles_of(*moved(motion), motion)
    assert tiles.count > 30
    np.testing.assert_allclose(tiles.rest, np.broadcast_to([0.3, 0.4], tiles.rest.shape), atol=1e-9)
    mean, contrast = tiles.light
    # the tapers lie alike on the pattern: what is left is the sampling of a band-limited pattern
    np.testing.assert_allclose(mean[1], mean[0], atol=0.02)
    np.testing.assert_allclose(contrast[1] / contrast[0], 1, atol=1e-3)
    spectra = Spectra.of(tiles)
    phase = np.angle(spectra.cross.sum(axis=0))[[1, 2, 3, -1, -2, -3], 1:4]
    assert np.abs(phase).max() < 0.01


def test_tiles_only_where_all_pixels_count():
    motion = Affine.translation(0.5, 0.5)
    first, second = (frame.astype(np.float32) for frame in moved(motion))
    valid = np.ones(SHAPE, np.uint8)
    valid[:, 112:] = 0
    grid = Grid.over(SHAPE, 8)
    maps = np.zeros((6, *grid.shape))
    tiles = Tiles.matched(Frame(first, valid), Frame(second, NO_MASK), grid, maps)
    assert tiles.count > 0
    assert (tiles.x + SIDE // 2 <= 112).all()
    assert Tiles.matched(Frame(first, 0 * valid), Frame(second, NO_MASK), grid, maps).count == 0
    assert Spectra.of(tiles_of(first, second, motion, known=slice(0, 1))) is None  # too few


# Light

LIGHTS = {
    "tilt of 3 %": 1 + 0.03 * RAMP,
    "tilt of 15 %": 1 + 0.15 * RAMP,
    "tilt of 30 %": 1 + 0.3 * RAMP,
    "vignetting": 1 - 0.15 * (RAMP**2 + RAMP.T**2),
    "lamp": np.full(SHAPE, 0.6),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_light_that_changes_unevenly(name):
    motion = Affine.from_six((0.3, -0.2, 0.004, 0.002, 0.006, 0.001), (112, 112))
    made = pair(Speckle(seed=5), motion, SHAPE)
    frames = grey(made.frame0, 2, 1), grey(made.frame1 * LIGHTS[name], 2, 2)
    fields = [measure(*frames, window=31, **options) for options in ({}, {"lighting": "gain+offset"})]
    assert "the light changed" in fields[0].attrs["notes"]
    given = [~measured.failed(field) for field in fields]
    assert given[0].mean() > given[1].mean() - 0.02
    z = (measured.errors(fields[0], made) / measured.standard_errors(fields[0]))[measured.complete(fields[0])]
    assert np.abs(z[:, :2]).max() < 5
    assert "the light changed" not in measure(grey(made.frame0, 2, 1), grey(made.frame1, 2, 2)).attrs["notes"]


@pytest.mark.parametrize("ramp", [RAMP, RAMP**2, np.ones(SHAPE)])
def test_a_smooth_change_is_found_beside_scatter(ramp):
    """Particles of which a fifth is lost: the tiles' contrast scatters by some percent, whatever the light does."""
    motion = Affine.translation(1.3, -0.6)
    made = pair(Particles(diameter=3, density=0.04, seed=2, unmatched=0.2), motion, SHAPE)
    for amount, expected in ((0.0, False), (0.3, True)):
        tiles = tiles_of(made.frame0, made.frame1 * (1 + amount * ramp), motion)
        change = Change.between(tiles)
        assert change.seen == expected
        assert change.matters(tiles, 2.0, 8.7) == expected
    x, y = tiles.x, tiles.y
    np.testing.assert_allclose(change.gain, 1 + 0.3 * ramp[y, x], atol=0.1)


# Sharpness

BLURS = {
    "motion along x": (lambda frame: uniform_filter1d(frame, 7, axis=1), 2.0, 0),
    "motion along y": (lambda frame: uniform_filter1d(frame, 7, axis=0), 2.0, 90),
}


@pytest.mark.parametrize("name", BLURS)
@pytest.mark.parametrize("which", [0, 1])
def test_a_frame_that_is_less_sharp(name, which):
    blur, width, angle = BLURS[name]
    frames = list(moved(Affine.translation(0.4, 0.3), Speckle(sigma=2.5, seed=7)))
    frames[which] = blur(frames[which])
    field = measure(grey(frames[0], 2, 1), grey(frames[1], 2, 2), window=31)
    told = re.search(
        r"frame (\d) is less sharp than frame (\d): .* of ([\d.]+) px more along (\d+)°", field.attrs["notes"]
    )
    assert told.group(1, 2) == (str(which), str(1 - which))
    assert float(told[3]) == pytest.approx(width, rel=0.15)
    assert abs((float(told[4]) - angle + 90) % 180 - 90) < 5


@pytest.mark.parametrize(("sigma", "stretch"), [(3, 0.03), (4, 0.04), (2, -0.06)])
def test_a_deformation_is_no_blur(sigma, stretch):
    """It changes spectra by ½ kᵀGk: of a texture of width s like a blur of 2 s² G, 0.5 to 1.3 px² here."""
    motion = Affine.from_six((0.2, 0.1, stretch, 0, stretch, 0), (112, 112))
    frames = moved(motion, Speckle(sigma=sigma, seed=7))
    assert "sharp" not in measure(grey(frames[0], 0.5, 1), grey(frames[1], 0.5, 2), window=31).attrs["notes"]


def test_blur_is_measured():
    motion = Affine.translation(1.2, -0.7)
    first, second = moved(motion)
    soft = gaussian_filter(second, 1.0)
    tiles = tiles_of(grey(first, 0.3, 1), grey(soft, 0.3, 2), motion)
    blur = Spectra.of(tiles).blur()
    assert blur.frame == 1
    assert blur.width == pytest.approx(1.0, rel=0.15)  # the taper smears the spectrum
    assert Spectra.of(tiles_of(grey(first, 0.3, 1), grey(second, 0.3, 2), motion)).blur() is None


# What stands still

MOSAIC = np.ones(SHAPE)
MOSAIC[::2, ::2], MOSAIC[1::2, 1::2] = 0.5, 0.7
COLUMNS = np.random.default_rng(3).normal(0, 8, (1, SHAPE[1]))
PIXELS = np.random.default_rng(3).normal(0, 4, SHAPE)


def with_pattern(name, frame):
    return {
        "mosaic": frame * MOSAIC,
        "columns": frame + COLUMNS,
        "rows": frame + COLUMNS.T,
        "pixels": 128 + 0.3 * (frame - 128) + PIXELS,
        "grid": 0.6 * frame + 40 + 60 * np.sin(2 * np.pi * X / 5.3) * np.sin(2 * np.pi * Y / 6.1),
    }[name]


@pytest.mark.parametrize("six", [(0.4, 0.3, 0, 0, 0, 0), (-0.2, 0.5, 0, 0.006, 0, 0)], ids=["shift", "turn"])
@pytest.mark.parametrize("name", ["mosaic", "columns", "rows", "pixels", "grid"])
def test_what_stands_still_is_told(name, six):
    motion = Affine.from_six(six, (112, 112))
    frames = [grey(with_pattern(name, frame), 1, k) for k, frame in enumerate(moved(motion))]
    assert "stands still" in measure(*frames, window=31).attrs["notes"]


def test_what_holds_a_field_back_is_in_its_errors():
    frames = [
        grey(with_pattern("pixels", frame), 1, k)
        for k, frame in enumerate(moved(Affine.translation(0.4, 0.3)))
    ]
    field = measure(*frames, window=31)
    off = np.hypot(field.u - 0.4, field.v - 0.3)
    said = np.hypot(*(field.sixflow.standard_error(name) for name in ("u", "v")))
    assert float((off / said).median()) < 3
    noise = np.sqrt(field.covariance.values[..., 0, 0] + field.covariance.values[..., 1, 1])
    assert np.nanmedian(off.values / noise) > 5


CLEAN = {
    "speckle": Speckle(seed=1),
    "fine": Speckle(sigma=1.2, seed=2),
    "coarse": Speckle(sigma=5, seed=3),
    "particles": Particles(diameter=2.5, density=0.03, seed=4),
    "lost": Particles(diameter=3, density=0.04, seed=5, unmatched=0.2),
}


@pytest.mark.parametrize("name", CLEAN)
@pytest.mark.parametrize("shift", [(0.4, 0.3), (2.7, -1.2), (0.0, 0.0)], ids=str)
def test_a_clean_pair_has_no_notes(name, shift):
    made = pair(CLEAN[name], Affine.translation(*shift), SHAPE, sensor=Sensor(noise=2, bits=8, seed=3))
    assert measure(made.frame0, made.frame1, window=31, robust=False).attrs["notes"] == ""


@pytest.mark.parametrize("shift", [(0.2, 0.1), (0.4, 0.3), (1.5, -1.2)], ids=str)
def test_dead_pixels_stand_still_until_they_are_replaced(shift):
    motion, dead = Affine.translation(*shift), np.random.default_rng(4).integers(0, SHAPE[0], (2, 500))
    frames = [grey(frame, 1, k).astype(np.float32) for k, frame in enumerate(moved(motion))]
    for frame in frames:
        frame[tuple(dead)] = 255
    assert stands_still(Spectra.of(tiles_of(*frames, motion))) is not None
    replaced = [repaired(frame, dead) for frame in frames]
    assert stands_still(Spectra.of(tiles_of(*replaced, motion))) is None


def test_share_that_stands_still():
    """Of a field that is held back by a half, cells that move say −1: they move by twice what was measured."""
    motion, half = Affine.translation(0.8, 0.6), Affine.translation(0.4, 0.3)
    first, second = moved(motion)
    frames = [grey(128 + 0.2 * (frame - 128) + PIXELS, 0.5, k) for k, frame in enumerate((first, second))]
    assert stands_still(Spectra.of(tiles_of(*frames, half))) == pytest.approx(1.0, abs=0.15)
    clean = [grey(frame, 1, k) for k, frame in enumerate((first, second))]
    assert stands_still(Spectra.of(tiles_of(*clean, motion))) is None
