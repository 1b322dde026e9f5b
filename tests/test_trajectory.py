"""Sequences against the first frame: joined steps, accumulated covariance, renewed references, resuming."""

import numpy as np
import pytest

import measured
from sixflow import InputError, iterate_sequence, measure, measure_sequence
from sixflow.cli import main
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.field.interval import elapsed
from sixflow.maps.grid import Grid
from sixflow.maps.motion import Motion
from sixflow.masks import Bodies
from sixflow.measurement import join_fields
from sixflow.recording.sequence import LOST
from sixflow.recording.trajectory import carried, composed
from sixflow.synth import Affine, Sensor, Speckle, sequence
from sixflow.write import open_field, write_field

SIX = (0.8, -0.6, 0.02, 0.03, 0.015, -0.01)
WINDOW, STEP = 31, 8


def recording(seed=0, count=6, noise=4.0, size=192, six=SIX):
    motion = Affine.from_six(six, ((size - 1) / 2, (size - 1) / 2))
    return sequence(Speckle(seed=seed), motion, (size, size), count, sensor=Sensor(noise=noise, seed=seed))


def truth(made, field):
    x, y = np.meshgrid(field.x, field.y)
    return made.truth(x, y, int(field.frame0[0]), int(field.frame1[0]))


def affine_motion(grid, plane, flag=0, spread=1e-4, bias=np.nan):
    """An affine motion on a grid, as a step."""
    from sixflow.convention import SIX_FROM_GRADIENT

    six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, grid.plane(np.array(plane)), axes=1), 0, -1)
    covariance = np.broadcast_to(spread * np.diag([1, 1, 0.01, 0.01, 0.01, 0.01]), (*grid.shape, 6, 6)).copy()
    flags = np.full(grid.shape, flag, np.uint16)
    same = np.ones(grid.shape)
    biases = np.full((*grid.shape, 6), bias)
    return Motion(six, covariance, covariance / 2, flags, same, same, None, biases)


def test_affine_steps_join_exactly():
    grid = Grid.over((120, 100), 8)
    one, two = (3.0, -2.0, 0.05, 0.1, -0.08, 0.02), (-1.0, 4.0, -0.1, 0.05, 0.06, 0.03)
    made = composed(affine_motion(grid, one), affine_motion(grid, two), grid, (120, 100))
    x, y = np.meshgrid(grid.x, grid.y)
    F = [np.eye(2) + np.reshape(p[2:], (2, 2)) for p in (one, two)]
    start = np.stack([x, y], axis=-1).astype(float)
    there = (start @ F[0].T + one[:2]) @ F[1].T + two[:2]
    kept = made.valid
    assert kept.mean() > 0.8
    np.testing.assert_allclose((made.six[..., :2] - (there - start))[kept], 0, atol=1e-10)
    G = F[1] @ F[0] - np.eye(2)
    np.testing.assert_allclose(made.six[..., 3][kept], G[1, 0] - G[0, 1], atol=1e-12)
    assert (made.flag[~kept] == FLAGS["unmatched"]).all()


def test_equal_steps_do_not_walk_at_random():
    """Two shifts of the same covariance: what both see of the frame between them cancels."""
    grid = Grid.over((64, 64), 8)
    step = affine_motion(grid, (0.5, 0.5, 0, 0, 0, 0))
    motion = step
    for _ in range(4):
        motion = composed(motion, step, grid, (64, 64))
    kept = motion.valid
    assert kept.sum() > 30
    kept[-1] = kept[:, -1] = False  # beyond the outermost points maps are extended
    np.testing.assert_allclose(motion.covariance[kept], step.covariance[kept], rtol=1e-3, atol=1e-12)


def test_biases_of_steps_add_up():
    """What windows leave out is alike in all steps: its size grows with their number, not with the root of it."""
    grid = Grid.over((64, 64), 8)
    step = affine_motion(grid, (0.5, 0.5, 0, 0, 0, 0), bias=0.01)
    motion = composed(composed(step, step, grid, (64, 64)), step, grid, (64, 64))
    kept = motion.valid
    kept[-1] = kept[:, -1] = False
    np.testing.assert_allclose(motion.bias[kept], 9 * 0.01, rtol=1e-6)
    unknown = composed(affine_motion(grid, (0.5, 0.5, 0, 0, 0, 0)), step, grid, (64, 64))
    np.testing.assert_allclose(unknown.bias[unknown.valid & kept], 0.01, rtol=1e-6)


