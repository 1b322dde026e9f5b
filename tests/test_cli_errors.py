"""The command line when something is wrong: one clear line, the right exit code, and nothing half-written."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest
import tifffile

from sixflow.cli.errors import report
from test_cli import QUICK, field_file, make_frames, measured, place, run  # noqa: F401

BAD_INPUT = {
    "measure A.tif B.tif": "--output",
    "measure -o field.nc": "FRAMES",
    "measure A.tif B.tif -o field.nc --windw 3": "Did you mean",
    "measure A.tif B.tif -o field.nc --window wide": "--window: 'wide' is no number",
    "measure A.tif B.tif -o field.nc --pairs all": "consecutive",
    "measure A.tif B.tif -o field.nc --step 1.5": "--step: '1.5' is no whole number",
    "measure A.tif B.tif -o field.nc --levels some": "'some' is no whole number",
    "plot field.nc -o a.png --time 0.5": "'0.5' is no whole number",
    "measure A.tif B.tif -o field.nc --step 0": "step=0: must be a whole number",
    "measure A.tif B.tif -o field.nc --lighting dim": "--lighting",
    "measure A.tif B.tif -o field.xyz": "the suffix '.xyz' is unknown",
    "measure A.tif B.tif -o nowhere/field.nc": "'nowhere' does not exist",
    "measure A.tif -o field.nc": "A.tif: a single frame; give two files",
    "measure A.tif C.tif -o field.nc": "C.tif: no such file",
    "measure A.tif small.tif -o field.nc": "all frames of a recording must be alike",
    "measure A.tif text.tif -o field.nc": "text.tif",
    "measure nowhere/*.tif -o field.nc": "no file matches",
    "measure A.tif B.tif -o field.nc --window 99": "smaller than window=99",
    "measure A.tif B.tif -o field.nc --threads 0": "threads=0: must be a whole number of threads",
    "measure A.tif B.tif -o field.nc --settings none.toml": "none.toml",
    "measure A.tif B.tif -o field.nc --settings bad.toml": "not valid TOML",
    "measure A.tif B.tif -o field.nc --settings unknown.toml": "windows",
    "measure A.tif B.tif -o field.nc --mask small.tif": "mask small.tif has shape (32, 32)",
    "measure A.tif B.tif -o field.nc --mask recording.tif": "mask recording.tif: 4 masks for 2 frames",
    "measure A.tif B.tif -o field.nc --mask mask.jpg": "JPEG",
    "measure A.tif B.tif -o field.nc --mask zero.tif": "mask zero.tif is False everywhere",
    "measure A.tif B.tif -o field.nc --plot field.xyz": "a figure ends in .png",
    "measure A.tif B.tif -o field.nc --plot nowhere/field.png": "'nowhere' does not exist",
    "measure flat.tif flat.tif -o field.nc": "is constant",
    "plot none.nc -o a.png": "none.nc: no such file",
    "plot A.tif -o a.png": "cannot be read as a field",
    "plot field.nc -o a.txt": "a figure ends in .png",
    "plot field.nc -o folder.png": "is a folder",
    "plot field.nc -o a.png --time 3": "time=3: the field has 3 pair(s)",
    "plot field.nc -o a.png --frame small.tif": "frame",
    "plot field.nc -o a.png --frame pair.tif --time 2": "2 frames, but the pair begins with frame 2",
    "plot field.nc -o a.png --units metres": "physical",
    "plot field.nc -o a.png --pixel-size -1 --units physical": "pixel_size",
    "info none.tif": "none.tif: no such file",
    "info text.tif": "text.tif",
    "info text.nc": "cannot be read as a field",
    "info other.nc": "holds no field",
    "mesure A.tif": "mesure",
    "demo --output A.tif": "A.tif: cannot be made",
}


@pytest.fixture
def troubled(field_file):  # noqa: F811
    """Return a folder with things that are not what they should be."""
    folder = field_file.parent
    tifffile.imwrite("small.tif", make_frames(1)[0, :32, :32])
    tifffile.imwrite("pair.tif", make_frames(2), photometric="minisblack")
    tifffile.imwrite("zero.tif", np.zeros((64, 64), np.uint8))
    tifffile.imwrite("flat.tif", np.full((64, 64), 7, np.uint8))
    shutil.copy("A.tif", "mask.jpg")
    for name in ("text.tif", "text.nc"):
        (folder / name).write_text("not what it seems")
    (folder / "bad.toml").write_text("window =")
    (folder / "unknown.toml").write_text("windows = 31")
    (folder / "folder.png").mkdir()
    import xarray as xr

    xr.Dataset({"a": ("t", [1.0])}).to_netcdf("other.nc", engine="h5netcdf")
    return folder


@pytest.mark.parametrize("command", BAD_INPUT)
def test_bad_input_is_2_and_leaves_nothing(troubled, command, capsys):
    before = {path: path.stat().st_mtime_ns for path in troubled.rglob("*")}
    capsys.readouterr()
    assert run(command.replace("-o field.nc", "-o new.nc") if command.startswith("measure") else command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("sixflow: error: ")
    assert BAD_INPUT[command] in err
    assert "Traceback" not in err
    assert len(err.splitlines()) == 1
    assert {path: path.stat().st_mtime_ns for path in troubled.rglob("*")} == before


def test_output_is_checked_before_frames_are_read(place, capsys):  # noqa: F811
    assert run("measure none.tif nothing.tif -o nowhere/field.nc") == 2
    assert "nowhere/field.nc" in capsys.readouterr().err


def test_folder_without_permission(place, capsys):  # noqa: F811
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    (place / "closed").mkdir(mode=0o500)
    assert run("measure A.tif B.tif -o field.nc --plot closed/a.png") == 2
    assert "cannot be written to" in capsys.readouterr().err


def test_error_of_a_flag_names_the_help(capsys):
    assert run("plot --tim 3") == 2
    assert capsys.readouterr().err.rstrip().endswith("See sixflow plot --help")


def test_nothing_measured_is_1_but_written(place, capsys):  # noqa: F811
    noise = np.random.default_rng(0).normal(size=(2, 64, 64)).astype(np.float32)
    tifffile.imwrite("noise.tif", noise, photometric="minisblack")
    assert run(["measure", "noise.tif", "-o", "field.nc", *QUICK]) == 1
    out, err = capsys.readouterr()
    assert "16 points, 0.0 % valid" in out
    assert "error: none of the 16 points could be measured; most are flagged" in err
    assert (place / "field.nc").exists()


@pytest.mark.parametrize("debug", [False, True])
def test_unforeseen_error_is_1(place, capsys, monkeypatch, debug):  # noqa: F811
    def fail(*args, **options):
        raise RuntimeError("boom")

    monkeypatch.setattr("sixflow.measurement.iterate_sequence", fail)
    assert run(["measure", "A.tif", "B.tif", "-o", "field.nc", *["--debug"] * debug]) == 1
    err = capsys.readouterr().err
    assert "sixflow: error: unexpected RuntimeError: boom; run it again with --debug" in err
    assert ("Traceback" in err) == debug
    assert sorted(path.name for path in place.iterdir()) == ["A.tif", "B.tif", "recording.tif"]


def test_failed_picture_leaves_none(field_file, capsys, monkeypatch):  # noqa: F811
    def fail(figure, path, **options):
        path.write_bytes(b"half")
        raise MemoryError("full")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", fail)
    assert run("plot field.nc -o a.png") == 1
    assert "not enough memory (full)" in capsys.readouterr().err
    assert not list(field_file.parent.glob("*.png"))
    assert not list(field_file.parent.glob(".*"))


def test_interruption_is_130(capsys):
    assert report(KeyboardInterrupt()) == 130
    assert capsys.readouterr().err == "sixflow: interrupted; the output was not written\n"
