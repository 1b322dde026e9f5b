"""Fields in files: exact round trips, whole or not at all, and readable by other programs."""

import csv
import io
import os
import stat
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
import zarr

from sixflow.errors import FieldFileError, InputError
from sixflow.field.backend import FieldBackend
from sixflow.field.dataset import FLAGS, SIX, build_field
from sixflow.write import check_output, open_field, write_field
from sixflow.write.layout import chunk_shape


def make_field(pairs=3, rows=4, columns=5, seed=0, first=0, dtype="f4"):
    rng = np.random.default_rng(seed)
    shape = (pairs, rows, columns)
    covariance = rng.random((*shape, 6, 6)).astype(dtype)
    flag = rng.choice([0, 2, 1, 18], shape).astype(np.uint8)
    six = rng.normal(size=(*shape, 6)).astype(dtype)
    failed = (flag & 17) > 0
    six[failed], covariance[failed] = np.nan, np.nan
    frames = np.arange(first, first + pairs)
    return build_field(
        six=six,
        covariance=covariance,
        residual=rng.random(shape).astype(dtype),
        noise=rng.random(shape).astype(dtype),
        flag=flag,
        x=8 * np.arange(columns) + 16,
        y=8 * np.arange(rows) + 16,
        time=0.04 * frames,
        time_unit="s",
        frame_numbers=[(k, k + 1) for k in frames],
        attrs={
            "settings": '{"window": 31}',
            "input_digest": "ab12",
            "sixflow_version": "0.1",
            "notes": "dark",
            "frame_shape": np.array([64, 80]),
        },
    )


@pytest.fixture
def field():
    return make_field()


def same(field, path):
    with open_field(path) as back:
        xr.testing.assert_identical(back.load(), field)
        for name, variable in field.variables.items():
            assert back[name].dtype == variable.dtype or name in ("param", "param2")
        np.testing.assert_array_equal(back["flag"].attrs["flag_masks"], list(FLAGS.values()))
        assert back["flag"].attrs["flag_masks"].dtype == np.uint16


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_round_trip_is_exact(tmp_path, suffix, dtype):
    field = make_field(dtype=dtype)
    path = write_field(field, tmp_path / f"field{suffix}")
    assert path == tmp_path / f"field{suffix}"
    assert os.listdir(tmp_path) == [path.name]
    same(field, path)
    with open_field(path) as back:
        write_field(back, tmp_path / f"again{suffix}")
    same(field, tmp_path / f"again{suffix}")


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_many_pairs_are_copied_in_batches(tmp_path, suffix):
    field = make_field(pairs=150, rows=2, columns=3)
    same(field, write_field(field, tmp_path / f"field{suffix}"))


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_parts_and_additions(tmp_path, field, suffix):
    single = field.isel(time=0)
    with open_field(write_field(single, tmp_path / f"a{suffix}")) as back:
        xr.testing.assert_identical(back.load(), single)
    more = field[["curl"]].assign(
        vorticity=field["curl"] / 2, mean=field["u"].mean(), label=("y", list("abcd"))
    )
    more["vorticity"].attrs["note"] = "Ω = ½ curl"
    with open_field(write_field(more, tmp_path / f"b{suffix}")) as back:
        xr.testing.assert_equal(back.load(), more)
        assert back["vorticity"].attrs["note"] == "Ω = ½ curl"


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_plain_xarray_reads_it(tmp_path, field, suffix):
    path = write_field(field, tmp_path / f"field{suffix}")
    engine = {"engine": "h5netcdf"} if suffix == ".nc" else {"engine": "zarr", "chunks": None}
    with xr.open_dataset(path, **engine) as back:
        assert [str(name) for name in back["param"].values] == list(SIX)
        np.testing.assert_array_equal(back["covariance"], field["covariance"])
        assert back["time"].dtype == np.float64


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_backend(tmp_path, field, suffix):
    path = write_field(field, tmp_path / f"field{suffix}")
    with xr.open_dataset(path, engine=FieldBackend) as back:
        xr.testing.assert_identical(back.load(), field)
        assert back.sixflow is not None
    with xr.open_dataset(path, engine=FieldBackend, drop_variables="covariance") as back:
        assert "covariance" not in back
    backend = FieldBackend()
    assert backend.guess_can_open(str(path)) == (suffix == ".zarr")
    assert not backend.guess_can_open(io.BytesIO())
    assert not backend.guess_can_open(tmp_path)


