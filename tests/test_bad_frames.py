"""Frames that cannot be used, and copies: their pairs are flagged whole, and the recording goes on."""

import numpy as np
import pytest
import tifffile
import xarray as xr

from sixflow import InputError, iterate_sequence, measure, measure_sequence
from sixflow.cli import main
from sixflow.cli.errors import BAD_FRAMES
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.errors import BadFrameError
from sixflow.frames import BadFrame, open_frames
from sixflow.measurement import join_fields
from sixflow.synth import Affine, Sensor, Speckle, sequence
from sixflow.write import open_field

FRAMES = sequence(
    Speckle(seed=1), Affine.translation(0.7, -0.3), (64, 64), 8, sensor=Sensor(noise=1, bits=8)
).frames.astype(float)
OPTIONS = {"window": 21, "step": 16}
BAD = {
    "black": lambda k: np.zeros_like(FRAMES[k]),
    "nan": lambda k: np.full_like(FRAMES[k], np.nan),
    "infinite": lambda k: np.full_like(FRAMES[k], np.inf),
    "small": lambda k: FRAMES[k][:40],
    "no frame": lambda k: np.zeros((3, 3, 7)),
}


def film(count=6, **bad):
    """Frames, of which some are bad: film(f2="black"); "copy" repeats the one before."""
    frames = list(FRAMES[:count])
    for name, kind in bad.items():
        k = int(name[1:])
        frames[k] = frames[k - 1].copy() if kind == "copy" else BAD[kind](k)
    return frames


def valid_and_flags(field):
    return (
        field.sixflow.valid.mean(("y", "x")).values.tolist(),
        [sorted({int(value) for value in np.unique(one & FAILING)} - {0}) for one in field.flag.values],
    )


LOST = {"consecutive": (1, 2), "double": (1,), "first": (1,), "incremental": (1,)}


@pytest.mark.parametrize(
    ("pairs", "kind"),
    [
        *(("consecutive", kind) for kind in BAD),
        ("double", "small"),
        ("first", "nan"),
        ("incremental", "black"),
    ],
)
def test_pairs_of_a_bad_frame_are_flagged(pairs, kind):
    bad, lost = film(f2=kind), LOST[pairs]
    field = measure_sequence(bad, pairs=pairs, **OPTIONS)
    count = 3 if pairs == "double" else 5
    valid, flags = valid_and_flags(field)
    assert valid == [float(k not in lost) for k in range(count)]
    assert flags == [[FLAGS["bad_frame"]] if k in lost else [] for k in range(count)]
    good = measure_sequence(film(), pairs=pairs, **OPTIONS)
    motion = [0.7 * (k + 1) if pairs in ("first", "incremental") else 0.7 for k in range(count)]
    for k in set(range(count)) - set(lost):
        assert abs(float(field.u[k].median()) - motion[k]) < 0.05
        if pairs in ("consecutive", "double"):
            xr.testing.assert_equal(field.isel(time=k), good.isel(time=k))
    for name in ("u", "shear", "covariance", "residual", "noise", "resolution"):
        assert np.isnan(field[name].values[list(lost)]).all()
        assert field[name].dtype == good[name].dtype
    assert "frame 2" in field.attrs["notes"]
    assert "not measured" in field.attrs["notes"]
    with pytest.raises(InputError, match="frame 2"):
        measure_sequence(bad, pairs=pairs, strict=True, **OPTIONS)


def test_first_and_last_frames_and_several():
    assert valid_and_flags(measure_sequence(film(f0="black", f1="nan"), **OPTIONS))[0] == [0, 0, 1, 1, 1]
    assert valid_and_flags(measure_sequence(film(f5="black"), **OPTIONS))[0] == [1, 1, 1, 1, 0]
    assert valid_and_flags(measure_sequence(film(f2="black", f3="small"), **OPTIONS))[0] == [1, 0, 0, 0, 1]
    assert valid_and_flags(measure_sequence(film(f2="black"), lag=2, **OPTIONS))[0] == [0, 1, 0, 1]
    for pairs in ("first", "incremental"):
        with pytest.raises(
            BadFrameError, match=r"frame 0 is constant.*open_frames\(…, first=1\) \(--first 1\)"
        ):
            measure_sequence(film(f0="black"), pairs=pairs, **OPTIONS)
    with pytest.raises(BadFrameError, match="no frame of the recording can be used"):
        measure_sequence([np.zeros((64, 64))] * 3, **OPTIONS)


