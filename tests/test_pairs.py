"""Which frames make pairs: double frames, lags, and what the names of files say."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

from sixflow import InputError, iterate_sequence, measure, measure_sequence
from sixflow.cli import main
from sixflow.field.dataset import SIX
from sixflow.frames import open_frames
from sixflow.frames.doubles import Doubles
from sixflow.frames.naming import read_names
from sixflow.synth import Affine, Sensor, Speckle, sequence
from sixflow.write import RecordingWriter, open_field, write_field

FRAMES = sequence(
    Speckle(seed=1), Affine.translation(0.7, -0.3), (64, 64), 7, sensor=Sensor(noise=1, bits=8)
).frames
OPTIONS = {"window": 21, "step": 16}


@pytest.mark.parametrize(
    ("how", "truth"),
    [
        ({"pairs": "double"}, [(0, 1), (2, 3), (4, 5)]),
        ({"lag": 2}, [(k, k + 2) for k in range(5)]),
        ({"lag": 6}, [(0, 6)]),
    ],
)
@pytest.mark.parametrize("wrap", [np.asarray, iter])
def test_every_pair_is_the_same_pair_alone(how, truth, wrap):
    field = measure_sequence(wrap(FRAMES), **how, **OPTIONS)
    assert np.stack([field.frame0, field.frame1], -1).tolist() == [list(pair) for pair in truth]
    for k, (i, j) in enumerate(truth):
        alone = measure(FRAMES[i], FRAMES[j], **OPTIONS)
        for name in SIX:
            # the grey constant is that of the recording's first frame: rounding of single precision
            np.testing.assert_allclose(field[name][k], alone[name][0], atol=2e-5)
    left = "frame 6 is left over: it has no partner"
    assert (left in field.attrs["notes"]) == ("pairs" in how)
    rest = list(iterate_sequence(FRAMES, skip=1, **how, **OPTIONS))
    assert [one.frame1.item() for one in rest] == [j for _, j in truth[1:]]


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"lag": 0}, "lag=0: must be a whole number"),
        ({"lag": 1.5}, "lag=1.5: must be a whole number"),
        ({"lag": True}, "lag=True: must be a whole number"),
        ({"lag": 2, "pairs": "first"}, "lag=2: goes with pairs='consecutive' only"),
        ({"lag": 2, "pairs": "double"}, "lag=2: goes with pairs='consecutive' only"),
        ({"lag": 7}, "frames: 7 given; lag=7 needs at least 8"),
        ({"pairs": "twos"}, "pairs='twos': must be one of"),
        ({"update": 2, "pairs": "double"}, "update=2: goes with pairs='first' only"),
        ({"strict": 1}, "strict=1: must be True or False"),
    ],
)
def test_refused(how, said):
    with pytest.raises(InputError, match=said):
        measure_sequence(FRAMES, **how, **OPTIONS)


@pytest.mark.parametrize(
    "names",
    [
        ["r01_a.tif", "r01_b.tif", "r02_a.tif", "r02_b.tif"],
        ["r01A.tif", "r01B.tif", "r02A.tif", "r02B.tif"],
        ["t1-0.png", "t1-1.png", "t2-0.png", "t2-1.png"],
        ["t_1_1.png", "t_1_2.png", "t_2_1.png", "t_2_2.png", "t_3_1.png"],
    ],
)
def test_files_that_come_in_twos(names):
    found = Doubles.among(names)
    assert found is not None
    assert found.unmatched() is None


@pytest.mark.parametrize(
    "names",
    [
        ["img_1.tif", "img_2.tif", "img_3.tif", "img_4.tif"],
        ["img_0.tif", "img_1.tif"],
        ["a.tif", "b.tif"],
        ["a.tif", "b.tif", "c.tif"],
        ["run.tif[0]", "run.tif[1]", "run.tif[2]", "run.tif[3]"],
        ["frame 0", "frame 1", "frame 2"],
        ["0001.tif", "0002.tif", "0010.tif", "0011.tif", "0012.tif"],
        [],
    ],
)
def test_files_that_do_not(names):
    assert Doubles.among(names) is None


def test_leaps_in_the_numbers_of_files():
    def gaps(*numbers):
        return read_names([Path(f"img{number}.png") for number in numbers], given_order=True).gaps

    assert gaps(1, 2, 5, 6) == (2,)
    assert gaps(10, 20, 30) == ()
    assert gaps(3, 2, 1) == ()
    assert read_names([Path(name) for name in ("x1_y1.png", "x2_y5.png", "x9_y9.png")]).gaps == ()
    assert read_names([Path(name) for name in ("a1.png", "a2.png", "a3.png", "ref.png")]).gaps == (3,)


def test_gaps_and_joints_of_files(tmp_path):
    for number in (0, 1, 2, 6):
        tifffile.imwrite(tmp_path / f"img{number}.tif", FRAMES[number % 3])
    single = open_frames(tmp_path)
    assert (single.gaps, single.joints) == ((3,), ())
    assert (single[1:].gaps, single[1:].files) == ((3,), ("img1.tif", "img2.tif", "img6.tif"))
    for number in (0, 1):
        tifffile.imwrite(tmp_path / f"stack{number}.tif", FRAMES[:2], photometric="minisblack")
    stacks = open_frames(str(tmp_path / "stack*.tif"))
    assert (stacks.gaps, stacks.joints) == ((), (2,))
    assert open_frames(tmp_path / "stack0.tif").files == ()


def save(folder, names):
    for name, frame in zip(names, FRAMES, strict=False):
        tifffile.imwrite(folder / name, frame)
    return folder


def test_double_files_measured_as_consecutive_say_so(tmp_path, capsys):
    names = [f"r{k}_{letter}.tif" for k in range(3) for letter in "ab"]
    folder = save(tmp_path, names)
    field = measure_sequence(str(folder), **OPTIONS)
    assert field.attrs["notes"].startswith(
        "CHECK THE PAIRS: the files come in twos, such as r0_a.tif and r0_b.tif"
    )
    double = measure_sequence(str(folder), pairs="double", frame_interval=1e-3, **OPTIONS)
    assert double.attrs["notes"] == ""
    assert double.name0.values.tolist() == names[::2]
    assert double.name1.values.tolist() == names[1::2]
    assert (double.interval == 1e-3).all()
    assert double.time.attrs["units"] == "frame"  # when the pairs were taken is unknown
    output = str(tmp_path / "field.nc")
    assert (
        main(["measure", str(folder), "-o", output, "--window", "21", "--step", "16", "--pairs", "double"])
        == 0
    )
    assert "3 pairs" in capsys.readouterr().out
    (folder / names[3]).unlink()
    with pytest.raises(InputError, match=r"r1_a.tif and r2_a.tif would be a pair, but their names say"):
        measure_sequence(str(folder), pairs="double", **OPTIONS)


def test_time_over_a_leap_is_unknown(tmp_path):
    folder = save(tmp_path, [f"img{number}.tif" for number in (1, 2, 5, 6)])
    for known, unit in (({}, "frame"), ({"frame_interval": 0.5}, "s")):
        field = measure_sequence(str(folder), **known, **OPTIONS)
        passed = known.get("frame_interval", 1.0)
        np.testing.assert_array_equal(field.interval, [passed, np.nan, passed])
        assert field.interval.attrs["units"] == unit
        assert np.isnan(field.sixflow.vorticity[1]).all()
        assert np.isfinite(field.u[1]).all()
        assert "frames may be missing between img2.tif and img5.tif" in field.attrs["notes"]
        later = field.sixflow.calibrate(frame_interval=0.5)
        np.testing.assert_array_equal(later.interval, [0.5, np.nan, 0.5])
    first = measure_sequence(str(folder), pairs="first", frame_interval=0.5, **OPTIONS)
    np.testing.assert_array_equal(first.interval, [0.5, np.nan, np.nan])
    given = measure_sequence(str(folder), times=[1, 2, 5, 6], **OPTIONS)
    np.testing.assert_array_equal(given.interval, [1, 3, 1])


def test_pair_of_paths(tmp_path):
    save(tmp_path, ["a.tif", "b.tif"])
    field = measure(tmp_path / "a.tif", str(tmp_path / "b.tif"), frame_interval=0.5, **OPTIONS)
    alone = measure(FRAMES[0], FRAMES[1], frame_interval=0.5, **OPTIONS)
    for name in ("u", "covariance", "interval", "time"):
        np.testing.assert_array_equal(field[name], alone[name])
    assert field.name1.item() == "b.tif"
    tifffile.imwrite(tmp_path / "stack.tif", FRAMES[:3], photometric="minisblack")
    with pytest.raises(InputError, match="hold 6 frames"):
        measure(tmp_path / "stack.tif", tmp_path / "stack.tif", **OPTIONS)
    with pytest.raises(InputError, match="a path and an array"):
        measure(tmp_path / "a.tif", FRAMES[0], **OPTIONS)


@pytest.mark.parametrize("suffix", ["nc", "zarr", "csv"])
def test_names_of_files_are_stored(tmp_path, suffix):
    names = ["a9,x.tif", "a10ü.tif", "a11.tif", "a100.tif", "a101.tif"]
    folder = save(tmp_path, names)
    paths = [str(folder / name) for name in names]
    with RecordingWriter(tmp_path / f"r.{suffix}", batch=2) as writer:
        for field in iterate_sequence(paths, **OPTIONS):
            writer.append(field)
    if suffix == "csv":
        text = (tmp_path / "r.csv").read_text(encoding="utf-8")
        assert '"a9,x.tif",a10ü.tif,' in text
        header = next(line for line in text.splitlines() if line[0] != "#")
        assert header.startswith(
            "time_frame,time0_frame,time1_frame,interval_frame,frame0,frame1,name0,name1,y_px"
        )
        return
    with open_field(tmp_path / f"r.{suffix}") as back:
        assert back.name0.values.tolist() == names[:-1]
        assert back.name1.values.tolist() == names[1:]
        write_field(back, tmp_path / f"again.{'zarr' if suffix == 'nc' else 'nc'}")