def test_a_lost_point_stays_lost():
    grid = Grid.over((96, 96), 8)
    base = affine_motion(grid, (0, 0, 0, 0, 0, 0))
    base.flag[4, 5] = FLAGS["outlier"]
    gone = affine_motion(grid, (0, 0, 0, 0, 0, 0))
    gone.flag[2, 3] = FLAGS["low_texture"]
    made = composed(base, gone, grid, (96, 96))
    made = composed(made, affine_motion(grid, (0, 0, 0, 0, 0, 0)), grid, (96, 96))
    assert made.flag[4, 5] & FLAGS["outlier"]
    assert np.isnan(made.six[4, 5]).all()
    # the point itself failed, and the neighbours are a step away: its map can be told from theirs
    assert made.valid.sum() >= made.valid.size - 2


def test_nothing_is_told_far_from_what_was_measured():
    grid = Grid.over((96, 96), 8)
    step = affine_motion(grid, (0, 0, 0, 0, 0, 0))
    step.flag[:, 6:] = FLAGS["unmatched"]
    made = composed(affine_motion(grid, (0.5, 0, 0, 0, 0, 0)), step, grid, (96, 96))
    assert made.valid[:, :6].all()
    assert not made.valid[:, 7:].any()
    assert (made.flag[:, 7:] & FLAGS["unmatched"]).all()


@pytest.mark.parametrize("noise", [2.0, 6.0])
def test_the_accumulated_covariance_is_calibrated(noise):
    """Six frames: neither as five independent steps nor as one, but as the steps' shared frames say."""
    z = {0: [], 2: [], 4: []}
    for seed in range(2):
        made = recording(seed, noise=noise, size=256)
        field = measure_sequence(made.frames, pairs="incremental")
        for k, kept in z.items():
            one = field.isel(time=[k])
            error = measured.six_of(one) - truth(made, one)
            kept.append((error / measured.standard_errors(one))[measured.complete(one)])
    for kept in z.values():
        kept = np.concatenate(kept)
        count = measured.windows(len(kept), STEP, WINDOW)
        np.testing.assert_allclose(measured.rms(kept), 1, atol=4 / np.sqrt(2 * count))


@pytest.mark.parametrize(
    ("options", "source"),
    [
        ({"pairs": "first"}, None),
        ({"pairs": "incremental"}, [0, 1, 2, 3, 4]),
        ({"pairs": "first", "update": 2}, [0, 0, 2, 2, 4]),
        ({"pairs": "first", "update": "lost"}, [0, 0, 0, 0, 0]),
    ],
)
def test_every_way_finds_the_motion_from_the_first_frame(options, source):
    made = recording(noise=1.0)
    field = measure_sequence(made.frames, **options)
    assert field.frame0.values.tolist() == [0] * 5
    assert field.time.values.tolist() == [1, 2, 3, 4, 5]
    assert field.time.attrs["long_name"] == "time of the moved frame"
    assert (field.measured_from.values.tolist() if source else None) == source
    assert ("moved_covariance" in field) == (source is not None)
    for k in range(5):
        one = field.isel(time=[k])
        error = measured.six_of(one) - truth(made, one)
        kept = ~measured.failed(one)
        assert kept.mean() > 0.8
        assert (np.abs(error)[kept] < np.maximum(6 * measured.standard_errors(one)[kept], 1e-3)).all()


