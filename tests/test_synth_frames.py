"""Frames: rendering, the camera, pairs and sequences with their truth."""

import numpy as np
import pytest

from sixflow.errors import InputError
from sixflow.synth import (
    Affine,
    CellularVortices,
    Grating,
    LambOseen,
    Particles,
    Sensor,
    Speckle,
    Texture,
    pair,
    render,
    sequence,
)

FLAT = np.full((300, 400), 100.0)


def test_frames_follow_the_convention():
    pattern = Speckle()
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))
    frame0 = render(pattern, (30, 40))
    np.testing.assert_array_equal(frame0, pattern(x, y))
    # a pattern that moves by whole pixels to the right and down
    frame1 = render(pattern, (30, 40), Affine.translation(3.0, 2.0))
    np.testing.assert_allclose(frame1[2:, 3:], frame0[:-2, :-3], atol=1e-9)


@pytest.mark.parametrize("motion", [None, CellularVortices(amplitude=1.0, period=30.0)])
def test_pixel_integration_agrees_with_dense_sampling(motion):
    pattern = Texture(shortest=5.0, longest=20.0)
    shape = (12, 14)
    parts = (np.arange(40) + 0.5) / 40 - 0.5
    dense = np.zeros(shape)
    x, y = np.meshgrid(np.arange(14.0), np.arange(12.0))
    for dy in parts:
        dense += pattern.image(x[..., None] + parts, y[..., None] + dy, motion).mean(axis=-1) / 40
    np.testing.assert_allclose(render(pattern, shape, motion, pixel_integration=4), dense, atol=0.02)
    assert np.abs(render(pattern, shape, motion) - dense).max() > 0.5


def test_pixel_integration_of_a_grating():
    k = 2 * np.pi / 8
    centre = render(Grating(wavelength=8.0), (3, 9)) - 128
    integrated = render(Grating(wavelength=8.0), (3, 9), pixel_integration=8) - 128
    np.testing.assert_allclose(integrated, centre * np.sin(k / 2) / (k / 2), atol=1e-10)


def test_an_ideal_sensor_changes_nothing():
    light = render(Speckle(), (20, 30))
    np.testing.assert_array_equal(Sensor().expose(light, 5), light)


@pytest.mark.parametrize(
    ("sensor", "variance"),
    [
        (Sensor(noise=2.0), 4.0),
        (Sensor(noise=2.0, bits=8), 4.0 + 1 / 12),
        (Sensor(electrons=4.0), 25.0),
        (Sensor(gain=0.5, offset=20.0, electrons=10.0, noise=1.5), 5.0 + 2.25),
    ],
)
def test_noise_has_the_variance_that_was_asked_for(sensor, variance):
    grey = sensor.expose(FLAT, 3)
    scatter = variance * (2 / grey.size) ** 0.5
    assert grey.var(dtype=float) == pytest.approx(variance, abs=5 * scatter)
    assert grey.mean(dtype=float) == pytest.approx(
        100 * sensor.gain + sensor.offset, abs=5 * (variance / grey.size) ** 0.5
    )


def test_noise_is_chosen_by_seed_and_frame_number():
    sensor = Sensor(noise=1.0, seed=4)
    one = sensor.expose(FLAT, 0)
    np.testing.assert_array_equal(one, Sensor(noise=1.0, seed=4).expose(FLAT, 0))
    for other in (sensor.expose(FLAT, 1), Sensor(noise=1.0, seed=5).expose(FLAT, 0)):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.015


@pytest.mark.parametrize(
    ("bits", "dtype"), [(8, np.uint8), (10, np.uint16), (12, np.uint16), (16, np.uint16)]
)
def test_rounding_and_clipping(bits, dtype):
    light = np.array([[-3.0, 0.49, 0.51, 99.6, 1e6]])
    grey = Sensor(bits=bits).expose(light)
    assert grey.dtype == dtype
    assert grey.tolist() == [[0, 0, 1, 100, 2**bits - 1]]


def test_shading_runs_across_the_frame():
    grey = Sensor(shading=0.2).expose(FLAT)
    assert grey[0, 0] == pytest.approx(80)
    assert grey[-1, -1] == pytest.approx(120)
    assert grey.mean() == pytest.approx(100)


def test_pair_knows_its_truth():
    motion = CellularVortices(amplitude=2.0, period=80.0)
    made = pair(Speckle(seed=3), motion, (50, 60))
    rows, columns = np.mgrid[5:45, 5:55]
    truth = made.truth(columns, rows)
    assert truth.shape == (40, 50, 6)
    np.testing.assert_array_equal(truth, motion.six(columns, rows))
    np.testing.assert_allclose(
        made.pattern.image(columns + truth[..., 0], rows + truth[..., 1], motion),
        made.frame0[5:45, 5:55],
        atol=1e-8,
    )
    assert "frame0" not in repr(made)


