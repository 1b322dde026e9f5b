"""Recordings: pairs, times, progress, skipping; every pair equals the same pair measured alone."""

import json

import numpy as np
import pytest

from sixflow import Settings, iterate_sequence, measure, measure_sequence
from sixflow.field.dataset import SIX
from sixflow.synth import Affine, Sensor, Speckle, sequence

MEASURED = (*SIX, "covariance", "residual", "noise", "flag")


@pytest.fixture(scope="module")
def frames():
    return sequence(
        Speckle(), Affine.rotation(0.01, (48, 40)), (80, 96), 5, sensor=Sensor(noise=2, bits=8)
    ).frames


@pytest.mark.parametrize("pairs", ["consecutive", "first"])
def test_a_recording_is_its_pairs(frames, pairs):
    field = measure_sequence(frames, pairs=pairs, window=21)
    assert field.sizes["time"] == 4
    for k in range(4):
        first = k if pairs == "consecutive" else 0
        assert (int(field.frame0[k]), int(field.frame1[k])) == (first, k + 1)
        alone = measure(frames[first], frames[k + 1], window=21)
        # the grey constant is that of the recording's first frame: single precision rounds differently
        # from the pair before: each of the two is within the tolerance of the fixed point
        started = pairs == "first" and k > 0
        border = ~np.uint8(2) if started else ~np.uint8(0)
        np.testing.assert_array_equal(field.flag.values[k] & border, alone.flag.values[0] & border)
        tolerance = 2 * Settings().tolerance if started else 2e-5
        for name in SIX:
            np.testing.assert_allclose(field[name].values[k], alone[name].values[0], atol=tolerance)
        variances = [
            np.diagonal(c, axis1=-2, axis2=-1)
            for c in (field.covariance.values[k], alone.covariance.values[0])
        ]
        if started:  # at the border, a pixel more or less has a partner
            variances = [v[alone.flag.values[0] == 0] for v in variances]
        np.testing.assert_allclose(*variances, rtol=0.1 if started else 1e-2)


def test_first_pair_is_identical_to_measure(frames):
    field, alone = measure_sequence(frames[:2]), measure(frames[0], frames[1])
    for name in MEASURED:
        np.testing.assert_array_equal(field[name].values, alone[name].values)
    assert field.attrs["input_digest"] == alone.attrs["input_digest"]


@pytest.mark.parametrize("kind", [list, iter, tuple, lambda frames: (frame for frame in frames)])
def test_frames_of_any_kind(frames, kind):
    one, other = measure_sequence(frames), measure_sequence(kind(frames))
    for name in MEASURED:
        np.testing.assert_array_equal(one[name].values, other[name].values)


def test_frames_are_taken_one_at_a_time(frames):
    taken = []

    def camera():
        for k, frame in enumerate(frames):
            taken.append(k)
            yield frame

    fields = iterate_sequence(camera())
    assert taken == []
    next(fields)
    assert taken == [0, 1]
    next(fields)
    assert taken == [0, 1, 2]


@pytest.mark.parametrize("pairs", ["consecutive", "first"])
@pytest.mark.parametrize("skip", [0, 1, 2, 4])
def test_skip_goes_on_where_a_run_ended(frames, pairs, skip):
    whole = list(iterate_sequence(frames, pairs=pairs))
    rest = list(iterate_sequence(frames, pairs=pairs, skip=skip))
    assert len(rest) == 4 - skip
    for one, other in zip(whole[skip:], rest, strict=True):
        assert other.time.values.tolist() == one.time.values.tolist()
        assert other.frame0.values.tolist() == one.frame0.values.tolist()
        for name in SIX:
            np.testing.assert_allclose(other[name].values, one[name].values, atol=2e-5)


def test_times(frames):
    def times(**options):
        field = measure_sequence(frames, **options)
        return field.time.values.tolist(), field.time.attrs["units"]

    assert times() == ([0, 1, 2, 3], "frame")
    assert times(pairs="first") == ([1, 2, 3, 4], "frame")
    assert times(frame_interval=0.5) == ([0, 0.5, 1, 1.5], "s")
    assert times(times=[1.0, 2.0, 4.0, 8.0, 16.0]) == ([1, 2, 4, 8], "s")
    assert times(times=[1.0, 2.0, 4.0, 8.0, 16.0], pairs="first") == ([2, 4, 8, 16], "s")


def test_times_of_a_source(frames):
    class Source(list):
        times = (0.0, 0.1, 0.3, 0.6, 1.0)

    assert measure_sequence(Source(frames)).time.values.tolist() == [0, 0.1, 0.3, 0.6]
    assert measure_sequence(Source(frames), times=range(5)).time.values.tolist() == [0, 1, 2, 3]


def test_progress(frames):
    done = []
    measure_sequence(frames, progress=done.append)
    assert done == [1, 2, 3, 4]


def test_attributes_of_the_whole(frames):
    darker = [frames[0], frames[1], 0.5 * frames[2], 0.5 * frames[3]]
    field = measure_sequence(darker, settings=Settings(window=21))
    assert json.loads(field.attrs["settings"])["window"] == 21
    assert field.attrs["frame_shape"] == [80, 96]
    assert len(field.attrs["notes"].splitlines()) == 1
    assert field.attrs["notes"].startswith("frames 1 and 2: the light changed")
    digests = {
        measure_sequence(some).attrs["input_digest"]
        for some in (frames, frames[1:], frames[::-1], frames[:2])
    }
    assert len(digests) == 4
    assert all(len(digest) == 16 for digest in digests)


def test_mask_and_settings_hold_for_every_pair(frames):
    mask = np.ones((80, 96), bool)
    mask[:, 60:] = False
    field = measure_sequence(frames[:3], mask=mask, step=16, settings=Settings(window=21))
    assert field.x.diff("x").values.tolist() == [16] * (field.x.size - 1)
    outside = field.x.values >= 60
    assert (field.flag.values[..., outside] == 1).all()
    assert np.isfinite(field.u.values[..., ~outside]).all()
