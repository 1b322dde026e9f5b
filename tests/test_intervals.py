"""Rates: whatever pairs are made, selected, joined, stored or calibrated, each is divided by its own elapsed time."""

import dataclasses
import warnings

import numpy as np
import pytest
import xarray as xr

from sixflow import InputError, measure, measure_sequence
from sixflow.field.interval import elapsed
from sixflow.frames import FrameSource, Metadata, open_frames
from sixflow.interpretation import fit_region, interpret_all, time_to_contact
from sixflow.plot.view import View
from sixflow.scenes import Camera
from sixflow.synth import Affine, Sensor, Speckle, sequence
from sixflow.write import open_field, write_field

COUNT = 6
ZOOM = Affine.zoom(1.01, centre=(32, 32))
FRAMES = sequence(Speckle(seed=2), ZOOM, (64, 64), COUNT, sensor=Sensor(noise=1, bits=8)).frames
STAMPS = np.array([10.0, 10.5, 12.0, 12.25, 13.0, 17.0])
OPTIONS = {"window": 21, "step": 16}
KINDS = {
    "consecutive": ({}, [(k, k + 1) for k in range(5)]),
    "lag": ({"lag": 2}, [(k, k + 2) for k in range(4)]),
    "double": ({"pairs": "double"}, [(0, 1), (2, 3), (4, 5)]),
    "first": ({"pairs": "first"}, [(0, k) for k in range(1, 6)]),
    "incremental": ({"pairs": "incremental"}, [(0, k) for k in range(1, 6)]),
    "update": ({"pairs": "first", "update": 2}, [(0, k) for k in range(1, 6)]),
    "lost": ({"pairs": "first", "update": "lost"}, [(0, k) for k in range(1, 6)]),
    "middle": ({"reference": "middle"}, [(k, k + 1) for k in range(5)]),
    "second first": ({"reference": "second", "pairs": "first"}, [(0, k) for k in range(1, 6)]),
}
KNOWN = {
    "unknown": {},
    "interval": {"frame_interval": 0.25},
    "times": {"times": STAMPS},
    "dates": {"times": np.datetime64("2026-01-01", "us") + (STAMPS * 1e6).astype("m8[us]")},
    "both": {"times": 0.25 * np.arange(COUNT), "frame_interval": 0.25},
}


@pytest.fixture(scope="module")
def measured():
    """Every kind of pairs once; the numbers do not depend on times."""
    made = {}

    def get(kind):
        if kind not in made:
            made[kind] = measure_sequence(FRAMES, **KINDS[kind][0], **OPTIONS)
        return made[kind]

    return get


@pytest.fixture(scope="module")
def timed():
    made = {}

    def get(kind, known):
        if (kind, known) not in made:
            made[kind, known] = measure_sequence(FRAMES, **KINDS[kind][0], **KNOWN[known], **OPTIONS)
        return made[kind, known]

    return get


def truth(kind, known):
    """Elapsed time of every pair, and its unit."""
    pairs = KINDS[kind][1]
    if known in ("times", "dates"):
        return np.array([STAMPS[j] - STAMPS[i] for i, j in pairs]), "s"
    apart = np.array([float(j - i) for i, j in pairs])
    return (apart, "frame") if known == "unknown" else (0.25 * apart, "s")


@pytest.fixture(scope="module")
def per_frame(measured):
    """Rates of every kind of pairs over one unit of time, and the displacement."""
    made = {}

    def get(kind):
        if kind not in made:
            field = measured(kind)
            alone = field.assign_coords(
                interval=xr.ones_like(field.interval, float).assign_attrs(units="frame")
            )
            made[kind] = {
                "vorticity": alone.sixflow.vorticity.values,
                "error": alone.sixflow.standard_error("vorticity").values,
                "strain_rate": alone.sixflow.strain_rate.values,
                "shear": alone.sixflow.derive("strain_rate_max_shear").values,
                "u": field.u.values,
                "u_error": field.sixflow.standard_error("u").values,
            }
        return made[kind]

    return get


def divided(values, intervals):
    return values / np.reshape(intervals, (-1, *[1] * (values.ndim - 1)) if np.ndim(intervals) else ())


def assert_vorticity(field, expected, intervals, unit):
    found = field.sixflow.vorticity
    assert found.attrs["units"] == f"1/{unit}"
    np.testing.assert_allclose(found.values, divided(expected, intervals), rtol=1e-12)


def assert_rates(field, expected, intervals, unit):
    """All that is per time, with errors, is that of one unit of time over these intervals."""
    assert_vorticity(field, expected["vorticity"], intervals, unit)
    for found, name in (
        (field.sixflow.standard_error("vorticity"), "error"),
        (field.sixflow.strain_rate, "strain_rate"),
        (field.sixflow.derive("strain_rate_max_shear"), "shear"),
    ):
        assert found.attrs["units"] == f"1/{unit}"
        np.testing.assert_allclose(found.values, divided(expected[name], intervals), rtol=1e-12)


