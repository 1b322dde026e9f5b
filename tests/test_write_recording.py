"""Recordings written batch by batch: killed, resumed, and equal to one written in one go."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr

from sixflow.errors import FieldFileError, InputError
from sixflow.write import RecordingWriter, open_field, write_field
from sixflow.write.recording import RecordingWriter as _Writer
from test_write import make_field, read_table

PAIRS = 11


@pytest.fixture
def whole():
    return make_field(pairs=PAIRS)


def pairs_of(whole, start=0, stop=None):
    return [whole.isel(time=slice(k, k + 1)) for k in range(start, PAIRS if stop is None else stop)]


def append_to(path, fields, **options):
    with RecordingWriter(path, **options) as writer:
        for field in fields:
            writer.append(field)


def write_part(path, whole, stop, **options):
    """Append the pairs up to `stop`, then stop with an exception."""

    def interrupted():
        with RecordingWriter(path, batch=4, **options) as writer:
            for pair in pairs_of(whole, writer.done, stop):
                writer.append(pair)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        interrupted()
    return caught.value


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
@pytest.mark.parametrize("batch", [1, 4, 11, 64])
@pytest.mark.parametrize("size", [1, 3, 11])
def test_batches_make_the_whole(tmp_path, whole, suffix, batch, size):
    path = tmp_path / f"run{suffix}"
    with RecordingWriter(path, batch=batch) as writer:
        assert writer.done == 0
        for start in range(0, PAIRS, size):
            writer.append(whole.isel(time=slice(start, start + size)))
            assert writer.done == (start + min(size, PAIRS - start)) // batch * batch
            assert not path.exists()
    assert os.listdir(tmp_path) == [path.name]
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), whole)


def test_table_equals_the_one_written_at_once(tmp_path, whole):
    with RecordingWriter(tmp_path / "run.csv", batch=4) as writer:
        for pair in pairs_of(whole):
            writer.append(pair)
    assert read_table(tmp_path / "run.csv") == read_table(write_field(whole, tmp_path / "once.csv"))


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_resume_after_an_exception(tmp_path, whole, suffix):
    path = tmp_path / f"run{suffix}"
    error = write_part(path, whole, 7)
    assert error.__notes__ == [
        f"4 pairs are complete in {path}.partial; continue with resume=True (--resume)"
    ]
    assert os.listdir(tmp_path) == [path.name + ".partial"]
    with pytest.raises(FieldFileError, match=r"no such file; .*partial holds an unfinished recording"):
        open_field(path)
    with (
        pytest.raises(FieldFileError, match=r"an unfinished recording; continue it with resume=True"),
        RecordingWriter(path),
    ):
        pass
    write_part(path, whole, 9, resume=True)
    with RecordingWriter(path, resume=True, attrs=whole.attrs) as writer:
        assert writer.done == 8
        for pair in pairs_of(whole, writer.done):
            writer.append(pair)
    assert os.listdir(tmp_path) == [path.name]
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), whole)


def test_resume_without_a_beginning_starts_anew(tmp_path, whole):
    write_part(tmp_path / "run.zarr", whole, 2)
    assert os.listdir(tmp_path) == []
    (tmp_path / "run.zarr.partial").mkdir()  # killed before the first batch was complete
    with RecordingWriter(tmp_path / "run.zarr", resume=True) as writer:
        assert writer.done == 0
        writer.append(whole)
    with open_field(tmp_path / "run.zarr") as back:
        xr.testing.assert_identical(back.load(), whole)


def test_resume_after_a_batch_was_written_but_not_counted(tmp_path, whole, monkeypatch):
    """A kill between the arrays and the count leaves pairs that are measured again."""

    def stopped(self):
        raise KeyboardInterrupt

    path = tmp_path / "run.zarr"
    write_part(path, whole, 5)
    with monkeypatch.context() as patch:
        patch.setattr(_Writer, "_note_progress", stopped)
        write_part(path, whole, 9, resume=True)
    with RecordingWriter(path, resume=True) as writer:
        assert writer.done == 4
        for pair in pairs_of(whole, 4):
            writer.append(pair)
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), whole)


@pytest.mark.parametrize("name", ["settings", "digest"])
def test_resume_refuses_other_settings_and_frames(tmp_path, whole, name):
    path = tmp_path / "run.zarr"
    write_part(path, whole, 5)
    other = whole.assign_attrs({name: "other"})
    message = f"the unfinished recording has {name} = .*, but now it is other; take the former, or discard"
    with pytest.raises(FieldFileError, match=message), RecordingWriter(path, resume=True, attrs=other.attrs):
        pass
    with (
        pytest.raises(FieldFileError, match=message),
        RecordingWriter(path, resume=True) as writer,
    ):
        writer.append(pairs_of(other, 4)[0])
    with RecordingWriter(path, overwrite=True) as writer:
        assert writer.done == 0
        writer.append(other)
    with open_field(path) as back:
        assert back.attrs[name] == "other"


def test_unreadable_progress(tmp_path, whole):
    path = tmp_path / "run.zarr"
    write_part(path, whole, 5)
    (tmp_path / "run.zarr.partial" / "progress.json").write_text("{")
    with (
        pytest.raises(FieldFileError, match=r"cannot be read .*; discard it"),
        RecordingWriter(path, resume=True),
    ):
        pass


def test_overwrite_keeps_the_former_output_until_the_end(tmp_path, whole):
    path = write_field(whole, tmp_path / "run.zarr")
    with pytest.raises(FieldFileError, match="exists already"), RecordingWriter(path):
        pass
    other = make_field(pairs=PAIRS, seed=1)
    with RecordingWriter(path, overwrite=True, batch=4) as writer:
        for pair in pairs_of(other):
            writer.append(pair)
        with open_field(path) as back:
            xr.testing.assert_identical(back.load(), whole)
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), other)
    assert os.listdir(tmp_path) == [path.name]


def test_refused_appends(tmp_path, whole):
    with pytest.raises(InputError, match=r"batch=0: must be a whole number of pairs, at least 1"):
        RecordingWriter(tmp_path / "run.zarr", batch=0)
    with (
        pytest.raises(FieldFileError, match="nothing was appended, so nothing is written"),
        RecordingWriter(tmp_path / "run.zarr"),
    ):
        pass
    for bad, message in (
        (whole.assign_coords(x=whole.x + 1), "the x of its grid differ from those of the first field"),
        (make_field(rows=3), "the y of its grid differ"),
        (whole.drop_vars("noise"), "its variables differ from those of the first field by noise"),
        (whole.isel(time=0), "the dimension 'time' is missing"),
    ):
        with pytest.raises(InputError, match=message):
            append_to(tmp_path / "run.zarr", [whole, bad])
    assert os.listdir(tmp_path) == []


def test_full_disk(tmp_path, whole, monkeypatch):
    def full_disk(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sixflow.write.zarrstore.extend", full_disk)
    with (
        pytest.raises(FieldFileError, match=r"cannot be written \(No space left on device\)") as caught,
        RecordingWriter(tmp_path / "run.zarr", batch=4) as writer,
    ):
        writer.append(whole)
    assert caught.value.__notes__[0].startswith("4 pairs are complete in")


KILLED = """
import sys
from test_write import make_field
from sixflow.write import RecordingWriter

