"""What `measure` promises whatever the frames: symmetries, equal results, masks, lighting, notes, frozen numbers."""

import json
import re

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import Settings
from sixflow.field.dataset import SIX
from sixflow.synth import Affine, Sensor, Speckle, pair


@pytest.fixture(scope="module")
def made():
    """A pair of unequal sides, eight bits, noise 2."""
    shape = (112, 145)
    motion = measured.affine((1.8, -0.6, 0.014, 0.016, 0.013, -0.012), shape)
    return pair(Speckle(seed=3), motion, shape, sensor=Sensor(noise=2, bits=8, seed=3))


@pytest.fixture(scope="module")
def field(made):
    return measure(made.frame0, made.frame1)


def assert_identical(first, second):
    for name in (*SIX, "covariance", "residual", "noise", "flag"):
        np.testing.assert_array_equal(first[name].values, second[name].values, err_msg=name)


def assert_close(first, second, atol=2e-5):
    """Equal flags, numbers within a few float32 roundings of positions of some 100 px."""
    np.testing.assert_array_equal(first.flag.values, second.flag.values)
    np.testing.assert_allclose(measured.six_of(first), measured.six_of(second), atol=atol)
    np.testing.assert_allclose(measured.standard_errors(first), measured.standard_errors(second), rtol=2e-3)


def test_layout(made, field):
    assert field.u.dims == ("time", "y", "x")
    assert field.covariance.dims == ("time", "y", "x", "param", "param2")
    assert field.param.values.tolist() == list(SIX)
    assert field.u.shape == (1, 14, 19)
    assert field.u.dtype == field.covariance.dtype == np.float32
    assert measure(made.frame0, made.frame1, float64=True).u.dtype == np.float64
    assert field.attrs["frame_shape"] == [112, 145]
    assert Settings.from_mapping(json.loads(field.attrs["settings"])) == Settings(window=31)
    assert field.attrs["notes"] == ""
    covariance = field.covariance.values[0][measured.complete(field)].astype(float)
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    spread = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / spread[..., None] / spread[..., None, :]
    assert np.linalg.eigvalsh(correlation).min() > 0


def test_settings_and_options_are_one(made):
    by_option = measure(made.frame0, made.frame1, window=21, step=10)
    assert_identical(by_option, measure(made.frame0, made.frame1, settings=Settings(window=21, step=10)))
    assert_identical(
        by_option, measure(made.frame0, made.frame1, settings=Settings(window=99, step=10), window=21)
    )
    assert by_option.x.diff("x").values.tolist() == [10] * (by_option.x.size - 1)


def test_repeated_runs_are_identical(made, field):
    frames = made.frame0.copy(), made.frame1.copy()
    assert_identical(measure(*frames), field)
    np.testing.assert_array_equal(frames[0], made.frame0)
    np.testing.assert_array_equal(frames[1], made.frame1)


@pytest.mark.parametrize(
    "dtype", [np.uint8, np.uint16, np.int16, np.int64, np.float32, np.float64, ">u2", ">f4"]
)
def test_the_kind_of_number_does_not_matter(made, field, dtype):
    assert_identical(measure(made.frame0.astype(dtype), made.frame1.astype(dtype)), field)


def test_the_layout_in_memory_does_not_matter(made, field):
    wide = np.zeros((224, 290), np.uint8)
    wide[::2, ::2] = made.frame1
    assert_identical(measure(np.asfortranarray(made.frame0), wide[::2, ::2]), field)
    assert_identical(measure(made.frame0.tolist(), made.frame1.tolist()), field)


@pytest.mark.parametrize(("gain", "offset"), [(1 / 255, 0), (1, 1e4), (257, -5000)])
def test_the_unit_of_grey_does_not_matter(made, field, gain, offset):
    frames = (gain * frame.astype(np.float64) + offset for frame in (made.frame0, made.frame1))
    scaled = measure(*frames)
    assert_close(scaled, field, atol=2e-4)
    np.testing.assert_allclose(scaled.noise, gain * field.noise, rtol=1e-3)
    np.testing.assert_allclose(scaled.residual, field.residual, rtol=1e-3)