def test_netcdf_is_made_for_other_programs(tmp_path, field):
    """What the netCDF library, and with it MATLAB and ParaView, require of an HDF5 file."""
    path = write_field(field, tmp_path / "field.nc")
    with h5py.File(path) as file:
        assert b"h5netcdf" in file.attrs["_NCProperties"]
        assert file["time"].maxshape == (None,)
        for name in ("time", "y", "x"):
            assert file[name].attrs["CLASS"] == b"DIMENSION_SCALE"
        for name, item in file.items():
            assert "_Netcdf4Dimid" in item.attrs or not item.is_scale
            if name in field.data_vars:
                scales = [dimension[0].name.strip("/") for dimension in item.dims]
                assert scales == list(field[name].dims)
                assert item.compression == "gzip"
                assert item.dtype == field[name].dtype
            assert h5py.check_vlen_dtype(item.dtype) is None
        for item in (file, *file.values()):
            for attribute, value in item.attrs.items():
                kind = item.attrs.get_id(attribute).dtype
                if attribute not in ("DIMENSION_LIST", "REFERENCE_LIST"):
                    assert h5py.check_vlen_dtype(kind) is None, attribute
                    assert not isinstance(value, str) or h5py.check_string_dtype(kind).length
        for name in ("u", "covariance", "noise"):
            assert np.isnan(file[name].attrs["_FillValue"]).all()
            assert file[name].attrs["_FillValue"].dtype == file[name].dtype
        assert "_FillValue" not in file["time"].attrs
        # 1-D coordinates of text stop ParaView; text in NetCDF is an array of characters
        assert file["param"].dtype == np.dtype("S1")
        assert file["param"].shape == (6, 10)
        assert file["flag"].attrs["flag_masks"].dtype == file["flag"].dtype == np.uint16
        assert file["flag"].attrs["flag_meanings"].decode().split() == list(FLAGS)
        assert file.attrs["Conventions"] == b"CF-1.11"
        assert file["x"].attrs["axis"] == b"X"


def test_zarr_holds_standard_types_only(tmp_path, field):
    path = write_field(field, tmp_path / "field.zarr")
    group = zarr.open_group(path, mode="r")
    assert group.metadata.zarr_format == 3
    assert group.metadata.consolidated_metadata is not None
    types = {name: group[name].metadata.to_dict()["data_type"] for name in field.variables}
    assert types["param"] == "string"
    assert set(types.values()) == {"float32", "float64", "uint16", "int64", "string"}


def test_chunks_keep_to_their_size():
    big = xr.Variable(
        ("time", "y", "x", "param", "param2"), np.broadcast_to(np.float32(0), (100, 200, 300, 6, 6))
    )
    assert chunk_shape(big, 16, 2**24) == (1, 200, 300, 6, 6)
    assert chunk_shape(big, 16, 2**20) == (1, 24, 300, 6, 6)
    assert chunk_shape(big, 16, 2**30) == (16, 200, 300, 6, 6)
    assert chunk_shape(big[:, :1, :1, 0, 0], 16, 2**20) == (16, 1, 1)