def test_joined_fields_are_written_and_read(tmp_path):
    frames = recording(count=3, size=96).frames
    mask = np.where(np.arange(96)[:, None] < 48, 1, 2) * np.ones((1, 96), int)
    field = measure_sequence(frames, pairs="incremental", mask=mask, times=[0.0, 0.1, 0.2])
    np.testing.assert_allclose(elapsed(field).values, [0.1, 0.2])  # every pair has an interval of its own
    for suffix in ("nc", "zarr"):
        path = tmp_path / f"field.{suffix}"
        write_field(field, path)
        with open_field(path) as back:
            np.testing.assert_array_equal(back.body, field.body)
            np.testing.assert_array_equal(back.moved_covariance, field.moved_covariance)
            np.testing.assert_array_equal(back.measured_from, [0, 1])
    write_field(field, tmp_path / "field.csv")


def test_points_once_lost_have_no_numbers_again():
    made = recording(six=(3.0, 1.0, 0.0, 0.1, 0.0, 0.0))
    field = measure_sequence(made.frames, pairs="incremental")
    failed = (field.flag.values & FAILING) != 0
    assert (failed[1:] >= failed[:-1]).all()
    assert failed[-1].any()
    assert np.isnan(field.u.values[failed]).all()


def test_correlation_that_is_lost_renews_the_reference():
    """The pattern changes from frame to frame: the first frame is soon forgotten, neighbours are alike."""
    parts = [sequence(Speckle(seed=s), Affine.translation(1.0, 0.5), (128, 128), 6).frames for s in (1, 2)]
    angle = np.linspace(0, 1, 6)[:, None, None]
    frames = np.cos(angle) * parts[0] + np.sin(angle) * parts[1]
    how = {"pairs": "first", "search": "pyramid", "lighting": "gain+offset"}
    direct, renewed = (measure_sequence(frames, update=update, **how) for update in (None, "lost"))
    valid = [((f.flag.values[-1] & FAILING) == 0).mean() for f in (direct, renewed)]
    assert valid[0] < 0.2
    sources = renewed.measured_from.values
    # up to a fifth of the points may go before each renewal, and none returns
    assert valid[1] > LOST ** (len(set(sources)) - 1)
    assert sources[0] == 0
    assert sources[-1] > 0
    assert (np.diff(sources) >= 0).all()
    assert float(renewed.u[-1].median()) == pytest.approx(5.0, abs=0.2)


MASK = np.zeros((192, 192), bool)
MASK[30:160, 30:90] = MASK[30:160, 93:160] = True


@pytest.mark.parametrize(
    "options",
    [
        {"pairs": "first"},
        {"pairs": "incremental"},
        {"pairs": "first", "update": 3},
        {"pairs": "first", "update": "lost"},
        {"pairs": "first", "update": 2, "mask": MASK},
    ],
)
def test_an_interrupted_run_goes_on_with_the_same_numbers(options):
    frames = recording(six=(3.0, 1.0, 0.02, 0.1, 0.0, 0.0)).frames
    options = {"step": 16, "search": "pyramid"} | options
    whole = list(iterate_sequence(frames, **options))
    for skip in (1, 4):
        done = join_fields(whole[:skip])
        for source in (done, None) if skip == 1 else (done,):
            rest = list(iterate_sequence(frames, skip=skip, done=source, **options))
            assert len(rest) == len(whole) - skip
            for one, other in zip(rest, whole[skip:], strict=True):
                assert one.attrs["input_digest"] == other.attrs["input_digest"]
                for name in other.variables:
                    np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=str(name))


def test_the_mask_of_the_first_frame_goes_along():
    grid = Grid.over((120, 120), 8)
    mask = np.zeros((120, 120), bool)
    mask[40:70, 30:60] = True
    there = carried(Bodies.of(mask), affine_motion(grid, (20.0, 5.0, 0, 0, 0, 0)), grid)
    moved = np.zeros((120, 120), bool)
    moved[45:75, 50:80] = True
    np.testing.assert_array_equal(there.labels > 0, moved)
    gone = affine_motion(grid, (0, 0, 0, 0, 0, 0), flag=FLAGS["unmatched"])
    assert carried(Bodies.of(mask), gone, grid) is None


