"""Stores that were damaged, cut, copied in part, locked or mutated: what is lost fails, nothing foreign is raised."""

import contextlib
import json
import os
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray as xr

from sixflow.cli import main
from sixflow.errors import FieldFileError, SixflowError
from sixflow.field.dataset import FAILING, FLAGS
from sixflow.write import RecordingWriter, open_field, write_field
from sixflow.write.layout import fill_value
from test_write import make_field

SUFFIXES = (".nc", ".zarr")


@pytest.fixture(params=SUFFIXES)
def stored(request, tmp_path):
    return write_field(make_field(pairs=2), tmp_path / f"f{request.param}")


def invert(path, start, count):
    raw = bytearray(path.read_bytes())
    raw[start : start + count] = bytes(255 - byte for byte in raw[start : start + count])
    path.write_bytes(raw)


def place_of_values(path, name):
    """File and place of the first chunk of a variable."""
    if path.suffix == ".zarr":
        piece = next(p for p in sorted((path / name / "c").rglob("*")) if p.is_file())
        return piece, 0, piece.stat().st_size
    with h5py.File(path) as file:
        chunk = file[name].id.get_chunk_info(0)
        return path, chunk.byte_offset, chunk.size


def all_uses(path):
    """What can be done with a field file."""

    def loaded():
        with open_field(path) as field:
            return field.load().sixflow.summary()

    def averaged():
        with open_field(path) as field:
            return field.sixflow.mean()

    def as_backend():
        with xr.open_dataset(path, engine="sixflow") as field:
            return field.load().sixflow.valid

    return loaded, averaged, as_backend


@pytest.mark.parametrize("name", ["u", "covariance", "flag"])
def test_changed_values_are_told(stored, name, capsys):
    place, start, size = place_of_values(stored, name)
    invert(place, start + size // 2, 4)
    with open_field(stored) as field, pytest.raises(FieldFileError, match=f"{stored.name}: {name} cannot"):
        field.load()
    with xr.open_dataset(stored, engine="sixflow") as field, pytest.raises(FieldFileError):
        field.load()
    assert main(["info", str(stored)]) == 2
    said = capsys.readouterr().err
    assert stored.name in said
    assert "unexpected" not in said


def test_changed_description_of_a_netcdf_file_is_told_before_hdf5_reads_it(tmp_path):
    path = write_field(make_field(), tmp_path / "f.nc")
    invert(path, 700, 3)
    with pytest.raises(FieldFileError, match=r"f.nc: the file is damaged: its checksum does not fit"):
        open_field(path)


def test_seal_goes_when_somebody_writes_into_the_file(tmp_path):
    path = write_field(make_field(), tmp_path / "f.nc")
    with h5py.File(path, "r+") as file:
        file["u"][:] = 5
        file.attrs["by"] = "hand"
    with open_field(path) as field:
        assert (field.u == 5).all()
        assert field.attrs["by"] == "hand"


@pytest.mark.parametrize("name", ["flag", "covariance", "u", "curl"])
def test_points_of_missing_chunks_are_not_valid(tmp_path, name):
    path = write_field(make_field(pairs=2), tmp_path / "f.zarr")
    shutil.rmtree(path / name / "c")
    with open_field(path) as field:
        assert not field.sixflow.valid.any()
        assert field[name].dtype == make_field()[name].dtype
        if name == "flag":
            assert field.sixflow.flagged("missing").all()


def test_missing_chunk_in_the_middle_fails_there_only(tmp_path):
    whole = make_field(pairs=9)
    with RecordingWriter(tmp_path / "f.zarr", batch=3) as writer:
        for pair in range(9):
            writer.append(whole.isel(time=[pair]))
    chunks = sorted(p for p in (tmp_path / "f.zarr/flag/c").iterdir())
    shutil.rmtree(chunks[1])
    with open_field(tmp_path / "f.zarr") as field:
        missing = field.sixflow.flagged("missing").any(("y", "x")).values
        assert missing.tolist() == [False] * 3 + [True] * 3 + [False] * 3
        assert field.sixflow.valid.any(("y", "x")).values.tolist() == (~missing).tolist()


def test_chunks_of_netcdf_that_were_never_written_fail(tmp_path):
    path = write_field(make_field(), tmp_path / "f.nc")
    with h5py.File(path, "r+") as file:
        for name in ("flag", "covariance", "u", "time", "frame0"):
            item = file[name]
            item.resize(item.shape[0] + 2000, axis=0)  # as by a program that was killed in the middle
            assert "_FillValue" not in item.attrs or item.dtype.kind == "f"
        assert file["flag"].fillvalue == FLAGS["missing"]
        assert np.isnan(file["u"][-1]).all()
    with xr.open_dataset(path, engine="h5netcdf", decode_cf=True) as other:
        assert other.flag.dtype == np.uint16


def test_variables_of_netcdf_of_unlike_lengths_are_told_or_filled(tmp_path):
    """As a program leaves them that was killed between two variables: h5netcdf fills up the shorter ones."""
    path = write_field(make_field(pairs=2), tmp_path / "f.nc")
    with h5py.File(path, "r+") as file:
        file["u"].resize(5, axis=0)
    with pytest.raises(FieldFileError, match=r"f.nc: a part of .*time.* is missing"):
        open_field(path)
    path = write_field(make_field(pairs=2), tmp_path / "g.nc")
    with h5py.File(path, "r+") as file:
        for name in file:
            if file[name].maxshape and file[name].maxshape[0] is None and name != "u":
                file[name].resize(3, axis=0)
                if file[name].ndim == 1 and file[name].dtype.kind in "iuf":
                    file[name][2] = 2
    with open_field(path) as field:
        assert field.u.shape[0] == 3
        assert np.isnan(field.u[2]).all()
        assert not field.sixflow.valid[2].any()


@pytest.mark.parametrize("name", ["x", "frame0", "param"])
def test_coordinates_that_are_missing_are_refused(tmp_path, name):
    path = write_field(make_field(), tmp_path / "f.zarr")
    shutil.rmtree(path / name / "c")
    with pytest.raises(FieldFileError, match=f"a part of {name}"):
        open_field(path)


@pytest.mark.parametrize("dtype", ["u1", "u2", "i4", "i8"])
def test_fill_values_of_flags_fail(dtype):
    assert int(fill_value("flag", xr.Variable("x", np.zeros(2, dtype)))) & FAILING
    assert int(fill_value("flag", xr.Variable("x", np.zeros(2, dtype)))) & ~sum(FLAGS.values()) == 0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("settings", "no JSON"), ("settings", 5), ("settings", '{"window": "x"}'), ("settings", '{"reference": []}'),
        ("frame_shape", 3), ("frame_shape", [1e300, 2]), ("frame_shape", "ab"), ("frame_shape", [0, 5]),
        ("notes", 7), ("effective_window", "x"), ("attenuation_period_10", "x"), ("input_digest", [1]),
    ],
)  # fmt: skip
def test_attributes_that_are_none(tmp_path, key, value, capsys):
    stored = write_field(make_field(), tmp_path / ("f.nc" if key == "frame_shape" else "f.zarr"))
    if stored.suffix == ".zarr":
        text = json.loads((stored / "zarr.json").read_text())
        text["attributes"][key] = value
        (stored / "zarr.json").write_text(json.dumps(text))
    else:
        with h5py.File(stored, "r+") as file:
            file.attrs[key] = value
    for use in all_uses(stored)[:2]:
        try:
            use()
        except SixflowError as error:
            assert key in str(error)  # noqa: PT017 - some uses do not look at it
    assert main(["info", str(stored)]) in (0, 2)
    assert "unexpected" not in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"text", b"\x89HDF\r\n\x1a\n", bytes(range(256)) * 20])