def read_table(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    return comments, list(csv.DictReader(lines[len(comments) :]))


def test_table(tmp_path, field):
    comments, rows = read_table(write_field(field, tmp_path / "field.csv"))
    assert '# settings: {"window": 31}' in comments
    assert "# sixflow_version: 0.1" in comments
    assert "# column u_px: displacement to the right (x)" in comments
    assert list(rows[0]) == [
        *("time_s", "frame0", "frame1", "y_px", "x_px"),
        *("u_px", "u_se_px", "v_px", "v_se_px", "divergence_1", "divergence_se_1", "curl_1", "curl_se_1"),
        *("stretch_1", "stretch_se_1", "shear_1", "shear_se_1", "residual_1", "noise_grey", "flag"),
    ]
    assert len(rows) == 3 * 4 * 5
    points = field.stack(point=("time", "y", "x"))
    for name, unit in (("u", "px"), ("shear", "1")):
        cells = np.array([float(row[f"{name}_{unit}"] or "nan") for row in rows], dtype=np.float32)
        np.testing.assert_array_equal(cells, points[name])
        cells = np.array([float(row[f"{name}_se_{unit}"] or "nan") for row in rows], dtype=np.float32)
        np.testing.assert_array_equal(cells, np.sqrt(points["covariance"].sel(param=name, param2=name)))
    assert [int(row["x_px"]) for row in rows] == points["x"].values.tolist()
    assert [int(row["frame1"]) for row in rows] == points["frame1"].values.tolist()
    words = {0: "ok", 1: "masked", 2: "border", 18: "border|outlier"}
    assert [row["flag"] for row in rows] == [words[value] for value in points["flag"].values.tolist()]


def test_table_of_one_map_without_covariance(tmp_path, field):
    _, rows = read_table(write_field(field[["u", "flag"]].isel(time=1), tmp_path / "field.csv"))
    assert list(rows[0]) == ["time_s", "frame0", "frame1", "y_px", "x_px", "u_px", "flag"]
    assert {row["frame0"] for row in rows} == {"1"}


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".csv"])
def test_existing_output(tmp_path, field, suffix):
    path = write_field(field, tmp_path / f"field{suffix}")
    with pytest.raises(
        FieldFileError, match=r"exists already; replace it with overwrite=True \(--overwrite\)"
    ):
        write_field(field, path)
    other = make_field(seed=1)
    write_field(other, path, overwrite=True)
    assert os.listdir(tmp_path) == [path.name]
    if suffix != ".csv":
        same(other, path)


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".csv"])
def test_a_failing_writer_leaves_the_former_output(tmp_path, field, suffix, monkeypatch):
    path = write_field(field, tmp_path / f"field{suffix}")
    before = sorted((p.relative_to(tmp_path), p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))

    def broken(*args):
        yield field
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sixflow.write.fieldfile.batches", broken)

    with pytest.raises(
        FieldFileError, match=r"cannot be written \(No space left on device\); check the room"
    ):
        write_field(field, path, overwrite=True)
    assert before == sorted((p.relative_to(tmp_path), p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    with pytest.raises(FieldFileError, match="No space left"):
        write_field(field, tmp_path / f"other{suffix}")
    assert os.listdir(tmp_path) == [path.name]


def test_a_failing_rename_restores_the_former_store(tmp_path, field, monkeypatch):
    path = write_field(field, tmp_path / "field.zarr")
    rename = os.rename

    def failing(source, target):
        if ".partial" in str(source):
            raise OSError(5, "Input/output error")
        rename(source, target)

    monkeypatch.setattr(os, "rename", failing)
    with pytest.raises(FieldFileError, match="Input/output error"):
        write_field(make_field(seed=1), path, overwrite=True)
    same(field, path)
    assert os.listdir(tmp_path) == [path.name]


def test_check_output(tmp_path):
    assert check_output(tmp_path / "field.NC") == tmp_path / "field.NC"
    assert check_output("~/field.nc") == Path.home() / "field.nc"
    with pytest.raises(FieldFileError, match=r"the suffix '.mat' is unknown; choose one of .nc, .zarr, .csv"):
        check_output(tmp_path / "field.mat")
    with pytest.raises(FieldFileError, match=r"a suffix is missing"):
        check_output(tmp_path / "field")
    with pytest.raises(FieldFileError, match=r"the folder '.*none' does not exist; create it"):
        check_output(tmp_path / "none" / "field.nc")
    (tmp_path / "file").touch()
    with pytest.raises(FieldFileError, match=r"the folder '.*file' is a file"):
        check_output(tmp_path / "file" / "field.nc")
    (tmp_path / "folder.nc").mkdir()
    with pytest.raises(FieldFileError, match=r"is a folder, which a .nc file cannot replace"):
        check_output(tmp_path / "folder.nc", overwrite=True)


def test_a_folder_that_is_no_store_is_never_deleted(tmp_path, field):
    (tmp_path / "photos.zarr").mkdir()
    (tmp_path / "photos.zarr" / "a.jpg").touch()
    with pytest.raises(FieldFileError, match="is a folder but no Zarr store, so it is not replaced"):
        write_field(field, tmp_path / "photos.zarr", overwrite=True)
    assert (tmp_path / "photos.zarr" / "a.jpg").exists()


def test_unwritable_folder(tmp_path):
    if os.geteuid() == 0:
        folder = Path("/proc")
        if not folder.is_dir():
            pytest.skip("needs a folder that even root cannot write to")
    else:
        folder = tmp_path
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(FieldFileError, match=r"cannot be written to \(.*\); choose another"):
        check_output(folder / "field.nc")


def test_refused_fields(tmp_path, field):
    with pytest.raises(InputError, match="field: a DataArray; give the xarray"):
        write_field(field["u"], tmp_path / "a.nc")
    with pytest.raises(InputError, match=r"no variable has the dimensions y and x, only time"):
        write_field(xr.Dataset({"a": ("time", [1.0])}), tmp_path / "a.nc")
    for suffix in (".nc", ".zarr"):
        with pytest.raises(
            FieldFileError, match=rf"the field holds something that a \{suffix} file cannot: .*; convert"
        ):
            write_field(field.assign_attrs(thing=object()), tmp_path / f"a{suffix}")
    assert os.listdir(tmp_path) == []


def test_truth_values_become_numbers_in_netcdf(tmp_path, field):
    with open_field(write_field(field.assign_attrs(y_up=True), tmp_path / "a.nc")) as back:
        assert back.attrs["y_up"] == 1


def test_unreadable_inputs(tmp_path, field):
    with pytest.raises(FieldFileError, match=r"none.nc: no such file; check the path"):
        open_field(tmp_path / "none.nc")
    with pytest.raises(FieldFileError, match="a table has no covariances and is not read back"):
        open_field(write_field(field, tmp_path / "a.csv"))
    with pytest.raises(FieldFileError, match=r"a folder, but no Zarr store; give a .nc or .zarr file"):
        open_field(tmp_path)
    (tmp_path / "bad.nc").write_bytes(b"no HDF5 here")
    with pytest.raises(FieldFileError, match=r"bad.nc: cannot be read as a field"):
        open_field(tmp_path / "bad.nc")
    path = write_field(field, tmp_path / "cut.nc")
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(FieldFileError, match=r"cut.nc: cannot be read as a field"):
        open_field(path)
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(FieldFileError, match=r"other.nc: holds no field"):
        open_field(tmp_path / "other.nc")
    (tmp_path / "bad.zarr").mkdir()
    (tmp_path / "bad.zarr" / "zarr.json").write_text("{")
    with pytest.raises(FieldFileError, match=r"bad.zarr: cannot be read as a field"):
        open_field(tmp_path / "bad.zarr")