def test_a_large_total_motion_is_followed():
    """Each pair starts from the one before: 2.5° a frame, to 30°, which the pyramid does not find from rest."""
    turn = np.radians(2.5)
    made = recording(count=13, noise=2.0, size=128, six=(0, 0, 2 * np.cos(turn) - 2, 2 * np.sin(turn), 0, 0))
    last = measure_sequence(made.frames, pairs="first", search="pyramid").isel(time=[-1])
    alone = measure(made.frames[0], made.frames[-1], search="pyramid")
    kept = ~measured.failed(last)
    x, y = np.meshgrid(last.x, last.y)
    stays = np.hypot(x - 63.5, y - 63.5) < 45
    assert kept[stays].mean() > 0.95
    assert (~measured.failed(alone))[stays].mean() < 0.5
    error = measured.six_of(last) - truth(made, last)
    assert np.abs(error[kept & stays][:, :2]).max() < 0.2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pairs": "first", "update": 0}, "update=0"),
        ({"pairs": "first", "update": True}, "update=True"),
        ({"pairs": "first", "update": "never"}, "update='never'"),
        ({"update": 3}, "update=3: goes with pairs='first' only"),
        ({"pairs": "incremental", "update": 3}, "update=3: goes with pairs='first' only"),
        ({"pairs": "incremental", "reference": "middle"}, "reference='middle': steps are joined"),
        ({"pairs": "first", "update": "lost", "reference": "second"}, "reference='second': steps are joined"),
        ({"pairs": "last"}, "pairs='last': must be one of 'consecutive', 'double', 'first', 'incremental'"),
    ],
)
def test_what_does_not_go_together(options, said):
    frames = recording(count=3, size=64).frames
    with pytest.raises(InputError) as caught:
        measure_sequence(frames, **options)
    assert said in str(caught.value)


def test_done_has_to_hold_all_that_is_left_out():
    frames = recording(count=4, size=64).frames
    done = measure(frames[0], frames[1])
    with pytest.raises(InputError, match="done holds 1 pairs, but skip=2"):
        list(iterate_sequence(frames, pairs="first", skip=2, done=done))


def test_the_command_line_follows_and_resumes(tmp_path, monkeypatch):
    import tifffile

    from sixflow import write

    frames = recording(count=5, size=96).frames
    tifffile.imwrite(tmp_path / "recording.tif", frames.astype(np.float32), photometric="minisblack")
    masks = np.zeros(frames.shape, np.uint8)
    masks[:, 10:80, 10:44], masks[:, 10:80, 44:80] = 1, 2
    tifffile.imwrite(tmp_path / "masks.tif", masks, photometric="minisblack")
    monkeypatch.chdir(tmp_path)
    flags = ["--pairs", "first", "--update", "2", "--window", "21", "--mask", "masks.tif", "--bodies", "-q"]
    assert main(["measure", "recording.tif", "-o", "whole.zarr", *flags]) == 0
    with open_field("whole.zarr") as field:
        whole = field.load()
    assert whole.measured_from.values.tolist() == [0, 0, 2, 2]
    assert set(np.unique(whole.body)) == {0, 1, 2}

    original = write.RecordingWriter.__init__

    def small(self, *args, **options):
        original(self, *args, **options | {"batch": 1})

    monkeypatch.setattr(write.RecordingWriter, "__init__", small)
    add = write.RecordingWriter.append

    def stopping(self, field):
        if self.done == 3:
            raise KeyboardInterrupt
        add(self, field)

    monkeypatch.setattr(write.RecordingWriter, "append", stopping)
    assert main(["measure", "recording.tif", "-o", "cut.zarr", *flags]) == 130
    monkeypatch.setattr(write.RecordingWriter, "append", add)
    assert main(["measure", "recording.tif", "-o", "cut.zarr", "--resume", *flags]) == 0
    with open_field("cut.zarr") as field:
        again = field.load()
    for name in whole.variables:
        np.testing.assert_array_equal(again[name].values, whole[name].values, err_msg=str(name))
    assert main(["measure", "recording.tif", "-o", "no.nc", "--update", "lots", "-q"]) == 2
    assert main(["measure", "recording.tif", "-o", "no.nc", "--update", "2", "-q"]) == 2
    assert main(["measure", "recording.tif", "-o", "no.nc", "--bodies", "-q"]) == 2
