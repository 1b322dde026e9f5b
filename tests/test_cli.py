"""The command line: what its commands do, and where their settings come from."""

from __future__ import annotations

import dataclasses
import json
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
import tifffile
import xarray as xr
from PIL import Image

from sixflow import measure, measure_sequence
from sixflow.cli import main
from sixflow.cli.app import EXAMPLES, build_app
from sixflow.cli.settings_flags import SettingsFlags, settings_help
from sixflow.settings import Settings
from sixflow.version import __version__
from sixflow.write import open_field

QUICK = ("--window", "21", "--step", "16")
DOCUMENTATION = Path(__file__).parents[1] / "docs" / "command-line.md"


@cache
def make_frames(count, seed=0):
    """Return uint8 frames of 64 × 64 px that move by (1, 1) px each; not to be changed."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    base = gaussian_filter(rng.normal(size=(80, 80)), 2, mode="wrap")
    base = 128 + 35 * base / base.std()
    frames = [np.roll(base, k, (0, 1))[:64, :64] + rng.normal(size=(64, 64)) for k in range(count)]
    made = np.stack(frames).clip(0, 255).astype(np.uint8)
    made.flags.writeable = False
    return made


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return a folder, made the current one, with a pair A.tif, B.tif and a recording of four frames."""
    frames = make_frames(4)
    tifffile.imwrite(tmp_path / "A.tif", frames[0])
    tifffile.imwrite(tmp_path / "B.tif", frames[1])
    tifffile.imwrite(tmp_path / "recording.tif", frames, photometric="minisblack")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(path):
    with open_field(path) as field:
        return field.load()


def assert_measured_alike(field, expected):
    """Equal but for what tells where the frames came from."""

    def bare(one):
        attrs = {name: value for name, value in one.attrs.items() if name not in ("source", "pairs")}
        return one.drop_vars(["name0", "name1"], errors="ignore").drop_attrs(deep=False).assign_attrs(attrs)

    xr.testing.assert_identical(bare(field), bare(expected))


def is_picture(path):
    with Image.open(path) as image:
        return image.format == "PNG" and image.width > 1000


def run(command):
    return main(shlex.split(command) if isinstance(command, str) else command)


# sixflow measure


def test_two_files_are_a_pair(place, capsys):
    assert run(["measure", "A.tif", "B.tif", "-o", "field.nc", *QUICK]) == 0
    expected = measure(*make_frames(4)[:2], window=21, step=16)
    assert_measured_alike(load("field.nc"), expected)
    assert load("field.nc").name0.values == ["A.tif"]
    out, err = capsys.readouterr()
    assert err == ""
    first, second = out.splitlines()
    assert first.startswith("field.nc: 1 pair, 16 points, 100.0 % valid, ")
    assert first.endswith(" s")
    assert second.startswith("median standard errors: u 0.0")


@pytest.mark.parametrize("output", ["field.nc", "field.zarr", "field.csv"])
def test_stack_is_a_recording(place, output):
    assert run(["measure", "recording.tif", "-o", output, *QUICK]) == 0
    if output == "field.csv":
        lines = [line for line in Path(output).read_text().splitlines() if line[0] != "#"]
        assert len(lines) == 1 + 3 * 16
    else:
        expected = measure_sequence(make_frames(4), window=21, step=16)
        assert_measured_alike(load(output), expected)


@pytest.mark.parametrize("given", [["run"], ["run/*.png"], ["run/a2.png", "run/a10.png", "run/a11.png"]])
def test_folder_pattern_and_list_are_recordings(place, given):
    (place / "run").mkdir()
    for name, frame in zip(("a2", "a10", "a11"), make_frames(3), strict=True):
        Image.fromarray(frame).save(place / "run" / f"{name}.png")
    assert run(["measure", *given, "-o", "field.nc", "--pairs", "first", *QUICK]) == 0
    field = load("field.nc")
    assert field["frame1"].values.tolist() == [1, 2]
    np.testing.assert_allclose(field["u"].mean(("y", "x")), [1, 2], atol=0.05)