def test_large_offsets_lose_no_precision(made):
    """A constant is taken off before single precision is used: 16-bit counts on a high pedestal are as good as any."""
    raised = [frame.astype(np.float64) + 60000 for frame in (made.frame0, made.frame1)]
    assert_close(measure(*raised), measure(made.frame0, made.frame1), atol=1e-5)


def test_transposed_frames(made):
    """x and y change places: u and v as well, curl and stretch change sign."""
    plain = measure(made.frame0, made.frame1, float64=True)
    turned = measure(made.frame0.T, made.frame1.T, float64=True)
    expected = measured.six_of(turned).swapaxes(0, 1)[..., [1, 0, 2, 3, 4, 5]] * [1, 1, 1, -1, -1, 1]
    np.testing.assert_allclose(measured.six_of(plain), expected, atol=1e-9)
    np.testing.assert_array_equal(plain.flag.values[0], turned.flag.values[0].T)
    order = np.ix_(range(14), range(19), [1, 0, 2, 3, 4, 5], [1, 0, 2, 3, 4, 5])
    signs = np.outer(s := [1, 1, 1, -1, -1, 1], s)
    swapped = turned.covariance.values[0].swapaxes(0, 1)[order] * signs
    np.testing.assert_allclose(plain.covariance.values[0], swapped, atol=1e-9)


@pytest.mark.parametrize(("axis", "signs"), [(1, [-1, 1, 1, -1, 1, -1]), (0, [1, -1, 1, -1, 1, -1])])
def test_mirrored_frames(axis, signs):
    shape = (113, 145)  # points lie symmetrically
    made = pair(Speckle(seed=3), measured.affine(measured.SMALL, shape), shape, sensor=Sensor(noise=2))
    # search halves the frames from the first pixel on, and is not symmetric: the fixed point is
    options = {"float64": True, "passes": 30, "tolerance": 1e-7}
    plain = measure(made.frame0, made.frame1, **options)
    other = measure(np.flip(made.frame0, axis), np.flip(made.frame1, axis), **options)
    expected = np.flip(measured.six_of(other), axis) * signs
    inside = measured.complete(plain) & np.flip(measured.complete(other), axis)
    assert inside.sum() > 100
    np.testing.assert_allclose(measured.six_of(plain)[inside], expected[inside], atol=1e-5)


def test_frames_in_reverse_order():
    """Back from the moved frame is the inverse motion."""
    motion = Affine.translation(2.3, -1.4)
    made = pair(Speckle(), motion, (128, 128), sensor=Sensor(noise=1))
    back = measure(made.frame1, made.frame0)
    inside = measured.complete(back)
    z = (measured.six_of(back) + np.array([2.3, -1.4, 0, 0, 0, 0]))[inside] / measured.standard_errors(back)[
        inside
    ]
    assert np.abs(z).max() < 5


def test_the_step_changes_only_where_points_lie():
    frames = measured.noisy(measured.ideal("speckle", 0, 129), 2)
    coarse, fine = (measure(*frames, step=step) for step in (8, 4))
    shared = fine.sel(x=coarse.x, y=coarse.y)
    inside = measured.complete(coarse) & measured.complete(shared)
    difference = (measured.six_of(coarse) - measured.six_of(shared))[inside]
    assert np.abs(difference / measured.standard_errors(coarse)[inside]).max() < 0.2


@pytest.fixture(scope="module")
def mask():
    mask = np.ones((112, 145), bool)
    mask[40:70, 50:90] = False
    mask[:, 130:] = False
    return mask


