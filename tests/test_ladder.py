"""The default, all windows from one sweep: no worse than one window, and honest where texture does not bear it."""

import numpy as np
import pytest

import measured
import sixflow
from sixflow import Settings, synth
from sixflow.plan import Window
from sixflow.refine.mix import Mix
from sixflow.refine.sharpen import Borne, at_order, orders_of

SHAPE = (160, 176)


def swirl(seed=1, pattern=synth.Particles, angle=0.5):
    motion = synth.LambOseen(angle=angle, core=30, centre=(88, 80))
    return synth.pair(pattern(seed=seed), motion, SHAPE, sensor=synth.Sensor(noise=3, seed=seed))


@pytest.fixture(scope="module")
def vortex():
    return swirl()


@pytest.fixture(scope="module")
def field(vortex):
    return sixflow.measure(vortex.frame0, vortex.frame1)


def z_of(field, made):
    """Errors of u and v over their standard errors."""
    given = ~measured.failed(field)
    errors = field.sixflow.standard_errors
    return (measured.errors(field, made)[..., :2] / np.stack([errors.u[0], errors.v[0]], axis=-1))[given]


def test_it_is_the_default(vortex, field):
    assert Settings().window == "auto"
    again = sixflow.measure(vortex.frame0, vortex.frame1, window="auto")
    np.testing.assert_array_equal(field.u, again.u)


def test_a_vortex_is_resolved_and_its_errors_are_told(vortex, field):
    assert (~measured.failed(field)).mean() > 0.95
    fixed = measured.measure(vortex.frame0, vortex.frame1)
    error, other = (
        measured.rms(measured.errors(each, vortex)[~measured.failed(each)]) for each in (field, fixed)
    )
    assert error[:2].max() < 0.2 * other[:2].max()
    for each in (field, fixed):
        assert (np.abs(z_of(each, vortex)) > 3).mean() < 0.02


@pytest.mark.parametrize("pattern", [synth.Particles, synth.Speckle])
def test_points_take_what_they_bear(pattern):
    """Numbers stay near the truth, and the field says how far each was sharpened."""
    made = swirl(2, pattern)
    found = sixflow.measure(made.frame0, made.frame1, window=31, sharpen=4, step=4)
    error = measured.errors(found, made)[~measured.failed(found)]
    assert measured.rms(error)[:2].max() < 0.05
    assert (np.abs(z_of(found, made)) > 3).mean() < 0.02
    periods = {Window(31, n).period for n in orders_of(4)}
    given = np.unique(found.resolution.values[np.isfinite(found.resolution.values)])
    assert all(min(abs(value / period - 1) for period in periods) < 1e-5 for value in given)


@pytest.mark.parametrize("threads", [2, 3])
def test_any_number_of_threads(vortex, field, threads):
    other = sixflow.measure(vortex.frame0, vortex.frame1, threads=threads)
    np.testing.assert_array_equal(other.u, field.u)
    np.testing.assert_array_equal(other.covariance, field.covariance)


def test_uniform_motion_has_no_more_error_than_one_window():
    motion = synth.Affine.from_six((1.4, -0.7, 0.01, 0.02, -0.01, 0.015), centre=(88, 80))
    made = synth.pair(synth.Speckle(seed=5), motion, SHAPE, sensor=synth.Sensor(noise=3, seed=5))
    error, fixed = (
        measured.rms(np.nan_to_num(measured.errors(how(made.frame0, made.frame1), made)))
        for how in (sixflow.measure, measured.measure)
    )
    assert (error < fixed).all()


def test_orders():
    assert orders_of(5) == (5, 2, 1, 0)
    aims = [np.full((6, 1, 4), value) for value in (4.0, 2.0, 0.0)]
    np.testing.assert_array_equal(at_order(aims, np.array([[0, 1, 2, 3]]))[0], [[4, 2, 0, 0]])


def test_what_is_borne():
    """An aim that moves by more than the motion did is not borne; one that moves by less than matters is."""
    moved = np.zeros((6, 40, 40))
    moved[0] = 0.1
    still = np.zeros_like(moved)
    aims = [3 * moved, 0.5 * moved, still]
    borne = Borne.of(aims, [still] * 3, moved, 1.0, 0.005)
    np.testing.assert_array_equal(borne.order, 1)
    np.testing.assert_allclose(borne.left, 0.05 * 0.5 / (1 - 0.5), rtol=1e-6)
    lost = Borne.of([3 * moved] * 3, [still] * 3, moved, 1.0, 0.005)
    np.testing.assert_array_equal(lost.order, 3)
    quiet = Borne.of([0.04 * moved], [still], 0.01 * moved, 1.0, 0.005)
    np.testing.assert_array_equal(quiet.order, 0)


def test_the_mix_is_what_was_chosen(vortex):
    """Between windows that can be used, a blend with the weights of the logarithms of their sizes."""
    windows = tuple(Window(size, 2) for size in (16, 22, 31))
    levels = [_level(window, value) for window, value in zip(windows, (1.0, 2.0, 3.0), strict=True)]
    levels[1] = levels[1].replace(flag=np.array([[0, 4]], np.uint16))
    chosen = levels[0].replace(window=np.array([[np.sqrt(16 * 22), np.sqrt(16 * 31)]]))
    mix = Mix.of(chosen, levels, windows)
    np.testing.assert_allclose(mix.t, 0.5)
    assert mix.used == [0, 1, 2]
    np.testing.assert_allclose(mix.blend(dict(enumerate(levels))).maps[0], [[1.5, 2.0]])


def _level(window, value):
    from sixflow.refine.solution import Solution, WindowStatistics

    ones = np.ones((1, 2))
    return Solution(
        np.full((6, 1, 2), value), np.ones((1, 2, 6, 6)), WindowStatistics(*[ones] * 7), ones,
        ones * window.size, ones * window.period, np.zeros((1, 2), np.uint16),
    )  # fmt: skip