def assert_velocities(field, expected, intervals):
    data = field.sixflow.physical(pixel_size=0.1, length_unit="mm")
    assert data["velocity_x"].attrs["units"] == "mm/s"
    for found, name in (("velocity_x", "u"), ("velocity_x_standard_error", "u_error")):
        np.testing.assert_allclose(data[found].values, 0.1 * divided(expected[name], intervals), rtol=1e-6)
    for found, name in (("vorticity", "vorticity"), ("vorticity_standard_error", "error")):
        np.testing.assert_allclose(data[found].values, divided(expected[name], intervals), rtol=1e-12)


def joined(field):
    """Single pairs joined again, in another order."""
    order = list(reversed(range(field.sizes["time"])))
    parts = [field.isel(time=k) for k in order]
    return xr.concat(parts, "time", coords="different", compat="equals", data_vars="minimal"), order


@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("kind", KINDS)
def test_table(kind, known, timed, per_frame):
    field, expected = timed(kind, known), per_frame(kind)
    intervals, unit = truth(kind, known)
    np.testing.assert_allclose(field.interval, intervals, rtol=1e-12)
    assert field.interval.attrs["units"] == unit
    if (kind, known) != ("double", "interval"):  # when those pairs were taken is unknown
        np.testing.assert_allclose(field.time1 - field.time0, intervals, rtol=1e-12)
        assert field.time.attrs["units"] == field.time0.attrs["units"] == unit
    np.testing.assert_array_equal(np.stack([field.frame0, field.frame1], -1), KINDS[kind][1])
    last, rate = field.sizes["time"] - 1, expected["vorticity"]
    assert_vorticity(field, rate, intervals, unit)
    for select in (
        lambda f: f.isel(time=last),
        lambda f: f.sel(time=f.time.values[last]),
        lambda f: f.isel(time=[last]).squeeze("time"),
        lambda f: f.isel(time=last).drop_vars("time"),
    ):
        assert_vorticity(select(field), rate[last], intervals[last], unit)
    assert_vorticity(field.isel(time=[last, 0]), rate[[last, 0]], intervals[[last, 0]], unit)
    whole, order = joined(field)
    assert_vorticity(whole, rate[order], intervals[order], unit)


@pytest.mark.parametrize("kind", KINDS)
def test_table_of_velocities(kind, timed, per_frame):
    field, expected = timed(kind, "times"), per_frame(kind)
    intervals, _ = truth(kind, "times")
    assert_rates(field, expected, intervals, "s")
    assert_velocities(field, expected, intervals)
    if kind == "first":
        assert_velocities(
            field.isel(time=1), {name: value[1] for name, value in expected.items()}, intervals[1]
        )
    with pytest.raises(InputError, match=r"frame_interval is unknown: .* give frame_interval"):
        timed(kind, "unknown").sixflow.physical(pixel_size=0.1)


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
@pytest.mark.parametrize(("kind", "known"), [("lost", "times"), ("double", "interval"), ("lag", "unknown")])
def test_table_of_files(kind, known, suffix, timed, per_frame, tmp_path):
    field, rate = timed(kind, known), per_frame(kind)["vorticity"]
    intervals, unit = truth(kind, known)
    for name, some in (("whole", slice(None)), ("one", 1)):
        path = write_field(field.isel(time=some), tmp_path / f"{name}.{suffix}")
        with open_field(path) as back:
            assert_vorticity(back.load(), rate[some], intervals[some], unit)
            if name == "whole":
                assert_vorticity(back.isel(time=1), rate[1], intervals[1], unit)


@pytest.mark.parametrize("kind", KINDS)
def test_calibrated_later_is_as_measured_with_the_interval(kind, timed):
    for k in (slice(None), 1):
        later = timed(kind, "unknown").isel(time=k).sixflow.calibrate(frame_interval=0.25)
        whole = timed(kind, "interval").isel(time=k)
        changed = timed(kind, "interval").isel(time=k).sixflow.calibrate(frame_interval=0.5)
        xr.testing.assert_equal(later, whole)
        np.testing.assert_allclose(changed.interval, 2 * whole.interval)
        np.testing.assert_allclose(changed.sixflow.vorticity, whole.sixflow.vorticity / 2)


def test_known_times_are_not_contradicted(timed):
    for kind in KINDS:
        field = timed(kind, "times")
        for call in (
            lambda f: f.sixflow.calibrate(frame_interval=0.25),
            lambda f: f.sixflow.physical(pixel_size=1, frame_interval=0.25),
            lambda f: f.isel(time=1).sixflow.calibrate(frame_interval=7.0),
            lambda f: fit_region(f, coefficients="six", frame_interval=7.0, border=True),
        ):
            with pytest.raises(InputError, match=r"frame_interval=.*contradicts the times of the frames"):
                call(field)
    field = measure_sequence(FRAMES[:3], times=[0, 0.5, 1.0], **OPTIONS)
    agreed = field.sixflow.calibrate(frame_interval=0.5)
    np.testing.assert_array_equal(agreed.interval, field.interval)