def test_masked_points(made, mask):
    field = measure(made.frame0, made.frame1, mask=mask)
    here = mask[np.ix_(field.y, field.x)]
    np.testing.assert_array_equal(measured.flagged(field, "masked"), ~here)
    np.testing.assert_array_equal(field.flag.values[0][~here], 1)
    for name in (*SIX, "residual", "noise", "covariance"):
        assert np.isnan(field[name].values[0][~here]).all()
    assert not measured.failed(field)[here].any()
    near = here & measured.flagged(field, "border")
    assert near.sum() > 50
    z = (measured.errors(field, made) / measured.standard_errors(field))[near]
    assert np.isfinite(z).all()
    assert np.abs(z).max() < 6


def test_points_beside_the_mask_have_larger_errors(made, mask):
    plain, cut = measure(made.frame0, made.frame1), measure(made.frame0, made.frame1, mask=mask)
    near = measured.on_border(cut) & measured.complete(plain)
    assert (measured.standard_errors(cut)[near] > 0.99 * measured.standard_errors(plain)[near]).all()


def test_far_from_the_mask_nothing_changes(made):
    mask = np.ones((112, 145), bool)
    mask[:8, :8] = False
    plain, cut = (measure(made.frame0, made.frame1, mask=m, levels=0) for m in (None, mask))
    far = np.hypot(*np.meshgrid(plain.x, plain.y)) > 80
    difference = (measured.six_of(plain) - measured.six_of(cut))[far]
    assert np.nanmax(np.abs(difference)) < 1e-4


def test_a_full_mask_is_no_mask(made, field):
    for full in (np.ones((112, 145), bool), np.full((112, 145), 255, np.uint8)):
        assert_close(measure(made.frame0, made.frame1, mask=full), field)


def test_nothing_under_the_mask_counts(made, mask):
    rng = np.random.default_rng(1)
    plain = measure(made.frame0, made.frame1, mask=mask)
    for garbage in (rng.integers(0, 256, mask.shape), np.zeros(mask.shape), np.full(mask.shape, 255)):
        spoiled = np.where(mask, made.frame0, garbage)
        assert_close(measure(spoiled, made.frame1, mask=mask), plain)


def test_nan_is_masked(made, mask):
    spoiled = np.where(mask, made.frame0, np.nan)
    spoiled[0, 0] = np.inf
    field = measure(spoiled, made.frame1)
    assert (
        f"frame0: {(~mask).sum() + 1} pixels without a value (NaN or infinite) are masked"
        in field.attrs["notes"]
    )
    here = mask[np.ix_(field.y, field.x)]
    np.testing.assert_array_equal(measured.flagged(field, "masked"), ~here)
    z = (measured.errors(field, made) / measured.standard_errors(field))[here]
    assert np.abs(z).max() < 6


def test_nan_in_the_moved_frame(made):
    spoiled = made.frame1.astype(float)
    spoiled[40:70, 50:90] = np.nan
    spoiled[np.random.default_rng(2).random(spoiled.shape) < 0.001] = np.nan
    field = measure(made.frame0, spoiled)
    assert "frame1: " in field.attrs["notes"]
    y, x = np.meshgrid(field.y, field.x, indexing="ij")
    centre = (x > 62) & (x < 78) & (y > 50) & (y < 60)
    assert centre.any()
    assert measured.failed(field)[centre].all()
    assert not measured.flagged(field, "masked").any()
    kept = ~measured.failed(field)
    assert kept.mean() > 0.9
    z = (measured.errors(field, made) / measured.standard_errors(field))[kept]
    assert np.abs(z).max() < 6


@pytest.fixture(scope="module")
def scene():
    return measured.ideal("speckle", 2, 192)


@pytest.mark.parametrize("lighting", ["gain+offset", "local"])
def test_gain_and_offset_are_removed(scene, lighting):
    frame0, frame1 = measured.noisy(scene, 2)
    plain = measure(frame0, frame1, lighting=lighting)
    lit = measure(frame0, 1.3 * frame1 - 20, lighting=lighting)
    assert lit.attrs["notes"] == ""
    inside = measured.depth(plain) >= 16
    change = (measured.six_of(lit) - measured.six_of(plain))[inside] / measured.standard_errors(plain)[inside]
    # noise is amplified with the frame; nothing else may change
    assert np.abs(change).max() < 0.5