def test_copies_are_no_measurement_of_no_motion():
    field = measure_sequence(film(f2="copy"), **OPTIONS)
    valid, flags = valid_and_flags(field)
    assert valid == [1, 0, 1, 1, 1]
    assert flags[1] == [FLAGS["repeated"]]
    assert "frames 1 and 2 are the same to the last bit" in field.attrs["notes"]
    assert "frame 2 repeats frame 1 to the last bit: other pairs" in field.attrs["notes"]
    assert valid_and_flags(measure_sequence(film(f2="copy"), pairs="incremental", **OPTIONS))[0] == [
        1,
        0,
        1,
        1,
        1,
    ]
    first = measure_sequence(film(f2="copy"), pairs="first", **OPTIONS)
    assert valid_and_flags(first)[0] == [1] * 5  # no pair of two equal frames, but it is told
    assert "frame 2 repeats frame 1" in first.attrs["notes"]
    assert valid_and_flags(measure_sequence(film(f1="copy"), pairs="first", **OPTIONS))[0] == [0, 1, 1, 1, 1]
    alone = measure(FRAMES[0], FRAMES[0], **OPTIONS)
    assert (alone.flag == FLAGS["repeated"]).all()
    for pairs in ("consecutive", "first"):
        with pytest.raises(InputError, match="frame 2 repeats frame 1"):
            measure_sequence(film(f2="copy"), pairs=pairs, strict=True, **OPTIONS)


def test_copies_inside_the_mask():
    mask = np.ones((64, 64), bool)
    mask[:8] = False
    stamped = [np.where(mask, FRAMES[0], 40 * k) for k in range(3)]  # a clock that is burnt in
    assert (measure_sequence(stamped, mask=mask, **OPTIONS).sixflow.flagged("repeated")).all()


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("pairs", ["consecutive", "incremental"])
def test_masked_points_stay_masked(pairs, moving):
    mask = np.zeros((64, 64), int)
    mask[:, :28], mask[:, 36:] = 1, 2
    masks = np.stack([mask] * 6) if moving else mask
    field = measure_sequence(film(f2="black", f4="copy"), pairs=pairs, mask=masks, **OPTIONS)
    masked = field.sixflow.flagged("masked")
    for k in range(5):
        np.testing.assert_array_equal(masked[k], masked[0])
        np.testing.assert_array_equal(field.body[k] == 0, masked[0])
    assert field.sixflow.flagged("bad_frame")[1].all()
    assert field.sixflow.flagged("repeated")[3].all()