def test_mask_is_where_not_zero(place, capsys):
    mask = np.zeros((64, 64), np.uint16)
    mask[:, :32] = 7
    tifffile.imwrite("mask.tif", mask)
    assert run(["measure", "A.tif", "B.tif", "-o", "field.nc", "--mask", "mask.tif", *QUICK]) == 0
    assert_measured_alike(load("field.nc"), measure(*make_frames(4)[:2], mask="mask.tif", window=21, step=16))
    assert "50.0 % masked, 100.0 % of the others valid" in capsys.readouterr().out


def test_plot_and_quiet(place, capsys, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "sixflow.plot.plot_field",
        lambda field, frame, path: (seen.append((field, frame)), path.write_bytes(b"x")),
    )
    assert run(["measure", "recording.tif", "-o", "field.csv", "--plot", "field.png", "-q", *QUICK]) == 0
    frames = make_frames(4)
    assert_measured_alike(seen[0][0], measure(*frames[:2], window=21, step=16))
    np.testing.assert_array_equal(seen[0][1], frames[0])
    assert Path("field.png").read_bytes() == b"x"
    assert capsys.readouterr() == ("", "")


def test_notes_are_said_once_on_stderr(place, capsys):
    colour = np.stack([make_frames(3)] * 3, -1).astype(np.float32)
    colour[1, 5, 5] = np.nan
    tifffile.imwrite("colour.tif", colour, photometric="rgb")
    assert run(["measure", "colour.tif", "-o", "field.nc", *QUICK]) == 0
    assert capsys.readouterr().err.splitlines() == [
        "sixflow: note: colour → luminance (Rec. 709)",
        "sixflow: note: frame 1: 1 pixels without a value (NaN or infinite) are masked",
    ]


def test_many_notes_are_cut_short(capsys):
    from sixflow.cli.measure import say_notes

    say_notes(["a", *map(str, range(9)), "a"])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 6
    assert lines[-1] == "sixflow: note: and 5 more, in the attribute 'notes' of the field"


def test_overwrite(place, monkeypatch):
    monkeypatch.setattr("sixflow.plot.plot_field", lambda field, frame, path: path.write_bytes(b"x"))
    command = ["measure", "A.tif", "B.tif", "-o", "field.nc", "--plot", "field.png", *QUICK]
    assert run(command) == 0
    assert run(command) == 2
    assert run([*command, "--overwrite"]) == 0


# Settings


def stored(path="field.nc"):
    return Settings.from_mapping(json.loads(load(path).attrs["settings"]))


def test_flags_win_over_file_and_file_over_defaults(place):
    Path("settings.toml").write_text('window = 25\nstep = 16\nlevels = 1\nlighting = "local"\n')
    command = ["measure", "A.tif", "B.tif", "-o", "field.nc", "--settings", "settings.toml"]
    assert run([*command, "--window", "21", "--float64", "--levels", "none"]) == 0
    assert stored() == Settings(window=21, step=16, lighting="local", float64=True)
    Path("settings.toml").write_text("float64 = true\nwindow = 21\n")
    assert run([*command, "--no-float64", "--overwrite"]) == 0
    assert stored() == Settings(window=21)


def test_every_setting_is_a_flag():
    fields = dataclasses.fields(Settings)
    assert list(get_type_hints(SettingsFlags)) == [field.name for field in fields]
    assert list(settings_help()) == [field.name for field in fields]
    assert all(settings_help().values())


