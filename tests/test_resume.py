"""Recordings that are resumed: frames that were measured must still be the same; attributes are those of all pairs."""

import json

import numpy as np
import pytest
import xarray as xr

import sixflow
from sixflow import synth
from sixflow.errors import FieldFileError, InputError
from sixflow.field.provenance import joined_attrs
from sixflow.frames.bad import BadFrame
from sixflow.frames.digests import FrameDigests, frame_digest
from sixflow.measurement import join_fields
from sixflow.write import RecordingWriter, open_field

QUICK = {"window": 21, "step": 16}


@pytest.fixture(scope="module")
def frames():
    made = synth.sequence(
        synth.Speckle(seed=1),
        synth.Affine.translation(0.6, -0.3),
        (48, 64),
        6,
        sensor=synth.Sensor(noise=1, bits=8),
    )
    return made.frames


def part(path, frames, stop=None, **options):
    """Measure into a file; stop by an exception after so many pairs."""
    with RecordingWriter(path, batch=2, resume=True) as writer:
        fields = sixflow.iterate_sequence(
            frames, skip=writer.done, done=writer.stored(), seen=writer.frames, **(QUICK | options)
        )
        for number, field in enumerate(fields):
            if number == stop:
                raise KeyboardInterrupt
            writer.append(field)


def interrupted(path, frames, **options):
    with pytest.raises(KeyboardInterrupt):
        part(path, frames, stop=3, **options)  # two pairs are complete: of the frames 0, 1 and 2


@pytest.mark.parametrize("pairs", ["consecutive", "first", "incremental"])
@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_frame_that_was_measured_and_changed_is_refused(tmp_path, frames, pairs, number):
    path = tmp_path / "f.zarr"
    interrupted(path, frames, pairs=pairs)
    changed = np.array(frames)
    changed[number, 5, 7] ^= 1
    with pytest.raises(InputError, match=rf"frame {number}: is not the frame that was measured"):
        part(path, changed, pairs=pairs)
    part(path, frames, pairs=pairs)
    with open_field(path) as field:
        whole = sixflow.measure_sequence(frames, pairs=pairs, **QUICK)
        xr.testing.assert_identical(field.load().drop_attrs(), whole.drop_attrs())
        assert field.attrs["input_digest"] == whole.attrs["input_digest"]


def test_frames_that_were_not_measured_may_change(tmp_path, frames):
    interrupted(tmp_path / "f.nc", frames)
    changed = np.array(frames)
    changed[4, 5, 7] ^= 1
    part(tmp_path / "f.nc", changed)
    interrupted(tmp_path / "g.nc", frames)
    with pytest.raises(InputError, match="there are 2, but 3 were measured"):
        part(tmp_path / "g.nc", frames[:2])


def test_digests_of_frames():
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert frame_digest(image) == frame_digest(np.asfortranarray(image))
    different = [
        image,
        image.T.copy(),
        image.astype(np.uint16),
        image + 1,
        np.ma.array(image, mask=image > 4),
    ]
    assert len({frame_digest(one) for one in different}) == len(different)
    bad = [BadFrame("a", InputError("cut")), BadFrame("b", InputError("black"))]
    assert frame_digest(bad[0]) == frame_digest(bad[1]) not in {frame_digest(one) for one in different}
    seen = FrameDigests([frame_digest(image), "bad"])
    assert len(list(seen.watch([image, bad[1], image + 1]))) == len(seen.known) == 3
    with pytest.raises(InputError, match=r"f1.png: is not the frame"):
        list(FrameDigests(seen.known).watch([image, image], ["f0.png", "f1.png"].__getitem__))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("progress.json", "{}"), ("progress.json", "[]"), ("progress.json", '{"done": 99, "batch": 2, "identity": {}}'),
        ("progress.json", '{"done": 2, "batch": 0, "identity": {}}'), ("fields.jsonl", '{"end": 2, "said": 5}\n'),
        ("fields.jsonl", "7\n"), ("fields.jsonl", '{"end": "x", "said": {}}\n'),
    ],
)  # fmt: skip
def test_unfinished_recordings_that_were_damaged(tmp_path, frames, file, text):
    interrupted(tmp_path / "f.zarr", frames)
    (tmp_path / "f.zarr.partial" / file).write_text(text)
    with pytest.raises(FieldFileError, match=r"f.zarr.partial: the unfinished recording cannot be read"):
        part(tmp_path / "f.zarr", frames)