def test_files_that_are_no_fields(tmp_path, content):
    for name in ("f.nc", "f.zarr"):
        path = tmp_path / name
        path.write_bytes(content)
        for use in all_uses(path):
            with pytest.raises(FieldFileError, match=name):
                use()


def test_paths_that_are_no_files(tmp_path):
    (tmp_path / "folder.nc").mkdir()
    os.mkfifo(tmp_path / "pipe.nc")
    for path in (
        tmp_path / "folder.nc",
        tmp_path / "pipe.nc",
        "a\0b.nc",
        "~nobody-at-all/f.nc",
        "x" * 5000,
        "",
    ):
        with pytest.raises(FieldFileError):
            open_field(path)
    with pytest.raises(SixflowError, match="path"):
        open_field(None)


def test_some_mutants_of_every_file(stored, tmp_path):
    """Bytes flipped, cut and inserted in every file of a store: an error of our own, or what was in it."""
    rng = np.random.default_rng(5)
    files = [stored] if stored.is_file() else sorted(p for p in stored.rglob("*") if p.is_file())
    for trial in range(15):
        copy = tmp_path / f"copy{trial}{stored.suffix}"
        (shutil.copytree if stored.is_dir() else shutil.copy)(stored, copy)
        file = copy if copy.is_file() else copy / files[trial % len(files)].relative_to(stored)
        raw = bytearray(file.read_bytes())
        at = int(rng.integers(len(raw)))
        if trial % 3 == 0:
            raw[at] ^= 1 << int(rng.integers(8))
        elif trial % 3 == 1:
            del raw[at:]
        else:
            raw[at:at] = rng.bytes(3)
        file.write_bytes(raw)
        with contextlib.suppress(SixflowError):
            all_uses(copy)[0]()


# Two writers


def test_second_writer_is_refused(tmp_path):
    field, path = make_field(), tmp_path / "f.zarr"
    with RecordingWriter(path) as writer:
        writer.append(field)
        for overwrite in (False, True):
            with pytest.raises(FieldFileError, match=rf"f.zarr: is being written by process {os.getpid()}"):
                write_field(field, path, overwrite)
            with (
                pytest.raises(FieldFileError, match="is being written"),
                RecordingWriter(path, overwrite=overwrite, resume=not overwrite),
            ):
                pass
    assert sorted(os.listdir(tmp_path)) == ["f.zarr"]
    write_field(field, path, overwrite=True)


def test_lock_of_a_killed_process_keeps_nobody(tmp_path):
    program = (
        "import os, sys; from pathlib import Path; from sixflow.write.lock import locked\n"
        "with locked(Path(sys.argv[1])): print('locked', flush=True); sys.stdin.read()"
    )
    path = tmp_path / "f.nc"
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "locked\n"
    with pytest.raises(FieldFileError, match=f"process {process.pid} on"):
        write_field(make_field(), path)
    process.kill()
    process.communicate()
    assert write_field(make_field(), path).exists()
    assert os.listdir(tmp_path) == ["f.nc"]


# A new process


@pytest.mark.parametrize(
    "way",
    ["from sixflow import open_field", "from sixflow.write import open_field",
     "import xarray; open_field = lambda path: xarray.open_dataset(path, engine='sixflow')"],
)  # fmt: skip
def test_fields_of_a_new_process_have_their_accessor(stored, way):
    program = f"{way}\nprint(int(open_field({str(stored)!r}).sixflow.valid.sum()))"
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True)
    assert (done.stderr, int(done.stdout)) == ("", int(make_field(pairs=2).sixflow.valid.sum()))
