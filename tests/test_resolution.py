"""The automatic window: near the best of its ladder, honest about its resolution, refused where it cannot be."""

import numpy as np
import pytest

from sixflow import InputError, Settings, measure, synth
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.window import attenuation_period, window_sigma
from sixflow.plan import LADDER, SHARPEN, Plan, Window
from sixflow.refine.bias import difference_noise

SIDE = 192


def error_of(field, made):
    x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
    difference = np.stack([field.u.values[0], field.v.values[0]], axis=-1) - made.truth(x, y)[..., :2]
    complete = (
        field.flag.values[0] & (FAILING | FLAGS["border"])
    ) == 0  # coarse windows leave much unresolved
    return np.sqrt(np.mean(difference[complete] ** 2))


@pytest.fixture(scope="module")
def vortices():
    motion = synth.CellularVortices(amplitude=1.0, period=48.0)
    return synth.pair(synth.Speckle(seed=4), motion, (SIDE, SIDE), sensor=synth.Sensor(noise=3, seed=4))


@pytest.fixture(scope="module")
def uniform():
    motion = synth.Affine.translation(1.3, -0.4)
    return synth.pair(synth.Speckle(seed=4), motion, (SIDE, SIDE), sensor=synth.Sensor(noise=3, seed=4))


@pytest.mark.parametrize("kind", ["vortices", "uniform"])
def test_near_the_best_of_the_ladder(kind, request):
    made = request.getfixturevalue(kind)
    fixed = {
        window: error_of(measure(made.frame0, made.frame1, window=window, sharpen=SHARPEN), made)
        for window in LADDER
    }
    field = measure(made.frame0, made.frame1, window="auto")
    assert error_of(field, made) < 1.5 * min(fixed.values())
    assert error_of(field, made) < 0.75 * fixed[31]
    best = min(fixed, key=fixed.get)
    assert best / 1.7 < field.attrs["effective_window"] < best * 1.7


def test_resolution_is_said(vortices):
    field = measure(vortices.frame0, vortices.frame1, window="auto")
    failed = (field.flag.values & FAILING) != 0
    assert np.isnan(field.resolution.values[failed]).all()
    inside = field.resolution.values[~failed]
    periods = [attenuation_period(window_sigma(window), SHARPEN) for window in LADDER]
    assert inside.min() >= periods[0] * 0.999
    assert inside.max() <= periods[-1] * 1.001
    assert field.attrs["attenuation_period_10"] == pytest.approx(np.median(inside))
    assert field.resolution.dims == ("time", "y", "x")
    assert field.resolution.attrs["units"] == "px"
    plain = measure(vortices.frame0, vortices.frame1, window=31, sharpen=1)
    known = plain.resolution.values[np.isfinite(plain.u.values)]
    sharpened, held = (attenuation_period(window_sigma(31), n) for n in (1, 0))
    assert np.isclose(known, sharpened).mean() > 0.98  # but at a few points with cut windows
    assert (np.isclose(known, sharpened) | np.isclose(known, held)).all()


def test_uniform_texture_and_motion_have_no_steps(uniform):
    """Neighbouring points differ by no more than their errors let them."""
    field = measure(uniform.frame0, uniform.frame1, window="auto", step=4)
    error = np.sqrt(np.nanmax(field.covariance.values[0, ..., 0, 0]))
    assert np.nanmax(np.abs(np.diff(field.u.values[0], axis=1))) < 4 * error


def test_noise_of_a_difference():
    assert [f for f, _ in difference_noise(1.0, SHARPEN)] == [0.0, 0.0]
    (displacement, _), (gradient, _) = difference_noise(100.0, SHARPEN)
    assert displacement == pytest.approx(1, abs=2e-3)
    assert gradient == pytest.approx(1, abs=1e-3)
    steps = [[f for f, _ in difference_noise(ratio, SHARPEN)] for ratio in (1.4, 2.0, 2.8, 4.0)]
    assert (np.diff(steps, axis=0) > 0).all()
    # plain windows in closed form: ∫(e^−x − e^−2x)² dx / ∫e^−2x dx, and with x
    (displacement, _), (gradient, _) = difference_noise(2**0.5, 0)
    assert displacement == pytest.approx(1 / 6, abs=1e-3)
    assert gradient == pytest.approx((1 / 4 - 2 / 9 + 1 / 16) * 4, abs=1e-3)


def test_ladder_fits_the_frame():
    asked = Settings(window="auto", step=4)
    assert [one.size for one in Plan.of(asked, (64, 200)).ladder] == [8, 11, 16, 22, 31]
    assert {one.sharpen for one in Plan.of(asked, (64, 200)).ladder} == {SHARPEN}
    assert {one.sharpen for one in Plan.of(asked.replace(sharpen=4), (64, 200)).ladder} == {4}
    assert [one.size for one in Plan.of(asked, (10, 10)).ladder] == [8]
    assert Plan.of(asked, (512, 512)).window == Window(31)
    assert Plan.of(asked, (20, 512)).window == Window(16)
    fixed = Plan.of(Settings(window=20, sharpen=1), (20, 512))
    assert (fixed.window, fixed.ladder) == (Window(20, 1), ())
    assert fixed.of_search.window == Window(20)
    with pytest.raises(InputError, match="smaller than window=25"):
        Plan.of(Settings(window=25), (20, 512))


@pytest.mark.parametrize(
    ("options", "windows", "sharpen"),
    [
        ({"method": "eigenfilter"}, [31, 44, 62], SHARPEN),
        ({"group": "similarity"}, list(LADDER), 0),
        ({"method": "eigenfilter", "group": "translation"}, [31, 44, 62], 0),
    ],
)
def test_other_methods_have_ladders_too(options, windows, sharpen):
    plan = Plan.of(Settings(window="auto", **options), (200, 200))
    assert plan.ladder == tuple(Window(size, sharpen) for size in windows)


@pytest.mark.parametrize("options", [{"method": "eigenfilter"}, {"group": "translation"}])
def test_other_methods_choose_too(options, uniform):
    frames = uniform.frame0[:96, :96], uniform.frame1[:96, :96]
    field = measure(*frames, window="auto", **options)
    error = np.stack([field.u.values[0] - 1.3, field.v.values[0] + 0.4])
    fixed = measure(*frames, window=31, **options)
    assert np.isfinite(error).mean() > 0.97
    assert np.sqrt(np.nanmean(error**2)) < np.sqrt(np.nanmean((fixed.u.values[0] - 1.3) ** 2))


def test_other_words():
    with pytest.raises(InputError, match="window='wide': must be from 5 to 1048576 px, or 'auto'"):
        Settings(window="wide")


def test_frames_without_motion_in_common():
    rng = np.random.default_rng(0)
    field = measure(rng.normal(size=(96, 96)), rng.normal(size=(96, 96)), window="auto", search="pyramid")
    assert float(np.isfinite(field.u).mean()) < 0.05