def test_what_has_been_lost_is_not_guessed(timed):
    even, uneven = timed("consecutive", "interval"), timed("first", "interval")
    picked = even.isel(time=1, drop=True)
    np.testing.assert_allclose(picked.sixflow.vorticity, even.sixflow.vorticity[1], rtol=1e-12)
    with pytest.raises(InputError, match="interval: the field has lost the times of its pairs"):
        _ = uneven.isel(time=1, drop=True).sixflow.vorticity
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        parts = [uneven.isel(time=k) for k in (0, 3)]
        minimal = xr.concat(parts, "time", coords="minimal", compat="override", join="override")
    with pytest.raises(InputError, match="one for all"):
        _ = minimal.sixflow.vorticity
    with pytest.raises(InputError, match="units None"):
        _ = even.assign_coords(interval=("time", np.ones(5))).sixflow.vorticity


def test_fields_of_earlier_versions(timed):
    def as_before(field):
        bare = field.drop_vars(["interval", "time0", "time1"])
        bare.attrs = {k: v for k, v in field.attrs.items() if k not in ("interval", "pairs", "source")}
        return bare

    for kind in ("consecutive", "first", "lag"):
        for known in ("unknown", "interval"):
            field = timed(kind, known)
            np.testing.assert_allclose(elapsed(as_before(field)).values, field.interval)
            assert as_before(field).sixflow.vorticity.attrs == field.sixflow.vorticity.attrs
    # the last interval could only be guessed from time stamps of the reference frames
    assert elapsed(as_before(timed("consecutive", "times"))).unit == "frame"


def test_a_pair_alone():
    field = measure(FRAMES[0], FRAMES[1], frame_interval=0.5, reference="middle", **OPTIONS)
    assert (field.time.item(), field.time0.item(), field.time1.item(), field.interval.item()) == (
        0.25,
        0,
        0.5,
        0.5,
    )
    assert field.sixflow.vorticity.attrs["units"] == "1/s"
    assert measure(FRAMES[0], FRAMES[1], **OPTIONS).interval.attrs["units"] == "frame"


def test_interpretation_counts_from_the_first_frame(timed):
    camera = Camera(focal=300, centre=(32, 32))
    frames = 1 / (
        1 - 1 / 1.01
    )  # from the first frame, at constant speed; the zoom is a little less than that later
    table = interpret_all(
        timed("first", "interval"), camera, coefficients="six", border=True, heading=(0, 0, 1)
    )
    assert table.sizes["time"] == 5
    assert table["time_to_contact.time"].attrs["units"] == "s"
    for k in range(5):
        own = 0.25 * (k + 1) / (1 - 1.01 ** -(k + 1))
        found = float(table["time_to_contact.time"][k])
        error = float(table["time_to_contact.time.standard_error"][k])
        assert abs(found - own) < 5 * error
        fit = fit_region(timed("first", "interval"), coefficients="six", border=True, time=k)
        alone = time_to_contact(fit, camera, heading=(0, 0, 1)).time
        assert alone.value == pytest.approx(found)
    unknown = interpret_all(
        timed("first", "unknown"), camera, coefficients="six", border=True, heading=(0, 0, 1)
    )
    assert unknown["time_to_contact.time"].attrs["units"] == "frame"
    np.testing.assert_allclose(0.25 * unknown["time_to_contact.time"], table["time_to_contact.time"])
    assert abs(float(unknown["time_to_contact.time"][0]) / frames - 1) < 0.05
    picked = interpret_all(
        timed("first", "interval").isel(time=3), camera, coefficients="six", border=True, heading=(0, 0, 1)
    )
    assert picked["time_to_contact.time"].item() == table["time_to_contact.time"][3].item()
    with pytest.raises(InputError, match="region="):
        interpret_all(timed("first", "interval"), camera, (5, 5, 1, 1))
    with pytest.raises(InputError, match="time=2: all pairs"):
        interpret_all(timed("first", "interval"), camera, time=2)


def test_plots_divide_by_the_same(timed):
    field = timed("first", "times").sixflow.calibrate(pixel_size=0.1)
    physical = field.sixflow.physical()
    for k in (0, 3):
        view = View.of(field, time=k, units="physical", y_up=False)
        np.testing.assert_allclose(view.quantity("u").values, physical["velocity_x"][k])
        np.testing.assert_allclose(view.quantity("vorticity").values, field.sixflow.vorticity[k])
    assert View.of(field, time=2, units="px", y_up=False).quantity("vorticity").unit == "1/s"