whole = make_field(pairs=250, rows=20, columns=20)
with RecordingWriter(sys.argv[1], batch=4, resume=True) as writer:
    for k in range(writer.done, 250):
        writer.append(whole.isel(time=slice(k, k + 1)))
"""


def done_pairs(path):
    progress = path.with_name(path.name + ".partial") / "progress.json"
    return json.loads(progress.read_text())["done"] if progress.exists() else 0


def test_killed_again_and_again(tmp_path):
    """A process killed at any moment leaves nothing under the final name; complete batches stay."""
    path = tmp_path / "run.zarr"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    former = 0
    for delay in (0.0, 0.13):
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], env=environment)
        while done_pairs(path) == former:
            assert process.poll() is None
            time.sleep(0.002)
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not path.exists()
        former = done_pairs(path)
    assert former % 4 == 0
    whole = make_field(pairs=250, rows=20, columns=20)
    with RecordingWriter(path, resume=True, batch=4) as writer:
        assert 0 < writer.done < 250
        writer.append(whole.isel(time=slice(writer.done, None)))
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), whole)
    assert np.isnan(whole["u"]).any()


def test_killed_single_write(tmp_path):
    """A kill while a file is written leaves nothing under the final name."""
    code = """
import os, signal, sys
from test_write import make_field
from sixflow.write import fieldfile
def parts():
    yield make_field()
    os.kill(os.getpid(), signal.SIGKILL)
fieldfile.batches = lambda *args: parts()
fieldfile.write_field(make_field(), sys.argv[1])
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    for name in ("a.nc", "a.zarr", "a.csv"):
        answer = subprocess.run([sys.executable, "-c", code, str(tmp_path / name)], env=environment)
        assert answer.returncode == -signal.SIGKILL
        assert not (tmp_path / name).exists()
        write_field(make_field(), tmp_path / name)