def test_pair_with_two_cameras():
    sensors = (Sensor(bits=8), Sensor(gain=0.9, offset=5.0, bits=8))
    made = pair(Speckle(), Affine.translation(0.0, 0.0), (40, 40), sensor=sensors)
    np.testing.assert_allclose(made.frame1, np.rint(0.9 * render(Speckle(), (40, 40)) + 5), atol=0)
    assert made.sensors == sensors


def test_pair_is_the_start_of_the_sequence():
    motion = LambOseen(angle=0.3, core=15.0, centre=(20.0, 20.0))
    pattern = Particles(unmatched=0.1)
    sensor = Sensor(noise=1.0, bits=12)
    made = sequence(pattern, motion, (40, 40), 4, sensor=sensor)
    two = pair(pattern, motion, (40, 40), sensor=sensor)
    assert made.frames.shape == (4, 40, 40)
    assert len(made) == 4
    np.testing.assert_array_equal(made.frames[0], two.frame0)
    np.testing.assert_array_equal(made.frames[1], two.frame1)


@pytest.mark.parametrize(
    "motion",
    [
        Affine.from_six((0.5, 0.3, 0.02, 0.05, 0.0, 0.01), centre=(20, 20)),
        CellularVortices(amplitude=1.0, period=60.0),
    ],
    ids=["group", "straight"],
)
@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 3), (1, 2), (2, 3), (3, 1)])
def test_sequence_truth_carries_the_brightness(motion, first, second):
    pattern = Speckle()
    made = sequence(pattern, motion, (40, 40), 4)
    rows, columns = np.mgrid[8:32, 8:32]
    truth = made.truth(columns, rows, first, second)
    seen = pattern.image(columns + truth[..., 0], rows + truth[..., 1], motion.at(second))
    np.testing.assert_allclose(seen, made.frames[first, 8:32, 8:32], atol=1e-8)
    if isinstance(motion, Affine) and second == first + 1:
        np.testing.assert_allclose(truth, motion.six(columns, rows), atol=1e-12)


STILL = Affine.translation(0.0, 0.0)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Sensor(gain=0), "gain=0"),
        (lambda: Sensor(noise=-1.0), "noise=-1.0"),
        (lambda: Sensor(noise="2"), "noise='2'"),
        (lambda: Sensor(electrons=0), "electrons=0"),
        (lambda: Sensor(shading=1.5), "shading=1.5"),
        (lambda: Sensor(bits=9), "bits=9"),
        (lambda: Sensor(bits="8"), "bits='8'"),
        (lambda: Sensor(bits=[8]), r"bits=\[8\]"),
        (lambda: Sensor(seed=-1), "seed=-1"),
        (lambda: Sensor().expose(FLAT, -1), "number=-1"),
        (lambda: Sensor(electrons=1e300).expose(FLAT), "electrons="),
        (lambda: render("speckle", (5, 5)), "pattern='speckle'"),
        (lambda: render(Speckle(), 5), "shape=5"),
        (lambda: render(Speckle(), (5, 0)), r"shape\[1\]=0"),
        (lambda: render(Speckle(), (5, 5.0)), r"shape\[1\]=5.0"),
        (lambda: render(Speckle(), (5, 5, 3)), "shape="),
        (lambda: render(Speckle(), (5, 5), "still"), "motion='still'"),
        (lambda: render(Speckle(), (5, 5), number=-1), "number=-1"),
        (lambda: render(Speckle(), (5, 5), pixel_integration=1.5), "pixel_integration=1.5"),
        (lambda: pair(Speckle(), None, (5, 5)), "motion=None"),
        (lambda: pair(Speckle(), STILL, (5, 5), sensor=None), "sensor=None"),
        (lambda: pair(Speckle(), STILL, (5, 5), sensor=[Sensor()]), "sensor="),
        (lambda: sequence(Speckle(), STILL, (5, 5), 1), "count=1"),
        (lambda: sequence(Speckle(), STILL, (5, 5), 2).truth(0, 0, 0, 2), "second=2"),
        (lambda: sequence(Speckle(), STILL, (5, 5), 2, sensor=(Sensor(bits=8), Sensor())), "sensor:"),
    ],
)
def test_a_bad_argument_is_named(make, name):
    with pytest.raises(InputError, match=f"{name}.*must"):
        make()


@pytest.mark.parametrize("light", [np.zeros(5), np.full((3, 3), np.nan), "light", [[1, 2], [3]]])
def test_bad_light_is_refused(light):
    with pytest.raises(InputError, match="light: "):
        Sensor().expose(light)