def test_dense_and_sampled_fields_keep_the_times(timed):
    field = timed("first", "times")
    dense = field.sixflow.dense()
    np.testing.assert_array_equal(dense.interval, field.interval)
    assert dense.sixflow.vorticity.attrs["units"] == "1/s"
    assert field.sixflow.sample(30.0, 30.0, time=3).interval.item() == field.interval[3].item()


class Stating(FrameSource):
    """A recording with metadata."""

    def __init__(self, frames, metadata, times=None, numbers=None):
        self._frames, self._stated, self._times, self._numbers = frames, metadata, times, numbers
        super().__init__()

    @property
    def count(self):
        return len(self._frames)

    def _raw(self, numbers):
        for k in range(len(self._frames))[numbers.start : numbers.stop]:
            yield k, f"frame {k}", self._frames[k]

    def _origin(self):
        return "a camera"

    @property
    def times(self):
        return self._times

    @property
    def numbers(self):
        return self._numbers or range(self.count)

    @property
    def metadata(self):
        return self._stated


STATED = Metadata(pixel_size=0.5, length_unit="µm", frame_interval=0.2)


def test_calibration_of_the_recording_is_the_default():
    field = measure_sequence(Stating(FRAMES[:3], STATED), **OPTIONS)
    np.testing.assert_allclose(field.interval, [0.2, 0.2])
    data = field.sixflow.physical()
    assert data.velocity_x.attrs["units"] == "µm/s"
    np.testing.assert_allclose(data.velocity_x, field.u * 0.5 / 0.2, rtol=1e-6)
    assert "the size of a pixel, 0.5 µm, is that of the recording's metadata" in field.attrs["notes"]
    assert "the frame interval, 0.2 s, is that of the recording's metadata" in field.attrs["notes"]
    assert field.attrs["source"] == "a camera"

    given = measure_sequence(Stating(FRAMES[:3], STATED), pixel_size=2.0, frame_interval=0.1, **OPTIONS)
    np.testing.assert_allclose(given.interval, [0.1, 0.1])
    assert given.sixflow.physical().velocity_x.attrs["units"] == "mm/s"
    assert given.attrs["notes"] == ""

    other = measure_sequence(Stating(FRAMES[:3], STATED), length_unit="m", **OPTIONS)
    assert "it is not used, since length_unit='m' was given" in other.attrs["notes"]
    with pytest.raises(InputError, match="pixel_size is unknown"):
        other.sixflow.physical()


def test_stamps_of_a_recording():
    rounded = dataclasses.replace(STATED, frame_interval=1 / 30, time_resolution=0.001)
    field = measure_sequence(Stating(FRAMES[:4], rounded, [0, 0.033, 0.067, 0.1]), **OPTIONS)
    np.testing.assert_allclose(field.interval, 1 / 30, rtol=1e-12)
    assert "the time stamps are rounded to 0.001 s" in field.attrs["notes"]
    uneven = measure_sequence(Stating(FRAMES[:4], rounded, [0, 0.033, 0.1, 0.133]), **OPTIONS)
    np.testing.assert_allclose(uneven.interval, [0.033, 0.067, 0.033])
    with pytest.raises(InputError, match="contradicts"):
        uneven.sixflow.calibrate(frame_interval=1 / 30)
    given = measure_sequence(
        Stating(FRAMES[:4], rounded, [0, 0.033, 0.1, 0.133]), frame_interval=0.5, **OPTIONS
    )
    np.testing.assert_allclose(given.interval, 0.5)
    assert "frame_interval=0.5 s, as given, counts" in given.attrs["notes"]


def test_selected_frames_keep_their_numbers():
    source = Stating(FRAMES[::2], Metadata(), numbers=range(0, COUNT, 2))
    for pairs, truth in (
        ("consecutive", [(0, 2), (2, 4)]),
        ("first", [(0, 2), (0, 4)]),
        ("incremental", [(0, 2), (0, 4)]),
    ):
        field = measure_sequence(source, pairs=pairs, frame_interval=0.1, **OPTIONS)
        np.testing.assert_array_equal(np.stack([field.frame0, field.frame1], -1), truth)
        np.testing.assert_allclose(field.interval, [0.1 * (b - a) for a, b in truth])
        unknown = measure_sequence(source, pairs=pairs, **OPTIONS)
        np.testing.assert_allclose(unknown.interval, [b - a for a, b in truth])
        if pairs == "incremental":
            np.testing.assert_array_equal(field.measured_from, [0, 2])


@pytest.mark.parametrize("wrap", [list, iter, open_frames])
def test_one_time_for_each_frame(wrap):
    for count in (2, 4):
        with pytest.raises(InputError, match=f"times has {count} values"):
            measure_sequence(wrap(FRAMES[:3]), times=range(count), **OPTIONS)