# Attributes


def test_attributes_are_those_of_all_pairs(tmp_path):
    vortices = synth.pair(
        synth.Speckle(seed=1),
        synth.CellularVortices(amplitude=2.0, period=90.0),
        (96, 96),
        sensor=synth.Sensor(noise=1),
    )
    noise = np.random.default_rng(1).normal(size=(2, 96, 96))
    frames = [*noise, vortices.frame0, vortices.frame1]
    alone = list(sixflow.iterate_sequence(frames, window="auto", step=24))
    field = join_fields(alone)
    for name in ("effective_window", "attenuation_period_10"):
        said = {one.attrs[name] for one in alone if one.attrs[name] == one.attrs[name]}
        assert field.attrs.get(name) == (said.pop() if len(said) == 1 else None)
    assert field.attrs["memory_bytes"] == max(one.attrs["memory_bytes"] for one in alone)
    with RecordingWriter(tmp_path / "f.zarr") as writer:
        for one in alone:
            writer.append(one)
    with open_field(tmp_path / "f.zarr") as stored:
        assert stored.attrs == field.attrs | {"frame_shape": list(field.attrs["frame_shape"])}


def test_joined_attributes():
    said = [{"a": 1, "b": float("nan"), "memory_bytes": 5}, {"a": 2, "b": 3.0, "memory_bytes": 9, "c": 1}]
    assert joined_attrs(said) == {"b": 3.0, "memory_bytes": 9}
    assert joined_attrs(said[:1])["a"] == 1


# Options


BEYOND = {
    "40": 10**40,
    "5000": 10**5000,
    "e": 1e300,
    "n": float("nan"),
    "t": "31",
    "a": np.array([31, 32]),
    "b": b"31",
}


@pytest.mark.parametrize("name", ["skip", "done", "seen", "widow", "self"])
def test_options_that_are_none_are_refused_by_name(frames, name):
    for call in (
        lambda: sixflow.measure(frames[0], frames[1], **{name: 4}),
        lambda: sixflow.measure_sequence(frames, **{name: 4}),
        lambda: sixflow.Settings.from_mapping({name: 4}),
    ):
        with pytest.raises(InputError, match=f"{name}: no such setting; there are"):
            call()
    with pytest.raises(InputError, match=r"settings=\{'window': 31\}: must be a sixflow.Settings"):
        sixflow.measure(frames[0], frames[1], settings={"window": 31})


@pytest.mark.parametrize(
    "name", ["window", "step", "levels", "passes", "tolerance", "pixel_size", "frame_interval"]
)
@pytest.mark.parametrize("value", BEYOND.values(), ids=BEYOND)
def test_settings_beyond_reason(name, value):
    with pytest.raises(InputError, match=f"^{name}=") as caught:
        sixflow.Settings(**{name: value})
    assert len(str(caught.value)) < 300


def test_numbers_of_numpy_are_numbers():
    settings = sixflow.Settings(
        window=np.float32(31), step=np.int64(8), robust=np.True_, tolerance=np.float64(0.01)
    )
    assert settings == sixflow.Settings(window=31, tolerance=0.01)
    assert type(settings.step) is int
    assert sixflow.Settings.from_mapping(json.loads(settings.to_json())) == settings


@pytest.mark.parametrize("factor", [1e3, 1e12, 1e30, 1e-30])
def test_frames_of_unlike_values_are_measured_or_refused(frames, factor):
    first, second = frames[0].astype(np.float32), frames[1].astype(np.float32) * np.float32(factor)
    try:
        sixflow.measure(first, second, **QUICK)
    except InputError as error:
        assert "frame1" in str(error)  # noqa: PT017 - either will do
    for scale in (1e-36, 1e30):  # of both: no matter
        field = sixflow.measure(
            first * np.float32(scale), frames[1].astype(np.float32) * np.float32(scale), **QUICK
        )
        assert abs(float(field.u.median()) - 0.6) < 0.02


@pytest.mark.parametrize("name", ["flag", "x", "u"])
def test_an_unfinished_store_that_has_lost_an_array_is_refused(tmp_path, frames, name):
    interrupted(tmp_path / "f.zarr", frames)
    (tmp_path / "f.zarr.partial" / "field.zarr" / name / "zarr.json").unlink()
    with pytest.raises(FieldFileError, match=rf"what describes {name} is missing\); discard it"):
        part(tmp_path / "f.zarr", frames)
