"""Times of frames: what counts as a time, who is believed, rounded stamps, and the time in a pair."""

import datetime

import numpy as np
import pytest
import xarray as xr

from sixflow import InputError
from sixflow.frames.seconds import in_seconds
from sixflow.frames.times import FrameTimes, given_times, recorded_times

DAY = datetime.datetime(2026, 1, 1, 12)
STEP = datetime.timedelta(milliseconds=500)


@pytest.mark.parametrize(
    "times",
    [
        [0, 0.5, 1.0],
        (0.0, 0.5, 1.0),
        np.array([0, 0.5, 1], "f4"),
        xr.DataArray([0, 0.5, 1.0]),
        (0.5 * k for k in range(3)),
        np.array(["2026-01-01T00:00:00.000", "2026-01-01T00:00:00.500", "2026-01-01T00:00:01.000"], "M8[ms]"),
        np.datetime64("2026-01-01", "ns") + np.arange(3) * np.timedelta64(500_000_000, "ns"),
        np.arange(3) * np.timedelta64(500, "ms"),
        [DAY + k * STEP for k in range(3)],
        [DAY.replace(tzinfo=datetime.UTC) + k * STEP for k in range(3)],
        [k * STEP for k in range(3)],
    ],
)
def test_seconds_dates_and_durations(times):
    seconds, _ = in_seconds(times, "times")
    np.testing.assert_array_equal(seconds, [0, 0.5, 1])


def test_dates_count_from_the_first_and_say_so():
    seconds, notes = in_seconds(np.array(["2026-01", "2026-02", "2026-04"], "M8[M]"), "times")
    np.testing.assert_array_equal(seconds, 86400.0 * np.array([0, 31, 90]))
    assert notes == ("times are seconds since 2026-01",)


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ([0, 1, 1], "frame 2 has 1, as frame 1 has"),
        ([0, 2, 1], "frame 2 has 1, after 2 of frame 1"),
        ([0, np.nan, 1], "frame 1 has nan"),
        ([0, 1, np.inf], "frame 2 has inf"),
        (np.array(["2026", "NaT", "2027"], "M8[D]"), "frame 1 has NaT"),
        (np.array([1.7e9, 1.7e9 + 1, 1.7e9 + 2], "f4"), "two frames cannot be at one time"),
        (["0", "1", "2"], "holds str, such as '0'"),
        ([0, None, 2], "holds NoneType"),
        ([True, False, True], "holds bool"),
        ([DAY, DAY.replace(tzinfo=datetime.UTC), DAY], "holds datetime"),
        ([0j, 1j, 2j], "holds complex"),
        (np.zeros((3, 1)), r"shape \(3, 1\)"),
        (1.0, r"shape \(\)"),
    ],
)
def test_what_is_no_time_is_refused_by_name(times, said):
    with pytest.raises(InputError, match="^times: .*" + said):
        in_seconds(times, "times")


def test_times_and_frame_interval_must_not_contradict():
    numbers = range(4)
    for times in ([0, 1, 2, 3], [0, 1.01, 2, 3]):
        np.testing.assert_array_equal(given_times(times, 4, numbers, 1.0, False).stamps, times)
    for times in ([0, 1, 2, 12], [0, 0.5, 1, 1.5]):
        with pytest.raises(
            InputError, match=r"times and frame_interval=1.0 contradict each other: from frame"
        ):
            given_times(times, 4, numbers, 1.0, False)
    given_times([0, 0.1, 5, 5.1], 4, numbers, 0.1, True)  # of double frames, the interval is that in a pair
    given_times([0, 2, 4, 6], 4, range(0, 8, 2), 1.0, False)  # every second frame of a recording
    with pytest.raises(InputError, match="times has 3 values for 4 frames"):
        given_times([0, 1, 2], 4, numbers, None, False)


def rounded(rate, count, unit):
    return np.round(np.arange(count) / rate / unit) * unit


@pytest.mark.parametrize(
    ("rate", "unit"), [(30, 1e-3), (30, 1e-2), (29.97, 1e-3), (24, 1e-2), (120, 1e-3), (30, 1 / 90000)]
)
@pytest.mark.parametrize("truncated", [False, True])
def test_rounded_stamps_of_a_constant_rate_are_even(rate, unit, truncated):
    stamps = rounded(rate, 200, unit) if not truncated else np.floor(np.arange(200) / rate / unit) * unit
    for stated in (None, 1 / rate):
        times = recorded_times(stamps, stated, unit, range(200), None, False).stamps
        steps = np.diff(times)
        np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
        # without a stated rate it is known to the unit over the whole recording
        np.testing.assert_allclose(steps[0], 1 / rate, rtol=1e-12 if stated else unit * rate / 150)
        assert np.abs(times - stamps).max() <= unit * (1 + 1e-9)


def test_a_variable_rate_counts_as_it_is():
    stamps = np.array([0, 0.033, 0.067, 0.133, 0.167])  # a frame was dropped
    known = recorded_times(stamps, 1 / 30, 1e-3, range(5), None, False)
    np.testing.assert_array_equal(known.stamps, stamps)
    assert known.notes == ()
    exact = recorded_times(stamps, None, 0.0, range(5), None, False)
    np.testing.assert_array_equal(exact.stamps, stamps)


def test_what_is_given_counts_before_what_a_file_says():
    known = recorded_times([0, 0.04, 0.08], 0.04, 0.0, range(3), 0.1, False)
    assert known.of_pair((1, 2), (1, 2), "consecutive", "first").interval == pytest.approx(0.1)
    assert any("frame_interval=0.1 s, as given, counts" in note for note in known.notes)
    falling = recorded_times([0, 1, 1], None, 0.0, range(3), None, False)
    assert falling.stamps is None
    assert "They are not used" in falling.notes[0]


@pytest.mark.parametrize("reference", ["first", "middle", "second"])
def test_time_in_a_pair(reference):
    share = {"first": 0.0, "middle": 0.5, "second": 1.0}[reference]

    def of(times, places=(2, 3), numbers=(4, 6), pairs="consecutive"):
        found = times.of_pair(places, numbers, pairs, reference)
        return found.time, found.time0, found.time1, found.unit, found.interval, found.interval_unit

    assert of(FrameTimes(np.array([0, 1, 3, 7.0]))) == (3 + 4 * share, 3, 7, "s", 4, "s")
    assert of(FrameTimes(None, 0.5)) == (2 + share, 2, 3, "s", 1, "s")
    assert of(FrameTimes(None, 0.5, double=True)) == (4 + 2 * share, 4, 6, "frame", 0.5, "s")
    assert of(FrameTimes()) == (4 + 2 * share, 4, 6, "frame", 2, "frame")
    gap = of(FrameTimes(None, 0.5, breaks=(5,)))
    assert gap[:4] == (4 + 2 * share, 4, 6, "frame")
    assert np.isnan(gap[4])
    assert of(FrameTimes(None, 0.5, breaks=(4,)))[4] == 1  # missing before the pair, not in it
    assert of(FrameTimes(None, 0.5), (0, 3), (0, 6), "first")[0] == 3  # of the moved frame