@pytest.mark.parametrize("field", dataclasses.fields(Settings), ids=lambda field: field.name)
def test_every_flag_reaches_the_settings(field):
    choices = {
        "method": "eigenfilter",
        "reference": "middle",
        "group": "similarity",
        "search": "pyramid",
        "interpolation": "cubic",
        "lighting": "local",
        "lowpass": "1.5",
        "roi": "8:,:40",
        "polygons": "1,1 40,1 20,30",
        "holes": "1,1 40,1 20,30; 50,50 60,50 60,60",
    } | {"length_unit": "µm"}
    value = choices.get(field.name, "7")
    flag = "--" + field.name.replace("_", "-")
    given = [flag, value]
    if isinstance(field.default, bool):
        given = [f"--no-{flag[2:]}" if field.default else flag]
    _, bound, _ = build_app().parse_args(["measure", "A.tif", "B.tif", "-o", "f.nc", *given])
    flags = bound.arguments["flags"]
    assert list(flags) == [field.name]
    assert Settings(**flags) != Settings()


# sixflow plot


@pytest.fixture(scope="session")
def measured(tmp_path_factory):
    """Return a field file of three pairs of the recording."""
    folder = tmp_path_factory.mktemp("measured")
    tifffile.imwrite(folder / "recording.tif", make_frames(4), photometric="minisblack")
    assert run(["measure", f"{folder}/recording.tif", "-o", f"{folder}/field.nc", "-q", *QUICK]) == 0
    return folder / "field.nc"


@pytest.fixture
def field_file(place, measured):
    return Path(shutil.copy(measured, place))


def test_plot_writes_a_picture(field_file, capsys):
    assert run("plot field.nc -o field.png --frame A.tif --no-standard-errors --title Vortex") == 0
    assert is_picture("field.png")
    assert capsys.readouterr().out == "field.png\n"


def test_plot_takes_the_frame_of_the_pair_from_the_recording(field_file, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "sixflow.plot.plot_field",
        lambda field, frame, path, **options: (seen.append((frame, options)), path.write_bytes(b"x")),
    )
    command = "plot field.nc -o a.png --frame recording.tif --time 2 --y-up --arrows 9 --glyphs 5"
    assert run(f"{command} --exaggerate 3") == 0
    frame, options = seen[0]
    np.testing.assert_array_equal(frame, make_frames(4)[2])
    assert options == {
        "time": 2, "y_up": True, "units": "px", "arrows": 9, "glyphs": 5, "exaggerate": 3.0,
        "standard_errors": True, "title": None,
    }  # fmt: skip


def test_plot_in_physical_units(field_file, capsys, monkeypatch):
    assert run("plot field.nc -o a.png --units physical") == 2
    assert "--pixel-size" in capsys.readouterr().err
    assert not Path("a.png").exists()
    seen = []
    monkeypatch.setattr(
        "sixflow.plot.plot_field",
        lambda field, frame, path, units, **options: (seen.append((field, units)), path.write_bytes(b"x")),
    )
    assert run("plot field.nc -o a.png --units physical --pixel-size 0.1 --frame-interval 0.01") == 0
    field, units = seen[0]
    assert units == "physical"
    assert json.loads(field.attrs["settings"])["pixel_size"] == 0.1


# sixflow info


def test_info_of_frames(place, capsys):
    assert run("info recording.tif") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("recording.tif: 4 frames of 64×64 px, uint8")
    assert lines[1].startswith("grey ")
    assert lines[2] == "names       recording.tif[0] to recording.tif[3]"
    assert "not recorded" in lines[3]


def test_info_of_frames_with_times(place, capsys):
    tifffile.imwrite(
        "timed.tif", make_frames(3), photometric="minisblack", imagej=True, metadata={"finterval": 0.25}
    )
    assert run("info timed.tif") == 0
    assert "0 s to 0.5 s, every 0.25 s" in capsys.readouterr().out


def test_info_of_a_field(field_file, capsys):
    assert run("info field.nc") == 0
    out = capsys.readouterr().out
    field = load("field.nc")
    assert out.startswith(
        "field.nc: a field of 3 pairs of frames of 64×64 px, time 0 to 2 frame, 1 frame between "
    )
    for text in ("48 points", "window         21", __version__, field.attrs["input_digest"], "10 %"):
        assert text in out