def test_a_mask_that_falls_on_missing_pixels():
    frames = film()
    frames[2] = frames[2].copy()
    frames[2][:, :40] = np.nan
    mask = np.zeros((64, 64), bool)
    mask[:, :30] = True
    field = measure_sequence(frames, mask=mask, **OPTIONS)
    assert field.sixflow.flagged("bad_frame").all(("y", "x")).values.tolist() == [
        False,
        False,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize("update", [1, 2, 3, "lost"])
def test_steps_go_on_from_the_last_good_frame(update):
    field = measure_sequence(film(8, f2="black", f4="small"), pairs="first", update=update, **OPTIONS)
    assert valid_and_flags(field)[0] == [1, 0, 1, 0, 1, 1, 1]
    np.testing.assert_allclose(
        field.u[[0, 2, 4, 5, 6]].median(("y", "x")), [0.7, 2.1, 3.5, 4.2, 4.9], atol=0.03
    )
    expected = {1: [0, 1, 1, 3, 3, 5, 6], 2: [0, 0, 0, 0, 0, 0, 6], 3: [0, 0, 0, 3, 3, 3, 6], "lost": [0] * 7}
    assert field.measured_from.values.tolist() == expected[update]
    assert np.isnan(field.moved_covariance.values[[1, 3]]).all()


@pytest.mark.parametrize(
    ("pairs", "update"),
    [
        ("consecutive", None),
        ("double", None),
        ("first", None),
        ("incremental", None),
        ("first", 2),
        ("first", "lost"),
    ],
)
def test_resumed_numbers_are_those_of_an_uninterrupted_run(pairs, update):
    frames = film(7, f1="black", f3="copy", f5="nan")
    if update == "lost":  # a leap, at which correlation is lost
        frames = [np.roll(frame, 0 if k < 4 else 9, 1) for k, frame in enumerate(frames)]
    options = {"pairs": pairs, "update": update, "frame_interval": 0.5, **OPTIONS}
    whole = list(iterate_sequence(frames, **options))
    for skip in {1, len(whole) // 2, len(whole) - 1}:
        for done in (join_fields(whole[:skip]), None):
            rest = list(iterate_sequence(frames, skip=skip, done=done, **options))
            assert len(rest) == len(whole) - skip
            for one, other in zip(whole[skip:], rest, strict=True):
                xr.testing.assert_equal(one, other)
                assert one.attrs["input_digest"] == other.attrs["input_digest"]


def test_frames_that_cannot_be_read():
    class Damaged(type(open_frames(FRAMES))):
        def _raw(self, numbers):
            for k, name, frame in super()._raw(numbers):
                yield k, name, BadFrame(name, InputError(f"{name}: damaged")) if k == 2 else frame

    field = measure_sequence(Damaged(FRAMES[:5]), **OPTIONS)
    assert valid_and_flags(field)[0] == [1, 0, 0, 1]
    assert "frames 1 and 2 were not measured: frame 2: damaged" in field.attrs["notes"]


def test_types_may_differ_in_memory():
    frames = [FRAMES[0].astype(np.uint8), FRAMES[1], FRAMES[2].astype(np.float32)]
    assert valid_and_flags(measure_sequence(frames, **OPTIONS))[0] == [1, 1]


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_command_line(tmp_path, monkeypatch, capsys, suffix):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sixflow.plot.plot_field", lambda field, frame, path: path.write_bytes(b"x"))
    frames = np.stack(film(f2="black", f4="copy")).astype(np.uint8)
    tifffile.imwrite("run.tif", frames, photometric="minisblack")
    command = ["measure", "run.tif", "-o", f"field.{suffix}", "--window", "21", "--step", "16"]
    assert main([*command, "--strict"]) == 2
    err = capsys.readouterr().err
    assert "frame 2" in err
    assert "constant (0)" in err
    assert "1 pairs are complete" in err
    assert main([*command, "--resume"]) == BAD_FRAMES  # done, but a frame was bad
    out, err = capsys.readouterr()
    assert ", 3 pairs with a bad or repeated frame, " in out
    assert "frames 1 and 2 were not measured" in err
    with open_field(f"field.{suffix}") as back:
        again = measure_sequence(frames, **OPTIONS)
        xr.testing.assert_equal(back.load(), again)
        assert set(back.attrs["notes"].splitlines()) == set(again.attrs["notes"].splitlines())
    if suffix == "nc":
        return
    assert main([*command, "--overwrite", "--plot", "field.png", "--quiet"]) == BAD_FRAMES
    black = np.stack(film(f0="black")).astype(np.uint8)
    tifffile.imwrite("dark.tif", black, photometric="minisblack")
    dark = ["measure", "dark.tif", "-o", "dark.csv", "--window", "21", "--step", "16"]
    assert main([*dark, "--pairs", "first"]) == 2
    assert "--first 1" in capsys.readouterr().err
    assert main(dark) == BAD_FRAMES
