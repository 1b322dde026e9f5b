"""Averages: the mean over time with its covariance, against truth; and averages that are none, which are refused."""

import numpy as np
import pytest
import xarray as xr

import sixflow
from sixflow import synth
from sixflow.errors import InputError
from sixflow.field.dataset import FLAGS, SIX, build_field

SIDE = (4, 5)


def recording(errors, *, covariance, frames, truth=0.25, flag=0):
    """A field of pairs with known errors, shape (time, y, x), the same in all six numbers."""
    count = len(errors)
    shape = (count, *SIDE)
    flags = np.broadcast_to(np.asarray(flag, np.uint16).reshape(-1, 1, 1), shape)
    return build_field(
        six=truth + np.repeat(errors[..., None], 6, axis=-1),
        covariance=np.tile(covariance * np.eye(6), (*shape, 1, 1)),
        residual=np.full(shape, 0.1),
        noise=np.full(shape, 2.0),
        flag=flags,
        x=np.arange(SIDE[1]),
        y=np.arange(SIDE[0]),
        time=np.arange(count, dtype=float),
        time_unit="frame",
        frame_numbers=frames,
        attrs={"settings": "{}", "notes": "dark"},
    )


def spread(frames, trials=400, sigma=0.1):
    """Root mean square of error / standard error of the mean, of frames with independent errors of their own."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(trials // 20):
        own = rng.normal(0, sigma, (max(map(max, frames)) + 1, *SIDE))
        errors = np.stack([own[b] - own[a] for a, b in frames])
        mean = recording(errors, covariance=2 * sigma**2, frames=frames).sixflow.mean("time")
        found.append((mean.u - 0.25) / mean.sixflow.standard_error("u"))
    return float(np.sqrt(np.mean(np.square(found))))


# 400 numbers: their root mean square scatters by 1/√800 = 0.035


def test_pairs_that_share_nothing():
    assert spread([(0, 1), (2, 3), (4, 5), (6, 7)]) == pytest.approx(1, abs=0.12)


def test_pairs_from_one_frame():
    assert spread([(0, n) for n in range(1, 6)]) == pytest.approx(1, abs=0.2)


def test_consecutive_pairs_err_less_than_stated():
    """Their noise cancels to 1/N of what independent pairs leave: the statement is √N too large."""
    assert spread([(n, n + 1) for n in range(4)]) == pytest.approx(0.5, abs=0.08)


def test_measured_recording():
    made = synth.sequence(
        synth.Speckle(seed=3),
        synth.Affine.translation(0, 0),
        (96, 96),
        5,
        sensor=synth.Sensor(noise=3, seed=3),
    )
    field = sixflow.measure_sequence(made.frames, pairs="first", window=21)
    mean = field.sixflow.mean()
    z = np.stack([mean[name] / mean.sixflow.standard_error(name) for name in SIX])
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4  # errors agree over the window: some 20 independent points
    assert (mean.sixflow.standard_error("u") < field.sixflow.standard_error("u").isel(time=0)).all()


def test_what_a_mean_says():
    flags = [0, FLAGS["border"], FLAGS["masked"]]
    errors = np.zeros((3, *SIDE))
    errors[2] = np.nan
    field = recording(errors, covariance=1e-4, frames=[(0, 1), (2, 3), (4, 5)], flag=flags)
    mean = field.sixflow.mean("time")
    assert mean.sizes == {"y": 4, "x": 5, "param": 6, "param2": 6}
    assert (mean.pairs == 2).all()
    assert mean.flag.dtype == np.uint16
    assert (mean.flag == FLAGS["border"]).all()
    assert mean.sixflow.valid.all()
    assert float(mean.covariance[0, 0, 0, 0]) == pytest.approx(0.5e-4)
    assert float(mean.time) == 1.0
    assert "frame0" not in mean.coords
    assert mean.attrs["notes"] == "dark\nmean of 3 pairs, frames 0 to 5"
    assert (mean.noise == 2).all()
    assert mean.u.attrs["cell_methods"] == "time: mean"
    alone = field.isel(time=[2]).sixflow.mean()
    assert (alone.flag == FLAGS["masked"]).all()
    assert not alone.sixflow.valid.any()
    assert alone.u.isnull().all()
    assert alone.covariance.isnull().all()


def test_parts_from_the_moved_frames_are_kept():
    field = recording(np.zeros((2, *SIDE)), covariance=4.0, frames=[(0, 1), (0, 2)])
    mean = field.assign(moved_covariance=field.covariance / 4).sixflow.mean()
    assert float(mean.moved_covariance[0, 0, 0, 0]) == pytest.approx(0.5)  # 1/2 of 1
    assert float(mean.covariance[0, 0, 0, 0]) == pytest.approx(3.5)  # and the 3 of frame 0 stay


AVERAGES = {
    "mean": lambda f: f.mean("time"),
    "kept": lambda f: f.mean("time", keep_attrs=True),
    "median": lambda f: f.median("time"),
    "sum": lambda f: f.sum("time"),
    "std": lambda f: f.std("time"),
    "reduce": lambda f: f.reduce(np.mean, "time"),
    "rolling": lambda f: f.rolling(time=2).mean(),
    "coarsen": lambda f: f.coarsen(time=2, boundary="trim").mean(),
    "interp": lambda f: f.interp(x=[1.5, 2.5]),
    "in time": lambda f: f.interp(time=[0.5]),
    "groups": lambda f: f.groupby("frame0").mean(),
    "weighted": lambda f: f.weighted(f.time + 1).mean("time"),
    "cumsum": lambda f: f.cumsum("time"),
    "quotient": lambda f: f / 2,
}


@pytest.mark.parametrize("kind", AVERAGES)
def test_averages_that_are_none(kind, tmp_path):
    field = recording(np.zeros((3, *SIDE)), covariance=1e-4, frames=[(0, 1), (1, 2), (2, 3)])
    average = AVERAGES[kind](field)
    for use in (
        lambda: average.sixflow.valid,
        lambda: average.sixflow.standard_error("u"),
        lambda: average.sixflow.flagged("border"),
        lambda: average.sixflow.summary(),
        lambda: sixflow.write_field(average, tmp_path / "f.nc"),
        lambda: average.sixflow.mean(),
    ):
        with pytest.raises(InputError, match=r"flags of the field are numbers|no dim 'time'"):
            use()
    assert list(tmp_path.iterdir()) == []


def test_selections_are_no_averages():
    field = recording(np.zeros((3, *SIDE)), covariance=1e-4, frames=[(0, 1), (1, 2), (2, 3)])
    for part in (
        field.isel(time=0),
        field.isel(time=0, drop=True),
        field.isel(time=[1]).squeeze(),
        field.sel(x=slice(1, 3)),
        field.where(field.x > 1).assign(flag=field.flag),
        field.assign(flag=field.flag.astype(np.int64)),
        xr.concat([field, field], "time"),
    ):
        assert part.sixflow.valid.any()
        assert part.sixflow.standard_error("u").max() == pytest.approx(0.01)
    with pytest.raises(InputError, match="'time' only"):
        field.sixflow.mean("x")
