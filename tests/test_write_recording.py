"""Recordings written batch by batch: killed, resumed, and equal to one written in one go."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest
import xarray as xr

from sixflow.errors import FieldFileError, InputError
from sixflow.write import RecordingWriter, open_field, write_field
from sixflow.write.progress import Progress
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


def expected(whole, appended):
    """Return the field that comes of so many appended parts: their digests are joined."""
    digest = hashlib.sha256(b"ab12" * appended).hexdigest()[:16] if appended > 1 else "ab12"
    return whole.assign_attrs(input_digest=digest)


def check(path, field):
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), field)
        assert list(back.data_vars) == list(field.data_vars)


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
@pytest.mark.parametrize(("batch", "size"), [(1, 11), (4, 1), (4, 3), (64, 1)])
def test_batches_make_the_whole(tmp_path, whole, suffix, batch, size):
    path = tmp_path / f"run{suffix}"
    with RecordingWriter(path, batch=batch) as writer:
        assert writer.done == 0
        for start in range(0, PAIRS, size):
            writer.append(whole.isel(time=slice(start, start + size)))
            assert writer.done == (start + min(size, PAIRS - start)) // batch * batch
            assert not path.exists()
    assert os.listdir(tmp_path) == [path.name]
    check(path, expected(whole, -(-PAIRS // size)))


def test_table_equals_the_one_written_at_once(tmp_path, whole):
    append_to(tmp_path / "run.csv", pairs_of(whole), batch=4)
    once = write_field(expected(whole, PAIRS), tmp_path / "once.csv")
    assert read_table(tmp_path / "run.csv") == read_table(once)


def test_digests_and_notes_of_the_pairs_are_joined(tmp_path, whole):
    pairs = [
        pair.assign_attrs(input_digest=f"d{number}", notes=f"dark\nframe {number % 2}")
        for number, pair in enumerate(pairs_of(whole))
    ]
    append_to(tmp_path / "run.nc", pairs)
    with open_field(tmp_path / "run.nc") as back:
        digests = "".join(f"d{number}" for number in range(PAIRS))
        assert back.attrs["input_digest"] == hashlib.sha256(digests.encode()).hexdigest()[:16]
        assert back.attrs["notes"] == "dark\nframe 0\nframe 1"


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_resume_after_an_exception(tmp_path, whole, suffix):
    path = tmp_path / f"run{suffix}"
    error = write_part(path, whole, 7, identity={"frames": "f1"})
    assert error.__notes__ == [
        f"4 pairs are complete in {path}.partial; continue with resume=True (--resume)"
    ]
    assert os.listdir(tmp_path) == [path.name + ".partial"]
    with pytest.raises(FieldFileError, match=r"no such file; .*partial holds an unfinished recording"):
        open_field(path)
    with pytest.raises(FieldFileError, match=r"an unfinished recording; continue it with resume=True"):
        append_to(path, [])
    write_part(path, whole, 9, resume=True)
    with RecordingWriter(path, resume=True, identity={"frames": "f1"}) as writer:
        assert writer.done == 8
        for pair in pairs_of(whole, writer.done):
            writer.append(pair)
    assert os.listdir(tmp_path) == [path.name]
    check(path, expected(whole, PAIRS))


def test_resume_without_a_beginning_starts_anew(tmp_path, whole):
    write_part(tmp_path / "run.zarr", whole, 2)
    assert os.listdir(tmp_path) == []
    (tmp_path / "run.zarr.partial").mkdir()  # killed before the first batch was complete
    append_to(tmp_path / "run.zarr", [whole], resume=True)
    check(tmp_path / "run.zarr", whole)


def test_resume_after_a_batch_was_written_but_not_counted(tmp_path, whole, monkeypatch):
    """A kill between the arrays and the count leaves pairs that are measured again."""

    def stopped(self, done):
        with self._log.open("a") as log:
            log.write('{"end": 5, "said": {}}\n{"end": 6, "sa')
        raise KeyboardInterrupt

    path = tmp_path / "run.zarr"
    write_part(path, whole, 5)
    with monkeypatch.context() as patch:
        patch.setattr(Progress, "save", stopped)
        write_part(path, whole, 9, resume=True)
    with RecordingWriter(path, resume=True) as writer:
        assert writer.done == 4
        for pair in pairs_of(whole, 4):
            writer.append(pair)
    check(path, expected(whole, PAIRS))


def test_resume_refuses_other_settings_and_frames(tmp_path, whole):
    path = tmp_path / "run.zarr"
    write_part(path, whole, 5, identity={"frames": "f1", "mask": "m1"})
    with pytest.raises(FieldFileError, match="the recording began with frames = f1, but now it is f2; take"):
        append_to(path, [], resume=True, identity={"frames": "f2", "mask": "m1"})
    with pytest.raises(FieldFileError, match="began with mask = m1, but now it is None"):
        append_to(path, [], resume=True, identity={"frames": "f1"})
    other = whole.assign_attrs(settings="other")
    with pytest.raises(FieldFileError, match=r'began with settings = {"window": 31}, but now it is other'):
        append_to(path, pairs_of(other, 4), resume=True)
    append_to(path, [other], overwrite=True)
    check(path, other)


def test_unreadable_progress(tmp_path, whole):
    path = tmp_path / "run.zarr"
    write_part(path, whole, 5)
    (tmp_path / "run.zarr.partial" / "progress.json").write_text("{")
    with pytest.raises(FieldFileError, match=r"cannot be read .*; discard it"):
        append_to(path, [], resume=True)


def test_overwrite_keeps_the_former_output_until_the_end(tmp_path, whole):
    path = write_field(whole, tmp_path / "run.zarr")
    with pytest.raises(FieldFileError, match="exists already"):
        append_to(path, [])
    other = make_field(pairs=PAIRS, seed=1)
    with RecordingWriter(path, overwrite=True, batch=4) as writer:
        for pair in pairs_of(other):
            writer.append(pair)
        check(path, whole)
    check(path, expected(other, PAIRS))
    assert os.listdir(tmp_path) == [path.name]


def test_an_output_that_appears_meanwhile_is_kept(tmp_path, whole):
    def meanwhile():
        yield from pairs_of(whole)
        os.rename(write_field(whole, tmp_path / "other.zarr"), path)

    path = tmp_path / "run.zarr"
    with pytest.raises(FieldFileError, match="exists already") as caught:
        append_to(path, meanwhile())
    assert caught.value.__notes__[0].startswith("11 pairs are complete in")
    check(path, whole)
    append_to(path, [], resume=True, overwrite=True)
    check(path, expected(whole, PAIRS))


def test_refused_appends(tmp_path, whole):
    with pytest.raises(InputError, match=r"batch=0: must be a whole number of pairs, at least 1"):
        RecordingWriter(tmp_path / "run.zarr", batch=0)
    with pytest.raises(FieldFileError, match="nothing was appended, so nothing is written"):
        append_to(tmp_path / "run.zarr", [])
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
    with pytest.raises(FieldFileError, match=r"cannot be written \(No space left on device\)") as caught:
        append_to(tmp_path / "run.zarr", [whole], batch=4)
    assert caught.value.__notes__[0].startswith("4 pairs are complete in")


KILLED = """
import sys
from test_write import make_field
from sixflow.write import RecordingWriter

whole = make_field(pairs=80, rows=20, columns=20)
with RecordingWriter(sys.argv[1], batch=4, resume=True) as writer:
    for k in range(writer.done, 80):
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
    whole = make_field(pairs=80, rows=20, columns=20)
    with RecordingWriter(path, resume=True) as writer:
        assert 0 < writer.done < 80
        for number in range(writer.done, 80):
            writer.append(whole.isel(time=slice(number, number + 1)))
    check(path, expected(whole, 80))


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
for path in sys.argv[1:]:
    if (child := os.fork()) == 0:
        fieldfile.write_field(make_field(), path)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    names = ("a.nc", "a.zarr", "a.csv")
    subprocess.run([sys.executable, "-c", code, *(tmp_path / n for n in names)], env=environment, check=True)
    for name in names:
        assert not (tmp_path / name).exists()
        write_field(make_field(), tmp_path / name)