def test_info_of_a_long_recording_is_of_its_beginning(field_file, capsys, monkeypatch):
    monkeypatch.setattr("sixflow.cli.info.SUMMARISED_BYTES", 10)
    assert run("info field.nc") == 0
    out = capsys.readouterr().out
    assert "the summary is of its first 1 pairs" in out
    assert "16 points" in out


# Help and documentation


def test_version(capsys):
    assert run("--version") == 0
    assert capsys.readouterr().out == f"{__version__}\n"


@pytest.mark.parametrize("command", EXAMPLES)
def test_help_shows_examples_unbroken(command, capsys):
    assert run(["--help"] if command == "sixflow" else [command, "--help"]) == 0
    assert EXAMPLES[command] in capsys.readouterr().out


def test_help_of_measure_says_what_the_settings_say(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "1000")
    assert run("measure --help") == 0
    out = capsys.readouterr().out
    for field in dataclasses.fields(Settings):
        assert settings_help()[field.name] in out
    assert "[default: auto]" in out


def command_lines(text):
    lines = text.replace("\\\n", " ").splitlines()
    return [
        line.strip().removeprefix("$ ")
        for line in lines
        if line.strip().removeprefix("$ ").startswith("sixflow ")
    ]


@pytest.mark.parametrize("line", command_lines("".join(EXAMPLES.values()) + DOCUMENTATION.read_text("utf-8")))
def test_example_is_understood(line):
    tokens = shlex.split(line, comments=True)[1:]
    command, _, _ = build_app().parse_args(tokens, exit_on_error=False, print_error=False)
    assert callable(command)


def test_help_loads_nothing_heavy():
    heavy = "{'numpy', 'numba', 'xarray', 'matplotlib', 'scipy', 'zarr', 'av'}"
    code = f"import sys; from sixflow.cli import main; main(['--help']); print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"


def test_a_first_guess_in_numbers(place, capsys):
    command = ["measure", "A.tif", "B.tif", "-o", "field.nc", *QUICK]
    assert run([*command, "--search", "0.6,0,0,0,0,0"]) == 0
    assert stored().search == (0.6, 0, 0, 0, 0, 0)
    for nonsense in ("guess", "nonsense", "1,2"):
        assert run([*command, "--overwrite", "--search", nonsense]) == 2
    assert "search='nonsense': must be one of" in capsys.readouterr().err


# Which frames


def test_frames_are_chosen_by_flags(place, capsys):
    values = np.stack([make_frames(6), make_frames(6)[::-1]], 1)
    tifffile.imwrite(
        "two.tif", values, imagej=True, metadata={"axes": "TCYX", "finterval": 0.5, "unit": "um"}
    )
    assert run("info two.tif") == 2
    assert "holds the channels 0, 1 (channel=); choose one" in capsys.readouterr().err
    assert run("info two.tif --channel 1 --first 1 --last 5 --every 2") == 0
    out = capsys.readouterr().out
    assert out.startswith("two.tif, frames 1 to 5, every 2: 3 frames of 64×64 px")
    assert "names       two.tif[1] to two.tif[5]" in out
    assert "interval    0.5 s" in out
    assert run("measure two.tif -o two.nc --channel 0 --last 1 --window 21") == 0
    assert load("two.nc").sizes["time"] == 1
    assert run("measure two.tif -o three.nc --channel red --last 1") == 2
    assert "channel='red': there is none of this name" in capsys.readouterr().err


def test_info_tells_frames_from_fields_in_arrays(place, field_file, capsys):
    import zarr

    zarr.save("frames.zarr", make_frames(3))
    assert run("info frames.zarr") == 0
    assert capsys.readouterr().out.startswith("frames.zarr: 3 frames of 64×64 px")
    assert run("info field.nc") == 0
    assert "a field of 3 pairs" in capsys.readouterr().out
    assert run("measure field.nc -o other.nc") == 2
    assert "is a field that sixflow wrote, not a recording" in capsys.readouterr().err