@pytest.mark.parametrize("lighting", ["none", "gain+offset", "local"])
def test_errors_in_steady_light(scene, lighting):
    field = measure(*measured.noisy(scene, 3), lighting=lighting)
    assert measured.failed(field).mean() < 0.02
    inside = measured.complete(field)
    z = (measured.errors(field, scene) / measured.standard_errors(field))[inside]
    count = measured.windows(inside.sum(), 8, 31)
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 / np.sqrt(2 * count))


@pytest.mark.parametrize(("lighting", "limit"), [("gain+offset", 1e-2), ("local", 2e-2)])
def test_light_that_varies_over_the_frame(scene, lighting, limit):
    y, x = np.mgrid[:192, :192] / 191
    frame1 = (0.8 + 0.4 * x) * scene.frame1 + 30 * y
    field = measure(scene.frame0, frame1, lighting=lighting)
    inside = measured.depth(field) >= 48
    error = measured.rms(measured.errors(field, scene)[inside])
    assert error[:2].max() < limit
    without = measure(scene.frame0, frame1, lighting="none")
    worse = measured.rms(np.nan_to_num(measured.errors(without, scene), nan=1.0)[inside])
    assert worse[:2].max() > 2 * error[:2].max()


def test_changed_light_is_noted(scene):
    assert measure(scene.frame0, scene.frame1).attrs["notes"] == ""
    brighter = measure(scene.frame0, scene.frame1 + 40, lighting="none")
    assert re.search(r"brightness \+(39|40)", brighter.attrs["notes"])  # the motion is biased by the light
    assert 'consider lighting="gain+offset"' in brighter.attrs["notes"]


def test_changed_light_is_seen_and_corrected(scene):
    frame1 = 1.5 * scene.frame1 - 30
    field = measure(scene.frame0, frame1)
    assert "contrast × 1.5" in field.attrs["notes"]
    assert "its own gain and offset" in field.attrs["notes"]
    corrected = measure(scene.frame0, frame1, lighting="gain+offset")
    np.testing.assert_array_equal(measured.six_of(field), measured.six_of(corrected))


def test_steady_light_is_not_corrected(scene):
    frames = measured.noisy(scene, 2)
    np.testing.assert_array_equal(
        measured.six_of(measure(*frames)), measured.six_of(measure(*frames, lighting="none"))
    )


def test_frozen_numbers():
    """Numbers of one small case, so that no change goes unnoticed; they may differ by float32 rounding only."""
    made = pair(Speckle(seed=1), measured.affine((1.4, -0.7, 0.01, 0.02, -0.01, 0.015), (64, 64)), (64, 64))
    field = measure(made.frame0.round(), made.frame1.round(), step=24)
    assert field.x.values.tolist() == field.y.values.tolist() == [7, 31, 55]
    np.testing.assert_array_equal(field.flag.values[0], [[2, 2, 2], [2, 0, 2], [2, 2, 2]])
    values = measured.six_of(field)
    # float32 holds positions of 64 px to 4e-6 px and their slopes to that over σ
    np.testing.assert_allclose(values[1, 1, :2], [1.3986228, -0.7142230], atol=2e-5)
    np.testing.assert_allclose(values[1, 1, 2:], [0.0100058, 0.0202501, -0.0099091, 0.0152278], atol=2e-6)
    u = [[1.461782, 1.458926, 1.464236], [1.402893, 1.398623, 1.404847], [1.339755, 1.341387, 1.340343]]
    np.testing.assert_allclose(values[..., 0], u, atol=2e-5)
    spread = [0.00115455, 0.00124155, 0.0001308, 0.00013472, 0.00012681, 0.00013246]
    np.testing.assert_allclose(measured.standard_errors(field)[1, 1], spread, rtol=1e-3)
    assert float(field.noise[0, 1, 1]) == pytest.approx(0.296625, rel=1e-3)
