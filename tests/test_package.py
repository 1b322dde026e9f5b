"""The package as a whole: light to import, every public name there, settings said once."""

import dataclasses
import inspect
import subprocess
import sys
import typing

import pytest

import sixflow
from sixflow.settings import Settings, SettingsOptions

HEAVY = (
    "numba",
    "xarray",
    "scipy",
    "matplotlib",
    "zarr",
    "h5netcdf",
    "h5py",
    "tifffile",
    "imageio",
    "av",
    "rich",
    "numpy",
)


def python(code, cwd):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_loads_nothing_heavy(tmp_path):
    loaded = python("import sys, sixflow; print(*sys.modules)", tmp_path).split()
    assert not set(HEAVY) & set(loaded)
    assert not [name for name in loaded if name.startswith("sixflow.")]


def test_importing_has_no_side_effects(tmp_path):
    code = """
import logging, os, signal, sys, threading, warnings
def state():
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    return (dict(os.environ), os.getcwd(), list(sys.path), warnings.filters[:], threading.active_count(),
            logging.root.handlers[:], logging.root.level, handlers, sys.excepthook)
before = state()
import sixflow
assert state() == before
import numpy
errors = numpy.geterr()
sixflow.measure, sixflow.write_field, sixflow.plot_field, sixflow.synth
assert numpy.geterr() == errors and threading.active_count() == 1 and os.environ.get("OMP_NUM_THREADS") is None
"""
    assert python(code, tmp_path) == ""
    assert list(tmp_path.iterdir()) == []


def test_matplotlib_keeps_its_backend(tmp_path):
    code = """
import matplotlib
def state():  # past the accessor, which would choose a backend
    return dict(dict.items(matplotlib.rcParams))
before = state()
import sixflow
sixflow.plot_field
assert state() == before
"""
    python(code, tmp_path)


@pytest.mark.parametrize("name", sixflow.__all__)
def test_public_names_resolve(name, tmp_path):
    value = getattr(sixflow, name)
    assert value is getattr(sixflow, name)
    if name != "__version__":
        assert inspect.getdoc(value)


def test_public_names_are_listed():
    assert sorted(sixflow.__all__) == sixflow.__all__
    assert set(sixflow.__all__) <= set(dir(sixflow))
    with pytest.raises(AttributeError, match="no attribute 'flow'"):
        _ = sixflow.flow


def test_star_import(tmp_path):
    python("from sixflow import *; measure, Settings, InputError, synth", tmp_path)


def test_settings_are_said_once():
    """The keyword arguments are the fields: same names, same order, same types; `search` takes a guess as well."""
    fields = {field.name: field.type for field in dataclasses.fields(Settings)}
    assert list(typing.get_type_hints(SettingsOptions)) == list(fields)
    options = typing.get_type_hints(SettingsOptions)
    assert options.pop("window") == float | typing.Literal["auto"]  # a number for all that measures
    hints = typing.get_type_hints(Settings)
    assert typing.get_args(options.pop("search"))[0] == typing.get_args(hints["search"])[0]
    assert options == {name: hint for name, hint in hints.items() if name not in ("window", "search")}


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(Settings)])
def test_settings_are_documented_and_refuse_nonsense(field):
    assert f"\n{field} : " in inspect.getdoc(Settings)
    with pytest.raises(sixflow.InputError, match=field):
        Settings(**{field: object()})
    with pytest.raises(sixflow.InputError, match=field):
        Settings(**{field: [[]]})


@pytest.mark.parametrize("function", [sixflow.measure, sixflow.measure_sequence, sixflow.iterate_sequence])
def test_settings_are_options_of_every_measurement(function):
    parameters = inspect.signature(function, eval_str=True).parameters
    assert typing.get_args(parameters["options"].annotation) == (SettingsOptions,)
    assert parameters["options"].kind is inspect.Parameter.VAR_KEYWORD
    assert parameters["settings"].default is None
    doc = inspect.getdoc(function)
    if function is not sixflow.iterate_sequence:  # which refers to measure_sequence
        for name in parameters:
            assert name in doc


def test_settings_travel_through_mappings_and_json(tmp_path):
    import json

    settings = Settings(
        window=25, step=5, sharpen=2, interpolation="cubic", lighting="local", levels=2, float64=True
    )
    assert Settings.from_mapping(json.loads(settings.to_json())) == settings
    assert settings.replace() == settings
    assert settings.replace(step=6).step == 6
    path = tmp_path / "settings.toml"
    path.write_text(
        'window = 25\nstep = 5\nsharpen = 2\ninterpolation = "cubic"\nlighting = "local"\nlevels = 2\nfloat64 = true\n'
    )
    assert Settings.from_toml(path) == settings
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.step = 3


@pytest.mark.parametrize(
    ("text", "said"), [("window = ", "not valid TOML"), ("windwo = 3", "windwo"), ("step = 0", "step=0")]
)
def test_settings_files_that_cannot_be_used(tmp_path, text, said):
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(sixflow.InputError, match=said):
        Settings.from_toml(path)
    with pytest.raises(sixflow.InputError, match="cannot be read"):
        Settings.from_toml(tmp_path / "none.toml")


def test_version():
    from importlib.metadata import version

    assert sixflow.__version__ == version("sixflow")
